"""The one decision rule: effects join while a score exceeds what chance and immaterial error explain; the verdict is defined by the set of
models that nothing is left beside."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..thresholds import LEVEL, MOST
from .bursts import at_moments, burst
from .candidates import Kind, best, simpler
from .confidence_set import AcceptedEffect, accepted_effect, competing, drop_unnecessary
from .described import describing, outdone
from .search import REPEATABLE, EffectSearch
from .significance import parametric
from .tones import tone

if TYPE_CHECKING:
    from ...effects.described import Described
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved
    from .scores import Scores

Array = np.ndarray
#: Times that an accepted effect is replaced by a member of its set beside which less is left.
_SWAPS = 3


@dataclass(frozen=True)
class Left:
    """Structure that is left: what it follows, on which joint (or whole robot), and how far beyond chance."""

    name: str
    joints: tuple[str, ...]
    z: float
    named: bool


@dataclass(frozen=True, eq=False)
class Decision:
    """What was decided. `critical`: what the largest score must exceed; `left`: what does so beside the accepted effects, largest first;
    `laws`: smooth functions that describe it."""

    verdict: str
    named: tuple[AcceptedEffect, ...]
    left: tuple[Left, ...]
    critical: float
    fit: Fit
    frame: Solved
    scores: Scores
    trail: tuple[str, ...] = ()
    laws: tuple[Described, ...] = ()


def decide(
    fit: Fit,
    speeds: Array,
    note: Callable[[str], None] | None = None,
    progress: Callable[[float], None] | None = None,
    *,
    level: float = LEVEL,
    most: int = MOST,
) -> Decision:
    """Decide what a fit's model lacks. `speeds` (n,): usual speeds of the motors; `level`: how often chance may do so; `most`: effects that
    are accepted at most (0: it is only told whether something is left)."""
    trail: list[str] = []

    def say(text: str) -> None:
        trail.append(text)
        if note is not None:
            note(text)

    tell = progress or (lambda _: None)
    state = EffectSearch.begun(fit, speeds, level)
    tell(0.3)
    _forward(state, say, lambda share: tell(0.3 + 0.45 * share), most)
    tell(0.75)
    drop_unnecessary(state, say)
    tell(0.85)
    if _swap(state, say):
        drop_unnecessary(state, say)
    _simplify(state, say)
    _replace_impossible(state, say, most)
    tell(0.87)
    _give_way(state, say)
    if most:
        state = _with_one_stretch(state, say, most)
    tell(0.9)
    left = _left(state)
    laws = _described(state, say) if most else ()
    tell(0.95)
    # What is described is told as it was seen before.
    return replace(_decision(state, left if laws else _left(state), tuple(trail)), laws=laws)


def _described(state: EffectSearch, say: Callable[[str], None]) -> tuple[Described, ...]:
    """Smooth functions of what the leftover follows. What they make unnecessary among the accepted was accepted in their place: it goes."""
    joints = [
        g.joints[0] for k in np.flatnonzero(state.scores.z > state.critical).tolist() if len((g := state.scores.group(k)).joints) == 1
    ]
    laws = describing(state.fit, state.frame, tuple(dict.fromkeys(joints)), say) if joints else ()
    # A function of the joint's own motion can always do what an effect of that motion does: only another quantity speaks against a name.
    if not state.accepted or all(law.own_motion for law in laws):
        return laws
    named = list(state.accepted)
    state.accepted += [(law, law.joints or ()) for law in laws]
    state.solve()
    drop_unnecessary(state, say, spared=len(laws))
    state.accepted = [x for x in named if x in state.accepted]
    state.solve()
    return laws


def _forward(
    state: EffectSearch, say: Callable[[str], None], tell: Callable[[float], None], most: int, without: Collection[Kind] = ()
) -> None:
    """Accept effects while a named score is beyond the critical value; `without`: effects that are not tried."""
    refused = {*without, *((e.name, joints) for e, joints in state.accepted if e.name not in REPEATABLE)}
    for step in range(2 * MOST):
        state.calibrate()
        tell(1.0 - 0.6**step)
        say(f"    step {step}: {_told(state)}; critical {state.critical:.1f}")
        found = best(state, refused) if len(state.accepted) < most else None
        if found is None:
            return
        effect, joints = found
        if effect.name not in REPEATABLE:
            refused.add((effect.name, joints))
        state.accept(found)
        state.reprofile()
        say(f"accepted: {effect.name} on {', '.join(joints) or 'the whole robot'}")


def _swap(state: EffectSearch, say: Callable[[str], None]) -> bool:
    """Where something is left, replace an accepted effect by a member of its set beside which nothing is; whether any was."""
    for turn in range(_SWAPS):
        if not state.accepted or state.scores.z.max(initial=0.0) <= state.critical:
            return turn > 0
        adequate = [(m.left, i, m) for i in range(len(state.accepted)) for m in competing(state, i) if not m.same]
        if not adequate:
            return turn > 0
        _, i, member = min(adequate, key=lambda x: x[0])
        say(f"swapped: {state.accepted[i][0].name} for {member.effect.name}")
        state.accepted[i] = (state.labelled(member.effect), member.joints)
        state.solve()
        state.reprofile()
    return True


def _simplify(state: EffectSearch, say: Callable[[str], None]) -> None:
    """Take a simpler effect inside an accepted one that does in its place, now that the others are there: the last one had its choice."""
    for i in range(len(state.accepted) - 1):
        if (found := simpler(state, i)) is None:
            continue
        say(f"simpler: {found[0].name} for {state.accepted[i][0].name}")
        state.accepted[i] = (state.labelled(found[0]), found[1])
        state.solve()
        state.reprofile()


def _replace_impossible(state: EffectSearch, say: Callable[[str], None], most: int) -> None:
    """Retract effects whose values are physically impossible, and search once without them; what that finds is accepted only if nothing is
    left beside it."""
    refused = _retract_impossible(state, say)
    if not refused:
        return
    kept = list(state.accepted)
    _forward(state, say, lambda _: None, most, refused)
    drop_unnecessary(state, say)
    _retract_impossible(state, say)
    if state.accepted != kept and _left(state):
        say("nothing suffices in its place")
        state.accepted = kept
        state.solve()


def _retract_impossible(state: EffectSearch, say: Callable[[str], None]) -> set[Kind]:
    """Retract effects whose values, beside the others, are physically impossible, and two that undo each other: they stood for something
    else. Which were retracted."""
    found: set[Kind] = set()
    while gone := state.impossible():
        names = " and ".join(state.accepted[i][0].name for i in gone)
        say(f"retracted: {names}, {'which undo each other' if len(gone) > 1 else 'whose values are physically impossible'}")
        found.update((state.accepted[i][0].name, state.accepted[i][1]) for i in gone)
        state.accepted = [x for i, x in enumerate(state.accepted) if i not in gone]
        state.solve()
    return found


def _give_way(state: EffectSearch, say: Callable[[str], None]) -> None:
    """Retract what is named on a joint where one smooth law accounts for more with less: it stood for that law."""
    for joints in dict.fromkeys(j for _, j in state.accepted if len(j) == 1):
        named = [x for x in state.accepted if x[1] == joints]
        if outdone(state, joints[0]):
            say(f"retracted: {', '.join(e.name for e, _ in named)} on {joints[0]}: one smooth law accounts for more with less")
            state.accepted = [x for x in state.accepted if x[1] != joints]
            state.solve()


def _with_one_stretch(state: EffectSearch, say: Callable[[str], None], most: int) -> EffectSearch:
    """The search with what one stretch of the log alone shows, if one name accounts for it so well that the whole log, that stretch
    included, shows nothing else; the search as it was where none does.

    What happens once is like many effects for a moment, and is not like any of them to within the noise; several together are like
    anything."""
    if state.scores.z.max(initial=0.0) > state.critical or _of_one_stretch(state) is None:
        return state
    whole = EffectSearch(state.fit, state.catalogue, state.level, list(state.accepted), stretch=0.0)
    whole.solve()
    _forward(whole, lambda _: None, lambda _: None, min(most, len(state.accepted) + 1))
    if len(whole.accepted) > len(state.accepted) and not whole.impossible() and not _left(whole):
        say(f"accepted, seen in one stretch only: {', '.join(e.name for e, _ in whole.accepted[len(state.accepted) :])}")
        return whole
    return state


def _left(state: EffectSearch) -> list[Left]:
    """What is left beside the accepted effects, largest first; where nothing else is, what a single stretch shows, bursts, and tones."""
    scores = state.scores
    own = {(e.name, j) for e, j in state.accepted}
    left = [
        Left(g.name, g.joints, float(scores.z[k]), g.named)
        for k in np.argsort(-scores.z)[:40].tolist()
        if scores.z[k] > state.critical and (g := scores.group(k)).kind not in own
    ]
    if not left and (seen := _of_one_stretch(state)) is not None:
        g = scores.group(seen[0])
        left.append(Left(f"{g.name}, in one stretch of the log only", g.joints, seen[1], False))
    if not left and (found := burst(state.fit, state.frame)) is not None:
        left.append(Left("bursts", (state.fit.robot.joint_names[found[0]],), state.critical, False))
    if not left and (sound := tone(state.fit, state.frame)) is not None:
        left.append(Left(f"a tone of {sound[1]:.3g} Hz", (state.fit.robot.joint_names[sound[0]],), state.critical, False))
    return left


def _of_one_stretch(state: EffectSearch) -> tuple[int, float] | None:
    """The group that the whole log speaks for most beyond chance, though without one stretch of it nothing does, with its z.

    How an accepted effect begins no law says: the moment itself does not count."""
    scores = state.scores
    if not (scores.plain > state.critical).any():
        return None
    # The whole log's scores reach further by chance than those without the stretch that speaks for them most.
    chance = parametric(replace(scores, stretch=0.0), state.level)
    critical = chance + scores.material
    own_rows = scores.self_normalised
    own = {(e.name, j) for e, j in state.accepted}
    kept = ~at_moments(state.fit, state.frame, len(scores.blocks[0]))
    z = scores.of_blocks(kept)
    for k in np.argsort(-z).tolist():
        if z[k] <= critical:
            return None
        if scores.group(k).kind not in own and own_rows[k] > chance:
            return k, float(z[k])
    return None


def _decision(state: EffectSearch, left: list[Left], trail: tuple[str, ...]) -> Decision:
    """The verdict, by definition: something left, nothing accepted, more than one model in the set, or one."""
    named = tuple(accepted_effect(state, i, suffices=not left) for i in range(len(state.accepted)))
    if left:
        verdict = "unexplained"
    elif not named:
        verdict = "clean"
    else:
        verdict = "ambiguous" if any(x.ambiguous for x in named) else "explained"
    return Decision(verdict, named, tuple(left), state.critical, state.fit, state.frame, state.scores, trail)


def _told(state: EffectSearch) -> str:
    """The largest scores, for the trail."""
    order = np.argsort(-state.scores.z)[:5].tolist()
    return ", ".join(f"{state.scores.group(k).name} on {'/'.join(state.scores.group(k).joints)} {state.scores.z[k]:.1f}" for k in order)
