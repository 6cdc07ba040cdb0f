"""Nodes from which functions of the joint positions follow exactly: products of trigonometric functions and powers.

Every entry of an energy vector is a combination of a known finite set of functions of the coordinates; with enough well-placed
nodes its coefficients are a linear map of its values there. Whether the nodes suffice is seen from the condition of that map."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..._utils.singular_values import condition, pinv
from ...robots.tree import RigidBodyTree

Array = np.ndarray

#: Larger function spaces are probed at generic nodes instead of being resolved into coefficients.
_MOST_FUNCTIONS = 400
#: Nodes are taken for coefficients only if they lose fewer digits than this.
_WORST_CONDITION = 1e4
#: Nodes (M, d), the map from node values to coefficients (F, M), and whether these are exact.
Nodes = tuple[Array, Array, bool]


def node_sets(tree: RigidBodyTree, bodies: tuple[int, ...], rates: Array) -> Iterator[Nodes]:
    """Nodes for a block of several joints, the best first. `rates` (r, d): joint positions per unit of the coordinates."""
    d = rates.shape[1]
    if d == 0:
        yield np.zeros((1, 0)), np.ones((1, 1)), True
        return
    functions = _functions(tree, bodies, rates)
    turning = np.where(tree.prismatic[list(bodies)][:, None], 0.0, np.abs(rates))
    # One period of the slowest wave of each coordinate; where there are only powers, one unit.
    period = np.array([np.pi / min((w for w in column if w > 0), default=np.pi) for column in turning.T])
    if functions is not None:
        # Powers beside waves are told apart only over several periods, so wider spreads are tried too.
        for spread in (1.0, 2.5, 6.0):
            reach = np.where(turning.any(axis=0), spread, 1.0) * period
            nodes = _spread(3 * len(functions) + 8, d) * reach
            values = np.column_stack([_evaluate(f, nodes, reach) for f in functions])
            if condition(values) < _WORST_CONDITION:
                yield nodes, pinv(values), True
    nodes = _spread(2 * len(bodies) + 40, d) * period
    differences = np.eye(len(nodes))
    differences[1:, 0] = -1.0
    differences[1:] /= np.sqrt(len(nodes))
    yield nodes, differences, False


def _spread(count: int, d: int) -> Array:
    """Points (count, d) spread over (-1, 1)^d: an additive recurrence with the generalised golden ratio."""
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (d + 1))
    steps = root ** -np.arange(1.0, d + 1)
    points: Array = 2.0 * np.modf(0.5 + np.outer(np.arange(1, count + 1), steps))[0] - 1.0
    return points


#: A function of the coordinates: frequency and power per coordinate.
_Function = tuple[tuple[float, ...], tuple[int, ...]]


def _functions(tree: RigidBodyTree, bodies: tuple[int, ...], rates: Array) -> list[_Function] | None:
    """Functions that occur in products of two poses of the block, constant first; None where they are too many."""
    d = rates.shape[1]
    constant: _Function = ((0.0,) * d, (0,) * d)
    pose: dict[int, set[_Function]] = {}
    found: set[_Function] = {constant}
    for i, body in enumerate(bodies):
        if tree.prismatic[body]:
            steps = {constant} | {((0.0,) * d, tuple(int(b == a) for b in range(d))) for a in range(d) if rates[i, a] != 0.0}
        else:
            steps = {constant, (tuple(rates[i]), (0,) * d), (tuple(-rates[i]), (0,) * d)}
        pose[body] = _products(pose.get(int(tree.parent[body]), {constant}), steps)
        if len(pose[body]) > _MOST_FUNCTIONS // 4:
            return None
        found |= _products(pose[body], pose[body])
        if len(found) > 2 * _MOST_FUNCTIONS:
            return None
    half = {f for f in found if f[0] >= tuple(-w for w in f[0])}  # e^{iw} and e^{-iw} give one cosine and one sine
    cosines = sorted(half, key=lambda f: (f != constant, f))
    real: list[_Function] = []
    for frequency, power in cosines:
        real.append((frequency, power))
        if any(frequency):
            real.append((frequency, (*power, -1)))  # the mark -1: the sine
    return real if len(real) <= _MOST_FUNCTIONS else None


def _products(one: set[_Function], other: set[_Function]) -> set[_Function]:
    return {
        (tuple(round(a + b, 9) + 0.0 for a, b in zip(f[0], g[0], strict=True)), tuple(a + b for a, b in zip(f[1], g[1], strict=True)))
        for f, g in product(one, other)
    }


def _evaluate(function: _Function, nodes: Array, reach: Array) -> Array:
    frequency, power = np.array(function[0]), function[1]
    d = nodes.shape[1]
    phase = nodes @ frequency
    wave = np.sin(phase) if len(power) > d else np.cos(phase)
    value: Array = wave * np.prod((nodes / reach) ** np.array(power[:d]), axis=1)
    return value


def _single_revolute() -> Nodes:
    angle = 2.0 * np.pi * np.arange(5) / 5.0
    waves = [np.ones(5), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)]
    return angle[:, None], np.linalg.inv(np.column_stack(waves)), True


def _single_prismatic() -> Nodes:
    at = np.array([0.0, 1.0, -1.0])
    return at[:, None], np.linalg.inv(np.column_stack([np.ones(3), at, at**2])), True


REVOLUTE = _single_revolute()
PRISMATIC = _single_prismatic()
