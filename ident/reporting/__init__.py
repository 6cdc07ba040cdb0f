"""Reports for people: one HTML file that needs nothing else, and its figures."""

from __future__ import annotations

from .build import report, report_of
from .document import Report, read_report

__all__ = ["Report", "read_report", "report", "report_of"]
