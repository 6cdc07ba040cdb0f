"""`ident diagnose`: what the declared model lacks, where, how large and how surely; before and after on data that no fit saw."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .._utils.files import write_atomic
from .._utils.text import wrapped
from ..diagnosis import diagnose
from ..diagnosis.next_motion import next_motion
from ..errors import ConfigurationError, DataError, UnsupportedError
from ..evaluation.misreadings import misassigned
from ..excitation.surroundings import Surroundings
from ..problem.integrated import TORQUE
from ..reporting.diagnosis import diagnosis_report
from ..study.session import Session
from .commanded import asks_for_simulation
from .commanded_diagnosis import diagnose_under_law
from .common import Output, add_output_arguments, add_study_arguments, positive, say_split, study_from
from .kept_report import keep_report

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..signals.signals import Signals


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    parser.add_argument("--verbose", action="store_true", help="print every step of the selection")
    parser.add_argument(
        "--next", metavar="FOLDER", help="also design a motion that distinguishes competing effects, and write it to this folder"
    )
    parser.add_argument("--next-seconds", type=positive, default=20.0, metavar="S", help="its duration (default: %(default)s)")
    parser.add_argument("--strict", action="store_true", help="exit with 1 unless the verdict is clean")


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    study = study_from(args)
    if asks_for_simulation(study):
        if args.next is not None:
            raise ConfigurationError(
                "--next needs logs with torque; under a drive law, the findings say what to record next. Leave it out."
            )
        return diagnose_under_law(study, args, out)
    folder_of_next = None if args.next is None else Path(args.next)
    if folder_of_next is not None and folder_of_next.exists() and not args.force:
        raise ConfigurationError(f"{folder_of_next} exists; nothing was diagnosed. Choose another --next, or add --force.")
    session = Session(study, out.progress("fitting"))
    for finding in session.audit.warnings:
        out.say(wrapped(f"audit: {finding}"))
    diagnosis = diagnosis_of(session, out, verbose=args.verbose)
    # What is misread is a cause like others: where findings explain the log and it is not there beside them, they are the better one.
    if session.misassigned and not (diagnosis.findings and diagnosis.verdict != "unexplained" and not misassigned(diagnosis.after)):
        out.say(wrapped(f"warning: {session.misassigned} Settle this first: what is found below stands in for it."))
    out.say(diagnosis)
    if session.held_by_split and diagnosis.held is not None:
        say_split(out)
    out.result(diagnosis.to_dict())
    with out.together() as folder:
        if folder is not None:
            _keep(folder, out, diagnosis, session)
    if out.folder is not None:
        out.note(f"saved {out.folder}: diagnosis.json, diagnosis.txt, before.fit.json, after.fit.json, extended.toml, report")
    if folder_of_next is not None:
        _design(diagnosis, folder_of_next, args.next_seconds, out, force=args.force)
    return 1 if args.strict and diagnosis.verdict != "clean" else 0


def _design(diagnosis: Diagnosis, folder: Path, seconds: float, out: Output, *, force: bool) -> None:
    """The motion of the next log, where two effects are to be told apart."""
    try:
        found = next_motion(diagnosis, seconds=seconds, surroundings=Surroundings(), progress=out.progress("searching"))
    except (ConfigurationError, UnsupportedError) as error:
        out.say(f"no next motion: {error}")
        return
    out.say(found)
    folder.mkdir(parents=True, exist_ok=True)
    found.excitation.to_csv(folder / "next.csv", force=force)
    write_atomic(folder / "next.json", json.dumps(found.to_dict(), indent=2) + "\n")
    out.note(f"saved {folder}: next.csv, next.json")


def diagnosis_of(session: Session, out: Output, *, verbose: bool = False) -> Diagnosis:
    """The diagnosis of a session's estimate, with the audit's warnings in it."""

    def note(step: str) -> None:
        # Candidates are indented; what was accepted, dropped or replaced is of use to everyone who waits.
        if verbose or not (out.quiet or step.startswith(" ")):
            out.note(step)

    if session.study.form != TORQUE:
        raise UnsupportedError(
            f"a diagnosis works on the torque form; leave out the {session.study.form} form (--form, or [estimator] form)."
        )
    if session.turned:
        raise DataError(session.turned)
    estimate = session.estimate
    found = diagnose(
        estimate, _held(session), estimator=session.study.make_estimator(), progress=out.progress("diagnosing"), note=note
    )  # fmt: skip
    return replace(found, warnings=(*(f"audit: {finding}" for finding in session.audit.warnings), *found.warnings))


def _held(session: Session) -> Signals | None:
    """The held-out signals; None where the part that is held out for want of validation logs is too short (the estimate says so)."""
    try:
        return session.held_signals
    except DataError:
        if session.held_by_split:
            return None
        raise


def _keep(folder: Path, out: Output, diagnosis: Diagnosis, session: Session) -> None:
    """The artefacts: the result, its text, the fit with the findings, the extended study ready for the next log, the report."""
    write_atomic(folder / "diagnosis.json", json.dumps(diagnosis.to_dict(), indent=2) + "\n")
    write_atomic(folder / "diagnosis.txt", f"{diagnosis}\n")
    diagnosis.before.save(folder / "before.fit.json")
    diagnosis.after.save(folder / "after.fit.json")
    assert out.folder is not None
    extended = session.study.with_effects(diagnosis.model.effects)
    write_atomic(folder / "extended.toml", extended.to_toml(out.folder))
    if diagnosis.description is not None:
        described = session.study.with_effects(diagnosis.description.estimate.model.effects)
        write_atomic(folder / "described.toml", described.to_toml(out.folder))
    keep_report(folder, out, diagnosis_report(diagnosis))
