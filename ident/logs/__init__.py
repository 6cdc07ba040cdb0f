"""Logs as recorded: reading files, what their columns mean, units, repairs."""

from __future__ import annotations

from .demo import demo_logs
from .log import Log, LogSet, read_logs

__all__ = ["Log", "LogSet", "demo_logs", "read_logs"]
