"""What a coupling of gears may be mistaken for: a torque that takes up something of another joint of which the catalogue knows nothing.

A coupling is all that the catalogue has to tie one joint's torque to another's motion, so whatever does so looks like one: a torque sensor
that a cable of another joint pulls at, a current loop that hears its neighbour. A coupling that is one accounts for more than the other
joint's position, speed, acceleration, sense or torque does by itself."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from ...effects.places import motors_of
from .evidence import acts_on
from .stage import with_effects

if TYPE_CHECKING:
    from ...effects.motion import Motion
    from .acceptance import Found
    from .search import Judged
    from .selection import Selection
    from .stage import Stage

Array = np.ndarray
#: What one joint's torque may take up of another joint.
_QUANTITIES = ("position", "speed", "acceleration", "sense", "torque")
#: Logarithm of odds beyond which they are no number any more.
_FARTHEST = 300.0


def cross_terms(found: Found, selection: Selection) -> dict[tuple[str, str, str], float]:
    """Of a coupling that was found the odds against it of each term (quantity of the other joint, joint, other joint): how much likelier it
    makes the data, times its share of all of them. Empty for everything else."""
    if not motors_of(found.effect):
        return {}
    without, own = _beside(found, selection)
    robot = without.problem.model.robot
    at, n = np.flatnonzero(acts_on(own)).tolist(), robot.n
    odds = {}
    for k in range(n):
        raw = _quantities(without, k)
        for j, (what, x) in itertools.product((j for j in at if j != k), zip(_QUANTITIES, raw.T, strict=True)):
            columns = np.zeros((len(raw), n, 1))
            columns[:, j, 0] = x
            score = without.frame.score(without.frame.whitened(columns))
            better = 0.5 * (min(score.heldout, score.fit_gain) - own.evidence)
            odds[what, robot.joint_names[j], robot.joint_names[k]] = float(np.exp(min(better, _FARTHEST)))
    return {key: odd / len(odds) for key, odd in odds.items()}


def _beside(found: Found, selection: Selection) -> tuple[Stage, Judged]:
    """The model of all other findings, and the coupling judged beside it."""
    final = selection.final
    others = [f.effect for f in selection.found if f is not found]
    like = final.search.candidates
    without = with_effects(selection.declared, others, final, final.search.bank, like) if others else selection.declared
    return without, without.search.judge_again(found.judged.hit)


def _quantities(stage: Stage, k: int) -> Array:
    """Position, speed, acceleration, sense and torque of a joint in the rows of a stage (M, 5)."""
    measured = stage.problem.model.robot.transmission.measured

    def of(motion: Motion) -> Array:
        own = motion.joint
        torque = motion.predicted_on(measured)[:, k] if motion.reference is not None else np.zeros(len(own.q))
        return np.column_stack([own.q[:, k], own.dq[:, k], own.ddq[:, k], np.sign(own.dq[:, k]), torque])

    return np.concatenate([block.reduce(of(motion)) for block, motion in stage.motions.parts])
