"""Choosing the tests of a plan: greedily, joint by joint from the tip, until every base parameter is determined.

For chains of revolute joints this arrives at the general rule of the step-by-step method (Yoshida, 1995, ch. 3): for each joint i from
the tip the test {i}, the test {i, j} with a partner j before it, and a further partner where rotor and link inertia are not told
apart otherwise. Because only ranks are asked, it holds for prismatic joints, branches and loops as well."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..excitation.limits import Limits
from ..model import Model
from ..robots.transmission import Side, Transmission
from ..simulation.trajectory import FourierTrajectory
from .rows import Knowledge, RowSampler
from .trials import MotionKind, PlannedTest, Sweep, Swing

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_HARMONICS, _BASE_HZ = 3, 0.5
_TRIES = 12


class Separation(StrEnum):
    """How rotor inertia is distinguished from link inertia.

    COUPLED: a coupled transmission is trusted to do it where it can, which takes the fewest tests. SAFE: as if every motor moved
    its own joint alone, which takes a test more for some joints and stands noise better (15 tests instead of 13
    for the PUMA 560, and a third of the error)."""

    COUPLED = "coupled"
    SAFE = "safe"


@dataclass(frozen=True)
class Draft:
    """A test before its postures are chosen, by joint numbers."""

    kind: MotionKind
    moving: tuple[int, ...]
    row: int
    side: Side


def candidates(n: int) -> Iterator[Draft]:
    """Tests in the order in which they are tried: static and constant velocity, then accelerated, from the tip."""
    for i in reversed(range(n)):
        yield Draft(MotionKind.STATIC, (i,), i, Side.JOINT)
    for i in range(n):
        yield Draft(MotionKind.CONSTANT_VELOCITY, (i,), i, Side.MOTOR)
    for i in reversed(range(n)):
        yield Draft(MotionKind.ACCELERATED, (i,), i, Side.JOINT)
        for j in reversed(range(i)):
            yield Draft(MotionKind.ACCELERATED, (j, i), i, Side.JOINT)
    # What is left, if anything, takes a partner beyond the joint, or all joints at once.
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            yield Draft(MotionKind.ACCELERATED, (i, j), i, Side.JOINT)
    for i in reversed(range(n)):
        yield Draft(MotionKind.ACCELERATED, tuple(range(n)), i, Side.JOINT)


class Chooser:
    """Chooses tests for one model within limits. `postures`: at least so many per accelerated and static test."""

    def __init__(self, model: Model, limits: Limits, postures: int, seed: int) -> None:
        self.model, self.limits, self.postures, self.seed = model, limits, postures, seed
        self.rng = np.random.default_rng(seed)
        self.sampler = RowSampler(model, self.reference())

    @property
    def robot(self) -> Robot:
        return self.model.robot

    def reference(self) -> Coordinates:
        """Motion of all joints, for the size of columns."""
        limits, rng = self.limits, np.random.default_rng(1)
        count = max(200, 4 * self.model.base.count)
        q = rng.uniform(limits.lower, limits.upper, (count, limits.n))
        return Coordinates(q, 0.5 * limits.velocity * rng.normal(size=q.shape), 0.5 * limits.acceleration * rng.normal(size=q.shape))

    def tests(self, separation: Separation) -> tuple[list[PlannedTest], int]:
        """The tests in order, and the rank that they reach."""
        known = Knowledge(self.sampler.base.count)
        found = self._safe_tests(known) if separation == Separation.SAFE else []
        for draft in candidates(self.robot.n):
            if known.rank == self.sampler.base.count:
                break
            test = self._designed(draft, known)
            if test is not None:
                found.append(test)
        return _numbered(found), known.rank

    def named_tests(self, accelerated: Sequence[tuple[Sequence[str], str]]) -> tuple[list[PlannedTest], int]:
        """Static and constant-velocity tests, then the accelerated ones that are named (joints that move, joint that is read), in order."""
        known, at = Knowledge(self.sampler.base.count), self.robot.joint_index
        slow = [draft for draft in candidates(self.robot.n) if draft.kind != MotionKind.ACCELERATED]
        quick = [Draft(MotionKind.ACCELERATED, tuple(at(j) for j in moving), at(row), Side.JOINT) for moving, row in accelerated]
        made = [self._designed(draft, known) for draft in (*slow, *quick)]
        return _numbered([test for test in made if test is not None]), known.rank

    def _safe_tests(self, known: Knowledge) -> list[PlannedTest]:
        """The tests that motors on joints of their own would need, with what each would reveal then; none for such a robot itself."""
        transmission = self.robot.transmission
        if transmission.is_diagonal or np.any(np.diag(transmission.K) == 0):
            return []
        plain = Transmission(np.diag(np.diag(transmission.K)), transmission.zero, transmission.measured)
        other = Chooser(Model(self.robot.with_transmission(plain), self.model.effects), self.limits, self.postures, self.seed)
        if other.sampler.base.names != self.sampler.base.names:
            return []
        found = []
        for test in other.tests(Separation.COUPLED)[0]:
            draft = Draft(test.kind, tuple(self.robot.joint_index(j) for j in test.moving), self.robot.joint_index(test.row), test.side)
            if test.kind == MotionKind.CONSTANT_VELOCITY:
                # A motor moves other joints here.
                postures, motion = self._placed(draft, self.rng)
                test = replace(test, postures=postures, motion=motion)
            known.learn(known.news(self._rows(draft, test.postures, test.motion))[0])
            found.append(test)
        return found

    # --- the design of one test ---------------------------------------------------------------------------------------

    def _designed(self, draft: Draft, known: Knowledge) -> PlannedTest | None:
        """The test with the best of some random postures and motions; None if it tells nothing new."""
        best: tuple[int, float] | None = None
        chosen: tuple[Array, Sweep | Swing, Array, Array] | None = None
        for _ in range(_TRIES):
            postures, motion = self._placed(draft, self.rng)
            directions, s = known.news(self._rows(draft, postures, motion))
            if not len(s):
                return None
            # First the rank, then the smallest confidence ellipsoid of what is new.
            score = len(s), float(np.sum(np.log(s)))
            if best is None or score > best:
                best, chosen = score, (postures, motion, directions, s)
        assert chosen is not None
        postures, motion, directions, s = chosen
        before = known.determined()
        known.learn(directions)
        names = self.sampler.base.names
        reveals = tuple(names[i] for i in np.flatnonzero(known.determined() & ~before))
        joints = self.robot.joint_names
        moving = tuple(joints[j] for j in draft.moving)
        partners = "all" if len(moving) > 2 else "_".join(moving)
        name = f"{draft.kind}_{partners}" + (f"_row_{joints[draft.row]}" if len(moving) > 2 or draft.row != max(draft.moving) else "")
        strength = float(s[-1] / self.sampler.whole)
        return PlannedTest(name, draft.kind, moving, joints[draft.row], draft.side, postures, motion, reveals, len(s), strength, "")

    def _placed(self, draft: Draft, rng: np.random.Generator) -> tuple[Array, Sweep | Swing]:
        """Random postures (P, n) and a motion that stays within the limits about each of them."""
        limits, n = self.limits, self.robot.n
        half = 0.5 * (limits.upper - limits.lower)
        direction = self._direction(draft)
        count = 1 if draft.kind == MotionKind.CONSTANT_VELOCITY else self.postures + (draft.kind == MotionKind.STATIC)
        moves = np.abs(direction) > 0 if draft.kind == MotionKind.CONSTANT_VELOCITY else np.isin(np.arange(n), draft.moving)
        room = np.where(moves, 0.5 if draft.kind == MotionKind.ACCELERATED else 0.9, 1.0)
        motion = self._swing(draft, rng, half) if draft.kind == MotionKind.ACCELERATED else self._sweep(draft, direction, half)
        if draft.kind == MotionKind.CONSTANT_VELOCITY:
            room = np.where(moves, 0.3, 1.0)
        postures = limits.middle + rng.uniform(-1.0, 1.0, (count, n)) * half * room
        return postures, motion

    def _direction(self, draft: Draft) -> Array:
        """Joint motion (n,) per unit of the moving coordinate of a sweep: one motor, or one joint."""
        i = draft.moving[0]
        if draft.kind == MotionKind.CONSTANT_VELOCITY:
            return self.robot.transmission.K[:, i].copy()
        return np.eye(self.robot.n)[i]

    def _sweep(self, draft: Draft, direction: Array, half: Array) -> Sweep:
        limits = self.limits
        with np.errstate(divide="ignore"):
            top = float(np.min(limits.velocity / np.abs(direction)))
            widest = float(np.min(half / np.abs(direction)))
            gain = float(np.min(limits.acceleration / np.abs(direction)))
        slow = draft.kind == MotionKind.STATIC
        speeds = (0.02 * top,) if slow else (0.25 * top, 0.8 * top)
        # Long enough that the steady part lasts about a second, if the range allows; no faster than ramps within the limits
        # reach: a ramp of T/6 peaks at (π/2) speed / ramp = 1.25 π speed² / reach.
        found, reach = [], []
        for speed in speeds:
            room = min(max(0.6 * speed, 1.25 * np.pi * speed**2 / gain), (0.09 if slow else 0.65) * widest)
            reach.append(room)
            found.append(min(speed, float(np.sqrt(0.999 * gain * room / (1.25 * np.pi)))))
        # Viscous and dry friction are told apart by speeds that differ.
        found[0] = min(found[0], 0.4 * found[-1]) if len(found) > 1 else found[0]
        return Sweep(direction, tuple(found), tuple(reach))

    def _swing(self, draft: Draft, rng: np.random.Generator, half: Array) -> Swing:
        n, limits = self.robot.n, self.limits
        sine, cosine = np.zeros((2, _HARMONICS, n))
        moving = list(draft.moving)
        sine[:, moving], cosine[:, moving] = rng.normal(size=(2, _HARMONICS, len(moving)))
        trial = FourierTrajectory(np.zeros(n), sine, cosine, _BASE_HZ)
        motion = trial.sample(np.linspace(0.0, trial.duration, 401))
        for j in moving:
            used = max(
                np.abs(motion.q[:, j]).max() / (0.5 * half[j]),
                np.abs(motion.dq[:, j]).max() / limits.velocity[j],
                np.abs(motion.ddq[:, j]).max() / limits.acceleration[j],
            )
            sine[:, j] *= 0.98 / used
            cosine[:, j] *= 0.98 / used
        return Swing(sine, cosine, _BASE_HZ)

    def _rows(self, draft: Draft, postures: Array, motion: Sweep | Swing) -> Array:
        """Scaled rows (m, b) that the test gives, with its friction known or cancelled as its kind says."""
        found = []
        for posture in postures:
            if isinstance(motion, Swing):
                piece = motion.parts(posture)[0][0]
                at = piece.sample(np.linspace(0.0, piece.duration, 41)[1:-1])
            else:
                count = 3
                share = np.linspace(-0.5, 0.5, count)
                q = np.concatenate([posture + np.outer(share * reach, motion.direction) for reach in motion.reach])
                dq = np.concatenate([np.tile(speed * motion.direction, (count, 1)) for speed in motion.speeds])
                at = Coordinates(q, dq, np.zeros_like(q))
            found.append(self.sampler.read(draft.kind, at, draft.row, draft.side))
        return np.concatenate(found)


def _numbered(tests: Sequence[PlannedTest]) -> list[PlannedTest]:
    """The tests with the names of their logs."""
    return [replace(test, log=f"{number:02d}_{test.name}.csv.gz") for number, test in enumerate(tests, start=1)]
