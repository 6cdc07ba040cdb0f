"""Logs as recorded: reading files, what their columns mean, units, repairs.

>>> import ident
>>> log = ident.demo_logs()[0][0]
>>> log.q.shape[1], sorted(log.tau)
(6, ['motor'])
"""

from __future__ import annotations

from .demo import demo_logs
from .log import Log, LogSet
from .readers.stored import LogFormat, Stored, register_log_format
from .reading import read_logs
from .recorders import Recorder, add_recorders

__all__ = ["Log", "LogFormat", "LogSet", "Recorder", "Stored", "add_recorders", "demo_logs", "read_logs", "register_log_format"]
