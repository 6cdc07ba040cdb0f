"""Simulation by compiled code, for plants of which it knows everything: a tree with drives whose forces are constant, linear in
position and speed, or dry friction of constant level, driven by given torque or a PD controller with feedforward.

`CompiledPlant.of` says whether a plant is one; `ident.simulation.runner` then leaves it the steps. Same method and numbers as
`integrator` and `dynamics`, events of friction included (ident/_native/integrator.h), some hundred times faster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effects.kinds import Factor
from ..regressor.kernel_choice import kernel
from ..robots.transmission import Side
from .dynamics import PlantDynamics, Response, State, singular_inertia
from .integrator import Phase, diverged
from .script import Script

Array = np.ndarray
#: What stops a simulation (ident/_native/tree.h).
_SINGULAR, _DIVERGED, _UNFIT = 1, 2, 3
#: Control periods times runs between two looks at the keyboard and the progress.
_AT_A_TIME = 200_000


class UnfitError(Exception):
    """The compiled integrator met a friction that feeds power in; the general one has to do it."""


@dataclass(frozen=True, eq=False)
class Kept:
    """What a simulation keeps of L logged instants: arrays (L, B, …); `torque` (K, B, n) of all, on the side where it was given."""

    q: Array
    dq: Array
    ddq: Array
    friction: Array
    modes: Array
    torque: Array

    @classmethod
    def empty(cls, logged: int, lanes: int, n: int, contacts: int, periods: int) -> Kept:
        q, dq, ddq, friction = (np.empty((logged, lanes, n)) for _ in range(4))
        return cls(q, dq, ddq, friction, np.empty((logged, lanes, contacts)), np.empty((periods, lanes, n)))

    def part(self, logged: slice, periods: slice) -> tuple[Array, ...]:
        return (self.q[logged], self.dq[logged], self.ddq[logged], self.friction[logged], self.modes[logged], self.torque[periods])


@dataclass(frozen=True, eq=False)
class CompiledPlant:
    """A plant as the compiled integrator has it."""

    native: Any
    dynamics: PlantDynamics
    plant: tuple[Array, ...]  # inertia, offset, direction, level
    entries: bytes
    touches: bytes

    @classmethod
    def of(cls, dynamics: PlantDynamics) -> CompiledPlant | None:
        """The plant, or None where some force of it is not of the kind, or the kernel was not built."""
        chosen = kernel()
        plain = dynamics.flexible is None and dynamics.robot.loop.is_trivial and not dynamics.dry.redundant
        if not chosen.compiled or not plain or any(not t.idle and t.parts is None for t in dynamics.terms):
            return None
        n, dry = dynamics.n, dynamics.dry
        offset, stiffness, damping, level = np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros((dry.count, n))
        for term in dynamics.terms:
            if term.parts is None:
                continue
            rates = dynamics.rates[term.side]
            zero = dynamics.robot.transmission.zero if term.side == Side.MOTOR else np.zeros(n)
            spring = rates.T @ (term.parts[Factor.POSITION][:, None] * rates)
            offset += term.parts[Factor.ONE] @ rates - spring @ zero
            stiffness += spring
            damping += rates.T @ (term.parts[Factor.SPEED][:, None] * rates)
            held = term.parts[Factor.DIRECTION]
            if np.any(held[~term.jumps]):
                return None  # too little to have been seen as a jump: not a contact
            surface = dry.surface(term.side)
            for j, contact, sense in zip(surface.own, surface.contact, surface.sense, strict=True):
                level[contact] += sense * held[j] * rates[j]
        if np.any(np.sum(level * dry.contacts, axis=1) <= 0):
            return None
        plant = tuple(np.ascontiguousarray(x, float) for x in (dynamics.rigid.inertia, offset, dry.contacts, level))
        forces = _records(("row", "column"), position=stiffness, speed=damping, acceleration=dynamics.inertia)
        return cls(chosen.dynamics, dynamics, plant, forces, _records(("contact", "coordinate"), direction=dry.contacts, level=level))

    def run(
        self,
        script: Script,
        state: State,
        modes: Array | None,
        *,
        period: float,
        substeps: int,
        every: int = 1,
        linear: bool = False,
        ends: bool = True,
        progress: Any = None,
        first: float = 0.0,
    ) -> tuple[Kept, State, Array]:
        """All instants of a script (K, B, n) from a state, and the state and modes after them.

        `ends`: the last instant is only looked at. `linear`: torque runs straight to its next value. `first`: time of the first
        instant. Raises DataError where a run has left every bound, UnfitError where the general integrator has to do it."""
        count, lanes, n = script.forward.shape
        contacts = self.dynamics.dry.count
        kept = Kept.empty((count + every - 1) // every, lanes, n, contacts, count)
        q, dq = (np.ascontiguousarray(x, float).copy() for x in (state.y, state.v))
        now = np.zeros((lanes, contacts)) if modes is None else modes.astype(float)
        rates = self.dynamics.rates[script.side]
        none = np.zeros_like(rates)
        ratio = _records(("row", "column"), position=rates, speed=none, acceleration=none)
        zero = self.dynamics.robot.transmission.zero if script.side == Side.MOTOR else np.zeros(n)
        at_a_time = count if linear else max(1, _AT_A_TIME // (every * max(lanes, 1))) * every
        for start in range(0, count, at_a_time):
            stop = min(start + at_a_time, count)
            part, last = slice(start, stop), stop == count
            fresh = modes is None and start == 0
            desired = [x if x is None else x[part] for x in (script.q, script.dq)]
            code = self.native.simulate(
                self.dynamics.robot.tree,
                (lanes, stop - start, substeps, every, period / substeps, linear, ends and last, fresh, self.dynamics.dry.complete),
                (*self.plant, zero),
                (self.entries, ratio, self.touches),
                (script.kp, script.kd, script.limit),
                (script.forward[part], *desired),
                (q, dq, now),
                kept.part(slice(start // every, (stop + every - 1) // every), part),
            )
            if code >= 0:
                raise _failure(code % 4, first + (start + code // 4) * period)
            if progress is not None:
                progress((stop - 1) / max(count - 1, 1))
        return kept, State(state.t + period * (count - ends), q, dq, state.x), now.astype(np.int8)

    def period(
        self, state: State, modes: Array | None, torque: Array, period: float, substeps: int, ends: bool
    ) -> tuple[Phase, State, Array]:
        """One control period under torque (B, n) on the measured side: the phase at its start, the state and modes at its end."""
        script = Script(self.dynamics.robot.transmission.measured, np.ascontiguousarray(torque, float)[None])
        kept, after, now = self.run(script, state, modes, period=period, substeps=substeps, ends=ends, first=float(state.t[0]))
        none = np.zeros((len(torque), 0))
        begun = kept.modes[0].astype(np.int8)
        response = Response(kept.ddq[0], none, np.zeros(begun.shape), kept.friction[0])
        return Phase(State(state.t, kept.q[0], kept.dq[0], none), begun, response), after, now


def _failure(kind: int, when: float) -> Exception:
    return {_SINGULAR: singular_inertia(), _DIVERGED: diverged(when), _UNFIT: UnfitError()}[kind]


def _records(index: tuple[str, str], **matrices: Array) -> bytes:
    """The places where any of the matrices is not zero, as records of ident/_native/tree.h."""
    places = np.nonzero(np.any([x != 0 for x in matrices.values()], axis=0))
    records = np.zeros(len(places[0]), [(name, "i8") for name in index] + [(name, "f8") for name in matrices])
    for name, values in zip(index, places, strict=True):
        records[name] = values
    for name, matrix in matrices.items():
        records[name] = matrix[places]
    return records.tobytes()
