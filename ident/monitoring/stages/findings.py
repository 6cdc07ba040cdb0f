"""Findings: what was accepted, in the terms of the answer, with confidence; and the verdict on the whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...diagnosis.result import Finding, FoundParameter, Imitator, Unexplained
from ...effects.base import Effect
from ...effects.kinds import Axis, Need
from ...robots.transmission import Side
from .acceptance import Found
from .cross_terms import cross_terms
from .evidence import acts_on
from .leftover import Leftover
from .precision import found_parameters, support
from .search import Judged
from .selection import Place, Selection
from .stage import Stage

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray
#: With a finding that is less likely than this nothing is explained for sure.
LIKELY = 0.5
#: Rivals less probable than this are not worth a word.
_NAMED = 0.01
#: Rivals that are told for what they would take up, however improbable: so many, of at least this share of the finding's evidence, and
#: only one that takes up more than a simpler one does, which has this share of it.
_TOLD = 3
_SHARE = 0.2
_AS_MUCH = 0.9
#: A finding is trusted no further than this: the catalogue may lack the true one.
_MOST = 0.99
#: Share of its confidence that a finding keeps beside something larger that nothing explains; and that it keeps at least beside what is
#: left of little evidence.
_OVERSHADOWED = 0.3
_BESIDE_LITTLE = 0.4
#: So many at one place are taken by their names; one that makes up less than this share of another which follows the position as well is a
#: part of that one's law, unless it is a ripple of so many radians a radian.
_TOGETHER = 2
_SMALL = 0.05
_RIPPLE = 20.0
#: Signature of what was found in the data fitted and is not borne out by those held out.
HELD_OUT = "held-out data"


def assess(selection: Selection, left: Sequence[Leftover]) -> tuple[str, tuple[Finding, ...], tuple[Unexplained, ...]]:
    """Verdict, findings (the strongest first) and what stays unexplained."""
    robot = selection.final.problem.model.robot
    counted = [x for x in left if x.counts]
    parameters = found_parameters(selection.final, [f.effect for f in selection.found])
    each = [_finding(f, own, selection, left) for f, own in zip(selection.found, parameters, strict=True)]
    findings = sorted(each, key=lambda f: -_strength(selection.final, f))
    unexplained = (*_told(counted, robot), *_drawn(selection.found, robot))
    if unexplained:
        verdict = "unexplained"
    elif any(f.ambiguous or f.confidence < LIKELY for f in findings):
        verdict = "ambiguous"
        # What took their confidence from them is told, little as it is.
        unexplained = _told([x for x in left if x.weight >= 1.0], robot)
    else:
        verdict = "explained" if findings else "clean"
    return verdict, tuple(findings), unexplained


def _told(left: Sequence[Leftover], robot: Robot) -> tuple[Unexplained, ...]:
    names = robot.joint_names
    return tuple(Unexplained(names[x.joint], x.signature, x.text(names[x.joint]), x.evidence) for x in left)


def _strength(final: Stage, finding: Finding) -> float:
    """What is lost without a finding, beside all others. Its evidence is from when it was found, under the noise as it was known then."""
    lost = support(final, finding.effect)
    return lost if np.isfinite(lost) else finding.evidence


def _drawn(found: Sequence[Found], robot: Robot) -> tuple[Unexplained, ...]:
    """Places where several effects were found that together draw what is there, so that none of their names says what it is."""
    out: dict[str, Unexplained] = {}
    for here in _heaps(found, robot):
        joint = (here[0].effect.joints or ("",))[0]
        names = ", ".join(f.effect.name for f in here)
        said = f"{joint}: {names} together draw what is there, as others could; none of these names is to be trusted"
        out[joint] = Unexplained(joint, "several effects together", said, float(sum(f.judged.evidence for f in here)))
    return tuple(out.values())


def _heaps(found: Sequence[Found], robot: Robot) -> list[list[Found]]:
    """What was found at each place where several effects draw together what is there, whatever it is."""
    places = dict.fromkeys(f.effect.joints for f in found if f.effect.joints)
    every = [[f for f in found if f.effect.joints == place] for place in places]
    return [here for here in every if _many(here) or any(_inexact(f, here, robot) for f in here)]


def _overshadows(heap: Sequence[Found], one: Found) -> bool:
    """Whether a finding is one of a heap, or acts on the rows of one that is larger: what nothing explains there may show as this."""
    if any(f is one for f in heap):
        return True
    rows = np.any([acts_on(f.judged) for f in heap], axis=0)
    return bool((rows & acts_on(one.judged)).any()) and sum(f.judged.evidence for f in heap) > one.judged.evidence


def _many(here: Sequence[Found]) -> bool:
    """Whether so many effects at one place draw what is there, whatever it is. What every drive has (friction, an offset) counts once."""
    usual = sum(f.effect.usual for f in here)
    return len(here) - usual + min(usual, 1) > _TOGETHER


def _inexact(one: Found, here: Sequence[Found], robot: Robot) -> bool:
    """Whether something much smaller that follows the position, too, stands at the same place: it makes up for a law that is not the right
    one. Or something of any size, if both have shapes that were sought: two such curves draw any other (a bumper at the end of the range).
    Or a second law of how the torque is read: a share of it and a power draw others (a dead zone). Friction is different: what grows with
    speed and what does not are two things."""
    others = [other for other in here if other is not one]
    if _of_reading(one.effect) and any(_of_reading(other.effect) for other in others):
        return True
    return _of_position(one.effect, robot) and any(
        _of_position(other.effect, robot)
        and (other.judged.evidence < _SMALL * one.judged.evidence or bool(one.effect.shape() and other.effect.shape()))
        for other in others
    )


def _of_reading(effect: Effect) -> bool:
    """Whether an effect is a law of how the torque is read; a limit that cuts it off is another thing."""
    return effect.axis == Axis.TORQUE and Need.TORQUE not in effect.needs


def _of_position(effect: Effect, robot: Robot) -> bool:
    """Whether an effect follows the position, a motor's angle being one, and not in so fine a ripple that no other law has it."""
    order = float(getattr(effect, "order", 0.0))
    if order and effect.joints and getattr(effect, "angle", effect.side) == Side.MOTOR:
        j = robot.joint_index(effect.joints[0])
        order /= max(abs(float(robot.transmission.K[j, j])), 1e-300)
    return effect.axis in (Axis.POSITION, Axis.MOTOR_ANGLE) and order < _RIPPLE


def _finding(found: Found, parameters: tuple[FoundParameter, ...], selection: Selection, left: Sequence[Leftover]) -> Finding:
    rows = acts_on(found.judged)
    trust = min((_trust_beside(x) for x in left if rows[x.joint]), default=_MOST)
    # What nothing explains on one joint shows on others, through all that they share: what is smaller than it is not to be trusted.
    if any(x.weight >= 1.0 and x.evidence > found.judged.evidence for x in left):
        trust *= _OVERSHADOWED
    if any(_overshadows(heap, found) for heap in _heaps(selection.found, selection.final.problem.model.robot)):
        trust *= _OVERSHADOWED

    own, robot = found.judged.hit.place, selection.final.problem.model.robot
    # What is there as well, in each other's company, is no rival.
    beside = {f.judged.hit.place for f in selection.found if f is not found}
    total = {own: found.weight}
    for rival, probability in zip(found.rivals, found.weights[1:], strict=True):
        if rival.hit.place not in beside:
            total[rival.hit.place] = total.get(rival.hit.place, 0.0) + float(probability)
    every = max(sum(total.values()), 1e-300)
    total = {key: probability / every for key, probability in total.items()}
    beyond = cross_terms(found, selection)
    trust_in_catalogue = 1.0 / (1.0 + sum(beyond.values()))
    imitators = _imitators(found, {key: p for key, p in total.items() if key != own}, trust * trust_in_catalogue, robot)
    imitators = (*_beyond(beyond, trust * trust_in_catalogue), *imitators)
    loss = float(selection.declared.frame.heldout_loss.sum())
    return Finding(
        found.effect,
        found.judged.hit.candidate.joints,
        parameters,
        float(np.clip(found.judged.score.heldout / max(loss, 1e-300), 0.0, 1.0)),
        found.judged.evidence,
        trust * trust_in_catalogue * total[own],
        imitators,
    )


def _trust_beside(leftover: Leftover) -> float:
    """How far a finding is trusted on whose rows something is left."""
    if leftover.weight < 1.0:
        return _MOST
    least = 0.0 if leftover.counts else _BESIDE_LITTLE
    return min(_MOST, max(least, 1.0 / (1.0 + leftover.weight**2)))


def _beyond(odds: Mapping[tuple[str, str, str], float], trust: float) -> tuple[Imitator, ...]:
    """Rivals of a coupling that are not of the catalogue, from the odds of each; `trust`: probability of the catalogue's own."""
    told = sorted(((odd * trust, *key) for key, odd in odds.items() if odd * trust >= _NAMED), reverse=True)
    return tuple(Imitator(f"a share of {other}'s {what}", (joint,), probability) for probability, what, joint, other in told)


def _imitators(found: Found, rivals: Mapping[Place, float], trust: float, robot: Robot) -> tuple[Imitator, ...]:
    """The rivals of a finding, by their probability: those that may be there in truth, and those that would take up much of the same."""
    best: dict[Place, Judged] = {}
    for rival in found.rivals:
        place = rival.hit.place
        if place in rivals and (place not in best or rival.evidence > best[place].evidence):
            best[place] = rival
    share = {place: rival.evidence / max(found.judged.evidence, 1e-300) for place, rival in best.items()}

    def parameters(place: Place) -> int:
        effect = best[place].hit.effect
        return len(effect.parameters(robot)) + len(effect.shape())

    told = list[Place]()
    for place in sorted((p for p in best if share[p] >= _SHARE), key=lambda p: (parameters(p), -share[p])):
        if all(parameters(simple) == parameters(place) or share[simple] < _AS_MUCH * share[place] for simple in told):
            told.append(place)
    told = sorted(told, key=lambda p: -share[p])[:_TOLD]
    out = []
    for place, probability in sorted(rivals.items(), key=lambda x: -x[1]):
        if probability >= _NAMED or place in told:
            effect, values = replace(best[place].hit.effect, label=""), best[place].score.values
            own = tuple((p.name, float(v), p.unit) for p, v in zip(effect.parameters(robot), values, strict=True))
            out.append(Imitator(*place[:2], trust * probability, place[2], min(share[place], 1.0), own))
    return tuple(out)
