"""The set of models that data do not tell apart: what could stand in the place of an accepted effect, and what the others make
unnecessary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..design.catalogue import Catalogue
from ..thresholds import COMPETES, CONTAINED
from .candidates import parameters, rank, tried
from .search import REPEATABLE

if TYPE_CHECKING:
    from ...effects.base import Effect
    from .scores import Scores
    from .search import EffectSearch

#: Kinds of effects that are tried by refits in the place of an accepted one, at most.
_REFINED = 3


@dataclass(frozen=True)
class Member:
    """A model of the confidence set: the effect that could stand in place of an accepted one; `z` beside the rest, `left`: the largest z
    after it. `same`: it has the very columns of the accepted one on this motion, and is the same by another name; `more`: it asks for more
    than the accepted one, by `extra` parameters; `needless`: it makes nothing ambiguous, since it asks for more and tells no more."""

    effect: Effect
    joints: tuple[str, ...]
    z: float
    left: float
    same: bool = False
    more: bool = False
    extra: int = 0
    needless: bool = False

    @property
    def renamed(self) -> bool:
        """The accepted effect by another name that asks for more."""
        return self.same and self.more

    def beside(self, z: float, rows: int) -> Member:
        """The member beside the accepted effect of this z: needless if it is the same by a name that asks for more, or if what its further
        parameters add is no more than parameters of nothing do (G. Schwarz, "Estimating the dimension of a model", Annals of Statistics
        6(2), 1978)."""
        adds = self.z**2 - z**2
        return replace(self, needless=self.renamed or (self.extra > 0 and adds <= self.extra * float(np.log(rows))))


@dataclass(frozen=True, eq=False)
class AcceptedEffect:
    """An accepted effect, with `z` beside the others, and its competing models."""

    effect: Effect
    joints: tuple[str, ...]
    z: float
    competing: tuple[Member, ...] = ()

    @property
    def ambiguous(self) -> bool:
        """Whether another model could be what acts in its place."""
        return any(not m.needless for m in self.competing)


def drop_unnecessary(state: EffectSearch, say: Callable[[str], None], spared: int = 0) -> None:
    """Drop what the others make unnecessary, at the noise of the whole model: one that lacks an effect would hide it in its own. The last
    `spared` ones stay. Where something is left in any case, what goes leaves no more than that."""
    while len(state.accepted) > spared:
        limit = max(state.critical, float(state.scores.z.max(initial=0.0)))
        unseen = [i for i in range(len(state.accepted) - spared) if own_score(state, i)[0] <= state.critical]
        tops = {i: float(state.without(i).z.max(initial=0.0)) for i in unseen}
        least = min(tops, key=lambda i: tops[i], default=-1)
        if least < 0 or tops[least] > limit:
            return
        say(f"dropped: {state.accepted[least][0].name}")
        del state.accepted[least]
        state.solve()


def accepted_effect(state: EffectSearch, i: int, *, suffices: bool) -> AcceptedEffect:
    """The i-th accepted effect with its score beside the others, and what could stand in its place; `suffices`: nothing is left beside all
    of them. Where something is, what leaves no more does as well, and no other is refitted at its best."""
    effect, joints = state.accepted[i]
    limit = max(state.critical, float(state.scores.of_noise_alone.z.max(initial=0.0)))
    members = competing(state, i, limit)
    others = _at_their_best(state, i, members, limit) if suffices else []
    _, z = own_score(state, i)
    return AcceptedEffect(effect, joints, z, tuple(m.beside(z, state.frame.rows) for m in (*members, *others)))


def own_score(state: EffectSearch, i: int) -> tuple[float, float]:
    """z of the i-th accepted effect beside the others, at the noise of the whole model: without the stretch that speaks for it most, and
    with it."""
    fit = state.fit_without(i)
    own = state.scored(fit, fit.behind(state.frame.gains), Catalogue.of_effects(state.fit, [state.accepted[i]]))
    return (float(own.z[0]), float(own.plain[0])) if len(own.kept) else (0.0, 0.0)


def competing(state: EffectSearch, i: int, limit: float | None = None) -> tuple[Member, ...]:
    """Effects that could stand in the place of the i-th accepted one, so that nothing is left beside them, or nothing beyond a `limit`.

    They are put in its place to first order. Those that have its very columns stand or fall with it. Friction that is never quite constant
    is left beside any of them: what one leaves counts in units of noise alone, against the limit of what all leave."""
    limit = state.critical if limit is None else limit
    effect, joints = state.accepted[i]
    scores, own = state.without(i).of_noise_alone, (effect.name, joints)
    # A joint does not have one effect twice.
    taken = {own, *((e.name, at) for e, at in state.accepted if e.name not in REPEATABLE)}
    mine = [k for k in range(len(scores.kept)) if scores.group(k).kind == own]
    z = scores.plain
    nearest = mine[int(np.argmax(z[mine]))] if mine else None
    top = float(z[scores.named].max(initial=0.0))
    found: dict[tuple[str, tuple[str, ...]], Member] = {}
    for k in np.argsort(-z).tolist():
        if z[k] < state.critical or z[k] < COMPETES * top:
            break
        g = scores.group(k)
        if scores.z[k] < state.critical or not g.named or g.kind in taken or not state.possible(scores, k):
            continue
        member = _member(state, scores, k, nearest)
        if member is None or not (member.same or member.left <= limit):
            continue
        if g.kind not in found or member.left < found[g.kind].left:
            found[g.kind] = member
    return tuple(sorted(found.values(), key=lambda m: m.left))


def _at_their_best(state: EffectSearch, i: int, members: tuple[Member, ...], limit: float) -> list[Member]:
    """Others that could stand in the place of the i-th accepted effect at shapes of their own between those of the catalogue, by refits."""
    own = state.accepted[i]
    known = {(m.effect.name, m.joints) for m in members} | {(own[0].name, own[1])}
    others = state.apart_from(i)
    near: dict[tuple[str, tuple[str, ...]], int] = {}
    for k in np.argsort(-others.scores.plain).tolist():
        g = others.scores.group(k)
        if others.scores.plain[k] < max(COMPETES * float(others.scores.plain.max()), state.critical) or len(near) >= _REFINED:
            break
        if g.effect is not None and g.joints == own[1] and g.effect.shape() and g.kind not in known and others.scores.z[k] > state.critical:
            near.setdefault(g.kind, k)
    found = []
    for k in near.values():
        trial = tried(others, others.scores.group(k))
        frame = trial.fit.behind(state.frame.gains)
        left = float(others.scored(trial.fit, frame).of_noise_alone.z.max(initial=0.0))
        beside = state.scored(trial.fit, frame, Catalogue.of_effects(trial.fit, [own]))
        if left <= limit and beside.plain.max(initial=0.0) <= state.chance:
            extra = parameters(trial.effect, state.fit.robot) - parameters(own[0], state.fit.robot)
            found.append(Member(trial.effect, trial.joints, float(others.scores.plain[k]), left, extra=extra))
    return found


def _member(state: EffectSearch, scores: Scores, k: int, nearest: int | None) -> Member | None:
    """The k-th group in the place of an accepted effect (`nearest`: its own group); None for a more general or a simpler form of it, and
    for nearly its columns where it still adds something beside them."""
    g = scores.group(k)
    assert g.effect is not None
    beside, energy = scores.beside(scores.slice_of(k))
    left = float(beside.max(initial=0.0))
    if nearest is None:
        return Member(g.effect, g.joints, float(scores.plain[k]), left)
    extra = rank(g)[0] - rank(scores.group(nearest))[0]
    other = scores.beside(scores.slice_of(nearest))[1]
    inside, around = energy[nearest] < CONTAINED, other[k] < CONTAINED
    after = float(beside[nearest])
    if inside and around and scores.degrees[k] == scores.degrees[nearest] and after <= state.chance:
        return Member(g.effect, g.joints, float(scores.plain[k]), left, True, rank(g) > rank(scores.group(nearest)), extra)
    if inside or around:
        return None
    # What the accepted effect still adds after it counts as left.
    if after > state.chance:
        left = max(left, state.critical + after - state.chance)
    return Member(g.effect, g.joints, float(scores.plain[k]), left, extra=extra)
