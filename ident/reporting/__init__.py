"""Reports for people: one HTML file that needs nothing else, and its figures."""

from __future__ import annotations

from ..drawing.document import Report, read_report
from .build import report, report_of

__all__ = ["Report", "read_report", "report", "report_of"]
