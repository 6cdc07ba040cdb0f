"""Velocities that stand beside positions of our own names under another (`qd1`, `vel_1`): taken where they are the positions' rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .channel_group import ChannelGroup, known_scale
from .channels import groups
from .column_plan import ColumnPlan
from .names import KEYS, QUANTITIES, Column
from .source import TableSource

Array = np.ndarray
#: Correlation with the change of position from which on a channel is its rate, and how near to 1 the two sizes' ratio then is.
_WITH, _NEAR = 0.8, 0.25
#: Samples over which positions change.
_STEPS = (1, 4, 16, 64)
#: Columns named in a note.
_SHOWN = 3


def with_rates(plan: ColumnPlan, source: TableSource) -> ColumnPlan:
    """The plan with the velocities of its positions, where they are there by another name; what is not taken is said."""
    own, times = plan.quantity("q"), plan.quantity("t")
    if len(own) < plan.n or not times or plan.quantity("dq") or plan.quantity("dq_motor"):
        return plan
    units = dict(zip(source.header.names, source.header.units, strict=False))
    likely = [g for g in groups(plan.extra, None, units) if g.quantity == "dq" and len(g.columns) == plan.n]
    likely = [g for g in likely if not (g.wanted or g.estimated or g.of_motors or g.unread)]
    if not likely:
        return plan
    table = source.read(list(dict.fromkeys([*(c.source for c in (*times, *own)), *(x for g in likely for x in g.columns)])), ())
    arrays = replace(plan, columns=(*times, *own), wanted=()).arrays(table)
    notes = list[str]()
    for g in sorted(likely, key=lambda g: (g.computed, not g.measured)):
        scales = [known_scale(u) for u in g.units] or [known_scale(g.unit) if g.unit else own[0].scale] * plan.n
        values = np.column_stack([np.asarray(table[c], float) * k for c, k in zip(g.columns, scales, strict=True)])
        ratio = velocity_ratio(arrays["t"], arrays["q"], values)
        if abs(np.log(ratio)) < _NEAR:
            named = [Column(c, "dq", j, k) for j, (c, k) in enumerate(zip(g.columns, scales, strict=True))]
            columns = sorted((*plan.columns, *named), key=lambda c: (QUANTITIES.index(c.quantity), c.joint))
            said = f"{plan.where}: {_listed(g)} are the velocities of the positions, and are read as such."
            extra = tuple(name for name in plan.extra if name not in g.columns)
            return replace(plan, columns=tuple(columns), extra=extra, notes=(*plan.notes, *notes, said))
        notes.append(f"{plan.where}: {_listed(g)} {_why_not(g, ratio, arrays['q'], values)}")
    return replace(plan, notes=(*plan.notes, *notes))


def velocity_ratio(t: Array, q: Array, dq: Array) -> float:
    """How many times the change of position per second, (N, n) both, a velocity is; NaN where they have nothing to do with each other."""
    ratios = [_joint_ratio(t, q[:, j], dq[:, j]) for j in range(q.shape[1])]
    told = [ratio for ratio in ratios if ratio is not None]
    return float(np.median(told)) if told else np.nan


def _joint_ratio(t: Array, q: Array, dq: Array) -> float | None:
    """That of one joint, over steps of the length that shows it best: of noisy positions a long one; None where nothing moves."""
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1]) * np.diff(t))])
    best, found = -1.0, None
    for k in (k for k in _STEPS if len(t) > 20 * k):
        time = t[k:] - t[:-k]
        time = np.where(time > 0, time, np.nan)
        rate, logged = (q[k:] - q[:-k]) / time, (summed[k:] - summed[:-k]) / time
        known = np.isfinite(rate) & np.isfinite(logged)
        if known.sum() < 10 or np.ptp(logged[known]) == 0 or np.ptp(rate[known]) == 0:
            continue
        with_it = float(np.corrcoef(rate[known], logged[known])[0, 1])
        if with_it > best:
            best, found = with_it, float(np.sqrt(np.mean(logged[known] ** 2) / np.mean(rate[known] ** 2)))
    return None if found is None else found if best >= _WITH else np.nan


def _why_not(g: ChannelGroup, ratio: float, q: Array, values: Array) -> str:
    key = f'{KEYS["dq"]}1 = {{ column = "{g.columns[0]}", scale = … }} …'
    if np.isfinite(ratio):
        return f"are {ratio:.3g} times the velocities, and are not used; if they are velocities, map them under [columns]: {key}."
    with np.errstate(invalid="ignore"):
        apart = np.sqrt(np.nanmean((values - q) ** 2)) if np.isfinite(values - q).any() else np.inf
        spread = np.sqrt(np.nanmean((q - np.nanmean(q, axis=0)) ** 2))
    if apart < 0.5 * spread:
        return "follow the positions themselves, not their change, and are not used; if they are desired positions, name them q_ref1 …."
    return "are not the velocities of these positions, whatever their name says, and are not used."


def _listed(g: ChannelGroup) -> str:
    shown: Sequence[str] = g.columns[:_SHOWN]
    return ", ".join(map(repr, shown)) + (" …" if len(g.columns) > len(shown) else "")
