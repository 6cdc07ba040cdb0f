"""`ident diagnose`: what the declared model lacks, where, how large and how surely; before and after on data that no fit saw."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from ..session import HELD_SHARE, Session
from ..study import write_study
from ..summary import wrapped
from .common import Output, add_output_arguments, add_study_arguments, study_from

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..study import Study

HELP = "find what the declared model lacks, refit with it, and compare before and after on held-out data"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    parser.add_argument("--verbose", action="store_true", help="tell every step of the selection")
    parser.add_argument("--strict", action="store_true", help="exit with 1 unless the verdict is clean")


def run(args: argparse.Namespace) -> int:
    from ..diagnosis import diagnose

    out = Output(args)
    study = study_from(args)
    session = Session(study)
    for finding in session.audit.warnings:
        out.say(wrapped(f"audit: {finding}"))
    diagnosis = diagnose(
        session.estimate,
        session.held_signals,
        estimator=study.make_estimator(),
        progress=out.progress("diagnosing"),
        note=out.note if args.verbose else None,
    )
    diagnosis = replace(diagnosis, warnings=(*(f"audit: {finding}" for finding in session.audit.warnings), *diagnosis.warnings))
    out.say(diagnosis)
    if session.held_by_split and diagnosis.held is not None:
        out.say(f"held out: the last {HELD_SHARE:.0%} of each log (no validation log was given)")
    out.result(diagnosis.to_dict(), "diagnosis")
    if out.folder is not None:
        _keep(out, diagnosis, study)
    return 1 if args.strict and diagnosis.verdict != "clean" else 0


def _keep(out: Output, diagnosis: Diagnosis, study: Study) -> None:
    """The artefacts: text, the extended study ready for the next log, the fit with the findings, the report."""
    out.keep("diagnosis.txt", f"{diagnosis}\n")
    path = out.path("after.fit.json")
    extended = out.path("extended.toml")
    assert path is not None
    assert extended is not None
    diagnosis.after.save(path, force=out.force)
    write_study(extended, study.with_effects(diagnosis.model.effects), force=out.force)
    out.note(f"saved {path} and {extended}")
