"""Presliding: before a contact slides it bends like a spring, so friction reverses over a distance, not at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature, Need
from ..effects.motion import Coordinates, Motion
from ..effects.registry import register
from ..robots.parameters import ShapeParameter
from .bristle import BristleForce

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class Presliding(JointEffect):
    """Dry friction that builds up over a distance z_s instead of jumping: τ = Fp (z − s(ω)) beside `coulomb`.

    z is Dahl's bristle deflection, dz/dφ = (1 − sgn(dφ) z) / z_s, zero at the start of the run. Fp: the part of Coulomb
    friction that builds up this way (Fp = Fc: all of it); Fc stays the friction of full sliding. Several with different z_s
    and labels make a Maxwell-slip-like spectrum. Source: Dahl (1968).

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.Presliding(joints=("joint2",), z_s=0.01)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fp_joint2', 'N m')]
    """

    name: ClassVar[str] = "presliding"
    title: ClassVar[str] = "presliding (friction that builds up over a distance)"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.HISTORY})
    symbols = (("Fp", "{tau}", 0.0),)

    z_s: float = 0.01

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("z_s", "rad (m)", 1e-7, 1e3, 0.01, log=True),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        z = np.empty_like(own.q)
        for i in range(z.shape[1]):
            z[:, i] = deflection(own.q[:, i], self.z_s)
        yield z - own.direction

    def force_model(self, robot: Robot, values: Array) -> BristleForce:
        """The same law with the bristles' deflection as states, for simulation."""
        return BristleForce(side=self.side, at=tuple(self.at(robot)), level=np.asarray(values, float), z_s=self.z_s)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """From a small part of what a joint moves between samples to a tenth of its whole range."""
        q = motion.on(self.side).q[:, self.at(robot)]
        if len(q) < 2:
            return self.bounded()
        span, step = float(np.ptp(q, axis=0).max()), float(np.median(np.abs(np.diff(q, axis=0)).max(axis=1)))
        return self.bounded(z_s=(max(0.2 * step, 1e-5 * span), 0.1 * span))


def deflection(position: Array, z_s: float) -> Array:
    """Dahl's deflection z (N,), −1 … 1, along a path of positions (N,); exact for motion that is monotone between samples.

    Over a stretch of one direction s the law integrates to z = s + (z_0 − s) exp(−|φ − φ_0|/z_s): only reversals need a step."""
    z = np.zeros(len(position))
    if len(position) < 2:
        return z
    sign = np.sign(np.diff(position))
    moved = np.flatnonzero(sign)
    if not len(moved):
        return z
    # Standing still counts to the stretch before it.
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), moved[0]))
    sign = sign[last]
    first = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1])
    begin = position[first]
    end = np.append(begin[1:], position[-1])
    decay = np.exp(-np.abs(end - begin) / z_s).tolist()
    at_begin = []
    level = 0.0
    for s, keep in zip(sign[first].tolist(), decay, strict=True):
        at_begin.append(level)
        level = s + (level - s) * keep
    length = np.diff(np.append(first, len(sign)))
    travelled = np.abs(position[1:] - np.repeat(begin, length))
    z[1:] = sign + (np.repeat(at_begin, length) - sign) * np.exp(-travelled / z_s)
    return z
