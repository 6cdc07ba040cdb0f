"""What is known from before: the fit's parameters with their doubt, and what the fit's own logs show that its model never had."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.design.catalogue import Catalogue
from ..diagnosis.design.places import places
from ..diagnosis.inference.decide import decide
from ..diagnosis.inference.scores import Scores
from ..effects.registry import effect_types
from ..effects.rigid_body import RigidBody
from ..instruments.fit import Fit
from ..instruments.known import Known
from ..instruments.prepared import prepared
from ..instruments.prior import prior_rows

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..signals.signals import Signals

Array = np.ndarray
Placed = tuple["Effect", tuple[str, ...]]
#: Goes into the names of a change's parameters, so that they stay apart from those of the model.
LABEL = "+"


@dataclass(frozen=True, eq=False)
class Before:
    """`model` with `values` (k,) of all its parameters: the fit's, and `beside` it what its own logs show. `rows` (r, b), `told` (r,): what
    is known of base parameters, told = rows p + noise of unit variance; `std` (b,). `noise` (n,): rms of what is left of
    each motor's torque, where the logs are at hand. `left`: what those logs hold that nothing accounts for."""

    model: Model
    values: Array
    rows: Array = field(repr=False)
    told: Array = field(repr=False)
    std: Array
    noise: Array | None = None
    beside: tuple[Effect, ...] = ()
    left: frozenset[tuple[str, tuple[str, ...]]] = frozenset()

    @classmethod
    def of_logs(cls, estimate: Estimate, reference: Signals, blind: Array) -> Before:
        """From the fit's own logs, by the engine that watches the new ones: whatever is left out of a law is left out of both.

        `blind` (n,) bool: joints that are not looked at."""
        return cls._fitted(prepared(estimate.model, reference, estimate.all_values, without=blind)[0], (), frozenset())

    @classmethod
    def of_diagnosis(cls, estimate: Estimate, reference: Signals, blind: Array) -> Before:
        """The same with what the fit's own logs show that its model never had."""
        fit, _, speeds = prepared(estimate.model, reference, estimate.all_values, without=blind)
        decision = decide(fit, speeds)
        extended = Fit(decision.fit.runs, decision.fit.model, (), decision.fit.values)
        return cls._fitted(extended, decision.fit.effects, frozenset((x.name, x.joints) for x in decision.left))

    @classmethod
    def _fitted(cls, fit: Fit, beside: tuple[Effect, ...], left: frozenset[tuple[str, tuple[str, ...]]]) -> Before:
        frame = fit.solved(2)
        assert fit.values is not None
        return cls(fit.model, fit.values, *frame.knowledge(), frame.std, fit.noise(frame), beside, left)

    @classmethod
    def of_estimate(cls, estimate: Estimate) -> Before:
        """From the fit alone. Its own base parameters may be groups of the structure's, where its logs could not tell them apart: the rest
        is known as weakly as of any robot."""
        model = estimate.model
        groups = estimate.base.regroup[:, model.base.independent]
        std = np.where(estimate.std > 0, estimate.std, 1e-12)
        values, vectors = np.linalg.eigh(estimate.covariance / np.outer(std, std))
        # A variance that rounding has made zero or negative must not turn into certainty.
        half = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / std
        weak = prior_rows(model)
        base = model.base.base_values(estimate.all_values)
        rows, told = np.concatenate([half @ groups, weak]), np.concatenate([half @ estimate.values, weak @ base])
        known = dict(zip(estimate.names, estimate.std, strict=True))
        std = np.array([known.get(name, np.inf) for name in model.base.names])
        return cls(model, estimate.all_values, rows, told, std)

    def known(self, free: Fit) -> Known:
        """This as the decision takes it; `free`: the model on the new logs, nothing known before."""
        base = self.model.base
        values = base.base_values(self.values)
        before = {n.replace(LABEL, ""): (float(v), float(s)) for n, v, s in zip(base.names, values, self.std, strict=True)}
        return Known(self.rows, self.told, tuple(own_changes(self.model)), before, _contained(free))


def own_changes(model: Model) -> Iterator[Placed]:
    """For each effect of a model beside the rigid body, and each joint it sits on, the change of its parameters there; and that on all its
    joints."""
    robot = model.robot
    for effect in model.effects:
        if isinstance(effect, RigidBody):
            continue
        label = effect.label + LABEL
        if not type(effect).per_joint:
            yield dataclasses.replace(effect, label=label), effect.joints or ()
            continue
        joints = tuple(robot.joint_names[j] for j in effect.at(robot))
        for joint in joints:
            yield dataclasses.replace(effect, joints=(joint,), label=label), (joint,)
        if len(joints) > 1:
            yield dataclasses.replace(effect, joints=joints, label=label), joints


def _contained(free: Fit) -> frozenset[tuple[str, tuple[str, ...]]]:
    """Kinds of the catalogue that the model absorbs when its parameters are free (a payload, by its link)."""
    tried: dict[tuple[str, tuple[str, ...]], Placed] = {}
    for name, kind in effect_types().items():
        if kind.cause and name != "rigid_body":
            for effect, joints in places(kind, free.declared, free.motions(instrument=True)):
                tried.setdefault((name, joints), (effect, joints))
    catalogue = Catalogue.of_effects(free, list(tried.values()))
    scores = Scores.of(free, free.solved(1), catalogue)
    seen = {scores.group(k).kind for k in range(len(scores.kept))}
    return frozenset(g.kind for g in catalogue.groups if g.kind not in seen)
