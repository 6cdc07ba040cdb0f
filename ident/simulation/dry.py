"""Dry friction of a plant: where it acts, what it takes while its contacts slide, and how much it can hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import matrix_rank, pinv
from ..effects.motion import Coordinates, Motion
from ..robots.transmission import Side
from .forces import TINY, Term

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Surface:
    """The coordinates of one side at whose zero speed something jumps: `own` indices, their `contact`, its `sense` (±1)."""

    own: Array
    contact: Array
    sense: Array
    everywhere: bool

    def clamp(self, side: Coordinates, direction: Array) -> Coordinates:
        """The same motion with these speeds on the side of zero that `direction` (B, c) says."""
        if not len(self.own):
            return side
        sense = direction[:, self.contact] * self.sense
        if self.everywhere:
            return Coordinates(side.q, sense * np.maximum(sense * side.dq, TINY), side.ddq, sense)
        dq, kept = side.dq.copy(), np.sign(side.dq)
        dq[:, self.own] = sense * np.maximum(sense * dq[:, self.own], TINY)
        kept[:, self.own] = sense
        return Coordinates(side.q, dq, side.ddq, kept)


@dataclass(frozen=True, eq=False)
class DryTerm:
    """A term that jumps, and which of the plant's states are its own."""

    term: Term
    states: slice


class DryFriction:
    """The friction contacts of a plant. `rates`: speeds of a side = rates[side] (n, m) @ speeds of the coordinates.

    `contacts` (c, m): directions whose zero speed is a contact; parallel ones (motor and joint of one axis) are one."""

    def __init__(self, robot: Robot, terms: Sequence[Term], rates: Mapping[Side, Array]) -> None:
        self._robot, self._rates = robot, rates
        directions: list[Array] = []
        self._surfaces: dict[Side, Surface] = {}
        n, m = rates[Side.JOINT].shape
        for side in (Side.MOTOR, Side.JOINT):
            touched = np.zeros(n, bool)
            for term in terms:
                if term.side == side:
                    touched |= term.jumps
            own = np.flatnonzero(touched)
            contact, sense = [], []
            for j in own:
                g = rates[side][j]
                cosines = [g @ d / (np.linalg.norm(g) * np.linalg.norm(d)) for d in directions]
                same = [i for i, cosine in enumerate(cosines) if abs(cosine) > 1 - 1e-12]
                if not same:
                    directions.append(g)
                contact.append(same[0] if same else len(directions) - 1)
                sense.append(np.sign(cosines[same[0]]) if same else 1.0)
            self._surfaces[side] = Surface(own, np.array(contact, dtype=int), np.array(sense), len(own) == n)
        self.contacts = np.array(directions).reshape(-1, m)
        rank = int(matrix_rank(self.contacts)) if directions else 0
        #: Whether more contacts may be held than there are coordinates, and whether holding all of them stops everything.
        self.redundant, self.complete = rank < len(directions), rank == m
        self._still: dict[bytes, Array] = {}

    def surface(self, side: Side) -> Surface:
        """The coordinates of a side that jump."""
        return self._surfaces[side]

    @property
    def count(self) -> int:
        """Number of contacts."""
        return len(self.contacts)

    def speed(self, v: Array) -> Array:
        """Speeds (B, c) of the contacts."""
        return v @ self.contacts.T

    def standing(self, v: Array) -> Array:
        """Contacts (B, c) bool whose speed is nothing but rounding."""
        return np.abs(self.speed(v)) <= 1e-14 + 1e-12 * (np.abs(v) @ np.abs(self.contacts.T))

    def at_rest(self, modes: Array, v: Array) -> Array:
        """Joints or motors (B, n) bool with dry friction whose contact is held, or only just lets go or reverses."""
        still = (modes == 0) | self.standing(v)
        out = np.zeros((len(modes), len(self._rates[Side.JOINT])), bool)
        for surface in self._surfaces.values():
            out[:, surface.own] |= still[:, surface.contact]
        return out

    def held_still(self, v: Array, modes: Array) -> Array:
        """Speeds (B, m) without what rounding has left at held contacts."""
        v = v.copy()
        for lane in np.flatnonzero((modes == 0).any(axis=1)):
            key = modes[lane].tobytes() if self.count else b""
            if key not in self._still:
                G = self.contacts[modes[lane] == 0]
                everything = self.complete and not modes[lane].any()
                self._still[key] = np.zeros((v.shape[1],) * 2) if everything else np.eye(v.shape[1]) - pinv(G) @ G
            v[lane] = self._still[key] @ v[lane]
        return v

    def forces(self, terms: Sequence[DryTerm], motion: Motion, x: Array, modes: Array, held: Array) -> tuple[Array, Array]:
        """Force (B, m) of terms that jump, contacts `held` by some run taken at their upper limit, and half of each one's jump
        (B, p, m), zero for runs that do not hold it."""
        lanes, m = len(motion), self.contacts.shape[1]
        if not terms:
            return np.zeros((lanes, m)), np.zeros((lanes, len(held), m))
        if not len(held):
            return self._general(self._by_side(terms, motion, x, modes)), np.zeros((lanes, 0, m))
        up = np.where(modes == 0, 1, modes)
        if all(t.term.own_rows for t in terms):
            both = self._by_side(terms, _repeated(motion, 2), np.concatenate([x, x]), np.concatenate([up, np.where(modes == 0, -1, modes)]))
            D = np.zeros((lanes, self.count, m))
            for side, torque in both.items():
                surface = self._surfaces[side]
                half = 0.5 * (torque[:lanes] - torque[lanes:])[:, surface.own]
                D[:, surface.contact] += half[:, :, None] * self._rates[side][surface.own]  # one side's contacts are distinct
            return self._general({side: torque[:lanes] for side, torque in both.items()}), D[:, held]
        many = len(held) + 1
        direction = np.tile(up, (many, 1))
        for place, c in enumerate(held):
            direction[(place + 1) * lanes + np.flatnonzero(modes[:, c] == 0), c] = -1
        parts = self._general(self._by_side(terms, _repeated(motion, many), np.tile(x, (many, 1)), direction)).reshape(many, lanes, m)
        return parts[0], 0.5 * np.swapaxes(parts[:1] - parts[1:], 0, 1)

    def _by_side(self, terms: Sequence[DryTerm], motion: Motion, x: Array, direction: Array) -> dict[Side, Array]:
        """Torque (B, n) of terms that jump on each side, with every contact sliding in a direction (B, c)."""
        joint, motor = self._surfaces[Side.JOINT].clamp(motion.joint, direction), self._surfaces[Side.MOTOR].clamp(motion.motor, direction)
        clamped = Motion(motion.t, joint, motor, motion.load, motion.torque)
        total: dict[Side, Array] = {}
        for dry in terms:
            torque = dry.term.force.torque(clamped, x[:, dry.states], self._robot)
            side = dry.term.side
            total[side] = total[side] + torque if side in total else torque
        return total

    def _general(self, by_side: Mapping[Side, Array]) -> Array:
        """Force (B, m) on the coordinates of torques on the two sides."""
        parts = [torque @ self._rates[side] for side, torque in by_side.items()]
        return parts[0] if len(parts) == 1 else parts[0] + parts[1]


def _repeated(motion: Motion, times: int) -> Motion:
    """All runs of a motion, `times` over."""

    def many(x: Array) -> Array:
        return np.concatenate([x] * times)

    joint, motor = motion.joint, motion.motor
    return Motion(
        many(motion.t),
        Coordinates(many(joint.q), many(joint.dq), many(joint.ddq)),
        Coordinates(many(motor.q), many(motor.dq), many(motor.ddq)),
        None if motion.load is None else many(motion.load),
        None if motion.torque is None else many(motion.torque),
    )
