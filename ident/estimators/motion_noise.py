"""What noise in the measured motion does to the regressor: the mean covariance of each row's columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Motion
from ..effects.reference import Reference

if TYPE_CHECKING:
    from ..problem.problem import Problem

Array = np.ndarray


def column_noise(problem: Problem, position: Array, velocity: Array, acceleration: Array, samples: int = 400) -> Array:
    """Roots (n, r, b) of the mean covariance of each measured row's columns: for row j it is D[j]ᵀ D[j].

    `position`, `velocity`, `acceleration` (n,): standard deviations of the joint-side motion that the rows are made of.
    Each coordinate is moved by one deviation either way at samples spread over the log, so that jumps (Coulomb friction near
    reversals) are averaged and not differentiated. Noise of different coordinates counts as independent."""
    s, model = problem.signals, problem.model
    keep = problem.base.independent
    at = np.unique(np.linspace(0, len(s.q) - 1, min(samples, len(s.q))).astype(int))
    # One by one: signals on disk are read by slices only.
    sampled = [np.array([x[i] for i in at.tolist()]) for x in (s.q, s.dq, s.ddq)]
    found = []
    for kind, std in enumerate((position, velocity, acceleration)):
        for j in np.flatnonzero(std):
            ends = []
            for sign in (1.0, -1.0):
                moved = [x.copy() for x in sampled]
                moved[kind][:, j] += sign * std[j]
                motion = Motion.of(model.robot, moved[0], moved[1], moved[2], s.t[at])
                if problem.reference is not None:
                    motion = motion.with_reference(Reference(model, problem.reference))
                ends.append(model.columns(motion)[:, :, keep])
            found.append((ends[0] - ends[1]) / 2.0)
    if not found:
        return np.zeros((problem.valid.shape[1], 0, len(keep)))
    return np.concatenate(found).swapaxes(0, 1) / np.sqrt(len(at))
