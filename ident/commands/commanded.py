"""`ident fit` on logs of commands without torque: model and drive law by simulation in closed loop."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from .._utils.files import write_atomic
from .._utils.json import result
from .._utils.text import wrapped
from ..drives import DriveFit, DriveLog, fit_drives
from ..drives.plant import DrivePlant
from ..drives.seen import seen_in
from ..errors import ConfigurationError
from ..logs.reading import read_logs
from ..reporting import report
from ..reporting.commanded import drive_report
from ..study.session import HELD_SHARE
from .common import Output

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from ..drives.law import DriveLaw
    from ..logs.log import LogSet
    from ..robots.robot import Robot
    from ..study.study import Study

METHOD = "simulation"


def asks_for_simulation(study: Study) -> bool:
    """Whether a study declares a law from command to torque, and no method that needs a torque."""
    law = study.description.whole_drive().law
    return law not in (None, "torque", "current") and study.estimator.method in (None, METHOD)


def fit_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """Fit, say what was found, keep it. Returns the exit code."""
    if args.max_error is not None:
        raise ConfigurationError("--max-error is a torque error, which a fit by simulation does not have; see its position error.")
    robot, law, recorded = read_commanded(study)
    logs, held = split_commanded(study, robot, recorded)
    for note in (*robot.notes, *recorded.notes):
        out.say(wrapped(f"note: {note}"))
    fit = fit_drives(logs, study.model(robot), law, held=held, progress=out.progress("fitting"))
    out.say(fit.summary())
    if not study.validation_files():
        out.say(f"held out: the last {HELD_SHARE:.0%} of each log (no validation log was given)")
    if out.json:
        out.result(fit.to_dict())
    _keep(fit, held, out)
    return 0 if fit.settled else 1


def check_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """What logs of commands hold, and what is to be identified from them. Returns the exit code."""
    if args.strict:
        raise ConfigurationError("check --strict needs a torque, which logs of commands lack; `ident fit` says what they determine.")
    robot, law, recorded = read_commanded(study)
    plant = DrivePlant(study.model(robot), law, tuple(DriveLog.of(log, robot, law) for log in recorded))
    out.say_wrapped(f"robot {robot.name}: {robot.n} joints in the order of the log: {', '.join(robot.joint_names)}")
    for note in (*robot.notes, *robot.doubts, *recorded.notes):
        out.say_wrapped(f"note: {note}")
    seen = [seen_in(log, law) for log in plant.logs]
    for one in seen:
        out.say_wrapped(one.text())
    out.say_wrapped(f"law {law.kind}: {len(plant.unknowns)} unknowns, {', '.join(u.name for u in plant.unknowns)}")
    body = {"robot": robot.name, "joints": list(robot.joint_names), "logs": [asdict(one) for one in seen], "law": law.to_dict()}
    out.result(result("ident.check/1", {**body, "unknowns": [u.name for u in plant.unknowns]}, inputs=recorded.inputs), "check")
    return 0


def read_commanded(study: Study) -> tuple[Robot, DriveLaw, LogSet]:
    """Robot, drive law and logs to fit of a study that declares a law from command to torque."""
    robot = study.robot()
    law = study.drive_law(robot)
    assert law is not None
    return robot, law, _read(study, robot, study.fit_files())


def split_commanded(study: Study, robot: Robot, recorded: LogSet) -> tuple[LogSet, LogSet]:
    """Logs to fit, and logs held out: those of the study, or else the last part of each."""
    files = study.validation_files()
    return (recorded, _read(study, robot, files)) if files else recorded.split(by="fraction", held=HELD_SHARE)


def _read(study: Study, robot: Robot, files: Iterable[Path]) -> LogSet:
    return read_logs([*map(str, files)], robot, study.columns or None, **study.reading())


def _keep(fit: DriveFit, shown: LogSet, out: Output) -> None:
    """The fit, its text, and the report with the motion of the first log in `shown`."""
    with out.together() as folder:
        if folder is not None:
            fit.save(folder / "fit.json")
            out.keep("fit.txt", fit.summary() + "\n")
            document = drive_report(fit, shown)
            write_atomic(folder / "report.json", document.to_json())
            try:
                report(document, folder / "report.html", figures=folder / "figures")
            except ConfigurationError as error:  # without the drawing library everything else is still of use
                out.note(f"no report.html: {error}")
    if out.folder is not None:
        out.note(f"saved {out.folder / 'fit.json'}, report")
