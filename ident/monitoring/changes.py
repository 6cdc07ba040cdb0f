"""What a decision accepted, told as changes of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.confidence import confidence
from ..diagnosis.uncertainty import found_parameters
from ..effects.kinds import Need
from ..problem.problem import Problem
from .before import LABEL
from .result import Change, ChangedParameter, How
from .since import heldout_gains

if TYPE_CHECKING:
    from ..diagnosis.inference.confidence_set import AcceptedEffect
    from ..diagnosis.inference.decide import Decision
    from ..diagnosis.result import FoundParameter
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..instruments.known import Known
    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from .before import Before

Array = np.ndarray


def changes_of(estimate: Estimate, before: Before, decision: Decision, since: str, *, beside: bool) -> tuple[Change, ...]:
    """The changes, the surest first. `since`: name of the log from which on they are there; `beside`: something is left unexplained."""
    values, gains = found_parameters(decision.fit, decision.frame), heldout_gains(decision)
    found = []
    for accepted, gain in zip(decision.named, gains, strict=True):
        known = decision.fit.known
        assert known is not None
        own = known.holds(accepted.effect)
        believed, competing = confidence(_favoured(accepted, known, decision.fit.robot) if own else accepted, beside=beside)
        told = tuple(_changed(p, estimate, before, own=own) for p in values[accepted.effect])
        # A change of what the model has keeps its shape: there is nothing to tell of it.
        told = tuple(p for p in told if not own or p.name not in {s.name for s in accepted.effect.shape()})
        found.append(
            Change(
                effect=accepted.effect,
                joints=accepted.joints,
                parameters=told,
                heldout_gain=gain,
                evidence=float(accepted.z**2),
                confidence=believed,
                competing=competing,
                how=_how(accepted, told, decision, own=own),
                since=since,
            )
        )
    return tuple(sorted(found, key=lambda c: -c.evidence))


def _favoured(accepted: AcceptedEffect, known: Known, robot: Robot) -> AcceptedEffect:
    """A change of what the model has, with its competing models: one that the model never had and that asks for more parameters is told
    beside it, and makes nothing ambiguous."""
    asks = _asks(accepted.effect, robot)
    return replace(
        accepted,
        competing=tuple(
            replace(m, same=True, more=True) if not known.holds(m.effect) and _asks(m.effect, robot) > asks else m
            for m in accepted.competing
        ),
    )


def _asks(effect: Effect, robot: Robot) -> int:
    return len(effect.parameters(robot)) + len(effect.shape())


def _changed(p: FoundParameter, estimate: Estimate, before: Before, *, own: bool) -> ChangedParameter:
    """A parameter's change, with its value before."""
    value = None
    if own and p.name in estimate.names:
        value = float(estimate.value(p.name))
    elif own:
        names = [n.replace(LABEL, "") for n in before.model.base.names]
        value = float(before.model.base.base_values(before.values)[names.index(p.name)]) if p.name in names else None
    return ChangedParameter(p.name, p.value, p.std if np.isfinite(p.std) else np.inf, p.unit, value)


def _how(accepted: AcceptedEffect, told: Sequence[ChangedParameter], decision: Decision, *, own: bool) -> How:
    if own:
        return How.CHANGED
    first = accepted.effect.parameters(decision.fit.robot)[0]
    return How.DISAPPEARED if told[0].value < 0 and first.lower == 0.0 else How.APPEARED


def torque_of(estimate: Estimate, signals: Signals, changes: Sequence[Change]) -> Array:
    """Torque (M, n) of changes on prepared signals, on the measured side, filtered like the rows."""
    out = np.zeros_like(signals.tau)
    robot = estimate.model.robot
    problem = Problem(estimate.model, signals, reference=estimate.all_values)
    for block in signals.blocks(None):
        motion = problem.motion(block.samples, frozenset({Need.LOAD, Need.REFERENCE}))
        for change in changes:
            values = [p.value for p in change.parameters[: len(change.effect.parameters(robot))]]
            torque = change.effect.columns(motion, robot) @ np.array(values)
            out[block.rows] += block.reduce(robot.transmission.torque(torque, change.effect.side, robot.transmission.measured))
    return out
