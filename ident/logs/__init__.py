"""Logs as recorded: reading files, what their columns mean, units, repairs."""

from __future__ import annotations

from .log import Log, LogSet, read_logs

__all__ = ["Log", "LogSet", "read_logs"]
