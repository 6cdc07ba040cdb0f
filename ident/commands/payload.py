"""`ident payload`: the ten parameters of a load, from logs without and with it, or from logs with it on top of a saved fit."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .._utils.json import result
from .._utils.text import wrapped
from ..auditing import audit
from ..errors import ConfigurationError, DataError
from ..estimate.estimate import Estimate
from ..evaluation.doubts import log_doubt
from ..logs.reading import read_logs
from ..physical import payload_of
from ..problem.problem import Problem
from ..signals.likewise import like
from ..study.study import Study, read_study
from .common import (
    Output,
    add_log_argument,
    add_output_arguments,
    add_reading_arguments,
    add_study_arguments,
    read_as_asked,
    refuse_beside_fit,
    study_from,
)

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..model import Model
    from ..robots.robot import Robot
    from ..signals.signals import Signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser, logs=False)
    add_log_argument(parser, "logs with the load")
    parser.add_argument("--without", nargs="+", metavar="FILE", help="logs without the load (default with a study file: its own logs)")
    parser.add_argument("--fit", metavar="FILE", help="saved fit without the load, instead of logs without it")
    parser.add_argument("--link", help="link that carries the load (default: the end of the arm, of several that which the logs show)")
    parser.add_argument("--method", help="estimator of both fits (default: the study's, else wls)")
    parser.add_argument("--effects", nargs="+", metavar="EFFECT", help="effects of the model besides the rigid body")
    add_reading_arguments(parser)
    parser.add_argument("--cutoff", type=float, metavar="HZ", help="low-pass cut-off (default: chosen from the data)")
    parser.add_argument("--strict", action="store_true", help="exit with 1 if there is no statistically significant load")
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    if not args.log:
        raise ConfigurationError("no log with the load is given; pass one with --log FILE.")
    before, after = _of_saved(args) if args.fit else _of_logs(args)
    said = [*_said(before, "without"), *_said(after, "with")]
    for warning in said:  # first: what is wrong with a log may leave no load at all
        out.say(wrapped(f"warning: {warning}"))
    found = payload_of(before, after, link=args.link)
    out.say(found.text())
    body: dict[str, Any] = {
        **found.to_dict(),
        "torque_error": {"without": before.fit_error.to_dict(), "with": after.fit_error.to_dict()},
    }
    inputs = (*before.inputs, *after.inputs)
    out.result(result("ident.payload/1", body, inputs=inputs, warnings=(*said, *found.notes)), "payload")
    return 1 if args.strict and not found.significant else 0


def _said(estimate: Estimate, which: str) -> list[str]:
    """What is wrong with the logs of a fit, unless it was saved and has said so before."""
    if estimate.problem is None or estimate.problem.signals.source is None:
        return []
    found = audit(estimate.problem.signals.source, estimate.model.robot).warnings
    wrong = log_doubt(estimate)
    return [*(f"audit of the logs {which} the load: {one}" for one in found), *([f"of the fit {which} the load: {wrong}"] if wrong else [])]


def _of_logs(args: argparse.Namespace) -> tuple[Estimate, Estimate]:
    """Both fits, prepared alike, from logs without and with the load."""
    study = study_from(argparse.Namespace(**{**vars(args), "log": args.without}))
    if not study.logs.fit:
        raise ConfigurationError("the robot without the load is not known: pass logs without it (--without) or a saved fit (--fit).")
    robot = study.robot()
    model = study.model(robot)
    first = study.make_preparation()(_read(study, robot, "without"))
    before = _solved(study, model, first)
    loaded = like(first.report.to_dict())(_read(study.with_flags(logs=args.log), robot, "with"))
    return before, _solved(study, model, loaded)


def _of_saved(args: argparse.Namespace) -> tuple[Estimate, Estimate]:
    """A saved fit, and the fit of the same model to the logs with the load."""
    refuse_beside_fit(args, "without")
    before = Estimate.load(args.fit)
    study = (read_study(args.study) if args.study else Study()).with_flags(logs=args.log, method=args.method)
    study = read_as_asked(study, args)
    loaded = like(before.signals_config)(_read(study, before.model.robot, "with"))
    return before, _solved(study, before.model, loaded)


def _read(study: Study, robot: Robot, which: str) -> LogSet:
    try:
        return read_logs([*map(str, study.fit_files())], robot, study.columns or None, **study.reading())
    except DataError as error:
        raise DataError(f"logs {which} the load: {error}") from None


def _solved(study: Study, model: Model, signals: Signals) -> Estimate:
    found = study.make_estimator().solve(Problem(model, signals))
    return replace(found, inputs=signals.inputs, signals_config=signals.report.to_dict())
