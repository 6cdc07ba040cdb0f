"""`ident validate` of a fit under a drive law: how far simulated positions are from those of logs that it did not see."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from .._utils.json import result
from .._utils.text import wrapped
from ..drives import DriveFit, fit_drives
from ..drives.space import drive_logs
from ..errors import ConfigurationError
from ..evaluation.doubts import seen_by
from ..reporting.commanded import drive_report
from .commanded import read_commanded, split_commanded
from .common import Output, say_split
from .kept_report import keep_report

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np

    from ..logs.log import Log, LogSet
    from ..study.study import Study


def validate_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """Fit the study's logs, and simulate what it holds out. Returns the exit code."""
    _refuse_torque(args)
    robot, law, recorded = read_commanded(study)
    logs, held = split_commanded(study, robot, recorded)
    fit = fit_drives(logs, study.model(robot), law, held=held, progress=out.progress("fitting"))
    code = _told(fit, held, logs, "", out)
    if not study.validation_files():
        say_split(out)
    return code


def validate_drive_fit(fit: DriveFit, logs: LogSet, args: argparse.Namespace, out: Output) -> int:
    """Simulate logs with a saved fit. Returns the exit code."""
    _refuse_torque(args)
    drive_logs(logs, fit.model.robot, fit.law)
    return _told(fit.with_heldout(logs), logs, (), seen_by(fit.inputs, logs.inputs), out)


def _refuse_torque(args: argparse.Namespace) -> None:
    if args.max_error is not None:
        raise ConfigurationError("--max-error limits the torque error, which logs of commands do not have; look at the position error.")


def _told(fit: DriveFit, logs: LogSet, before: Iterable[Log], seen: str, out: Output) -> int:
    joints = fit.model.robot.joint_names
    assert fit.heldout_rms is not None
    if seen:
        out.say(wrapped(f"warning: {seen}"))
    width = max(map(len, fit.heldout_logs), default=0)
    out.say("error of simulated position, open loop under the logged commands (rms, rad or m)")
    out.say("\n".join(f"  {name:<{width}}  {', '.join(_each(joints, rms))}" for name, rms in fit.heldout_logs.items()))
    out.say(f"  {'all':<{width}}  {', '.join(_each(joints, fit.heldout_rms))}")
    body = {"robot": fit.model.robot.name, "joints": list(joints), "rms": fit.heldout_rms.tolist()}
    by_log = [{"name": name, "rms": rms.tolist()} for name, rms in fit.heldout_logs.items()]
    warnings = (*fit.warnings, *([seen] if seen else ()))
    with out.together() as folder:
        told = result("ident.drive_validation/1", {**body, "logs": by_log}, inputs=(*fit.inputs, *logs.inputs), warnings=warnings)
        out.result(told, "validation")
        if folder is not None:
            keep_report(folder, out, drive_report(fit, logs, before))
    return 0


def _each(joints: Sequence[str], rms: np.ndarray) -> list[str]:
    return [f"{name} {size:.3g}" for name, size in zip(joints, rms, strict=True)]
