"""Reports for people: one HTML file that needs nothing else, and its figures."""

from __future__ import annotations

from contextlib import suppress
from math import isfinite
from pathlib import Path

from .._utils.files import write_atomic
from ..auditing import Audit
from ..diagnosis import Diagnosis
from ..drawing.document import Report, percent
from ..drawing.figures import draw, require_matplotlib
from ..drawing.html import to_html
from ..drawing.shown import Shown
from ..errors import ConfigurationError, UnsupportedError
from ..estimate.estimate import Estimate
from ..estimate.pictures import correlation_figure, parameters_section, residual_figures, values_figure
from ..evaluation import Comparison, Essential, Validation
from ..excitation import Excitation
from ..monitoring import Monitoring
from ..physical import Judgement
from .diagnosis import diagnosis_report
from .estimate import estimate_report
from .monitoring import monitoring_report
from .robot import path_figure, robot_sections


def report(
    result: Diagnosis | Estimate | Monitoring | Shown | Report, path: str | Path, *, figures: str | Path | None = None, force: bool = False
) -> Path:
    """Write a report as one HTML file.

    Parameters
    ----------
    result : Diagnosis, Estimate, Monitoring, Validation, Comparison, Essential, Judgement, Excitation, Audit or Report
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
    """Whatever a result shows of itself: its sections, its picture where it has one, and what only a report has room for."""
    sections = list(result.sections())
    if isinstance(result, Validation) and result.signals is not None:
        estimate, signals = result.estimate, result.signals
        sections += [*residual_figures(estimate, signals, estimate.residual(signals), "held-out"), *robot_sections(estimate)]
        sections += [parameters_section(estimate), values_figure(estimate), correlation_figure(estimate)]
    else:
        with suppress(ConfigurationError, UnsupportedError):
            sections.append(result.figure())
    if isinstance(result, Excitation):
        sections.append(path_figure(result.model.robot, result.trajectory))
    return Report(*headline(result), sections[0].title, tuple(sections))


def headline(result: Shown) -> tuple[str, str]:
    """The answer in one line, and the word that decides its colour: ok, ambiguous or unexplained."""
    match result:
        case Validation():
            return f"Torque error on held-out data: {percent(result.error.relative_all)} %", "ok"
        case Comparison():
            spread = f" ± {percent(result.gain_std, 1)}" if isfinite(result.gain_std) else ""
            return (
                f"Squared error, weighted by noise, falls by {percent(result.gain, 1)}{spread} %",
                "ok" if result.gain > 0 else "ambiguous",
            )
        case Judgement() if not result.possible.possible:
            return "Not physically possible: the inertia matrix is not positive definite everywhere", "unexplained"
        case Judgement() if result.consistent is not None and not result.consistent.consistent:
            return "Physically possible, but no real bodies have these parameters", "ambiguous"
        case Judgement():
            return "Physically possible" + ("" if result.consistent is None else " and consistent"), "ok"
        case Audit():
            return str(result).splitlines()[0], "ok" if result.ok else "unexplained"
        case Essential():
            return f"Essential model: {len(result.reduced.names)} of {len(result.estimate.names)} parameters kept", "ok"
        case Excitation():
            return f"Designed motion of {result.trajectory.duration:g} s, {len(result.names)} base parameters", "ok"
        case _:
            return type(result).__name__, "ok"
