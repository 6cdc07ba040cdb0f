"""`ident report`: a kept result, or a study, as one HTML file with its figures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.structured import read_json
from ..drawing.document import read_report
from ..drawing.figures import require_matplotlib
from ..drives.result import is_drive_fit
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..reporting import report, report_of
from ..study.session import Session
from ..study.study import read_study
from .common import Output
from .diagnose import diagnosis_of

if TYPE_CHECKING:
    from ..drawing.document import Report

_KEPT = "report.json"
#: Results beside which a command keeps its report.
_REPORTED = ("ident.diagnosis/1", "ident.monitor/1", "ident.validation/1", "ident.judgement/1")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "result", help="output folder of `ident diagnose` (or validate, judge, monitor), its report.json, a saved fit, or a study file"
    )
    parser.add_argument("-o", "--output", metavar="FILE", default="report.html", help="HTML file to write (default: %(default)s)")
    parser.add_argument("--figures", metavar="DIR", help="folder for the figures as SVG files")
    parser.add_argument("--force", action="store_true", help="overwrite existing files")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    parser.set_defaults(json=False, out=None)


def run(args: argparse.Namespace) -> int:
    require_matplotlib()
    target = Path(args.output)
    if target.exists() and not args.force:
        raise ConfigurationError(f"{target} exists; nothing was written. Choose another -o, or add --force.")
    document = _document(Path(args.result), args)
    print(f"wrote {report(document, target, figures=args.figures, force=args.force)}: {document.headline}")
    return 0


def _document(path: Path, args: argparse.Namespace) -> Report:
    if path.is_dir():
        if not (path / _KEPT).exists() and (path / "fit.json").exists():
            return report_of(Estimate.load(path))
        if not (path / _KEPT).exists():
            raise ConfigurationError(
                f"{path} holds no {_KEPT}; give the folder that `ident diagnose --out` (or validate, judge, monitor) filled."
            )
        return read_report(path / _KEPT)
    if path.suffix == ".toml":
        return _of_study(path, args)
    match _schema(path):
        case "ident.report/1":
            return read_report(path)
        case "ident.fit/1" if is_drive_fit(read_json(path, "fit")):
            return read_report(path.parent / _KEPT)
        case "ident.fit/1":
            return report_of(Estimate.load(path))
        case schema if (path.parent / _KEPT).exists() and schema in _REPORTED:
            return read_report(path.parent / _KEPT)
        case schema:
            raise ConfigurationError(
                f"{path}: there is no report of {schema or 'this'}; give a folder that `ident diagnose --out` (or validate, judge,"
                f" monitor)"
                f" filled, its {_KEPT}, a saved fit (fit.json), or a study file."
            )


def _of_study(path: Path, args: argparse.Namespace) -> Report:
    out = Output(args)
    return report_of(diagnosis_of(Session(read_study(path), out.progress("fitting")), out))


def _schema(path: Path) -> str:
    """The schema that a JSON file names. Raises ConfigurationError where it is none."""
    data: Any = read_json(path, "result")
    return str(data.get("schema", "")) if isinstance(data, dict) else ""
