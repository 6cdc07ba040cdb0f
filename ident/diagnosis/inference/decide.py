"""The one decision rule: effects join while a score exceeds what chance and immaterial error explain; the verdict is defined by the set of
models that nothing is left beside."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect, Nature
from ..design.catalogue import Catalogue
from ..design.places import grid, is_order, search_range
from ..thresholds import BOUND, COMPETES, CONTAINED, MATERIAL, MOST
from ..scoring.fit import depends
from .bursts import burst
from .scores import Scores, z_of
from .significance import parametric

if TYPE_CHECKING:
    from ..design.catalogue import Group
    from ..scoring.fit import Fit, Solved

Array = np.ndarray
_FINE = 9
#: Rounds of a shape's refinement at most, and what z must gain by one for the next.
_ROUNDS, _FINER = 5, 0.05
import os; DEBUG=bool(os.environ.get('DBG'))
#: Candidates that are compared by a refit, at most.
_TRIED = 8


@dataclass(frozen=True)
class Member:
    """A model of the confidence set: the effect that could stand in place of an accepted one; `z` beside the rest, `left`: the largest z
    after it. `same`: it has the very columns of the accepted one on this motion, and is the same by another name; `more`: it asks for more
    than the accepted one."""

    effect: Effect
    joints: tuple[str, ...]
    z: float
    left: float
    same: bool = False
    more: bool = False

    @property
    def renamed(self) -> bool:
        """The accepted effect by another name that asks for more: it is told, and makes nothing ambiguous."""
        return self.same and self.more


@dataclass(frozen=True, eq=False)
class AcceptedEffect:
    """An accepted effect, with `z` beside the others, and its competing models."""

    effect: Effect
    joints: tuple[str, ...]
    z: float
    competing: tuple[Member, ...] = ()


@dataclass(frozen=True)
class Left:
    """Structure that is left: what it follows, on which joint (or whole robot), and how far beyond chance."""

    name: str
    joints: tuple[str, ...]
    z: float
    named: bool


@dataclass(frozen=True, eq=False)
class Decision:
    """What was decided. `critical`: what the largest score must exceed; `left`: what does so beside the accepted effects, largest first."""

    verdict: str
    named: tuple[AcceptedEffect, ...]
    left: tuple[Left, ...]
    critical: float
    fit: Fit
    frame: Solved
    scores: Scores
    trail: tuple[str, ...] = ()


@dataclass(eq=False)
class _Decider:
    """The search's state: fit with accepted effects, its frame, and the scores of the catalogue beside it."""

    fit: Fit
    catalogue: Catalogue
    accepted: list[tuple[Effect, tuple[str, ...]]]
    frame: Solved = field(init=False)
    scores: Scores = field(init=False)
    chance: float = field(init=False)

    def solve(self, passes: int = 2) -> None:
        self.fit = self.fit.with_effects(tuple(e for e, _ in self.accepted))
        self.frame = self.fit.solved(passes)
        self.catalogue.updated(self.fit)
        self.scores = Scores.of(self.fit, self.frame, self.catalogue)

    @property
    def slack(self) -> float:
        rows = self.frame.rows * float(self.fit.share[self.fit.share > 0].mean()) if (self.fit.share > 0).any() else self.frame.rows
        return MATERIAL * float(np.sqrt(rows))


def decide(fit: Fit, speeds: Array, note: Callable[[str], None] | None = None, progress: Callable[[float], None] | None = None) -> Decision:
    """Decide what a fit's model lacks. `speeds` (n,): usual speeds of the motors."""
    trail: list[str] = []

    def say(text: str) -> None:
        trail.append(text)
        if note is not None:
            note(text)

    tell = progress or (lambda _: None)
    fit.solved(1)
    state = _Decider(fit, Catalogue.of(fit, speeds), [])
    tell(0.3)
    state.solve()
    refused: set[tuple[str, tuple[str, ...]]] = set()
    tried: dict[tuple[str, tuple[str, ...]], int] = {}
    for step in range(MOST + 1):
        state.chance = parametric(state.scores)
        critical = state.chance + state.slack
        tell(0.3 + 0.6 * (1.0 - 0.6**step))
        best = _best(state, critical, refused)
        say(f"    step {step}: {_told(state)}; critical {critical:.1f}")
        if best is None or step == MOST:
            break
        effect, joints = best
        kind = (effect.name, joints)
        if tried.get(kind, 0) >= 1 and effect.name not in _REPEATABLE:
            refused.add(kind)
            continue
        tried[kind] = tried.get(kind, 0) + 1
        state.accepted.append((effect, joints))
        state.solve()
        if len(state.accepted) > 0:
            _reprofile(state)
        say(f"accepted: {effect.name} on {', '.join(joints) or 'the whole robot'}")
    state.chance = parametric(state.scores)
    critical = state.chance + state.slack
    tell(0.75)
    _backward(state, critical, say)
    tell(0.85)
    sets = [_confidence_set(state, one, critical) for one in state.accepted]
    for _ in range(3):
        if not state.accepted or state.scores.z.max(initial=0.0) <= critical:
            break
        adequate = [(m.left, i, m) for i, s in enumerate(sets) for m in s if m.left <= critical and not m.same]
        if not adequate:
            break
        _, i, member = min(adequate, key=lambda x: x[0])
        say(f"swapped: {state.accepted[i][0].name} for {member.effect.name}")
        state.accepted[i] = (_labelled(member.effect, state), member.joints)
        state.solve()
        _reprofile(state)
        sets = [_confidence_set(state, one, critical) for one in state.accepted]
    tell(0.95)
    return _decision(state, sets, critical, tuple(trail))


#: Effects of which a joint may have several: one for each order.
_REPEATABLE = frozenset({"cogging", "torque_ripple", "gear_coupling", "position_dependent_friction"})


def _decision(state: _Decider, sets: list[tuple[Member, ...]], critical: float, trail: tuple[str, ...]) -> Decision:
    scores = state.scores
    own = {(e.name, j) for e, j in state.accepted}
    order = np.argsort(-scores.z)
    left = [
        Left(g.name, g.joints, float(scores.z[k]), g.named)
        for k in order[:40].tolist()
        if scores.z[k] > critical and (g := scores.group(k)).kind not in own
    ]
    if (found := burst(state.fit, state.frame)) is not None and not left:
        left.append(Left("bursts", (state.fit.robot.joint_names[found[0]],), critical, False))
    named = []
    for (effect, joints), members in zip(state.accepted, sets, strict=True):
        inside = tuple(m for m in members if m.left <= critical)
        named.append(AcceptedEffect(effect, joints, _own_z(state, effect, joints), inside))
    if left:
        verdict = "unexplained"
    elif not named:
        verdict = "clean"
    else:
        verdict = "ambiguous" if any(not m.renamed for x in named for m in x.competing) else "explained"
    return Decision(verdict, tuple(named), tuple(left), critical, state.fit, state.frame, scores, trail)


def _own_z(state: _Decider, effect: Effect, joints: tuple[str, ...]) -> float:
    """z of an accepted effect beside the others, at the noise of the whole model."""
    fit = state.fit.with_effects(tuple(e for e, _ in state.accepted if e is not effect))
    frame = fit.behind(state.frame.gains)
    scores = Scores.of(fit, frame, Catalogue.of_effects(state.fit, [(effect, joints)]))
    return float(scores.plain[0]) if len(scores.kept) else 0.0


def _told(state: _Decider) -> str:
    order = np.argsort(-state.scores.z)[:5].tolist()
    return ", ".join(f"{state.scores.group(k).name} on {'/'.join(state.scores.group(k).joints)} {state.scores.z[k]:.1f}" for k in order)


def _best(state: _Decider, critical: float, refused: set[tuple[str, tuple[str, ...]]]) -> tuple[Effect, tuple[str, ...]] | None:
    """The effect that accounts best for what is left: of those whose scores come near the largest, by a refit with each.

    Scores are taken at the noise of a model that lacks something, and so are compressed: what a refit leaves tells more."""
    trials = [_trial(state, g) for g in _candidates(state, critical, refused)]
    if len(trials) < 2:
        return (trials[0].effect, trials[0].joints) if trials else None
    # One noise for all: the least that any of them leaves, at each frequency.
    gains = [np.max([t.frame.gains[i] for t in trials], axis=0) for i in range(len(state.fit.runs))]
    trials = [dataclasses.replace(t, cost=t.fit.energy(t.frame, gains) / 2.0) for t in trials]
    # What a likelihood gains by chance, or by less than what is material, does not decide.
    least = min(t.cost for t in trials)
    level = [t for t in trials if t.cost <= least + critical**2 / 2.0]
    if len(level) > 1:
        level = [dataclasses.replace(t, left=_left(state, t)) for t in level]
    if DEBUG:
        print("      trials", [(t.effect.name, t.joints, round(t.cost - least, 1), round(t.left, 1), t.rank, {p.name: round(getattr(t.effect, p.name), 3) for p in t.effect.shape()}) for t in level + trials])
    best = min(level, key=lambda t: (t.left > critical, *t.rank, t.cost))
    return best.effect, best.joints


def _candidates(state: _Decider, critical: float, refused: set[tuple[str, tuple[str, ...]]]) -> list[Group]:
    """Named groups beyond the critical value that come near the largest score, the best of each effect at each place: of those of the
    largest scores, and of those beside which the least is left."""
    scores, found, top = state.scores, {}, 0.0
    for k in np.argsort(-scores.z).tolist():
        g = scores.group(k)
        if scores.z[k] <= critical or scores.plain[k] < COMPETES * top:
            break
        if g.named and g.kind not in refused and g.kind not in found and not _impossible(state, k):
            found[g.kind] = k
            top = max(top, float(scores.plain[k]))
    every = list(found.values())
    if len(every) > 2 * _TRIED:
        every = every[: 2 * _TRIED]
    if len(every) <= _TRIED:
        return [scores.group(k) for k in every]
    left = {k: float(scores.beside(scores.slice_of(k))[0].max(initial=0.0)) for k in every}
    # Of those alike, those that ask for less come first.
    ranked = sorted(every, key=lambda k: (round(left[k], 1), _rank(scores.group(k))))
    chosen = list(dict.fromkeys([*every[: _TRIED // 2], *ranked]))[:_TRIED]
    return [scores.group(k) for k in chosen]


@dataclass(frozen=True)
class _Trial:
    """A candidate after a refit with it: `rank`: how much it asks for; `cost` of what it leaves, in units of a log-likelihood; `left`: the
    largest score beside it."""

    effect: Effect
    joints: tuple[str, ...]
    rank: tuple[int, bool, int]
    fit: Fit
    frame: Solved
    cost: float = 0.0
    left: float = 0.0


def _trial(state: _Decider, group: Group) -> _Trial:
    effect, joints = _refined(state, group)
    effect = _labelled(effect, state)
    fit = state.fit.with_effects((*(e for e, _ in state.accepted), effect))
    # Columns that depend on what the model predicts settle in a few passes.
    return _Trial(effect, joints, _rank(group), fit, fit.solved(3 if depends(effect) else 1))


def _rank(group: Group) -> tuple[int, bool, int]:
    """How much an effect asks for: parameters, friction (which acts only where something moves), what it needs to know."""
    effect = group.effect
    assert effect is not None
    return len(group.columns) + len(effect.shape()), effect.nature == Nature.FRICTION, len(effect.needs)


def _left(state: _Decider, trial: _Trial) -> float:
    """The largest score beside a candidate."""
    return float(Scores.of(trial.fit, trial.frame, state.catalogue).z.max(initial=0.0))


def _impossible(state: _Decider, k: int, scores: Scores | None = None) -> str:
    """Why the values that a group would have cannot be those of such an effect; "" if they can."""
    scores = state.scores if scores is None else scores
    effect, robot = scores.group(k).effect, state.fit.robot
    assert effect is not None
    values, std = scores.values(k)
    for p, v, s in zip(effect.parameters(robot), values, std, strict=True):
        if v < p.lower - BOUND * s or v > p.upper + BOUND * s:
            return f"{p.name} = {v:.3g}"
    return effect.implausible(robot, values, std)


def _labelled(effect: Effect, state: _Decider) -> Effect:
    """The effect under a label that keeps its parameters apart from those of the accepted ones."""
    taken = {p.name for e, _ in state.accepted for p in e.parameters(state.fit.robot)}
    while any(p.name in taken for p in effect.parameters(state.fit.robot)):
        effect = dataclasses.replace(effect, label=f"{effect.label}+")
    return effect


def _squares(state: _Decider, effects: list[Effect], joints: tuple[str, ...]) -> Array:
    """Score (z) of each effect in a list, beside the state's frame."""
    scores = Scores.of(state.fit, state.frame, Catalogue.of_effects(state.fit, [(e, joints) for e in effects]))
    out = np.zeros(len(effects))
    for z, k in zip(scores.plain, scores.kept, strict=True):
        out[k] = z
    return out


def _refined(state: _Decider, group: Group) -> tuple[Effect, tuple[str, ...]]:
    """The effect of a group at the shape that scores best, sought between the neighbours of the grid."""
    assert group.effect is not None
    effect = group.effect
    if is_order(effect) and not _on_a_slide(effect, state):
        return effect, group.joints  # whole orders: there is nothing between
    if not effect.shape() or (effect.response(state.fit.robot) is not None and any(getattr(effect, p.name) == 0.0 for p in effect.shape())):
        return effect, group.joints
    ranges = search_range(effect, state.fit.declared, state.fit.motions(instrument=True))
    first = effect.shape()[0].name
    points = len({getattr(g.effect, first) for g in state.catalogue.groups if g.kind == group.kind and g.effect is not None})
    width = 1.0 / max(points - 1, 1)
    last = 0.0
    for _ in range(_ROUNDS):
        for p in effect.shape():
            low, high = ranges[p.name]
            log = p.log and low > 0
            a, b = (np.log(low), np.log(high)) if log else (low, high)
            at = np.log(getattr(effect, p.name)) if log else getattr(effect, p.name)
            lo, hi = max(a, at - width * (b - a)), min(b, at + width * (b - a))
            trial = np.linspace(lo, hi, _FINE)
            values = np.exp(trial) if log else trial
            values = np.clip(values, p.lower, p.upper)
            options = [effect.with_shape(**{p.name: float(v)}) for v in values]
            found = _squares(state, options, group.joints)
            effect = options[int(np.argmax(found))]
        if found.max() < last + _FINER:
            break
        last = float(found.max())
        width /= 3.0
    return effect, group.joints


def _on_a_slide(effect: Effect, state: _Decider) -> bool:
    """An order's positions are those of a slide, where no order is whole."""
    robot = state.fit.robot
    return robot.position_unit(effect.at(robot)[0], getattr(effect, "angle", effect.side)) != "rad"


def _reprofile(state: _Decider) -> None:
    """Shapes of all accepted effects anew, each beside the others."""
    for i, (effect, joints) in enumerate(list(state.accepted)):
        if not effect.shape() or effect.response(state.fit.robot) is not None:
            continue
        if len(state.accepted) == 1 and effect.name in _REPEATABLE:
            continue
        others = [x for k, x in enumerate(state.accepted) if k != i]
        trial = _Decider(state.fit.with_effects(tuple(e for e, _ in others)), state.catalogue, others)
        trial.frame = trial.fit.behind(state.frame.gains)
        motions = trial.fit.motions(instrument=True)
        options = [effect, *(grid(effect, state.fit.declared, motions, 13 if len(effect.shape()) == 1 else 4))]
        best = options[int(np.argmax(_squares(trial, options, joints)))]
        g = next(x for x in Catalogue.of_effects(trial.fit, [(best, joints)]).groups)
        refined, _ = _refined(trial, g)
        state.accepted[i] = (dataclasses.replace(refined, label=effect.label), joints)
    state.solve()


def _backward(state: _Decider, critical: float, say: Callable[[str], None]) -> None:
    """Drop what the others make unnecessary, at the noise of the whole model: one that lacks an effect would hide it in its own."""
    while len(state.accepted) > 1:
        worst: tuple[float, int] | None = None
        for i in range(len(state.accepted)):
            top = float(_without(state, i).z.max(initial=0.0))
            if top <= critical and (worst is None or top < worst[0]):
                worst = (top, i)
        if worst is None:
            break
        say(f"dropped: {state.accepted[worst[1]][0].name}")
        del state.accepted[worst[1]]
        state.solve()


def _without(state: _Decider, i: int) -> Scores:
    """Scores beside a model without the i-th accepted effect, at the noise, and with the columns, of the model with it."""
    fit = state.fit.with_effects(tuple(e for k, (e, _) in enumerate(state.accepted) if k != i))
    return Scores.of(fit, fit.behind(state.frame.gains), state.catalogue)


def _confidence_set(state: _Decider, one: tuple[Effect, tuple[str, ...]], critical: float) -> tuple[Member, ...]:
    """Effects that could stand in the place of an accepted one, each with what is left beside it."""
    effect, joints = one
    scores, own = _without(state, next(i for i, x in enumerate(state.accepted) if x is one)), (effect.name, joints)
    mine = [k for k in range(len(scores.kept)) if scores.group(k).kind == own]
    z = scores.plain
    top = float(z[scores.named].max(initial=0.0))
    found: dict[tuple[str, tuple[str, ...]], Member] = {}
    for k in np.argsort(-z).tolist():
        if z[k] < critical or z[k] < COMPETES * top:
            break
        g = scores.group(k)
        if scores.z[k] < critical:
            continue  # it would not have been accepted itself
        if g.effect is None or g.kind == own or _impossible(state, k, scores):
            continue
        beside, energy = scores.beside(scores.slice_of(k))
        left = float(beside.max(initial=0.0))
        if mine:
            nearest = mine[int(np.argmax(z[mine]))]
            after = float(beside[nearest])
            own_energy = scores.beside(scores.slice_of(nearest))[1]
            if energy[nearest] < CONTAINED and own_energy[k] < CONTAINED and scores.degrees[k] == scores.degrees[nearest]:
                more = _rank(g) > _rank(scores.group(nearest))
                found.setdefault(g.kind, Member(g.effect, g.joints, float(z[k]), left, same=True, more=more))
                continue
            if energy[nearest] < CONTAINED or own_energy[k] < CONTAINED:
                continue  # a more general form of the same, or a simpler one
            if after > state.chance:
                left = max(left, critical + after - state.chance)
        if g.kind not in found or left < found[g.kind].left:
            found[g.kind] = Member(g.effect, g.joints, float(z[k]), left)
    return tuple(sorted(found.values(), key=lambda m: m.left))
