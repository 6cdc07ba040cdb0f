"""Whether a log's commands are positions of its joints: those of two motors that move two joints by a linkage are not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, DataError
from .audited import require_clock, told_of_positions
from .commands import DriveLog

if TYPE_CHECKING:
    from ..logs.log import Log
    from ..robots.robot import Robot
    from .law import DriveLaw

Array = np.ndarray
#: Share of a command's power that makes its slowest part, in which a drive's inertia and delay count least.
_SLOWEST = 0.1
#: Share of its slow motion that must follow the command for the answer to say anything.
_FOLLOWS = 0.6
#: Slow answers to a command, as shares of it, that no drive of the joint itself gives: against it, or far more than it.
_AGAINST, _BEYOND = -0.1, 2.0
#: A command in degrees beside a position in radians, within the precision of a slow answer.
_DEGREES, _ABOUT = 180.0 / np.pi, 1.5
#: Errors of following fall to this share, multiplied, where commands are exchanged: a joint follows its own better than another's.
_BETTER = 0.5
#: Joints of crossed axes that are no further from each other (m) are often moved by a pair of motors together.
_NEAR = 0.08
#: Samples at least.
_FEW = 50


def answers(log: DriveLog) -> Array:
    """How far each joint goes with the slowest part of its command (n,): 1 is all the way; NaN where it does not follow it at all."""
    return np.array([_answer(*(x[_on(log.enabled[:, j]), j] for x in (log.q_cmd, log.q))) for j in range(log.q.shape[1])])


def foreign_commands(log: DriveLog, robot: Robot) -> tuple[int, ...]:
    """Joints whose commands are not their positions, and those at one place with such a joint."""
    with np.errstate(invalid="ignore"):
        answer = answers(log)
        turning = np.array([not joint.prismatic for joint in robot.joints])
        degrees = turning & (np.abs(np.log(np.maximum(answer * _DEGREES, 1e-9))) < np.log(_ABOUT))
        found = (answer < _AGAINST) | (answer > _BEYOND) | degrees
    wider = found.copy()
    for child in range(robot.n):
        parent = int(robot.tree.parent[child])
        if 0 <= parent < robot.n and found[parent] != found[child] and _one_place(robot, child):
            wider[[parent, child]] = True
    return tuple(int(j) for j in np.flatnonzero(wider))


def drive_logs(logs: Iterable[Log], robot: Robot, law: DriveLaw) -> tuple[DriveLog, ...]:
    """Recorded logs as a drive law sees them. Raises DataError where they lack what it needs, or hold commands that it is not about."""
    logs = tuple(logs)
    found = tuple(DriveLog.of(log, robot, law) for log in logs)
    for one in found:
        require_clock(one)
    found = tuple(replace(one, notes=(*one.notes, *told_of_positions(log, robot))) for one, log in zip(found, logs, strict=True))
    if law.sends_positions:
        require_joint_commands(found, robot)
    return found


def require_used_patterns(law: DriveLaw, names: Sequence[str]) -> None:
    """Raises ConfigurationError where a table of `by_log` is that of none of the logs: its constants would be left out in silence."""
    unused = [pattern for pattern in law.by_log if not any(law.of_log(pattern, name) for name in names)]
    if names and law.by_log and len(unused) == len(law.by_log):
        raise ConfigurationError(
            f"[drive.by_log] {', '.join(unused)}: no log has such a name ({', '.join(names[:5])}{' …' if len(names) > 5 else ''});"
            " a pattern is compared with the file's name without its ending."
        )


def require_joint_commands(logs: Sequence[DriveLog], robot: Robot) -> None:
    """Raises DataError where a log's commands are in another space than its positions: every number would be wrong."""
    for log in logs:
        _require_own_commands(log, robot)
        joints = foreign_commands(log, robot)
        if joints:
            answer = answers(log)
            worst = max(joints, key=lambda j: abs(np.nan_to_num(answer[j], nan=1.0) - 1.0))
            raise DataError(
                f"log {log.name}: the commands of joint {', '.join(robot.joint_names[j] for j in joints)} do not match its"
                f" position (slow motion of {robot.joint_names[worst]} is {answer[worst]:.2g} times that of q_cmd{worst + 1}): they may be"
                " commands of motors behind a linkage or before their gears, in other units (degrees), or have the opposite sign. Log joint"
                " commands, name their unit in the column (q_cmd1_deg), or lock the joints ([robot] locked)."
            )


def _require_own_commands(log: DriveLog, robot: Robot) -> None:
    """Raises DataError where joints follow each other's commands, and not their own."""
    from scipy.optimize import linear_sum_assignment

    every = np.all(log.enabled > 0, axis=1)
    if np.count_nonzero(every) < _FEW:
        return
    q, sent = log.q[every], log.q_cmd[every]
    error = np.std(q[:, :, None] - sent[:, None, :], axis=0)
    _, of = linear_sum_assignment(np.log(np.maximum(error, 1e-12)))
    own = np.diag(error)
    better = error[np.arange(robot.n), of] / np.maximum(own, 1e-12)
    moved = np.flatnonzero(of != np.arange(robot.n))
    if np.all(better[moved] < 1.0) and np.prod(better[moved]) < _BETTER:
        told = ", ".join(f"{robot.joint_names[j]} follows q_cmd{of[j] + 1} ({robot.joint_names[of[j]]})" for j in moved)
        raise DataError(
            f"log {log.name}: commands are exchanged: {told}, within {max(error[j, of[j]] for j in moved):.2g} (rms), but its own only"
            f" within {min(own[j] for j in moved):.2g}. Rename the columns of commands or of positions."
        )


def _on(enabled: Array) -> slice:
    """The longest stretch with torque."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (enabled > 0).astype(int), [0]]))).reshape(-1, 2)
    if not len(edges):
        return slice(0, 0)
    start, stop = edges[int(np.argmax(edges[:, 1] - edges[:, 0]))]
    return slice(int(start), int(stop))


def _answer(command: Array, position: Array) -> float:
    count = len(command)
    if count < _FEW or np.ptp(command) == 0.0 or np.ptp(position) == 0.0:
        return float("nan")
    taper = np.clip(20.0 * np.minimum(np.arange(count), np.arange(count)[::-1]) / count, 0.0, 1.0)
    sent, moved = (np.fft.rfft(taper * (x - x.mean())) for x in (command, position))
    power = np.abs(sent) ** 2
    slow = slice(0, max(4, int(np.searchsorted(np.cumsum(power), _SLOWEST * power.sum())) + 1))
    cross = np.sum(np.conj(sent[slow]) * moved[slow])
    sizes = float(power[slow].sum()), float(np.sum(np.abs(moved[slow]) ** 2))
    follows = abs(cross) ** 2 / max(sizes[0] * sizes[1], 1e-300)
    return float(cross.real / sizes[0]) if follows > _FOLLOWS else float("nan")


def _one_place(robot: Robot, child: int) -> bool:
    """Whether a joint stands next to the one before it, with its axis in another direction."""
    tree = robot.tree
    across = np.cross(tree.rotation[child] @ tree.axis[child], tree.axis[int(tree.parent[child])])
    return float(np.linalg.norm(across)) > 0.5 and float(np.linalg.norm(tree.translation[child])) < _NEAR
