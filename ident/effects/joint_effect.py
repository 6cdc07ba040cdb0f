"""An effect that has the same few columns on each joint."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError
from ..robots.parameters import Parameter
from ..robots.transmission import Side
from .base import Effect, accelerated
from .kinds import Factor, Nature
from .motion import Coordinates, Motion

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class JointEffect(Effect):
    """An effect with the same few columns on each joint: torque on joint j depends on joint j's own motion."""

    #: For each column: symbol, unit of the parameter, lower bound (None: there is none). In units, `{tau}`, `{q}`, `{inertia}` stand for
    #: the units of torque, position and inertia, and the names of shape parameters for their values.
    symbols: ClassVar[tuple[tuple[str, str, float | None], ...]]
    #: For each column what it is; empty where one is something else. What is declared here is simulated by compiled code.
    factors: ClassVar[tuple[Factor, ...]] = ()
    #: For each column what it is as a formula of `q`, `dq`, `ddq` (on the effect's side), `load`, `x` (position on the side `angle`) and
    #: the shape parameters, with sgn, abs, exp, sin, cos, sqrt, tanh; empty where it is none. What is declared here is written as code.
    formulas: ClassVar[tuple[str, ...]] = ()

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        found = []
        shape = {p.name: f"{getattr(self, p.name):.6g}" for p in self.shape()}
        for j in self.at(robot):
            q, tau = robot.position_unit(j, self.side), robot.force_unit(j, self.side)
            units = {"q": q, "tau": tau, "inertia": "kg" if q == "m" else "kg m^2", **shape}
            for symbol, unit, lower in self._declared_symbols():
                least = -np.inf if lower is None else lower
                try:
                    own_unit = unit.format(**units)
                except KeyError as error:
                    known = ", ".join(f"{{{name}}}" for name in units)
                    raise ConfigurationError(f"effect {self.name!r}: the unit {unit!r} must hold no other name than {known}.") from error
                found.append(Parameter(self.named(symbol, robot, j), own_unit, self.name, robot.joint_names[j], least))
        return tuple(found)

    @abstractmethod
    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        """For each column its values (N, len(at)) on the joints `at`; `own` is the motion of those on the effect's side."""

    def _declared_symbols(self) -> tuple[tuple[str, str, float | None], ...]:
        """`symbols`; raises ConfigurationError where they are not what they must be."""
        symbols = getattr(self, "symbols", None)
        if not isinstance(symbols, tuple) or not symbols or not all(isinstance(one, tuple) and len(one) == 3 for one in symbols):
            raise ConfigurationError(
                f"effect {self.name!r}: `symbols` must hold (symbol, unit, lower bound) for each column, as in"
                f' symbols = (("F", "{{tau}}", 0.0),), not {symbols!r}.'
            )
        return symbols

    def column_values(self, motion: Motion, at: list[int]) -> list[Array]:
        """For each column its values (N, len(at)) on the joints `at`. Raises ConfigurationError where `basis` gives something else."""
        found = list(self.basis(motion.on(self.side).of(at), motion, at))
        shape = len(motion), len(at)
        if len(found) != len(self.symbols) or any(np.shape(values) not in ((), shape) for values in found):
            raise ConfigurationError(
                f"effect {self.name!r}: `basis` must yield {counted(len(self.symbols), 'array')} of shape {shape} (samples, joints), one"
                " for each of its `symbols`; use yield, not return."
            )
        return found

    def columns(self, motion: Motion, robot: Robot) -> Array:
        at = self.at(robot)
        width = len(self.symbols)
        out, own = np.zeros((len(motion), robot.n, width * len(at))), width * np.arange(len(at))
        for s, values in enumerate(self.column_values(motion, at)):
            out[:, at, own + s] = values
        return out

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        at = self.at(robot)
        out = np.zeros((len(motion), robot.n))
        each = np.asarray(values, float).reshape(len(at), len(self.symbols))
        for s, basis in enumerate(self.column_values(motion, at)):
            out[:, at] += basis * each[:, s]
        return out

    @property
    def declares_factors(self) -> bool:
        """Whether the columns are what `factors` say: a subclass with columns of its own does not inherit what its base declared."""
        kind = type(self)
        if kind.torque is not JointEffect.torque or kind.columns is not JointEffect.columns or self.needs:
            return False
        says, does = (next(k for k in kind.__mro__ if name in vars(k)) for name in ("factors", "basis"))
        return bool(self.factors) and says is does

    def affine(self, motion: Motion, robot: Robot, values: Array) -> tuple[Array, Array | None]:
        if self.needs or self.nature == Nature.SENSOR or type(self).columns is not JointEffect.columns:
            return super().affine(motion, robot, values)
        still = accelerated(motion, robot, np.zeros_like(motion.joint.dq))
        bias = self.torque(still, robot, values)
        if self.declares_factors and Factor.ACCELERATION not in self.factors:
            return bias, None
        # A joint's torque depends on its own acceleration alone; with a factor at hand, everywhere alike.
        if self.declares_factors:
            still = Motion.of(robot, *np.zeros((3, 1, robot.n)))
        own = replace(still.on(self.side), ddq=np.ones_like(still.joint.q))
        moved = replace(still, joint=own) if self.side == Side.JOINT else replace(still, motor=own)
        own_rates = np.eye(robot.n) if self.side == Side.JOINT else robot.transmission.K_inverse
        each = self.torque(moved, robot, values) - (self.torque(still, robot, values) if self.declares_factors else bias)
        return bias, each[:, :, None] * own_rates
