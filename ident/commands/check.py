"""`ident check`: what the logs and the model can give, before anything is estimated."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .._utils.json import result
from .._utils.text import counted
from ..errors import ConfigurationError, DataError
from ..problem.opposite_signs import opposite_sign
from ..streaming.session import StreamedSession
from ..study.session import Session
from .commanded import asks_for_simulation, check_under_law
from .common import Output, add_output_arguments, add_study_arguments, study_from
from .recording import check_recording, told, write_study_of
from .streaming import add_streaming_arguments, session_from


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    add_streaming_arguments(parser)
    parser.add_argument(
        "--strict",
        action="store_true",
        help="also run ident diagnose; exit with 1 if the declared model is missing an effect, the audit has warnings, or a"
        " parameter cannot be determined",
    )

    parser.add_argument("--write-study", metavar="FILE", help="write a study file that reads these logs in the same way, to edit or share")


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    if args.log and not (args.study or args.robot or args.urdf):
        return check_recording(args, out)
    study = study_from(args)
    if asks_for_simulation(study):
        return check_under_law(study, args, out)
    with session_from(args, study, out, "reading") as session:
        if not isinstance(session, StreamedSession):
            if any(log.recording is not None for log in session.recorded):
                for line in told(session.recorded):
                    out.say_wrapped(line)
                out.say()
            if args.write_study:
                write_study_of(study, session.recorded, Path(args.write_study), out)
        elif args.write_study:
            raise ConfigurationError("--write-study needs the whole logs in memory; leave out --stream (or add --no-stream).")
        return _checked(session, args, out)


def _checked(session: Session, args: argparse.Namespace, out: Output) -> int:
    if args.strict and isinstance(session, StreamedSession):
        raise ConfigurationError(
            "check --strict searches for undeclared effects, which needs the whole logs in memory; leave out --stream (or add"
            " --no-stream),"
            " or check without --strict."
        )
    robot = session.robot
    out.say_wrapped(f"robot {robot.name}: {counted(robot.n, 'joint')} in the order of the log: {', '.join(robot.joint_names)}")
    for note in robot.notes:
        out.say_wrapped(f"note: {note}")
    for doubt in robot.doubts:
        out.say_wrapped(f"warning: {doubt}")
    out.say()
    turned = _misread(session)
    if turned:
        out.say_wrapped(f"warning: {turned}")
        out.say()
    out.say_wrapped(session.audit)
    out.say()
    out.say_wrapped(session.fit_signals.report.text())
    check = session.problem.check()
    out.say()
    out.say_wrapped(check)
    for said in session.repeated:
        out.say_wrapped(f"warning: {said}")
    data: dict[str, Any] = {
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "audit": session.audit.to_dict(),
        "signals": session.fit_signals.report.to_dict(),
        "problem": check.to_dict(),
    }
    warnings = [*([turned] if turned else []), *robot.notes, *robot.doubts, *session.repeated, *check.notes]
    gates = [
        *([turned] if turned else []),
        *(["the audit has warnings"] if session.audit.warnings else []),
        *([f"the data determine {check.rank} of {check.base.count} parameters"] if check.rank < check.base.count else []),
    ]
    if args.strict:
        lacks, why = _undeclared(session, out)
        data["diagnosis"] = lacks
        gates += [why] if why else []
        warnings += [why] if lacks is None else []
    out.result(result("ident.check/1", data, inputs=session.inputs, warnings=warnings), "check")
    if not args.strict:
        return 0
    for gate in gates:
        out.note(f"gate: {gate}")
    return 1 if gates else 0


def _misread(session: Session) -> str:
    """What to settle first: torques with the opposite sign, columns of another joint, gravity in another direction, stretches that
    contradict the rest; "" for none."""
    if not isinstance(session, StreamedSession):
        return session.turned or session.misassigned or session.contrary
    problem = session.problem
    found = opposite_sign(problem.information, problem.base, session.robot.joint_names)
    return "" if found is None else str(found)


def _undeclared(session: Session, out: Output) -> tuple[dict[str, Any] | None, str]:
    """What the declared model lacks, for the result, and why the gate is closed ("" if it is not).

    Data that are good enough to be checked may be too few for a diagnosis: then nobody knows, and the gate stays closed."""
    out.say()
    try:
        from .diagnose import diagnosis_of

        diagnosis = diagnosis_of(session, out)
    except DataError as error:
        out.say_wrapped(f"no diagnosis: {error}")
        return None, f"cannot determine whether the model is missing an effect: {error}"
    out.say_wrapped(diagnosis)
    found = diagnosis.to_dict()
    said = {key: found[key] for key in ("verdict", "findings", "unexplained", "before", "after")}
    return said, "" if diagnosis.verdict == "clean" else f"the declared model is missing something (verdict: {diagnosis.verdict})"
