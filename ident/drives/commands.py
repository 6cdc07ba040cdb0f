"""What the drives were sent, and what the joints did: the columns of a log that a drive law needs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..errors import DataError
from ..logs.command_columns import command_of
from ..logs.units import split_unit, unit_of
from .clock import equal_steps
from .first_state import first_state
from .given import CommandForm, SupplyForm, VelocityCommand
from .instants import rows_of_a_command
from .law import DriveLaw
from .turns import joined_turns, of_the_same_turn

if TYPE_CHECKING:
    from ..logs.log import Log
    from ..robots.robot import Robot

Array = np.ndarray
#: Desired motion, of which a log that holds no commands may have told.
_DESIRED = re.compile(r"^q_ref(?P<joint>[0-9]+)$")
#: Steps of an encoder that a joint moves from one sample to the next but one where a repeated reading is none of a joint at rest.
_FEW = 4


@dataclass(frozen=True, eq=False)
class DriveLog:
    """One log as a drive law sees it. N samples, n joints, SI, joint side.

    `t` (N,) s from the first sample; `q` (N, n); `q_cmd`, `dq_cmd`, `tau_ff` (N, n): commands (of law "voltage": `tau_ff` is the voltage,
    V, the others are 0); `enabled` (N, n): share of the torque that is switched on; `supply` (N, n) V, None where the law needs none;
    `origin`, `start` (n,): first position and speed; `later`: whether the recording began before; `kept` (rows of the recording,): which
    of them these are; `notes`: what was made of commands and positions; `stays`: rows for which a command usually stays."""

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
    kept: Array = field(default_factory=lambda: np.zeros(0, bool))
    notes: tuple[str, ...] = ()
    stays: float = 1.0

    @property
    def lateness(self) -> float:
        """Seconds by which commands may have been sent before the row that first holds them, where the log does not tell."""
        return self.period if self.stays > 1.0 else 0.0

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
        logged = log.position(robot.transmission)
        q, turned = joined_turns(logged, robot)
        good = np.isfinite(q).all(axis=1)
        columns, desired = _columns_of(log, robot, law)
        _require(log.name, {what: array[good] for what, array in columns.items()}, robot, law)
        if law.kind == "voltage":
            columns = {"tau_ff": columns["voltage"], **{k: x for k, x in columns.items() if k == "torque_enable"}}
        t = equal_steps(log.t[good], q[good])
        unsteady = [] if np.array_equal(t, log.t[good]) else [_unsteady(log.t[good] - t)]
        t = t - t[0]
        got = {what: _held(array[good]) for what, array in columns.items()}
        none = np.zeros_like(q[good])
        q_cmd = of_the_same_turn(got["q_cmd"], q[good], robot, logged[good]) if "q_cmd" in got else none
        speed = got.get("dq_cmd", none) if law.velocity_command == VelocityCommand.LOGGED else none
        if law.velocity_command == VelocityCommand.DERIVATIVE:
            speed = np.gradient(q_cmd, t, axis=0)
        supply = got.get("supply")
        if supply is not None and law.supply == SupplyForm.MEAN:
            supply = np.broadcast_to(supply.mean(axis=0), supply.shape).copy()
        enabled = got.get("torque_enable", np.ones_like(none))
        rate = log.velocity(robot.transmission)
        origin, first = first_state(t, q[good])
        if rate is not None and np.isfinite(rate[good][0]).all():
            first = np.where(first == 0.0, 0.0, rate[good][0])
        later = bool(log.t[0] > log.began)
        lacking = _missing(log.name, {what: array[good] for what, array in columns.items()}, robot)
        stays = rows_of_a_command(q_cmd) if law.sends_positions and law.command == CommandForm.STAIRCASE else 1.0
        told = [_unknown_instants(stays, t)] if stays > 1.0 else []
        notes = (*(f"log {log.name}: {said}" for said in (*turned, *unsteady, *desired, *told)), *lacking)
        return cls(log.name, t, q[good], q_cmd, speed, got.get("tau_ff", none), enabled, supply, origin, first, later, good, notes, stays)

    @property
    def period(self) -> float:
        """Median seconds between samples."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1])


def _columns_of(log: Log, robot: Robot, law: DriveLaw) -> tuple[dict[str, Array], list[str]]:
    """Commands of a log (N, n), with a note where its desired motion is taken for those of position."""
    columns = commanded(log.extra, robot)
    desired = [] if not law.sends_positions or "q_cmd" in columns else [key for key in log.extra if _DESIRED.match(key)]
    if not desired:
        return columns, []
    columns |= commanded({key.replace("q_ref", "q_cmd"): log.extra[key] for key in desired}, robot)
    return columns, ["it has no position commands; its desired motion is taken for them."]


def _require(name: str, columns: Mapping[str, Array], robot: Robot, law: DriveLaw) -> None:
    """Raises DataError where commands (N, n) that a law needs are not there."""
    if law.sends_positions and "q_cmd" not in columns:
        raise DataError(
            f"log {name}: [drive] law {law.kind!r} needs the position commands, {_columns('q_cmd', '', robot)}, and the log has none."
            ' Rename the columns that hold them, or name them under [columns] of a study file (q_cmd1_deg = "its name").'
        )
    for what, array in columns.items():
        missing = np.flatnonzero(np.isnan(array).all(axis=0))
        if len(missing) and what in ("q_cmd", "dq_cmd", "voltage", *(("supply",) if law.kind == "pwm" else ())):
            joint = int(missing[0])
            raise DataError(f"log {name}: column {what}{joint + 1} (joint {robot.joint_names[joint]}) is missing or empty.")
    if law.kind == "pwm" and "supply" not in columns:
        one = "" if robot.n == 1 else ", or supply_V where all joints have one"
        raise DataError(f"log {name}: [drive] law 'pwm' needs the supply voltage, {_columns('supply', '_V', robot)}{one}.")
    if law.kind == "voltage" and "voltage" not in columns:
        raise DataError(
            f"log {name}: [drive] law 'voltage' needs the voltages that the drives were sent, {_columns('voltage', '_V', robot)},"
            " and the log has none. Rename the columns that hold them."
        )


def _columns(what: str, unit: str, robot: Robot) -> str:
    """Those of all joints, for a message."""
    return f"column {what}1{unit}" if robot.n == 1 else f"columns {what}1{unit} … {what}{robot.n}{unit}"


def commanded(extra: Mapping[str, Array], robot: Robot) -> dict[str, Array]:
    """Commands among a log's further columns: "q_cmd", "dq_cmd", "tau_ff", "torque_enable", "supply", "voltage" → (N, n), SI.

    NaN where one is missing. One supply without a number is that of every joint that has none of its own."""
    found: dict[str, dict[int, Array]] = {}
    shared: Array | None = None
    for column, values in extra.items():
        told = command_of(column)
        if told is None:
            continue
        _, suffix = split_unit(column.strip())
        scaled = np.asarray(values, float) * (1.0 if suffix is None else unit_of(suffix).scale)
        what, joint = told
        if joint < 0:
            shared = scaled
        else:
            found.setdefault(what, {})[joint] = scaled
    if shared is not None:
        found["supply"] = dict.fromkeys(range(max(len(robot.whole), robot.n)), shared) | found.get("supply", {})
    out = {}
    for what, by_number in found.items():
        numbers = list(range(robot.n))
        if set(by_number) == set(range(len(robot.whole))) and len(robot.whole) > robot.n:
            numbers = [robot.whole.index(name) for name in robot.joint_names]
        count = len(next(iter(by_number.values())))
        out[what] = np.stack([by_number.get(j, np.full(count, np.nan)) for j in numbers], axis=1)
    return out


def _missing(name: str, columns: Mapping[str, Array], robot: Robot) -> list[str]:
    """A note of commands that are missing in some rows (N, n): a drive goes by the last one."""
    out = []
    for what, values in columns.items():
        lacking = np.isnan(values)
        for j in np.flatnonzero(lacking.any(axis=0) & ~lacking.all(axis=0)):
            count, longest = int(lacking[:, j].sum()), _longest(lacking[:, j])
            out.append(
                f"log {name}: {what}{j + 1} (joint {robot.joint_names[j]}) is missing in {count} of {counted(len(values), 'sample')},"
                f" {longest} of them on end at most; the drive is taken to have gone by the last one before."
            )
    return out


def _unsteady(apart: Array) -> str:
    """A note of stamps that are `apart` (N,) from the equal steps that are taken for them."""
    rms = 1e3 * float(np.std(apart))
    return f"times differ from equal steps by {rms:.2g} ms (rms), and positions are smoother along equal ones, which are used."


def _unknown_instants(rows: float, t: Array) -> str:
    """A note of commands that stay for several `rows`."""
    period = float(np.median(np.diff(t)))
    return (
        f"commands change every {rows:.3g} rows (about {1.0 / (rows * period):.3g} Hz), so each was sent at some time between two rows: the"
        f" delay may be up to {1e3 * period:.3g} ms longer than the value, and its interval holds that. Log commands with the time at which"
        " they were sent, or more rows."
    )


def _longest(flags: Array) -> int:
    """Length of the longest run of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]]))).reshape(-1, 2)
    return int(np.max(edges[:, 1] - edges[:, 0], initial=0))


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
