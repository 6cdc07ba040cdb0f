"""A leftover as smooth functions of what it follows: which quantity, and how fine a function, by the rule that decides on effects."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...effects.described import DESCRIPTIONS, Described, Turned
from ...effects.kinds import Axis, Need
from ..design.catalogue import Catalogue
from ..thresholds import COMPETES, HALF
from .scores import Scores
from .significance import parametric

if TYPE_CHECKING:
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved
    from .search import EffectSearch

Array = np.ndarray
#: Intervals of a described function that are tried, coarse to fine; laws that are added up at most.
_INTERVALS = (2, 4, 7, 12)
_LAWS = 2
#: Quantities that are compared by a refit, at most.
_TRIED = 4
#: Quantities of effects that are one with a law's.
_SAME = {Axis.POSITION: {Axis.POSITION, Axis.MOTOR_ANGLE}}
#: Share of a quantity's size below which its changes are rounding, of single precision too.
_ROUNDING = 1e-6
#: Effects of one quantity on a joint from which on they are no separate causes.
_SERIES = 3


def describing(fit: Fit, frame: Solved, joints: tuple[str, ...], say: Callable[[str], None]) -> tuple[Described, ...]:
    """Smooth functions on some joints beside a fit's effects; none where nothing left there follows a logged quantity."""
    named = fit.effects
    found: tuple[Described, ...] = ()
    for _ in range(_LAWS):
        best = _best(fit, frame, joints, found)
        if best is None:
            break
        found = (*found, best)
        fit = fit.with_effects((*named, *found))
        frame = fit.solved(2)
        say(f"described: {best.name} on {', '.join(best.joints or ())}")
    return found


def outdone(state: EffectSearch, joint: str) -> bool:
    """Whether one smooth law accounts for more with less than all that is named on a joint.

    A law of the joint's own motion can always do what an effect of that motion does, one of time what a drift does: it speaks against
    several names of its own quantity, or where what is named leaves twice the error (rms) that the law leaves. Three and more of its
    quantity, of more than one name, are the terms of a series: they must leave half the error that the law leaves.

    Both are refits at one noise, by Schwarz's criterion; what a likelihood gains by chance, or by less than what is material, does not
    count."""
    named = [e for e, j in state.accepted if j == (joint,)]
    rest = state.fit.with_effects(tuple(e for e, j in state.accepted if j != (joint,)))
    law = _best(rest, rest.solved(2), (joint,), ())
    if law is None:
        return False
    fit = rest.with_effects((*rest.effects, law))
    frame = fit.solved(2)
    gains = fit.in_band([frame, state.frame])
    robot = state.fit.robot
    more = sum(len(e.parameters(robot)) + len(e.shape()) for e in named) - len(law.parameters(robot))
    gain = state.fit.energy(state.frame, gains) - fit.energy(frame, gains) + np.log(max(frame.rows, 2)) * more
    left = [f.noise(x)[robot.joint_index(joint)] for f, x in ((fit, frame), (state.fit, state.frame))]
    alike = law.own_motion or bool(law.needs & named[0].needs & {Need.TIME})
    if alike and len(named) >= _SERIES and len({e.name for e in named}) > 1 and {e.axis for e in named} <= _SAME.get(law.axis, {law.axis}):
        return bool(HALF * left[0] < left[1])
    if alike and (len(named) == 1 or any(e.axis != law.axis for e in named)):
        return bool(gain > state.critical**2 and left[0] < HALF * left[1])
    return bool(gain > state.critical**2)


def _best(fit: Fit, frame: Solved, joints: tuple[str, ...], taken: tuple[Described, ...]) -> Described | None:
    """The function that accounts best for what is left on some joints: quantity first, then how fine."""
    taken_kinds = {_kind(e) for e in taken}
    coarse = [e for e in _candidates(fit, joints, _INTERVALS[1]) if _kind(e) not in taken_kinds]
    if not coarse:
        return None
    scores = Scores.of(fit, frame, Catalogue.of_effects(fit, [(e, e.joints or ()) for e in coarse]))
    if not len(scores.kept):
        return None
    critical = parametric(scores) + scores.material
    ranked = [k for k in np.argsort(-scores.z).tolist() if scores.z[k] > max(critical, COMPETES * float(scores.z.max()))]
    if not ranked:
        return None
    # Scores are taken at the noise of a model that lacks something: what a refit leaves tells more.
    chosen = _cheapest(fit, [e for k in ranked[:_TRIED] if isinstance(e := scores.group(k).effect, Described)])
    return _cheapest(fit, [e for count in _INTERVALS for e in _candidates(fit, joints, count) if _kind(e) == _kind(chosen)])


def _cheapest(fit: Fit, laws: list[Described]) -> Described:
    """The law of the least cost by Schwarz's criterion, refits at one noise."""
    fits = [fit.with_effects((*fit.effects, e)) for e in laws]
    frames = [f.solved(1) for f in fits]
    gains = [np.max([x.gains[i] for x in frames], axis=0) for i in range(len(fit.runs))]
    # What a parameter must gain grows with the logarithm of the rows.
    each = np.log(max(frames[0].rows, 2))
    cost = [f.energy(x, gains) + each * len(e.parameters(fit.robot)) for f, x, e in zip(fits, frames, laws, strict=True)]
    return laws[int(np.argmin(cost))]


def _kind(law: Described) -> tuple[object, ...]:
    """What it follows and where, however fine."""
    return law.name, law.joints, law.by, law.turned


def _candidates(fit: Fit, joints: tuple[str, ...], intervals: int) -> Iterator[Described]:
    """Functions of every quantity that the joints' torque could follow, with knots over its usual range."""
    robot, motions = fit.robot, fit.motions(instrument=True)
    for joint in joints:
        for kind in DESCRIPTIONS:
            if Need.LOAD in kind.needs and motions[0].load is None:
                continue
            for by in ("", *(j for j in robot.joint_names if kind.elsewhere and j != joint)):
                for turned in Turned:
                    law = kind(joints=(joint,), by=by, turned=turned, label=f"~{kind.what[0]}{by}{turned[0]}")
                    x = np.concatenate([law.quantity(m, robot, robot.joint_index(law.followed)) for m in motions])
                    low, high = np.quantile(x, [0.002, 0.998])
                    # What stands still but for rounding is followed by nothing.
                    if high - low > _ROUNDING * max(abs(low), abs(high)):
                        yield replace(law, knots=tuple(np.linspace(low, high, intervals + 1).tolist()))
