"""`ident demo`: the whole way from a log to a validated estimate, on a bundled PUMA 560 log."""

from __future__ import annotations

import argparse

from .._utils.json import result
from ..robots.library.load import robot_folder
from ..robots.library.nominal import nominal_values
from ..study.session import Session
from ..study.study import Study
from .common import Output, add_output_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_output_arguments(parser)


def run(args: argparse.Namespace) -> int:
    out = Output(args)
    folder = robot_folder("puma560") / "demo"
    study = Study().with_flags(robot="puma560", logs=[folder / "train.csv.gz"], validate=[folder / "validate.csv.gz"])
    session = Session(study, out.progress("fitting"))
    robot = session.robot
    out.say(f"1. The log: {robot.name}, simulated in closed loop")
    out.say("   (coupled wrist, friction, 1000 encoder counts a motor turn, 2 % torque noise)")
    out.say(session.audit)
    out.say("\n2. The fit: base parameters of links and drives")
    out.say(session.estimate.summary())
    out.say("\n3. Validation on a second log that the fit never saw, and replay:")
    out.say("   simulated from the measured state, driven by the measured torque")
    validation = session.validation(simulate=True)
    out.say(validation)
    truth = _truth(session)
    inside = int(sum(abs(t - v) <= 1.96 * s for t, v, s in zip(truth, session.estimate.values, session.estimate.std, strict=True)))
    out.say(f"\n4. The truth is known here: {inside} of {len(truth)} parameters lie within their 95 % intervals")
    data = {"fit": session.estimate.to_dict(), "validation": validation.to_dict(), "within_95": inside}
    with out.together() as scratch:
        out.result(result("ident.demo/1", data, inputs=session.inputs), "demo")
        if scratch is not None:
            session.estimate.save(scratch / "fit.json")
    return 0


def _truth(session: Session):  # type: ignore[no-untyped-def]

    return session.estimate.base.base_values(nominal_values(session.model))
