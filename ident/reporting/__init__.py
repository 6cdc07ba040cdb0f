"""Reports for people: one HTML file that needs nothing else, and its figures."""

from __future__ import annotations

from .document import Report, read_report
from .report import report

__all__ = ["Report", "read_report", "report"]
