"""Intervals by profile likelihood: what a delay can be while everything else follows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._utils.singular_values import pinv
from .nearby import followed
from .plant import DrivePlant, joined
from .search import Fitted
from .uncertainty import Precision

Array = np.ndarray
#: Quantile of χ² with one degree of freedom, and its root: ends of a 95 % interval.
_LEVEL, _REACH = 3.841, 1.96
#: Looks at each side; an end is one where the rise of the cost is that near to its level.
_LOOKS, _NEAR = 8, 0.05
#: Delays up to so many samples beyond the found one are looked at, and by at most so much further from one look to the next.
_FAR, _FURTHER = 40.0, 4.0
#: Steps of the search after which the other unknowns have followed.
_STEPS = 4


def delay_profiles(plant: DrivePlant, found: Fitted, sizes: Array, precision: Precision) -> dict[str, tuple[float, float]]:
    """Name of each unknown delay → ends of its 95 % interval, s; not below zero, inf where the logs set no bound.

    The delay is held beside its estimate and the others are fitted again; the rise of the cost counts as much as the residual's memory
    lets it (Rotnitzky and Jewell, 1990). In a quadratic valley the ends are those of the standard deviation."""
    every = np.arange(len(found.values))
    counted, white = np.diag(precision.covariance(every)), _white(precision)
    out = {}
    for i, unknown in enumerate(plant.unknowns):
        if unknown.place == "delay_s":
            if not (precision.strengths[i] > 0.0 and np.isfinite(counted[i])):
                out[unknown.name] = (0.0, np.inf)
                continue
            side = _Side(plant, found, sizes, precision, i, _LEVEL * float(counted[i] / max(white[i], 1e-300)))
            reach = _REACH * float(precision.scale[i] * np.sqrt(counted[i]))
            far = _FAR * max(log.period for log in plant.logs)
            out[unknown.name] = (side.end(-min(reach, far), far), side.end(min(reach, far), far))
    return out


def _white(precision: Precision) -> Array:
    """Variances (p,) in units of the scale, were the residual white noise of its size."""
    size = np.maximum(precision.strengths, 1e-150)
    return np.diag(pinv(precision.information / np.outer(size, size), rcond=1e-10, hermitian=True)) / size**2


class _Side:
    """The rise of the cost when one delay is held beside its estimate."""

    def __init__(self, plant: DrivePlant, found: Fitted, sizes: Array, precision: Precision, index: int, level: float) -> None:
        self.plant, self.found, self.sizes, self.index, self.level = plant, found, sizes, index, level
        self.others = np.arange(len(found.values)) != index
        others = np.flatnonzero(self.others)
        taken = precision.regrouped(others, np.array([index]))[:, 0]
        self.along = -taken * precision.scale[others] / precision.scale[index]
        # The fit ended in steps of time finer than these: what they change is taken as it is there, or the valley would be another.
        plain = joined(plant.positions(found.values))[0] - np.concatenate([log.q for log in plant.logs])
        self.apart = found.residual - plain
        self.lowest, _ = self._followed(self.value, found.values[self.others])

    @property
    def value(self) -> float:
        return float(self.found.values[self.index])

    def end(self, reach: float, far: float) -> float:
        """Where the cost has risen by its level, from a first look at `value` + `reach` on."""
        away = max(reach, -self.value)
        inside, outside, moved = (0.0, 0.0), None, np.zeros(len(self.along))
        for _ in range(_LOOKS):
            rise, there = self._rise(away, inside[0], moved)
            if rise < self.level:
                if away < 0 and self.value + away <= 0.0:
                    return 0.0
                if abs(away) >= far:
                    return np.inf if away > 0 else 0.0
                inside, moved = (away, rise), there
            else:
                outside = (away, rise)
            if abs(rise / self.level - 1.0) < _NEAR:
                break
            if outside is None:
                step = np.sqrt(self.level / max(rise, self.level / _FURTHER**2))
                away = float(np.clip(away * step, -min(far, self.value), far))
            else:
                # The root of the cost is straight where the valley is quadratic.
                roots = [float(np.sqrt(max(x, 0.0))) for x in (inside[1], self.level, outside[1])]
                share = float(np.clip((roots[1] - roots[0]) / max(roots[2] - roots[0], 1e-300), 0.1, 0.9))
                away = inside[0] + share * (outside[0] - inside[0])
        return max(0.0, self.value + away)

    def _rise(self, away: float, before: float, moved: Array) -> tuple[float, Array]:
        """Rise of the cost, and how far the others (p - 1,) have moved, from where they were at `before`."""
        start = self.found.values[self.others] + (away - before) * self.along + moved
        cost, values = self._followed(self.value + away, start)
        self.lowest = min(self.lowest, cost)
        return cost - self.lowest, values - self.found.values[self.others]

    def _followed(self, delay: float, start: Array) -> tuple[float, Array]:
        weights, sizes = self.found.weights, self.sizes[self.others]
        return followed(self._held(delay), start, sizes, weights, steps=_STEPS, apart=self.apart)

    def _held(self, delay: float) -> DrivePlant:
        law, joint = self.plant.law, self.plant.unknowns[self.index].joint
        own = law.constants["delay_s"].copy()
        own[np.isnan(own) if joint < 0 else [joint]] = delay
        return replace(self.plant, law=replace(law, constants={**law.constants, "delay_s": own}))
