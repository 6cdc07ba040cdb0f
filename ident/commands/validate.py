"""`ident validate`: how well a fit predicts logs that it did not see: torque, and replayed motion."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.json import result
from .._utils.text import wrapped
from ..drives import DriveFit
from ..errors import ConfigurationError, UnsupportedError
from ..evaluation.doubts import seen_by
from ..evaluation.validation import validate
from ..logs.reading import read_logs
from ..reporting import report_of
from ..study.study import Study, read_study
from .commanded import asks_for_simulation
from .commanded_validation import validate_drive_fit, validate_under_law
from .common import Output, add_output_arguments, add_study_arguments, not_negative, read_as_asked, refuse_beside_fit, study_from
from .kept_report import keep_report
from .saved_fit import saved_fit
from .streaming import add_streaming_arguments, session_from, signals_from

if TYPE_CHECKING:
    from ..evaluation.validation import Validation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    add_streaming_arguments(parser)
    parser.add_argument(
        "--fit", metavar="FILE", help="saved fit (fit.json); its robot and model are used. Without it, the study is fitted first"
    )
    parser.add_argument("--no-replay", action="store_true", help="torque prediction only, no forward simulation")
    parser.add_argument(
        "--max-error", type=not_negative, metavar="SHARE", help="exit with 1 if the relative torque error over all joints exceeds this"
    )


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    if args.fit:
        return _of_saved(args, out)
    study = study_from(args)
    if asks_for_simulation(study):
        return validate_under_law(study, args, out)
    with session_from(args, study, out, "fitting") as session:
        return _told(session.validation(simulate=not args.no_replay), session.inputs, args, out, "")


def _told(validation: Validation, inputs: Iterable[Mapping[str, Any]], args: argparse.Namespace, out: Output, seen: str) -> int:
    """`seen`: what to say of logs that the fit has seen."""
    if seen:
        out.say(wrapped(f"warning: {seen}"))
    out.say(validation)
    warnings = (*validation.estimate.warnings, *([seen] if seen else ()))
    with out.together() as folder:
        out.result(result("ident.validation/1", validation.to_dict(), inputs=inputs, warnings=warnings), "validation")
        if folder is not None:
            try:
                keep_report(folder, out, report_of(validation))
            except UnsupportedError as error:  # pictures need the whole log in memory
                out.note(f"no report.html: {error}")
    if args.max_error is not None and not validation.error.relative_all <= args.max_error:
        out.note(f"gate: relative error {validation.error.relative_all:.4g} exceeds {args.max_error:g}")
        return 1
    return 0


def _of_saved(args: argparse.Namespace, out: Output) -> int:
    refuse_beside_fit(args, "method")
    saved = saved_fit(args.fit)
    study = read_study(Path(args.study)) if args.study else Study()
    study = study.with_flags(logs=args.log or (), validate=args.validate or ())
    if not (study.logs.validate or study.logs.fit):
        raise ConfigurationError("no log to validate on; pass one with --validate FILE or --log FILE, or in a study file.")
    files = [*map(str, study.validation_files())] or [*map(str, study.fit_files())]
    study = read_as_asked(study, args)
    if isinstance(saved, DriveFit):
        return validate_drive_fit(saved, read_logs(files, saved.model.robot, study.columns or None, **study.reading()), args, out)
    study = replace(study, logs=replace(study.logs, fit=tuple(files), validate=()))
    with signals_from(args, study, out, saved) as signals:
        validation = validate(saved, signals, simulate=not args.no_replay)
        return _told(validation, (*saved.inputs, *signals.inputs), args, out, seen_by(saved.inputs, signals.inputs))
