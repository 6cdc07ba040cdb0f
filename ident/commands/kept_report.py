"""The report that a command keeps beside its result."""

from __future__ import annotations

from pathlib import Path

from .._utils.files import write_atomic
from ..drawing.document import Report
from ..errors import ConfigurationError
from ..reporting import report
from .common import Output


def keep_report(folder: Path, out: Output, document: Report) -> None:
    """`report.json`, and `report.html` with its `figures`, in the folder of a command's artefacts."""
    write_atomic(folder / "report.json", document.to_json())
    try:
        report(document, folder / "report.html", figures=folder / "figures")
    except ConfigurationError as error:  # without the drawing library everything else is still of use
        out.note(f"no report.html: {error}")
