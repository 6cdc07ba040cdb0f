"""Base parameters of a sum of effects: its columns at random states, reduced."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..regressor.base_parameters.reduction import BaseReduction, preference, reduce_columns
from ..robots.reach import reach
from .motion import Motion

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .composed import ComposedModel

Array = np.ndarray

#: States, beside those at any speed, at which every joint is slower than those by up to so many decades: friction near standstill
#: (Stribeck) of a motor behind a large gear is nothing at all at a usual speed of its joint.
_SLOW_STATES = 60
_DECADES = 6.0


def random_motion(robot: Robot, count: int, seed: int = 0) -> Motion:
    """So many states that have nothing to do with each other: positions within the limits, where the robot has them."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(*reach(robot.joints), (count, robot.n))
    return Motion.of(robot, q, rng.normal(size=q.shape) * 2.0, rng.normal(size=q.shape) * 5.0)


def sample_columns(model: ComposedModel, seed: int = 0) -> Array:
    """Columns at random states of all speeds, stacked to (samples * n, k)."""
    robot, count = model.robot, 4 * len(model.parameters) // model.robot.n + 60
    slower = random_motion(robot, _SLOW_STATES, seed + 1).joint
    share = 10.0 ** np.random.default_rng(seed).uniform(-_DECADES, 0.0, slower.dq.shape)
    motions = random_motion(robot, count, seed), Motion.of(robot, slower.q, share * slower.dq, slower.ddq)
    return np.concatenate([model.columns(m).reshape(-1, len(model.parameters)) for m in motions])


def base_reduction(model: ComposedModel, seed: int = 0) -> BaseReduction:
    """Base reduction of the whole model: rigid body, drive train and everything else together.

    Columns that need history or the predicted load cannot be sampled at random states; they count as independent here, and
    the data decide (`Problem.check`)."""
    sampled = [e for e in model.effects if not e.needs]
    parameters = model.parameters
    static = [i for e, s in zip(model.effects, model.slices, strict=True) if any(e is x for x in sampled) for i in range(s.start, s.stop)]
    part = model.of(tuple(sampled))
    names = part.parameters
    found = reduce_columns(sample_columns(part, seed), names, preference(names))
    if len(static) == len(parameters):
        return found
    index = np.array(static, dtype=int)
    rest = [i for i in range(len(parameters)) if i not in set(static)]
    independent = np.array(sorted(index[found.independent].tolist() + rest), dtype=int)
    regroup = np.zeros((len(independent), len(parameters)))
    rows = np.searchsorted(independent, index[found.independent])
    regroup[np.ix_(rows, index)] = found.regroup
    regroup[np.searchsorted(independent, rest), rest] = 1.0
    return BaseReduction(parameters, independent, regroup, index[found.zero], found.gap, found.notes)
