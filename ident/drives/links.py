"""What a drive moves: links with known parameters, with a set of them in each lane, or behind a spring."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np

from .._native.choice import compiled
from ..simulation.rigid import RigidDynamics
from .simulate import LaneDrives, LaneIntegrals, LinkTerms, SingleLink

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


class FreeLinks:
    """Links with a set of parameters (B, 10 nb) in each lane."""

    def __init__(self, robot: Robot, parameters: Array) -> None:
        self.robot, self._lanes = robot, len(parameters)
        # Most lanes of a derivative differ in the drives alone.
        sets, of = np.unique(parameters, axis=0, return_inverse=True)
        lanes = [np.flatnonzero(of.reshape(-1) == i) for i in range(len(sets))]
        self._each = [(at, RigidDynamics(robot, one)) for at, one in zip(lanes, sets, strict=True) if np.isfinite(one).all()]

    def single(self) -> SingleLink | None:
        return _single(self.terms, self._lanes) if self.robot.n == 1 else None

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]:
        lanes, n = q.shape
        # A step of a search may have led out of every number: its lane is lost.
        H, c = np.full((lanes, n, n), np.nan), np.full((lanes, n), np.nan)
        for at, links in self._each:
            H[at], c[at] = links.terms(q[at], dq[at])
        return H, c


class KnownLinks:
    """Links with one set of parameters."""

    def __init__(self, robot: Robot, parameters: Array) -> None:
        self.robot = robot
        self.terms = RigidDynamics(robot, parameters).terms

    def single(self) -> SingleLink | None:
        return _single(self.terms, 1) if self.robot.n == 1 else None


def _single(terms: Callable[[Array, Array], tuple[Array, Array]], lanes: int) -> SingleLink | None:
    """Inertia, factors of sine and cosine (B,) of a single joint's links, None where they are not all (a slide on a slope)."""
    at = [terms(np.full((lanes, 1), x), np.zeros((lanes, 1))) for x in (0.0, 0.5 * np.pi, 1.0)]
    cosine, sine, between = (bias[:, 0] for _, bias in at)
    if not np.allclose(between, np.sin(1.0) * sine + np.cos(1.0) * cosine, rtol=1e-9, atol=1e-12):
        return None
    return SingleLink(at[0][0][:, 0, 0], sine, cosine)


class ElasticLinks:
    """Links of n joints, some of them behind a spring: n motors (and joints without a spring), then the links of the elastic joints.

    `elastic` (m,): their indices; `stiffness`, `twist` (B, m): N m/rad and N m s/rad in each lane. The encoder is the motor's."""

    def __init__(self, links: LinkTerms, n: int, elastic: Array, stiffness: Array, twist: Array) -> None:
        self.links, self.n, self.elastic = links, n, elastic.astype(np.int64)
        self.stiffness, self.twist = np.ascontiguousarray(stiffness), np.ascontiguousarray(twist)
        self.along = np.arange(n)
        self.along[elastic] = n + np.arange(len(elastic))
        self._recursions = compiled("_recursions")  # None: NumPy does the same
        self._links = np.empty((2, len(stiffness), n))
        # Where the links have no part it stays zero, step after step.
        self._inertia = np.zeros((len(stiffness), n + len(elastic), n + len(elastic)))

    @property
    def groups(self) -> list[slice]:
        return [slice(j, j + 1) for j in range(self.n + len(self.elastic))]

    def single(self) -> SingleLink | None:
        alone = getattr(self.links, "single", lambda: None)() if self.n == 1 else None
        return None if alone is None else replace(alone, stiffness=self.stiffness[:, 0], twist=self.twist[:, 0])

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]:
        bias = np.empty(q.shape)
        if self._recursions is not None:
            sizes = len(q), self.n, len(self.elastic)
            self._recursions.links_ahead(q, dq, self.elastic, self._links, *sizes)
            H, c = self.links.terms(self._links[0], self._links[1])
            given = np.ascontiguousarray(H), np.ascontiguousarray(c), q, dq, self.elastic, self.stiffness, self.twist
            self._recursions.behind_springs(*given, self._inertia, bias, *sizes)
            return self._inertia, bias
        H, c = self.links.terms(q[:, self.along], dq[:, self.along])
        self._inertia[:, self.along[:, None], self.along] = H
        bias[:, self.along] = c
        torque = self.stiffness * (q[:, self.elastic] - q[:, self.n :]) + self.twist * (dq[:, self.elastic] - dq[:, self.n :])
        bias[:, self.elastic] = torque
        bias[:, self.n :] -= torque
        return self._inertia, bias

    def resting(self, q: Array) -> Array:
        """Positions (B, n + m) at rest: the links hang by their springs."""
        _, c = self.links.terms(q, np.zeros_like(q))
        return np.concatenate([q, q[:, self.elastic] - c[:, self.elastic] / np.maximum(self.stiffness, 1e-9)], axis=1)

    def widened(self, values: Array, of: Array | None = None) -> Array:
        """Values (..., n) with those of the links behind them: none, or those of the motors `of`."""
        more = np.zeros((*values.shape[:-1], len(self.elastic))) if of is None else values[..., of]
        return np.concatenate([values, more], axis=-1)

    def integrals(self, integrals: LaneIntegrals) -> LaneIntegrals:
        """Those of the motors; the links have none."""
        return LaneIntegrals(*(self.widened(getattr(integrals, part.name)) for part in fields(integrals)))

    def drives(self, drives: LaneDrives) -> LaneDrives:
        """The links have neither drive nor friction of their own."""
        given = {part.name: getattr(drives, part.name) for part in fields(drives)}
        found = {key: self.widened(values) for key, values in given.items() if values is not None}
        for key in ("fall", "slow"):
            found[key][:, self.n :] = 1.0
        found["limit"][:, self.n :] = np.inf
        return LaneDrives(**found)
