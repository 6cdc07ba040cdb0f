"""What is shown to people: texts, tables and figures as plain data, drawn as SVG, as HTML, or on axes of the user's own."""

from __future__ import annotations

from .document import Figure, Report, Table, Text, read_report
from .shown import Shown

__all__ = ["Figure", "Report", "Shown", "Table", "Text", "read_report"]
