"""Where effects of the catalogue could sit, and the shapes worth scoring first."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ...errors import IdentError
from ...instruments.columns import is_order
from ...robots.transmission import Side

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...effects.motion import Motion
    from ...model import Model
    from ...robots.robot import Robot

#: Points of the grid over one shape, and over each of several.
_POINTS, _TOGETHER = 7, 4
#: Whole orders (cycles a turn) that machines have: poles, teeth, lobes, and their multiples.
_ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 18, 20, 24, 30, 36, 48)
#: Orders that differ by this share of a period over the travel are scored; of them at most so many.
_APART, _MOST_ORDERS = 0.75, 100
#: Samples that a period of an order needs, at a speed below which the joint is for this share of the time.
_SAMPLES, _SLOW_SHARE = 10.0, 0.2
#: Effects whose evidence lies above any band in which the reference drives the motion: they are said to be unseen, never named.
ABOVE_THE_BAND = frozenset({"backlash"})


def places(kind: type[Effect], model: Model, motions: Sequence[Motion]) -> Iterator[tuple[Effect, tuple[str, ...]]]:
    """Every effect of a kind that the model does not hold, with the joints it sits on; one for each shape of a grid."""
    if kind.name in ABOVE_THE_BAND:
        return
    for place in placements(kind, model.robot):
        if any(covers(e, place, model.robot) for e in model.effects):
            continue
        for choice in choices(place):
            try:
                for effect in grid(choice, model, motions):
                    yield effect, joints_of(place)
            except IdentError:
                break


def grid(effect: Effect, model: Model, motions: Sequence[Motion], points: int = 0) -> Iterator[Effect]:
    """The effect over a grid of its shapes."""
    parameters = effect.shape()
    if not any(effect.could_show(motion, model.robot) for motion in motions):
        return
    if not parameters:
        yield effect
        return
    if effect.response(model.robot) is not None and all(p.lower < 0 < p.upper for p in parameters):
        # A delay: its slope at zero shows every short one.
        yield effect.with_shape(**{p.name: 0.0 for p in parameters})
        return
    ranges = search_range(effect, model, motions)
    if is_order(effect):
        (p,) = parameters
        for order in _orders(effect, model, motions, ranges[p.name]):
            yield effect.with_shape(**{p.name: order})
        return
    usual = points or (_POINTS if len(parameters) == 1 else _TOGETHER)
    axes = []
    for p in parameters:
        low, high = ranges[p.name]
        count = 1 if p.points == 1 else min(p.points or usual, usual)
        if count == 1:
            axes.append(np.array([min(max(p.typical, low), high)]))
        else:
            axes.append(np.geomspace(low, high, count) if p.log and low > 0 else np.linspace(low, high, count))
    for values in itertools.product(*axes):
        yield effect.with_shape(**{p.name: float(v) for p, v in zip(parameters, values, strict=True)})


def search_range(effect: Effect, model: Model, motions: Sequence[Motion]) -> dict[str, tuple[float, float]]:
    """Where an effect's shapes may lie: in any of the runs."""
    every = [effect.search_range(motion, model.robot) for motion in motions]
    out = {}
    for p in effect.shape():
        told = [x[p.name] for x in every if x[p.name] != (p.lower, p.upper)]
        out[p.name] = (min(low for low, _ in told), max(high for _, high in told)) if told else (p.lower, p.upper)
    return out


def _orders(effect: Effect, model: Model, motions: Sequence[Motion], bounds: tuple[float, float]) -> Iterator[float]:
    """Orders worth scoring, within the bounds that the samples resolve: whole ones, and those of wheels between motor and joint, which may
    have any, as near to each other as the travel tells them apart."""
    j = effect.at(model.robot)[0]
    side = getattr(effect, "angle", effect.side)
    q = np.concatenate([m.on(side).q[:, j] for m in motions])
    slow = max(float(np.quantile(np.abs(m.on(side).dq[:, j]), _SLOW_SHARE)) for m in motions)
    unit = 1.0 if model.robot.position_unit(j, side) == "rad" else 2.0 * np.pi / max(float(np.ptp(q)), 1e-9)
    between = np.zeros(0)
    if (apart := order_spacing(effect, model, motions)) is not None:
        between = np.arange(bounds[0], _ORDERS[-1] + apart, max(apart, _ORDERS[-1] / _MOST_ORDERS))
        between = between[np.abs(between[:, None] - np.array(_ORDERS)).min(axis=1) > apart / 2.0]
    for order in sorted([unit * x for x in _ORDERS] + between.tolist()):
        if bounds[0] <= order <= bounds[1] and order * slow * _SAMPLES <= 2.0 * np.pi * motions[0].rate:
            yield order


def order_spacing(effect: Effect, model: Model, motions: Sequence[Motion]) -> float | None:
    """How far apart orders of a turning joint must be for its travel to tell them apart; None where orders are whole (of the motor's
    angle), or cycles over the travel (of a slide)."""
    j, side = effect.at(model.robot)[0], getattr(effect, "angle", effect.side)
    if side != Side.JOINT or model.robot.position_unit(j, side) != "rad":
        return None
    return _APART * 2.0 * np.pi / max(float(np.ptp(np.concatenate([m.on(side).q[:, j] for m in motions]))), 1e-9)


def joints_of(place: Effect) -> tuple[str, ...]:
    """Joints that an effect sits on, () for the whole robot."""
    return () if place.joints is None else place.joints


def placements(kind: type[Effect], robot: Robot) -> Iterator[Effect]:
    """Every smallest thing of the kind, and what may be on all joints at once; the label keeps parameter names apart from those of a
    declared effect of the kind."""
    try:
        yield from kind.placements(robot, label="+")
    except IdentError:
        return
    if kind.everywhere and robot.n > 1:
        yield kind(joints=robot.joint_names, label="+")


def covers(effect: Effect, place: Effect, robot: Robot) -> bool:
    """Whether the model holds the same thing, or another form of it, at the same place already."""
    if place.form_of and place.form_of == effect.form_of and set(place.at(robot)) & set(effect.at(robot)):
        return True
    if type(effect) is not type(place) or effect.side != place.side:
        return False
    plain = {f.name for f in dataclasses.fields(place)} - {"joints", "label", *(p.name for p in place.shape())}
    if any(getattr(effect, name) != getattr(place, name) for name in plain):
        return False
    return set(place.at(robot)) <= set(effect.at(robot))


def choices(place: Effect) -> Iterator[Effect]:
    """The effect with each member of every enumeration it is configured by (an angle on the joint or on the motor side)."""
    options = [
        (f.name, list(type(getattr(place, f.name)).__members__.values()))
        for f in dataclasses.fields(place)
        if f.name != "side" and isinstance(getattr(place, f.name), StrEnum)
    ]
    for chosen in itertools.product(*(members for _, members in options)):
        yield dataclasses.replace(place, **dict(zip([n for n, _ in options], chosen, strict=True)))
