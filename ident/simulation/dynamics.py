"""Accelerations of a plant: rigid body, drives, forces, and dry friction that holds or slides.

Generalised coordinates y (m) are the n link positions and, for each flexible joint, how far its drive is ahead of its link.
The motor speeds are K⁻¹ (dq + S dδ). With rotor inertias R on the motor side the equation of motion is
(H + K⁻ᵀ R K⁻¹) ddq = K⁻ᵀ τ_m − bias − friction, here for all coordinates together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates, Motion
from ..errors import ConfigurationError, DataError
from ..robots.transmission import Side
from .contact import resolve
from .dry import DryFriction, DryTerm
from .flexible import FlexibleJoints
from .forces import Term
from .rigid import RigidDynamics

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """B parallel runs: time `t` (B,), coordinates `y` and speeds `v` (B, m), the forces' own states `x` (B, s)."""

    t: Array
    y: Array
    v: Array
    x: Array

    def lane(self, i: int) -> State:
        """One run, as a batch of one."""
        return State(self.t[i : i + 1], self.y[i : i + 1], self.v[i : i + 1], self.x[i : i + 1])


@dataclass(frozen=True, slots=True, eq=False)
class Input:
    """Torque (B, n) on the measured side: what is `reported`, and what is `applied` to the drive."""

    reported: Array
    applied: Array

    def lane(self, i: int) -> Input:
        return Input(self.reported[i : i + 1], self.applied[i : i + 1])


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Accelerations `a` (B, m), rates `dx` (B, s), friction levels `s` (B, c) of held contacts in units of their limits
    (beyond ±1 a contact cannot hold), and the total `friction` (B, m) of the forces that jump at zero speed."""

    a: Array
    dx: Array
    s: Array
    friction: Array


class PlantDynamics:
    """The compiled plant for one set of parameter values. All arrays have one row a run (B)."""

    def __init__(self, robot: Robot, terms: Sequence[Term], inertial: Array, flexible: FlexibleJoints | None) -> None:
        self.robot, self.flexible, self.terms = robot, flexible, tuple(terms)
        self.n = n = robot.n
        soft = [robot.joint_index(j) for j in flexible.joints] if flexible else []
        self.m = m = n + len(soft)
        self.rigid = RigidDynamics(robot, inertial)
        transmission = robot.transmission
        link = np.eye(n, m)
        self.drive = link.copy()
        self.drive[soft, np.arange(n, m)] = 1.0
        motor = transmission.K_inverse @ self.drive
        #: Speeds on a side are `rates[side] @ v`; torque on a side acts on the coordinates through its transpose.
        self.rates = {Side.JOINT: link, Side.MOTOR: motor}
        self.input = motor if transmission.measured == Side.MOTOR else self.drive
        self._motor_rates_T = motor.T.copy()
        self.inertia = np.zeros((m, m))
        for term in terms:
            J = self.rates[term.side]
            self.inertia += J.T @ term.inertia @ J
        self._require_drive_inertia(soft)
        ends = [sum(t.states for t in self.terms[:i]) for i in range(len(self.terms) + 1)]
        self._states = [slice(a, b) for a, b in pairwise(ends)]
        live = [(i, t) for i, t in enumerate(self.terms) if not t.idle]
        self._smooth = [(i, t) for i, t in live if not t.jumps.any() and not t.implicit]
        self._implicit = [(i, t) for i, t in live if not t.jumps.any() and t.implicit]
        self._dry = [DryTerm(t, self._states[i]) for i, t in live if t.jumps.any() and not t.implicit]
        self._implicit_dry = [DryTerm(t, self._states[i]) for i, t in live if t.jumps.any() and t.implicit]
        self._needs_load = any(t.needs_load for t in self.terms)
        self._path_followers = [(i, t) for i, t in live if t.follows_path]
        self._links = [(i, t) for i, t in live if t.link]
        #: The friction contacts.
        self.dry = DryFriction(robot, self.terms, self.rates)
        #: How often accelerations were asked for.
        self.evaluations = 0

    def fastest_spring(self, state: State) -> tuple[float, str]:
        """How fast (1/s) drives can swing, or settle, against their links while everything else gives way: the largest modulus of the
        rates of all runs, and the joint that moves most with it. Only of a plant with flexible joints."""
        assert self.flexible is not None
        n, f = self.n, self.m - self.n
        free = np.linalg.inv(self._rigid_terms(state)[0])[:, n:, n:]
        rates = np.zeros((len(free), 2 * f, 2 * f))
        rates[:, :f, f:] = np.eye(f)
        rates[:, f:, :f] = -free * np.asarray(self.flexible.stiffness, float)
        rates[:, f:, f:] = -free * np.asarray(self.flexible.damping, float)
        values, vectors = np.linalg.eig(rates)
        lane, i = np.unravel_index(int(np.argmax(np.abs(values))), values.shape)
        return float(np.abs(values[lane, i])), self.flexible.joints[int(np.argmax(np.abs(vectors[lane, :f, i])))]

    # --- set-up -------------------------------------------------------------------------------------------------------

    def _require_drive_inertia(self, soft: list[int]) -> None:
        for row, j in enumerate(soft, start=self.n):
            if self.inertia[row, row] <= 0:
                raise ConfigurationError(
                    f"joint {self.robot.joint_names[j]!r} is flexible, but its drive has no inertia;"
                    " add rotor inertia on the motor side to the model."
                )

    def start(self, t: Array, q: Array, dq: Array, torque: Array | None = None) -> State:
        """The state at rest in the drives' springs: links at q, dq (B, n); springs carry `torque` (B, n), joint side, or the
        static load."""
        y, v = np.zeros((len(q), self.m)), np.zeros((len(q), self.m))
        y[:, : self.n], v[:, : self.n] = q, dq
        if self.flexible is not None:
            soft = self.drive[:, self.n :].T  # (f, n)
            load = self.rigid.terms(q, np.zeros_like(q))[1] if torque is None else torque
            y[:, self.n :] = self.flexible.rest(load @ soft.T)
        motion = self.motion(State(t, y, v, np.zeros((len(q), 0))))
        parts = [term.force.start(motion, self.robot) for term in self.terms if term.states]
        return State(t, y, v, np.concatenate([np.zeros((len(q), 0)), *parts], axis=1))

    # --- kinematics ---------------------------------------------------------------------------------------------------

    def motion(self, state: State, a: Array | None = None, torque: Array | None = None) -> Motion:
        """Link and motor motion at a state, with accelerations a (B, m) or none."""
        n = self.n
        if self.m == n:
            q, dq, ddq, drive = state.y, state.v, a, state.y
        else:
            q, dq, ddq, drive = state.y[:, :n], state.v[:, :n], None if a is None else a[:, :n], state.y @ self.drive.T
        transmission = self.robot.transmission
        motor_ddq = None if a is None else a @ self._motor_rates_T
        zero = np.zeros_like(q) if ddq is None or motor_ddq is None else None
        joint = Coordinates(q, dq, zero if ddq is None else ddq)  # type: ignore[arg-type]
        motor = Coordinates(
            transmission.motor_position(drive),
            state.v @ self._motor_rates_T,
            zero if motor_ddq is None else motor_ddq,  # type: ignore[arg-type]
        )
        return Motion(state.t, joint, motor, None, torque)

    def locked(self, modes: Array) -> bool:
        """Whether every coordinate of every run is held."""
        return self.dry.complete and not modes.any()

    # --- dynamics -----------------------------------------------------------------------------------------------------

    def respond(self, state: State, drive: Input, modes: Array, guess: Array | None = None, breaking: bool = False) -> Response:
        """Accelerations, with each contact (modes (B, c)) sliding forward (1), backward (-1) or held (0).

        `guess` (B, m): accelerations to start from where a force depends on them (friction that grows with the load).
        `breaking`: held contacts break loose where their limits do not suffice (see `settle`)."""
        self.evaluations += 1
        M, bias, H, h = self._rigid_terms(state)
        base = self.motion(state, None, drive.reported)
        free = drive.applied @ self.input - bias
        for i, term in self._smooth:
            free = free - self._force(i, term, base, state.x)
        held = np.flatnonzero((modes == 0).any(axis=0)) if not modes.all() else np.zeros(0, int)
        friction, D = self.dry.forces(self._dry, base, state.x, modes, held)
        if not self._implicit and not self._implicit_dry:
            a, s = self._solve(M, free - friction, D, held, modes, breaking)
        else:
            a, s, friction, D = self._solve_implicit(state, drive, modes, held, guess, (M, H, h), free, friction, D, breaking)
        if len(held):
            friction = friction - np.einsum("bp,bpm->bm", 1.0 - np.clip(s[:, held], -1.0, 1.0), D)
        return Response(a, self._state_rates(state, a, drive), s, friction)

    def _rigid_terms(self, state: State) -> tuple[Array, Array, Array, Array]:
        n = self.n
        if self.m == n:
            H, h = self.rigid.terms(state.y, state.v)
            return H + self.inertia, h, H, h
        H, h = self.rigid.terms(state.y[:, :n], state.v[:, :n])
        M = np.repeat(self.inertia[None], len(h), axis=0)
        M[:, :n, :n] += H
        bias = np.zeros((len(h), self.m))
        bias[:, :n] = h
        assert self.flexible is not None
        bias[:, n:] = self.flexible.torque(state.y[:, n:], state.v[:, n:])
        # The springs act between drive and link: on the link's own coordinate both halves cancel.
        return M, bias, H, h

    def _force(self, i: int, term: Term, motion: Motion, x: Array) -> Array:
        own = x if not x.shape[1] else x[:, self._states[i]]
        return term.force.torque(motion, own, self.robot) @ self.rates[term.side]

    def _solve(self, M: Array, free: Array, D: Array, held: Array, modes: Array, breaking: bool) -> tuple[Array, Array]:
        """Accelerations (B, m) and levels (B, c); `free` has held contacts at level +1."""
        s = np.zeros(modes.shape)
        try:
            if not len(held):
                return np.linalg.solve(M, free[..., None])[..., 0], s
            sticking = modes[:, held] == 0
            if breaking or (self.dry.redundant and sticking.sum() > 1):
                return self._solve_breaking(M, free, D, held, sticking, s)
            return self._solve_held(M, free, D, held, sticking, s)
        except np.linalg.LinAlgError:
            raise singular_inertia() from None

    def _solve_held(self, M: Array, free: Array, D: Array, held: Array, sticking: Array, s: Array) -> tuple[Array, Array]:
        """Held contacts do not accelerate, whatever level that takes: one bordered system for all runs."""
        lanes, m, p = len(M), self.m, len(held)
        weak = sticking & (np.abs(D).max(axis=2) < 1e-250)
        D = np.where(weak[..., None], 1e-250 * self.dry.contacts[held], D)  # nothing to hold with: the level comes out huge
        scale = np.abs(D).max(axis=2) + ~sticking
        system = np.zeros((lanes, m + p, m + p))
        system[:, :m, :m] = M
        system[:, :m, m:] = -np.swapaxes(D / scale[..., None], 1, 2)
        # Unknown per held contact: (1 - level) times its scale; for runs that do not hold it, nothing.
        system[:, m:, :m] = np.where(sticking[..., None], self.dry.contacts[held], 0.0)
        system[:, range(m, m + p), range(m, m + p)] = ~sticking
        right = np.concatenate([free, np.zeros((lanes, p))], axis=1)
        solution = np.linalg.solve(system, right[..., None])[..., 0]
        s[:, held] = np.where(sticking, 1.0 - solution[:, m:] / scale, 0.0)
        return solution[:, :m], s

    def _solve_breaking(self, M: Array, free: Array, D: Array, held: Array, sticking: Array, s: Array) -> tuple[Array, Array]:
        """Contacts at rest hold as far as their limits allow and else slide; the level of one that slides is given as ±2."""
        a = np.empty((len(M), self.m))
        for lane in range(len(M)):
            mine = np.flatnonzero(sticking[lane])
            without = free[lane] + D[lane, mine].sum(axis=0)
            pulled = np.linalg.solve(M[lane], np.concatenate([without[:, None], D[lane, mine].T], axis=1))
            G = self.dry.contacts[held[mine]]
            level, loose = resolve(G @ pulled[:, 1:], G @ pulled[:, 0])
            a[lane] = pulled[:, 0] - pulled[:, 1:] @ level
            s[lane, held[mine]] = np.where(loose == 0, level, 2.0 * loose)
        return a, s

    def _solve_implicit(
        self,
        state: State,
        drive: Input,
        modes: Array,
        held: Array,
        guess: Array | None,
        rigid: tuple[Array, Array, Array],
        free: Array,
        friction: Array,
        D: Array,
        breaking: bool,
    ) -> tuple[Array, Array, Array, Array]:
        """Newton's method on accelerations where forces depend on them other than by a constant inertia."""
        M, H, h = rigid
        lanes, m = free.shape

        def forces(a: Array, times: int) -> tuple[Array, Array, Array]:
            """Smooth and dry implicit forces and half jumps at accelerations (times * B, m)."""
            many = State(*(np.tile(z, (times,) + (1,) * (z.ndim - 1)) for z in (state.t, state.y, state.v, state.x)))
            motion = self.motion(many, a, np.tile(drive.reported, (times, 1)))
            if self._needs_load:
                load = (np.tile(H, (times, 1, 1)) @ a[:, : self.n, None])[..., 0] + np.tile(h, (times, 1))
                for i, term in self._links:
                    load = load + self._force(i, term, motion, many.x)[:, : self.n]
                motion = motion.with_load(load)
            smooth = np.zeros((len(a), m))
            for i, term in self._implicit:
                smooth += self._force(i, term, motion, many.x)
            dry, half = self.dry.forces(self._implicit_dry, motion, many.x, np.tile(modes, (times, 1)), held)
            return smooth, dry, half

        a = np.zeros((lanes, m)) if guess is None else guess
        steps = np.concatenate([np.zeros((1, m)), np.eye(m)])
        smooth, dry, half = forces((a[None] + steps[:, None]).reshape(-1, m), m + 1)
        probe = (smooth + dry).reshape(m + 1, lanes, m)
        J = np.moveaxis(probe[1:] - probe[0], 0, 2)
        s = np.zeros(modes.shape)
        change = np.inf
        for iteration in range(60):
            smooth, dry, half = forces(a, 1)
            new, s = self._solve(M + J, free - friction - smooth - dry + (J @ a[..., None])[..., 0], D + half, held, modes, breaking)
            change = float(np.abs(new - a).max(initial=0.0))
            a = new if iteration < 20 else 0.5 * (a + new)
            if change <= 1e-11 * (1.0 + float(np.abs(a).max(initial=0.0))):
                break
        else:
            raise DataError(
                f"no acceleration satisfies the forces that depend on it (last change {change:.2g});"
                " a friction that grows with the load may be too strong for the drive to move at all."
            )
        smooth, dry, half = forces(a, 1)
        return a, s, friction + dry, D + half

    def carried(self, before: State, after: State) -> State:
        """`after` with the states of forces that follow the path from `before`."""
        if not self._path_followers:
            return after
        x, then, now = after.x.copy(), self.motion(before), self.motion(after)
        for i, term in self._path_followers:
            own = self._states[i]
            x[:, own] = term.force.carried(then, before.x[:, own], now, self.robot)
        return State(after.t, after.y, after.v, x)

    def _state_rates(self, state: State, a: Array, drive: Input) -> Array:
        if not state.x.shape[1]:
            return state.x
        motion = self.motion(state, a, drive.reported)
        remembering = [(t, own) for t, own in zip(self.terms, self._states, strict=True) if t.states]
        return np.concatenate([t.force.rate(motion, state.x[:, own], self.robot) for t, own in remembering], axis=1)

    def settle(self, state: State, drive: Input, modes: Array, guess: Array | None = None) -> Array:
        """Modes (B, c) after the contacts at rest (mode 0) hold on or break loose, all together."""
        if modes.all():
            return modes
        level = self.respond(state, drive, modes, guess, breaking=True).s
        return np.where((modes == 0) & (np.abs(level) == 2.0), np.sign(level), modes).astype(np.int8)


def singular_inertia() -> DataError:
    """The error for an inertia matrix that cannot be inverted."""
    return DataError(
        "the inertia matrix is singular: some joint moves no inertia with these parameters."
        " Add rotor inertia, or take parameters from a possible model."
    )
