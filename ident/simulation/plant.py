"""The plant: a model with all its parameter values, and whatever the model does not say."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..effects.force import ForceModel
from ..errors import ConfigurationError
from .compiled import CompiledPlant
from .dynamics import Input, PlantDynamics, State
from .flexible import FlexibleJoints
from .forces import model_terms
from .integrator import begin
from .rigid import require_fixed_base

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Schedule:
    """Parameter values that change at given times: `values` (s+1, k), the i-th from `times[i-1]` until `times[i]` (s,)."""

    times: Array
    values: Array

    def __post_init__(self) -> None:
        times, values = np.asarray(self.times, float).reshape(-1), np.asarray(self.values, float)
        if values.ndim != 2 or len(values) != len(times) + 1 or np.any(np.diff(times) <= 0):
            raise ConfigurationError("a schedule needs rising times (s,) and one row of values more than times, (s+1, k).")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    def piece(self, t: float) -> int:
        """Which row of values holds at time t."""
        return int(np.searchsorted(self.times, t + 1e-12, side="right"))


@dataclass(frozen=True, eq=False)
class Plant:
    """A robot that can be driven: `model` with `values` (k,) of all its linear parameters, or a `Schedule` of them.

    `extra`: forces beside the model, with code and states of their own. `flexible`: joints with elasticity or backlash
    between drive and link. Raises ConfigurationError for wrong shapes or a flexible joint without rotor inertia,
    UnsupportedError for effects that cannot be simulated."""

    model: Model
    values: Array | Schedule
    extra: tuple[ForceModel, ...] = ()
    flexible: FlexibleJoints | None = None
    _dynamics: dict[int, PlantDynamics] = field(default_factory=dict, init=False, repr=False)
    _compiled: dict[int, CompiledPlant | None] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        require_fixed_base(self.robot)
        if not isinstance(self.values, Schedule):
            object.__setattr__(self, "values", np.asarray(self.values, float))
        given = self.schedule.values
        k = len(self.model.parameters)
        if given.shape[1:] != (k,):
            raise ConfigurationError(
                f"the model has {k} parameters, but the values have shape {given.shape[1:]}; base values go through `base.expand` first."
            )
        bad = np.flatnonzero(~np.isfinite(given).all(axis=0))
        if len(bad):
            raise ConfigurationError(f"the value of parameter {self.model.names[bad[0]]!r} is not finite.")

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @cached_property
    def schedule(self) -> Schedule:
        """The values as a schedule, of one piece where they never change."""
        return self.values if isinstance(self.values, Schedule) else Schedule(np.zeros(0), np.asarray(self.values)[None])

    def dynamics(self, t: float = 0.0) -> PlantDynamics:
        """The dynamics that hold at time t."""
        piece = self.schedule.piece(t)
        if piece not in self._dynamics:
            robot, terms, inertial = model_terms(self.model, self.schedule.values[piece], self.extra)
            self._dynamics[piece] = PlantDynamics(robot, terms, inertial, self.flexible)
        return self._dynamics[piece]

    def compiled(self, t: float = 0.0) -> CompiledPlant | None:
        """The same for compiled integration, where it can do all of it."""
        piece = self.schedule.piece(t)
        if piece not in self._compiled:
            self._compiled[piece] = CompiledPlant.of(self.dynamics(t))
        return self._compiled[piece]

    def forward_dynamics(self, q: Array, dq: Array, tau: Array, t: float = 0.0) -> Array:
        """Link accelerations (B, n) at q, dq with torque tau, all (B, n), tau on the measured side.

        Dry friction at rest holds as long as its limits allow."""
        dynamics = self.dynamics(t)
        q, dq, tau = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, tau))
        state: State = dynamics.start(np.full(len(q), t), q, dq)
        return begin(dynamics, state, Input(tau, tau)).response.a[:, : dynamics.n]
