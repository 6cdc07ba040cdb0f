"""What the drives were sent, and what the joints did: the columns of a log that a drive law needs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import lstsq
from ..errors import DataError
from ..logs.units import split_unit, unit_of
from .law import DriveLaw, SupplyForm, VelocityCommand

if TYPE_CHECKING:
    from ..logs.log import Log
    from ..robots.robot import Robot

Array = np.ndarray
_COLUMN = re.compile(r"^(?P<what>q_cmd|dq_cmd|tau_ff|torque_enable|supply|voltage)_?(?P<joint>[0-9]+)$", re.IGNORECASE)
#: Samples at the start of a log from which its initial speed is taken where none was logged.
_FIRST = 6
#: Standard deviations from which on a first speed is one.
_SURE = 4.0
#: Steps of an encoder that a joint moves from one sample to the next but one where a repeated reading is none of a joint at rest.
_FEW = 4


@dataclass(frozen=True, eq=False)
class DriveLog:
    """One log as a drive law sees it. N samples, n joints, SI, joint side.

    `t` (N,) s from the first sample; `q` (N, n); `q_cmd`, `dq_cmd`, `tau_ff` (N, n): commands (of law "voltage": `tau_ff` is the voltage,
    V, the others are 0); `enabled` (N, n): share of the torque that is switched on; `supply` (N, n) V, None where the law needs none;
    `origin`, `start` (n,): first position and speed; `later`: whether the recording began before."""

    name: str
    t: Array
    q: Array
    q_cmd: Array
    dq_cmd: Array
    tau_ff: Array
    enabled: Array
    supply: Array | None
    origin: Array
    start: Array
    later: bool = False

    @cached_property
    def fresh(self) -> Array:
        """(N, n): readings that are no repeat of the one before. Equal to it, while the joint moved by more than a few steps of its
        encoder from the sample before to the sample behind: nothing was read anew."""
        change = np.diff(self.q, axis=0)
        out = np.ones(self.q.shape, bool)
        moved = np.abs(self.q[2:] - self.q[:-2])
        for j, steps in enumerate(np.abs(change).T):
            least = float(np.min(steps[steps > 0], initial=np.inf))
            out[1:-1, j] = ~((steps[:-1] == 0) & (moved[:, j] > _FEW * least))
        return out

    @classmethod
    def of(cls, log: Log, robot: Robot, law: DriveLaw) -> DriveLog:
        """From a recorded log. Raises DataError where it lacks what the law needs."""
        law = law.for_log(log.name)
        q = log.position(robot.transmission)
        good = np.isfinite(q).all(axis=1)
        columns = commanded(log.extra, robot)
        if law.sends_positions and "q_cmd" not in columns:
            raise DataError(
                f"log {log.name}: [drive] law {law.kind!r} needs the position commands q_cmd1 … q_cmd{robot.n}, and the log has none."
                " Rename the columns that hold them."
            )
        for what, array in columns.items():
            missing = np.flatnonzero(np.isnan(array[good]).all(axis=0))
            if len(missing) and what in ("q_cmd", "dq_cmd", "supply", "voltage"):
                joint = int(missing[0])
                raise DataError(f"log {log.name}: column {what}{joint + 1} (joint {robot.joint_names[joint]}) is missing or empty.")
        if law.kind == "pwm" and "supply" not in columns:
            raise DataError(f"log {log.name}: [drive] law 'pwm' needs the supply voltage, columns supply1_V … supply{robot.n}_V.")
        if law.kind == "voltage":
            if "voltage" not in columns:
                raise DataError(
                    f"log {log.name}: [drive] law 'voltage' needs the voltages that the drives were sent, columns voltage1_V …"
                    f" voltage{robot.n}_V, and the log has none. Rename the columns that hold them."
                )
            columns = {"tau_ff": columns["voltage"], **{k: x for k, x in columns.items() if k == "torque_enable"}}
        t = log.t[good] - log.t[good][0]
        got = {what: _held(array[good]) for what, array in columns.items()}
        none = np.zeros_like(q[good])
        q_cmd = got.get("q_cmd", none)
        speed = got.get("dq_cmd", none) if law.velocity_command == VelocityCommand.LOGGED else none
        if law.velocity_command == VelocityCommand.DERIVATIVE:
            speed = np.gradient(q_cmd, t, axis=0)
        supply = got.get("supply")
        if supply is not None and law.supply == SupplyForm.MEAN:
            supply = np.broadcast_to(supply.mean(axis=0), supply.shape).copy()
        enabled = got.get("torque_enable", np.ones_like(none))
        rate = log.velocity(robot.transmission)
        origin, first = _first_state(t, q[good])
        if rate is not None and np.isfinite(rate[good][0]).all():
            first = np.where(first == 0.0, 0.0, rate[good][0])
        later = bool(log.t[0] > log.began)
        return cls(log.name, t, q[good], q_cmd, speed, got.get("tau_ff", none), enabled, supply, origin, first, later)

    @property
    def period(self) -> float:
        """Median seconds between samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1])


def commanded(extra: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Commands among a log's further columns: "q_cmd", "dq_cmd", "tau_ff", "torque_enable", "supply", "voltage" → (N, n), SI.

    NaN where one is missing."""
    found: dict[str, dict[int, Array]] = {}
    for column, values in extra.items():
        stem, suffix = split_unit(column.strip())
        match = _COLUMN.match(stem) or _COLUMN.match(column.strip())
        if match is None:
            continue
        scale = 1.0 if suffix is None else unit_of(suffix).scale
        found.setdefault(match["what"].lower(), {})[int(match["joint"]) - 1] = np.asarray(values, float) * scale
    out = {}
    for what, by_number in found.items():
        numbers = list(range(robot.n))
        if set(by_number) == set(range(len(robot.whole))) and len(robot.whole) > robot.n:
            numbers = [robot.whole.index(name) for name in robot.joint_names]
        count = len(next(iter(by_number.values())))
        out[what] = np.stack([by_number.get(j, np.full(count, np.nan)) for j in numbers], axis=1)
    return out


def _held(values: Array) -> Array:
    """Values with gaps filled by what stood before (a command lasts until the next)."""
    if np.isfinite(values).all():
        return values
    out = values.copy()
    for column in out.T:
        at = np.flatnonzero(np.isfinite(column))
        if len(at):
            column[:] = column[at[np.clip(np.searchsorted(at, np.arange(len(column)), side="right") - 1, 0, None)]]
        else:
            column[:] = 0.0
    return out


def _first_state(t: Array, q: Array) -> tuple[Array, Array]:
    """Position and speed (n,) at the first sample. A joint at rest: the mean of its readings there, and no speed, because a simulation
    that starts where noise has put it stays there until friction is overcome. One that moves: its first reading, and a straight line."""
    origin, speed = q[0].copy(), np.zeros(q.shape[1])
    few = min(_FIRST, len(t))
    for j, values in enumerate(q.T):
        slope, doubt = _line(t[:few], values[:few])
        if abs(slope) > _SURE * doubt and _goes_on(t[: 2 * few], values[: 2 * few], few):
            origin[j], speed[j] = _moving(t[:few], values[:few], slope)
            continue
        count = few
        while 2 * count <= len(t):
            slope, doubt = _line(t[: 2 * count], values[: 2 * count])
            if abs(slope) > _SURE * doubt or _beyond(values[:count], values[count : 2 * count]):
                break
            count *= 2
        origin[j] = float(np.mean(values[:count]))
    return origin, speed


def _beyond(before: Array, behind: Array) -> bool:
    """Whether readings are elsewhere than as many before them, at rest, whose spread is that of both. Few readings know their spread badly:
    in units of it the limit is that of Student's distribution, as rarely exceeded by chance as the sure one of known spread."""
    from scipy.special import ndtr, stdtrit

    count = len(before)
    sure = -float(stdtrit(count - 1, ndtr(-_SURE)))
    doubt = float(np.std(before, ddof=1)) * np.sqrt(2.0 / count)
    return abs(float(np.mean(behind) - np.mean(before))) > sure * doubt + 1e-12


def _goes_on(t: Array, values: Array, few: int) -> bool:
    """Whether the readings behind the first few are elsewhere. A line through few readings is never quite level, and its doubt, taken from
    the same few, is by chance several times too small: of one joint at rest in sixty that would be a speed."""
    if len(t) < 2 * few:
        return True
    halves = (slice(0, few), slice(few, 2 * few))
    spread = sum((_line(t[at], values[at])[1] ** 2) * float(np.sum((t[at] - t[at].mean()) ** 2)) for at in halves) / 2.0
    apart = abs(float(np.mean(values[halves[1]]) - np.mean(values[halves[0]])))
    return bool(apart > _SURE * np.sqrt(2.0 * spread / few))


def _moving(t: Array, values: Array, slope: float) -> tuple[float, float]:
    """Position and speed at the first of a few readings of a joint that moves: of a parabola where they are bent for sure."""
    powers = np.vander(t - t[0], 3, increasing=True)
    found = lstsq(powers, values, rcond=None)
    left = values - powers @ found
    spread = float(left @ left) / max(len(t) - 3, 1) * np.linalg.inv(powers.T @ powers)
    bent = abs(found[2]) > _SURE * np.sqrt(spread[2, 2])
    return (float(found[0]), float(found[1])) if bent else (float(values[0]), slope)


def _line(t: Array, values: Array) -> tuple[float, float]:
    """Slope of a straight line, and its standard deviation."""
    time = t - t.mean()
    size = max(float(time @ time), 1e-300)
    slope = float(time @ values) / size
    left = values - values.mean() - slope * time
    return slope, float(np.sqrt(left @ left / max(len(t) - 2, 1) / size))
