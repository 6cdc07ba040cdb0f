"""Reports for people: one HTML file that needs nothing else, and its figures."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from .._utils.files import write_atomic
from ..diagnosis import Diagnosis
from ..drawing.document import Report, read_report
from ..drawing.figures import draw, require_matplotlib
from ..drawing.html import to_html
from ..drawing.shown import Shown
from ..errors import ConfigurationError, UnsupportedError
from ..estimate.estimate import Estimate
from ..monitoring import Monitoring
from .diagnosis import diagnosis_report
from .estimate import estimate_report
from .monitoring import monitoring_report

__all__ = ["Report", "read_report", "report"]


def report(
    result: Diagnosis | Estimate | Monitoring | Shown | Report, path: str | Path, *, figures: str | Path | None = None, force: bool = False
) -> Path:
    """Write a report as one HTML file.

    Parameters
    ----------
    result : Diagnosis, Estimate, Monitoring, Validation, Comparison, Judgement, Excitation, Audit or Report
        What is reported.
    path : str or Path
        The file.
    figures : str or Path, optional
        A folder for its figures as SVG files.
    force : bool
        Write over an existing file.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ConfigurationError
        No matplotlib (the `report` extra), or an existing file.

    Examples
    --------
    >>> import ident, tempfile, pathlib
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=test)
    >>> ident.report(estimate, pathlib.Path(tempfile.mkdtemp()) / "fit.html").name
    'fit.html'
    """
    require_matplotlib()
    path = Path(path)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True).")
    document = result if isinstance(result, Report) else report_of(result)
    drawn = {f.name: draw(f) for f in document.figures}
    page = to_html(document, drawn)
    if figures is not None:
        folder = Path(figures)
        folder.mkdir(parents=True, exist_ok=True)
        for name, svg in drawn.items():
            write_atomic(folder / f"{name}.svg", svg, force=force)
    return write_atomic(path, page, force=force)


def report_of(result: object) -> Report:
    """The report of a result: of a diagnosis, an estimate, what monitoring found, and of whatever else shows itself. Raises
    ConfigurationError for anything else."""
    if isinstance(result, Diagnosis):
        return diagnosis_report(result)
    if isinstance(result, Estimate):
        return estimate_report(result)
    if isinstance(result, Monitoring):
        return monitoring_report(result)
    if isinstance(result, Shown) and result.sections():
        return _shown(result)
    raise ConfigurationError(f"there is no report of a {type(result).__name__}; give a result of ident: a Diagnosis, an Estimate …")


def _shown(result: Shown) -> Report:
    """Whatever a result shows of itself: its sections, and its picture where it has one."""
    sections = list(result.sections())
    with suppress(ConfigurationError, UnsupportedError):
        sections.append(result.figure())
    return Report(type(result).__name__, "ok", sections[0].title, tuple(sections))
