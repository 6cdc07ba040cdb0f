"""Candidates: every catalogued effect at every place it could sit, with the shapes worth trying first."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...diagnosis.design.places import choices, covers, joints_of, placements
from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.registry import effect_types
from ...errors import IdentError
from ...model import Model
from .spectral import order_parameter

if TYPE_CHECKING:
    from .motions import Motions

#: Points of the first grid over a shape parameter that does not say how many, alone and beside another.
_POINTS_ALONE = 12
_POINTS_TOGETHER = 6


@dataclass(frozen=True)
class Candidate:
    """An effect that the model may lack, in the variants (shapes) of a first grid; `joints` are those it sits on."""

    name: str
    joints: tuple[str, ...]
    variants: tuple[Effect, ...]

    def __str__(self) -> str:
        return f"{self.name} on {', '.join(self.joints)}" if self.joints else self.name

    @property
    def dependent(self) -> bool:
        """Whether its columns depend on what the model predicts."""
        return bool(self.variants[0].needs & {Need.LOAD, Need.REFERENCE})

    @property
    def spectral(self) -> bool:
        """Whether it is sought over a spectrum of orders."""
        return order_parameter(self.variants[0]) is not None


def candidates(model: Model, motions: Motions) -> tuple[Candidate, ...]:
    """Every candidate for a model on a robot's motions; what the model already holds at a place is left out."""
    found = []
    for name, kind in effect_types().items():
        if name == "rigid_body":
            continue
        for place in placements(kind, model.robot):
            if any(covers(e, place, model.robot) for e in model.effects):
                continue
            for choice in choices(place):
                # Columns of different choices of one place are different things, but only one of them can be found at a time.
                try:
                    variants = tuple(_shapes(choice, motions))
                    variants[0].parameters(model.robot)
                except IdentError:
                    continue  # an effect that this robot cannot have (a payload without a link to hold it)
                found.append(Candidate(name, joints_of(place), variants))
    return tuple(found)


def _shapes(effect: Effect, motions: Motions) -> Iterator[Effect]:
    """A first grid."""
    parameters = effect.shape()
    if not parameters:
        yield effect
        return
    ranges = motions.search_range(effect)
    usual = _POINTS_ALONE if len(parameters) == 1 else _POINTS_TOGETHER
    grids = []
    for p in parameters:
        low, high = ranges[p.name]
        points = p.points or usual
        if points == 1:
            grids.append(np.array([min(max(p.typical, low), high)]))
            continue
        grids.append(np.geomspace(low, high, points) if p.log and low > 0 else np.linspace(low, high, points))
    for values in itertools.product(*grids):
        yield effect.with_shape(**{p.name: float(v) for p, v in zip(parameters, values, strict=True)})
