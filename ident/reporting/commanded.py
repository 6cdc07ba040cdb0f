"""The report of a fit under a drive law: measured motion, our replay and MuJoCo's rollout of the exported model in one figure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..drawing.document import BlockKind, Figure, Layer, Panel, Report, Role, Section, Table, Text, plain
from ..drives.commands import DriveLog
from ..errors import IdentError
from ..exporting.rollout import mujoco_rollout
from ..logs.runs import whole_runs

if TYPE_CHECKING:
    from ..drives.result import DriveFit
    from ..logs.log import Log, LogSet

Array = np.ndarray
#: Panels and points of a line at most.
_SHOWN_JOINTS, _POINTS = 6, 1500


def drive_report(fit: DriveFit, logs: LogSet, before: Iterable[Log] = ()) -> Report:
    """What was found, and the motion of the first of `logs`: measured, simulated, and rolled out by MuJoCo where it is installed and the
    exported file takes what the log holds. A later part of a run of `before` is simulated from the run's beginning on."""
    robot = fit.model.robot
    first = next(iter(logs))
    (run, rows), *_ = whole_runs((first,), before)
    whole = DriveLog.of(run, robot, fit.law)
    kept = np.flatnonzero(whole.kept)
    at = (kept >= rows[first.name].start) & (kept < rows[first.name].stop)
    log = replace(whole, name=first.name, t=whole.t[at], q=whole.q[at])
    ours = log.q + fit.replay_after((first,), before)[first.name]
    theirs, why = None, ""
    try:
        theirs = mujoco_rollout(fit, whole)[at]
    except IdentError as error:
        why = f"Not rolled out by MuJoCo: {error}"
    sections: list[Section] = [Text("What the logs determine", tuple(fit.summary().splitlines()))]
    sections += [_table(fit, log, ours, theirs), _figure(fit, log, ours, theirs)]
    if why:
        sections.append(Text("MuJoCo", (why,)))
    size = float(np.sqrt(np.mean(np.square(ours - log.q))))
    headline = f"Error of simulated position in log {log.name}: {plain(size)} (rms, rad or m)"
    return Report(
        headline, "ok" if fit.settled else "ambiguous", f"{robot.name}, {counted(robot.n, 'joint')}; law {fit.law.kind}", tuple(sections)
    )


def _units(fit: DriveFit) -> list[tuple[float, str]]:
    return [(1e3, "mm") if joint.prismatic else (180 / np.pi, "deg") for joint in fit.model.robot.joints]


def _table(fit: DriveFit, log: DriveLog, ours: Array, theirs: Array | None) -> Table:
    def rms(x: Array, j: int, scale: float) -> str:
        return plain(scale * float(np.sqrt(np.mean(np.square(x[:, j])))))

    rows = []
    for j, (scale, unit) in enumerate(_units(fit)):
        apart = ("–", "–") if theirs is None else (rms(theirs - log.q, j, scale), rms(theirs - ours, j, scale))
        rows.append((fit.model.robot.joint_names[j], unit, rms(log.q - log.q.mean(axis=0), j, scale), rms(ours - log.q, j, scale), *apart))
    head = ("joint", "unit", "motion", "our replay", "MuJoCo", "MuJoCo from ours")
    note = f"Rms over log {log.name}, open loop from the first sample of its run under the logged commands."
    return Table("Error of simulated position", head, tuple(rows), note, left=2)


def _figure(fit: DriveFit, log: DriveLog, ours: Array, theirs: Array | None) -> Figure:
    """The joints with the largest error for their motion."""
    error = np.sqrt(np.mean(np.square(ours - log.q), axis=0)) / np.maximum(np.std(log.q, axis=0), 1e-12)
    order = np.sort(np.argsort(-error)[:_SHOWN_JOINTS])
    thin = slice(None, None, max(1, len(log.t) // _POINTS))
    lines = [(Role.MEASURED, log.q, "measured"), (Role.AFTER, ours, "our replay")]
    if theirs is not None:
        lines.append((Role.BEFORE, theirs, "MuJoCo's rollout of the exported model"))
    panels, units = [], _units(fit)
    for j in order:
        scale, unit = units[int(j)]
        layers = tuple(Layer.of(BlockKind.LINE, role, log.t[thin], scale * x[thin, int(j)], label=label) for role, x, label in lines)
        panels.append(Panel(fit.model.robot.joint_names[int(j)], "time (s)", f"position ({unit})", layers))
    caption = f"Log {log.name}: open loop from the first sample of its run under the logged commands."
    return Figure("commanded", "Measured, our replay, and MuJoCo", caption, tuple(panels), columns=1)
