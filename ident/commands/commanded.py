"""Logs of commands without torque: what a study says of them, and what they hold."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from .._utils.json import result
from .._utils.text import counted
from ..drives.fit import notes_of
from ..drives.plant import DrivePlant
from ..drives.residual import require_motion
from ..drives.seen import seen_in
from ..drives.space import drive_logs, require_used_patterns
from ..errors import ConfigurationError
from ..logs.reading import read_logs
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


def check_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """What logs of commands hold, and what is to be identified from them. Returns the exit code."""
    if args.strict:
        raise ConfigurationError(
            "check --strict needs a measured torque, which logs of commands do not have; `ident fit` reports what they determine."
        )
    robot, law, recorded = read_commanded(study)
    plant = DrivePlant(study.model(robot), law, drive_logs(recorded, robot, law))
    require_motion(plant)
    out.say_wrapped(f"robot {robot.name}: {counted(robot.n, 'joint')} in the order of the log: {', '.join(robot.joint_names)}")
    for note in (*robot.notes, *robot.doubts, *recorded.notes, *notes_of(plant)):
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
    recorded = _read(study, robot, study.fit_files())
    require_used_patterns(law, [*recorded.names, *(file.name.split(".")[0] for file in study.validation_files())])
    return robot, law, recorded


def split_commanded(study: Study, robot: Robot, recorded: LogSet) -> tuple[LogSet, LogSet]:
    """Logs to fit, and logs held out: those of the study, or else the last part of each."""
    files = study.validation_files()
    return (recorded, _read(study, robot, files)) if files else recorded.split(by="fraction", held=HELD_SHARE)


def _read(study: Study, robot: Robot, files: Iterable[Path]) -> LogSet:
    return read_logs([*map(str, files)], robot, study.columns or None, **study.reading())
