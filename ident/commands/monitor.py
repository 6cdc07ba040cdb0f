"""`ident monitor`: new logs against a saved fit: what has changed since, by how much, how surely."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .._utils.files import sha256, write_atomic
from ..auditing import audit
from ..errors import ConfigurationError, IdentError
from ..estimate.estimate import Estimate
from ..logs.reading import read_logs
from ..monitoring import monitor
from ..reporting import report_of
from ..signals.likewise import like
from ..study.study import Study, read_study
from .common import Output, add_log_argument, add_output_arguments, add_reading_arguments, read_as_asked
from .kept_report import keep_report

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..monitoring import Monitoring
    from ..signals.signals import Signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--fit", metavar="FILE", required=True, help="saved fit (fit.json, or after.fit.json of a diagnosis)")
    add_log_argument(parser, "new logs (CSV, CSV.gz, MAT, Parquet; patterns allowed)")
    parser.add_argument(
        "--reference",
        nargs="+",
        metavar="FILE",
        help="logs that were fitted: they separate what the model has always lacked from what is new (default: the files named in the fit)",
    )
    parser.add_argument(
        "--study", metavar="FILE", help="study file whose [columns] are used, and whose logs to fit are read if --log is not given"
    )
    add_reading_arguments(parser)
    parser.add_argument(
        "--look",
        type=int,
        default=1,
        metavar="K",
        help="this is the K-th check since the fit: all checks together raise a false alarm with a probability of at most 1 %%"
        " (default: 1)",
    )
    parser.add_argument("--strict", action="store_true", help="exit with 1 if anything has changed")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    estimate = Estimate.load(args.fit)
    study = read_study(Path(args.study)) if args.study else Study()
    study = read_as_asked(study, args)
    if args.log:
        study = study.with_flags(logs=args.log)
    files = [*map(str, study.fit_files())] if study.logs.fit else []
    if not files:
        raise ConfigurationError("no log is given; pass the new logs with --log FILE (or --study FILE with [logs] fit).")
    logs = _read(files, study, estimate)
    audited = [f"audit: {finding}" for finding in audit(logs, estimate.model.robot).warnings]
    signals = like(estimate.signals_config)(logs)
    reference, warning = _reference(args, study, estimate)
    found = monitor(estimate, signals, reference=reference, look=args.look, progress=out.progress("comparing"))
    found = replace(found, warnings=(*audited, *found.warnings, *([warning] if warning else ())))
    out.say(found)
    out.result(found.to_dict())
    with out.together() as folder:
        if folder is not None:
            _keep(folder, out, found)
    return 1 if args.strict and found.verdict != "unchanged" else 0


def _read(files: list[str], study: Study, estimate: Estimate) -> LogSet:
    return read_logs(files, estimate.model.robot, study.columns or None, **study.reading())


def _reference(args: argparse.Namespace, study: Study, estimate: Estimate) -> tuple[Signals | None, str]:
    """The fit's own logs: those named, else those that the fit names, as long as they are still what they were; and what is to be
    said where they are not at hand."""
    preparation = like(estimate.signals_config)
    if args.reference:
        named = study.with_flags(logs=args.reference).fit_files()
        return preparation(_read([*map(str, named)], study, estimate)), ""
    without = "the logs of the fit itself are not available (--reference): an effect may be new, or one that the model has always lacked."
    paths = [(Path(i["path"]), i["sha256"]) for i in estimate.inputs]
    if not paths or not all(p.is_file() and sha256(p) == known for p, known in paths):
        return None, without
    try:
        return preparation(_read([str(p) for p, _ in paths], study, estimate)), ""
    except IdentError as error:
        return None, f"{without} They exist, but {error}"


def _keep(folder: Path, out: Output, found: Monitoring) -> None:
    write_atomic(folder / "monitor.json", json.dumps(found.to_dict(), indent=2) + "\n")
    write_atomic(folder / "monitor.txt", f"{found}\n")
    keep_report(folder, out, report_of(found))
