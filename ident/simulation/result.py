"""The result of a simulation: the truth, and what the sensors made of it."""

from __future__ import annotations

import io
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._utils.files import write_atomic
from .._utils.short_repr import ShortRepr
from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..logs.log import Log
from ..robots.transmission import Side
from .sensors import Readings, Sensors

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(ShortRepr):
    """One simulated run of N samples. The truth, exact but for integration:

    `t` (N,) s; `link` and `motor` (N, n): motion of the links (joint side) and of the motors, which differ by more than K only at
    flexible joints; `tau` (N, n): torque that the drive reports, measured side; `applied`: what reached the drive;
    `friction` (N, n): what dry friction and the forces it belongs to took, measured side, holding torques included;
    `held` (N, n) bool: dry friction on a joint or motor at rest, whose torque no column can tell; `states` (N, s): those of
    forces with memory.
    Accelerations and torque are those right after each instant, where torque is held between samples.

    `readings`: what the sensors recorded; `sensors` and `seed`: how."""

    robot: Robot
    t: Array
    link: Coordinates
    motor: Coordinates
    tau: Array
    applied: Array
    friction: Array
    held: Array
    states: Array
    readings: Readings = field(repr=False)
    sensors: Sensors
    seed: int

    @classmethod
    def of(
        cls,
        robot: Robot,
        t: Array,
        link: Coordinates,
        motor: Coordinates,
        reported: Array,
        applied: Array,
        friction: Array,
        held: Array,
        states: Array,
        every: int,
        linear: bool,
        sensors: Sensors,
        seed: int,
    ) -> Simulation:
        """From the truth; `reported` (K, n) at all control instants, `every` of which is a sample."""
        source = link if sensors.encoder == Side.JOINT else motor
        tau = reported[::every]
        exact = Readings(robot, sensors.encoder, t, source, tau, _BetweenSamples(t, source), _BetweenTorques(t, reported, every, linear))
        return cls(robot, t, link, motor, tau, applied, friction, held, states, sensors.read(exact, seed), sensors, seed)

    @property
    def q(self) -> Array:
        """True link positions (N, n), rad or m."""
        return self.link.q

    @property
    def dq(self) -> Array:
        """True link velocities (N, n)."""
        return self.link.dq

    @property
    def ddq(self) -> Array:
        """True link accelerations (N, n)."""
        return self.link.ddq

    def reread(self, sensors: Sensors, seed: int = 0) -> Simulation:
        """The same run read by other sensors, or with other noise. The encoders stay on their side."""
        if sensors.encoder != self.sensors.encoder:
            raise ConfigurationError("the encoders of a finished simulation cannot move to the other side; simulate again.")
        source = self.link if sensors.encoder == Side.JOINT else self.motor
        exact = replace(self.readings, t=self.t, motion=source, tau=self.tau)
        return replace(self, readings=sensors.read(exact, seed), sensors=sensors, seed=seed)

    def until(self, t: float) -> Simulation:
        """The part of the run up to time t, as it was read."""
        count = int(np.searchsorted(self.t, t + 1e-9 * (1.0 + abs(t)), side="right"))

        def cut(c: Coordinates) -> Coordinates:
            return Coordinates(c.q[:count], c.dq[:count], c.ddq[:count])

        read = self.readings
        readings = replace(read, t=read.t[:count], motion=cut(read.motion), tau=read.tau[:count])
        arrays = {key: getattr(self, key)[:count] for key in ("t", "tau", "applied", "friction", "held", "states")}
        return replace(self, link=cut(self.link), motor=cut(self.motor), readings=readings, **arrays)

    def log(self, name: str = "simulated") -> Log:
        """What the sensors recorded, as a log."""
        columns = self._columns()
        return Log(
            name=name,
            t=self.readings.t,
            q=columns.get("q"),
            q_motor=columns.get("q_m"),
            dq=columns.get("dq"),
            ddq=columns.get("ddq"),
            dq_motor=columns.get("dq_m"),
            tau={self.robot.transmission.measured.value: self.readings.tau} if "tau" in self.sensors.columns else {},
        )

    def to_csv(self, path: str | Path, *, force: bool = False) -> Path:
        """Write what the sensors recorded (docs/formats.md): `t`, `q1` … (`q_m1` …), `tau1` … or `tau_m1` …; gzip by the suffix `.gz`.

        Written completely or not at all. Raises ConfigurationError if the file exists and `force` is false."""
        columns = self._columns()
        if "tau" in self.sensors.columns:
            columns["tau" if self.robot.transmission.measured == Side.JOINT else "tau_m"] = self.readings.tau
        return write_log_csv(path, self.readings.t, columns, force=force)

    def _columns(self) -> dict[str, Array]:
        """Recorded motion by column name, on the side on which it is written."""
        motion, wanted, K = self.readings.motion, self.sensors.columns, self.robot.transmission
        if self.sensors.written == Side.MOTOR:
            if self.sensors.encoder == Side.JOINT:
                motion = Coordinates(K.motor_position(motion.q), K.motor_rate(motion.dq), motion.ddq)
            found = {"q_m": motion.q, "dq_m": motion.dq}
            return {key: found[key] for key in found if key[:-2] in wanted}
        if self.sensors.encoder == Side.MOTOR:
            motion = Coordinates(K.joint_position(motion.q), K.joint_rate(motion.dq), K.joint_rate(motion.ddq))
        return {key: getattr(motion, key) for key in ("q", "dq", "ddq") if key in wanted}


def write_log_csv(path: str | Path, t: Array, columns: dict[str, Array], *, force: bool = False) -> Path:
    """Write a log of columns (N, n) by the contract's names, completely or not at all; gzip by the suffix `.gz`."""
    import pandas as pd

    target = Path(path)
    table = {"t": t} | {f"{key}{j + 1}": values[:, j] for key, values in columns.items() for j in range(values.shape[1])}
    text = io.StringIO()
    pd.DataFrame(table).to_csv(text, index=False)
    data: str | bytes = text.getvalue()
    if target.suffix == ".gz":
        import gzip

        data = gzip.compress(text.getvalue().encode(), mtime=0)
    return write_atomic(target, data, force=force)


class _BetweenSamples:
    """Motion between samples: the quintic that agrees with position, velocity and acceleration at both neighbours."""

    def __init__(self, t: Array, motion: Coordinates) -> None:
        self.t, self.motion = t, motion

    def __call__(self, at: Array) -> Coordinates:
        t, m = self.t, self.motion
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
        h = (t[i + 1] - t[i])[:, None]
        s = (at - t[i])[:, None] / h
        v0, v1, a0, a1 = m.dq[i] * h, m.dq[i + 1] * h, m.ddq[i] * h**2, m.ddq[i + 1] * h**2
        d, e, f = m.q[i + 1] - m.q[i] - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
        c3, c4, c5 = 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f
        q = m.q[i] + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
        dq = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
        ddq = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / h**2
        return Coordinates(q, dq, ddq)


class _BetweenTorques:
    """Reported torque at any time, held or straight between control instants as it was simulated."""

    def __init__(self, t: Array, reported: Array, every: int, linear: bool) -> None:
        self.reported, self.linear = reported, linear
        self.period = float(t[1] - t[0]) / every if len(t) > 1 else 1.0

    def __call__(self, at: Array) -> Array:
        place = np.clip(at / self.period, 0.0, len(self.reported) - 1)
        k = np.minimum(np.floor(place + 1e-9).astype(int), len(self.reported) - 1)
        if not self.linear:
            return self.reported[k]
        share = np.clip(place - k, 0.0, 1.0)[:, None]
        return self.reported[k] + share * (self.reported[np.minimum(k + 1, len(self.reported) - 1)] - self.reported[k])
