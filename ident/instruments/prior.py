"""A weak inertial prior, for what the data leave open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..model import Model

Array = np.ndarray
#: Sizes of a link that are one standard deviation of the prior.
_WEAK = 3.0


def prior_rows(model: Model) -> Array:
    """A weak inertial prior as rows (k, b) over the model's base parameters: a mass of all that is outboard, at its reach, is one standard
    deviation. Where instruments are weak it keeps parameters finite; where data speak it changes nothing."""
    robot, base = model.robot, model.base
    if robot.nominal is None or robot.floating_base:
        return np.zeros((0, base.count))
    tree = robot.model
    nb = len(robot.nominal) // 10
    table = np.asarray(robot.nominal).reshape(nb, 10)
    mass = np.maximum(np.abs(table[:, 0]), 1e-3)
    lever = np.linalg.norm(table[:, 1:4], axis=1) / mass
    offset = [float(np.linalg.norm(tree.jointPlacements[i + 1].translation)) for i in range(nb)]
    parent = [int(tree.parents[i + 1]) - 1 for i in range(nb)]
    reach, whole = lever + 0.02, mass.copy()
    moment = np.abs(table[:, [4, 6, 9]]).sum(axis=1)
    for i in reversed(range(nb)):
        if parent[i] >= 0:
            whole[parent[i]] += whole[i]
            moment[parent[i]] += moment[i]
            reach[parent[i]] = max(reach[parent[i]], offset[i] + reach[i])
    own = next((part for effect, part in zip(model.effects, model.slices, strict=True) if effect.name == "rigid_body"), None)
    if own is None:
        return np.zeros((0, base.count))
    others = np.delete(np.arange(len(model.parameters)), np.arange(own.start, own.stop))
    found = []
    for place, k in enumerate(base.independent):
        body, symbol = divmod(int(k) - own.start, 10)
        # What a rotor is grouped into has no link's size.
        if own.start <= k < own.stop and body < nb and not np.any(base.regroup[place, others]):
            powers = (whole[body], whole[body] * reach[body], max(whole[body] * reach[body] ** 2, moment[body]))
            size = _WEAK * powers[0 if symbol == 0 else 1 if symbol < 4 else 2]
            row = np.zeros(base.count)
            row[place] = 1.0 / size
            found.append(row)
    return np.array(found).reshape(-1, base.count)
