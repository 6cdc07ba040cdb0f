"""`ident fit` on logs of commands without torque: model and drive law by simulation in closed loop."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from .._utils.text import wrapped
from ..drives import DriveFit, fit_drives
from ..errors import ConfigurationError
from ..reporting.commanded import drive_report
from .commanded import read_commanded, split_commanded
from .common import Output, say_split
from .kept_report import keep_report

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..study.study import Study


def fit_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """Fit, say what was found, keep it. Returns the exit code."""
    if args.max_error is not None:
        raise ConfigurationError(
            "--max-error limits the torque error, which a fit by simulation does not have; look at its position error."
        )
    robot, law, recorded = read_commanded(study)
    logs, held = split_commanded(study, robot, recorded)
    for note in (*robot.notes, *recorded.notes):
        out.say(wrapped(f"note: {note}"))
    fit = fit_drives(logs, study.model(robot), law, held=held, progress=out.progress("fitting"))
    out.say(fit.summary())
    if not study.validation_files():
        say_split(out)
    if out.json:
        out.result(fit.to_dict())
    _keep(fit, held, logs, out)
    return 0 if fit.settled else 1


def _keep(fit: DriveFit, shown: LogSet, fitted: LogSet, out: Output) -> None:
    """The fit, its text, and the report with the motion of the first log in `shown`."""
    with out.together() as folder:
        if folder is not None:
            fit.save(folder / "fit.json")
            out.keep("fit.txt", fit.summary() + "\n")
            keep_report(folder, out, drive_report(fit, shown, fitted))
    if out.folder is not None:
        out.note(f"saved {out.folder / 'fit.json'}, report")
