"""`ident fit`: base parameters and drive parameters with their uncertainty, and the error on data held out."""

from __future__ import annotations

import argparse

from ..session import Session
from ..status import StatusCode
from .common import Output, add_output_arguments, add_study_arguments, study_from

HELP = "estimate base and drive parameters from logs, with uncertainty and held-out error"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    parser.add_argument("--max-error", type=float, metavar="SHARE", help="exit with 1 if the relative held-out error over all joints exceeds this")


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    session = Session(study_from(args), out.progress("fitting"))
    estimate = session.estimate
    for finding in session.audit.warnings:
        out.say(f"audit: {finding}")
    out.say(estimate.summary())
    if session.held_by_split:
        out.say("held out: the last part of each log (no validation log was given)")
    out.result(estimate.to_dict(), "fit.result")
    path = out.path("fit.json")
    if path is not None:
        estimate.save(path, force=out.force)
        out.note(f"saved {path}")
    heldout = estimate.heldout_error.relative_all if estimate.heldout_error else 0.0
    if args.max_error is not None and not heldout <= args.max_error:
        out.note(f"gate: relative held-out error {heldout:.4g} exceeds {args.max_error:g}")
        return 1
    return 1 if estimate.status.code == StatusCode.NOT_CONVERGED else 0
