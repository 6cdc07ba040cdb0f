"""Candidates: every catalogued effect on every joint it could sit on, with the shapes worth trying."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..effect import Effect, JointEffect, effect_types
from ..errors import IdentError
from ..model import Model
from ..motion import Motion
from ..transmission import Side

if TYPE_CHECKING:
    from ..robot import Robot

#: Points of the first grid over one shape parameter, and over each of several.
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


def candidates(model: Model, motion: Motion) -> tuple[Candidate, ...]:
    """Every candidate for a model on a robot's motion; what the model already holds on a joint is left out."""
    found = []
    for name, kind in effect_types().items():
        if name == "rigid_body":
            continue
        for place in _places(kind, model.robot):
            if any(_covers(e, place, model.robot) for e in model.effects):
                continue
            try:
                variants = tuple(v for base in _choices(place) for v in _shapes(base, motion, model.robot))
                joints = () if place.joints is None else place.joints
                variants[0].parameters(model.robot)
            except IdentError:
                continue  # an effect that this robot cannot have (a payload without a link to hold it)
            found.append(Candidate(name, joints, variants))
    return tuple(found)


def _places(kind: type[Effect], robot: Robot) -> Iterator[Effect]:
    """The effect on each joint alone, or once on the whole robot."""
    label = "+"  # keeps parameter names apart from those of a declared effect of the same kind
    if issubclass(kind, JointEffect):
        for joint in robot.joint_names:
            yield kind(joints=(joint,), label=label)
    else:
        yield from kind.placements(robot)


def _covers(effect: Effect, place: Effect, robot: Robot) -> bool:
    """Whether a declared effect is the same thing on the same joints: a second one would be its copy."""
    if type(effect) is not type(place) or effect.side != place.side:
        return False
    return not place.shape() and set(place.at(robot)) <= set(effect.at(robot))


def _choices(place: Effect) -> Iterator[Effect]:
    """The effect with each member of every enumeration it is configured by (an angle on the joint or on the motor side)."""
    options = [
        (f.name, list(type(getattr(place, f.name))))
        for f in dataclasses.fields(place)
        if f.name != "side" and isinstance(getattr(place, f.name), StrEnum) and not isinstance(getattr(place, f.name), Side)
    ]
    for chosen in itertools.product(*(members for _, members in options)):
        yield dataclasses.replace(place, **dict(zip([n for n, _ in options], chosen, strict=True)))


def _shapes(effect: Effect, motion: Motion, robot: Robot) -> Iterator[Effect]:
    parameters = effect.shape()
    if not parameters:
        yield effect
        return
    ranges = effect.search_range(motion, robot)
    points = _POINTS_ALONE if len(parameters) == 1 else _POINTS_TOGETHER
    grids = []
    for p in parameters:
        low, high = ranges[p.name]
        grids.append(np.geomspace(low, high, points) if p.log and low > 0 else np.linspace(low, high, points))
    for values in itertools.product(*grids):
        yield effect.with_shape(**{p.name: float(v) for p, v in zip(parameters, values, strict=True)})
