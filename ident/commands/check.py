"""`ident check`: what the logs and the model can give, before anything is estimated."""

from __future__ import annotations

import argparse

from ..results import result
from ..session import Session
from .common import Output, add_output_arguments, add_study_arguments, study_from
from .streaming import add_streaming_arguments, session_from

HELP = "audit the logs and check what they can reveal of the declared model"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_study_arguments(parser)
    add_output_arguments(parser)
    add_streaming_arguments(parser)
    parser.add_argument("--strict", action="store_true", help="exit with 1 if the audit has warnings or a parameter cannot be determined")


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    with session_from(args, study_from(args), out, "reading") as session:
        return _checked(session, args, out)


def _checked(session: Session, args: argparse.Namespace, out: Output) -> int:
    robot = session.robot
    out.say(f"robot {robot.name}: {robot.n} joints in the order of the log: {', '.join(robot.joint_names)}")
    for note in robot.notes:
        out.say(f"note: {note}")
    out.say()
    out.say(session.audit)
    out.say()
    out.say(session.fit_signals.report.text())
    check = session.problem.check()
    out.say()
    out.say(check)
    data = {
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "audit": session.audit.to_dict(),
        "signals": session.fit_signals.report.to_dict(),
        "problem": check.to_dict(),
    }
    out.result(result("ident.check/1", data, inputs=session.inputs, warnings=(*robot.notes, *check.notes)), "check")
    return 1 if args.strict and (session.audit.warnings or check.rank < check.base.count) else 0
