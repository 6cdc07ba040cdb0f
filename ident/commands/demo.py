"""`ident demo`: the whole way from a log to a validated estimate, on a bundled PUMA 560 log."""

from __future__ import annotations

import argparse

import numpy as np

from .._utils.json import result
from ..physical import PayloadEstimate, payload_of
from ..robots.library.folders import robot_folder
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
    out.say("\n5. The load: two more logs of the same arm, without and with 1.6 kg at (-7, 7, 11) cm in frame 6")
    load = _load()
    out.say(load.text())
    data = {"fit": session.estimate.to_dict(), "validation": validation.to_dict(), "within_95": inside, "load": load.to_dict()}
    with out.together() as scratch:
        out.result(result("ident.demo/1", data, inputs=session.inputs), "demo")
        if scratch is not None:
            session.estimate.save(scratch / "fit.json")
    return 0


def _load() -> PayloadEstimate:
    """The load of the published experiments, from the logs without and with it."""
    fits = []
    for name in ("unloaded", "loaded"):
        study = Study().with_flags(robot="puma560", logs=[robot_folder("puma560") / f"demo/{name}.csv.gz"])
        fits.append(Session(study).estimate)
    return payload_of(*fits, link="link6")


def _truth(session: Session) -> np.ndarray:
    return session.estimate.base.base_values(nominal_values(session.model))
