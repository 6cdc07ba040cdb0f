"""The robot of the comparison: a PUMA 560 whose parameters are known, its sensors, and the groups in which errors are told."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.model import Model
from ident.planning import default_model
from ident.problem.problem import Problem
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.simulation.plant import Plant
from ident.simulation.sensors import Quantisation, Sensors, TorqueNoise, TorqueWindow

from .random_motion import fourier

Array = np.ndarray
_FIRST_MOMENTS = ("mx", "my", "mz")
#: Sensors that record the truth, but for the averaging of torque over a sampling period.
_EVERYTHING = ("q", "dq", "ddq", "tau")


@dataclass(frozen=True, eq=False)
class World:
    """A robot with known parameters: `model`, `values` (k,) of all parameters; `noise` (n,): torque noise, measured side;
    `counts`: encoder counts a motor turn; `rate`: samples per second."""

    model: Model
    values: Array
    noise: Array
    counts: float = 1000.0
    rate: float = 200.0

    @cached_property
    def truth(self) -> Array:
        """True base parameters (b,)."""
        return self.model.base.base_values(self.values)

    @property
    def names(self) -> tuple[str, ...]:
        return self.model.base.names

    @cached_property
    def plant(self) -> Plant:
        return Plant(self.model, self.values)

    @cached_property
    def groups(self) -> dict[str, list[int]]:
        """Base parameters by what they are; inertias of the first and of the last joints apart."""
        joints = self.model.robot.joint_names
        half = len(joints) // 2
        found: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            parameter = self.model.base.parameters[self.model.base.independent[i]]
            symbol = name.removesuffix(f"_{parameter.joint}")
            if parameter.effect != "rigid_body":
                group = parameter.effect.replace("_", " ")
            elif symbol in _FIRST_MOMENTS:
                group = "first moments"
            else:
                group = "inertia, arm" if joints.index(parameter.joint) < half else "inertia, wrist"
            found.setdefault(group, []).append(i)
        return found

    def sensors(self, *, counts: float | None = None, noise: float = 1.0, rate: float | None = None) -> Sensors:
        """Encoders on the motors and torque averaged over a sampling period, with `noise` times the usual noise."""
        window = TorqueWindow(1.0 / (rate or self.rate))
        rounding = Quantisation.counts(counts or self.counts)
        return Sensors((rounding, window, TorqueNoise(tuple(noise * self.noise))), Side.MOTOR, columns=("q", "tau"))

    def exact(self, rate: float) -> Sensors:
        """Exact motion, and torque without noise, averaged over a period of the rate."""
        return Sensors((TorqueWindow(1.0 / rate),), Side.MOTOR, columns=_EVERYTHING)

    def position_std(self, counts: float | None = None) -> Array:
        """Standard deviation (n,) of joint positions by the encoders' rounding, rad."""
        step = 2.0 * np.pi / (counts or self.counts) / np.sqrt(12.0)
        return step * np.sqrt(np.sum(self.model.robot.transmission.K**2, axis=1))


def puma(noise_share: float = 0.02, counts: float = 1000.0) -> World:
    """The PUMA 560 with the consistent parameters nearest to the published step-by-step values.

    Torque noise is `noise_share` of the rms torque of quick random motion, joint by joint."""
    robot = load_robot("puma560")
    model = default_model(robot)
    values = nominal_values(model)
    return World(model, values, noise_share * typical_torque(model, values), counts)


def typical_torque(model: Model, values: Array) -> Array:
    """Rms torque (n,), measured side, of quick random motions."""
    found = []
    for seed in range(8):
        motion = fourier(model, 1000 + seed, 5.0, 0.9).sample(np.linspace(0.0, 5.0, 501))
        found.append(model.inverse_dynamics(motion.q, motion.dq, motion.ddq, values))
    return np.sqrt(np.mean(np.concatenate(found) ** 2, axis=0))


@dataclass(frozen=True, eq=False)
class TorqueMeasure:
    """What wrong parameters mean for torque: relative torque error on a noise-free motion, joint by joint.

    `factors` (n, b, b): ‖factors[j] e‖ is the torque error of joint j for parameter errors e; `size` (n,): norm of its torque."""

    factors: Array
    size: Array

    @classmethod
    def of(cls, exact: Problem) -> TorqueMeasure:
        """From a problem of exact motion."""
        information = exact.information
        return cls(information.factors[:, :-1, :-1], np.sqrt(information.torque_squares()))

    def __call__(self, error: Array) -> float:
        """Relative error, rms over the joints, for parameter errors (b,)."""
        return float(np.sqrt(np.mean(self.shares(error) ** 2)))

    def shares(self, error: Array) -> Array:
        """Relative error (n,) of every joint."""
        return np.asarray(np.linalg.norm(self.factors @ error, axis=1) / self.size)
