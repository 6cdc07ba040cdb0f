"""What was asked of the joints: columns of desired motion, assigned to the joints whose motion they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from .channel_group import ChannelGroup, bare_name, known_scale

Array = np.ndarray
_BY_JOINT = re.compile(r"^(?P<joint>.+)\.(?P<word>position|velocity|acceleration)_reference$")
_KEYS = {"position": "q_ref", "velocity": "dq_ref", "acceleration": "ddq_ref"}
#: Another order of the columns is taken only where it halves the distance to the measured positions.
_CLEARER = 0.5


def numbered_reference(name: str, joints: Sequence[str]) -> str:
    """The key (`q_ref3`) of a column of desired motion that goes by its joint (`elbow.position_reference`); "" for another column."""
    found = _BY_JOINT.match(name)
    if found is None or found["joint"] not in joints:
        return ""
    return f"{_KEYS[found['word']]}{list(joints).index(found['joint']) + 1}"


def references(
    found: Sequence[ChannelGroup], q: ChannelGroup, table: Mapping[str, Array], scale: tuple[float, float]
) -> tuple[dict[str, tuple[str, float, float]], tuple[str, ...]]:
    """Desired positions, velocities and accelerations: key (`q_ref1`) → column, factor, offset; and what was noticed.

    A controller may count its joints in another order than the log does: the order is that in which they follow the positions `q`.
    `scale`: (factor, offset) of these."""
    out: dict[str, tuple[str, float, float]] = {}
    notes: tuple[str, ...] = ()
    order = np.arange(len(q.columns))
    for quantity in ("q", "dq", "ddq"):
        wanted = [g for g in found if g.quantity == quantity and g.wanted and not g.estimated and len(g.columns) == len(order)]
        wanted = [g for g in wanted if any(np.nanmax(np.abs(table[c]), initial=0.0) > 0.0 for c in g.columns)]
        if not wanted:
            continue
        g = max(wanted, key=lambda g: len(g.words & q.words))
        told = 1.0 if g.units else known_scale(g.unit) if g.unit else None
        factor, offset = (told, 0.0) if told is not None else (scale[0], scale[1] if quantity == "q" else 0.0)
        if (by_name := _by_name(g, q)) is not None:
            order = by_name
        elif quantity == "q":
            order, notes = _order(g, q, table, factor / scale[0], (offset - scale[1]) / scale[0])
        for j, k in enumerate(order):
            out[f"{quantity}_ref{j + 1}"] = g.columns[int(k)], known_scale(g.units[int(k)]) if g.units else factor, offset
    return out, notes


def _by_name(g: ChannelGroup, q: ChannelGroup) -> Array | None:
    """For each joint, which column of g has its name; None where names do not tell all."""
    own, wanted = ([bare_name(name) for name in group.joints] for group in (q, g))
    if not all(own) or len(set(own)) < len(own) or sorted(own) != sorted(wanted):
        return None
    return np.array([wanted.index(name) for name in own])


def _order(g: ChannelGroup, q: ChannelGroup, table: Mapping[str, Array], factor: float, offset: float) -> tuple[Array, tuple[str, ...]]:
    """For each joint, which column of g follows it; their own order unless another is clearly nearer."""
    n = len(q.columns)
    distance = np.full((n, n), np.inf)
    for j, measured in enumerate(q.columns):
        for k, wanted in enumerate(g.columns):
            error = factor * np.asarray(table[wanted], float) + offset - np.asarray(table[measured], float)
            if np.isfinite(error).any():
                distance[j, k] = np.sqrt(np.nanmean(error**2))
    from scipy.optimize import linear_sum_assignment

    own = np.arange(n)
    if not np.isfinite(distance).all():
        return own, ()
    _, best = linear_sum_assignment(distance)
    if distance[own, best].sum() < _CLEARER * distance[own, own].sum():
        said = f"{g} follow the positions in a different order, and are reordered to match them."
        return best, (said,)
    return own, ()
