"""Integration of a plant in time: Runge-Kutta of order four between events, events where dry friction changes its mode.

A step is first tried for all runs together. A run in which a sliding contact came to rest or a held one broke loose within
the step is done again alone, up to the event; there the contacts at rest are settled together, and the step goes on. So
the solution never chatters, and between events it keeps the order of the method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DataError
from .dynamics import Input, PlantDynamics, Response, State

Array = np.ndarray
_EVENTS_PER_STEP = 24


@dataclass(frozen=True, slots=True, eq=False)
class Phase:
    """A state with the `modes` (B, c) of its contacts and the `response` there."""

    state: State
    modes: Array
    response: Response

    def lane(self, i: int) -> Phase:
        r = self.response
        one = slice(i, i + 1)
        return Phase(self.state.lane(i), self.modes[one], Response(r.a[one], r.dx[one], r.s[one], r.friction[one]))


def begin(dynamics: PlantDynamics, state: State, drive: Input, modes: Array | None = None, guess: Array | None = None) -> Phase:
    """The phase at a state: contacts at rest settle under the present torque. `modes`: those so far; none at the very start."""
    if modes is None:
        modes = np.where(dynamics.dry.standing(state.v), 0, np.sign(dynamics.dry.speed(state.v))).astype(np.int8)
        modes = dynamics.settle(state, drive, modes, guess)
    response = dynamics.respond(state, drive, modes, guess)
    if modes.all():
        return Phase(state, modes, response)
    over = np.abs(response.s) > 1 + 1e-10
    if not over.any():
        return Phase(state, modes, response)
    modes = dynamics.settle(state, drive, modes, response.a)
    return Phase(state, modes, dynamics.respond(state, drive, modes, response.a))


def advance(dynamics: PlantDynamics, phase: Phase, first: Input, last: Input, h: float) -> tuple[State, Array]:
    """State and modes after `h` seconds, under torque that runs linearly from `first` to `last`."""
    state = _runge_kutta(dynamics, phase, first, last, h, h)
    late = _violated(dynamics, phase, state, last)
    if not late.any():
        return _held_still(dynamics, state, phase.modes), phase.modes
    modes = phase.modes.copy()
    t, y, v, x = (z.copy() for z in (state.t, state.y, state.v, state.x))
    for lane in map(int, np.flatnonzero(late)):
        one, modes[lane : lane + 1] = _advance_one(dynamics, phase.lane(lane), first.lane(lane), last.lane(lane), h)
        t[lane], y[lane], v[lane], x[lane] = one.t[0], one.y[0], one.v[0], one.x[0]
    return _held_still(dynamics, State(t, y, v, x), modes), modes


def _runge_kutta(dynamics: PlantDynamics, phase: Phase, first: Input, last: Input, length: float, h: float) -> State:
    """One classical step of `h`; the torque reaches `last` after `length`."""
    s, k1 = phase.state, phase.response
    if dynamics.locked(phase.modes) and not s.x.shape[1]:
        return State(s.t + h, s.y, s.v, s.x)
    a1, x1 = k1.a, k1.dx
    middle, end = _between(first, last, 0.5 * h / length), _between(first, last, h / length)
    modes = phase.modes
    half, sixth = 0.5 * h, h / 6.0
    t2 = s.t + half

    def stage(state: State, drive: Input, guess: Array) -> Response:
        return dynamics.respond(dynamics.carried(s, state), drive, modes, guess)

    v2 = s.v + half * a1
    k2 = stage(State(t2, s.y + half * s.v, v2, s.x + half * x1), middle, a1)
    v3 = s.v + half * k2.a
    k3 = stage(State(t2, s.y + half * v2, v3, s.x + half * k2.dx), middle, k2.a)
    v4 = s.v + h * k3.a
    k4 = stage(State(s.t + h, s.y + h * v3, v4, s.x + h * k3.dx), end, k3.a)
    after = State(
        s.t + h,
        s.y + sixth * (s.v + 2.0 * (v2 + v3) + v4),
        s.v + sixth * (a1 + 2.0 * (k2.a + k3.a) + k4.a),
        s.x + sixth * (x1 + 2.0 * (k2.dx + k3.dx) + k4.dx),
    )
    return dynamics.carried(s, after)


def _between(first: Input, last: Input, share: float) -> Input:
    if first is last:
        return first
    return Input(
        first.reported + share * (last.reported - first.reported),
        first.applied + share * (last.applied - first.applied),
    )


def _violated(dynamics: PlantDynamics, phase: Phase, state: State, drive: Input) -> Array:
    """Runs (B,) bool whose modes do not fit the state: a sliding contact has turned, a held one cannot hold."""
    modes = phase.modes
    late = np.any(dynamics.dry.speed(state.v) * modes < 0, axis=1)
    still = (modes == 0).any(axis=1)
    if still.any():
        s = dynamics.respond(state, drive, modes, phase.response.a).s
        late |= np.any((modes == 0) & (np.abs(s) > 1 + 1e-10), axis=1)
    return late


def _margin(dynamics: PlantDynamics, phase: Phase, state: State, drive: Input) -> float:
    """Positive while the modes of one run fit, negative beyond the first event; continuous."""
    modes = phase.modes[0]
    speed = dynamics.dry.speed(state.v)[0]
    values = [speed[c] * modes[c] for c in np.flatnonzero(modes)]
    if not modes.all():
        s = dynamics.respond(state, drive, phase.modes, phase.response.a).s[0]
        values += [1.0 + 1e-10 - abs(s[c]) for c in np.flatnonzero(modes == 0)]
    return min(values)


def _advance_one(dynamics: PlantDynamics, phase: Phase, first: Input, last: Input, h: float) -> tuple[State, Array]:
    """The same for one run with events in it."""
    done = 0.0
    for _ in range(_EVENTS_PER_STEP):
        here = _between(first, last, done / h)
        rest = h - done
        state = _runge_kutta(dynamics, phase, here, last, rest, rest)
        if not _violated(dynamics, phase, state, last)[0]:
            return state, phase.modes
        step, state = _locate(dynamics, phase, here, last, rest)
        done = min(done + step, h)
        at = _between(first, last, done / h)
        modes = _at_rest(dynamics, phase, state)
        state = _held_still(dynamics, state, modes)
        modes = dynamics.settle(state, at, modes, phase.response.a)
        phase = Phase(state, modes, dynamics.respond(state, at, modes, phase.response.a))
        if done >= h:
            return state, modes
    # Events without end in a finite time (a contact that lets go and catches within rounding): hold what is at rest.
    modes = np.where(np.abs(dynamics.dry.speed(phase.state.v)) <= 1e-9, 0, phase.modes).astype(np.int8)
    state = _held_still(dynamics, phase.state, modes)
    phase = Phase(state, modes, dynamics.respond(state, _between(first, last, done / h), modes, phase.response.a))
    return _runge_kutta(dynamics, phase, _between(first, last, done / h), last, h - done, h - done), modes


def _at_rest(dynamics: PlantDynamics, phase: Phase, state: State) -> Array:
    """Modes (1, c) at an event with every contact that is at rest set to 0."""
    speed = dynamics.dry.speed(state.v)[0]
    before = np.abs(dynamics.dry.speed(phase.state.v)[0])
    reach = np.abs(dynamics.dry.speed(phase.response.a)[0])
    tiny = 1e-9 * (before + 1e-3 * reach) + 1e-14
    modes = phase.modes[0]
    stopped = (modes != 0) & (speed * modes <= tiny)
    return np.where(stopped, 0, modes).astype(np.int8)[None]


def _locate(dynamics: PlantDynamics, phase: Phase, first: Input, last: Input, length: float) -> tuple[float, State]:
    """Time until the first event of one run, and the state there, by the Illinois rule on the margin."""

    def reach(step: float) -> tuple[State, float]:
        state = _runge_kutta(dynamics, phase, first, last, length, step)
        return state, _margin(dynamics, phase, state, _between(first, last, step / length))

    low, high = 0.0, length
    at_low = _margin(dynamics, phase, phase.state, first)
    state, at_high = reach(length)
    scale = abs(at_low) + abs(at_high)
    if at_low <= 1e-13 * scale:
        # A contact that has just let go stands at zero but for rounding: step off before looking for its return.
        step, at_low = length, min(at_low, 0.0)
        while at_low <= 0.0:
            step *= 0.1
            if step < 1e-12 * length:
                return 0.0, phase.state
            trial, at_low = reach(step)
            if at_low <= 0.0:
                state, high, at_high = trial, step, at_low
            else:
                low = step
    last_side = 0
    for _ in range(60):
        step = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < step < high:
            step = 0.5 * (low + high)
        trial, value = reach(step)
        if value < 0:
            at_low *= 0.5 if last_side < 0 else 1.0
            state, high, at_high, last_side = trial, step, value, -1
        else:
            at_high *= 0.5 if last_side > 0 else 1.0
            low, at_low, last_side = step, value, 1
        if abs(value) <= 1e-13 * scale or high - low <= 1e-14 * length:
            return step, trial
    return high, state


def _held_still(dynamics: PlantDynamics, state: State, modes: Array) -> State:
    """Held contacts have no speed at all: take off what rounding left."""
    return state if modes.all() else State(state.t, state.y, dynamics.dry.held_still(state.v, modes), state.x)


def diverged(when: float) -> DataError:
    """The error for a run that has left every bound."""
    return DataError(
        f"the simulated motion grows without bound at t = {when:.3f} s:"
        " the controller is unstable, the step too long or the model not physical."
    )


def require_finite(state: State, when: float) -> None:
    """Raise DataError where a run has left every bound."""
    if not np.all(np.isfinite(state.v)):
        raise diverged(when)
