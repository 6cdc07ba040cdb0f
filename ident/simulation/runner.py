"""Running a plant over control periods, and keeping what happened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..robots.transmission import Side
from .actuators import Actuator
from .compiled import CompiledPlant, Kept, UnfitError
from .dynamics import Input, PlantDynamics, State
from .integrator import Phase, advance, begin, require_finite
from .result import Simulation

if TYPE_CHECKING:
    from .command import Command
    from .plant import Plant
    from .sensors import Sensors

Array = np.ndarray
#: Rate times step up to which a Runge-Kutta step does not blow up what it is to damp (2.78), with some room for other postures.
_STABLE = 2.5


@dataclass(frozen=True, eq=False)
class Record:
    """What happened in B runs at N logged instants: arrays (N, B, …); torque `reported` and `applied` (K, B, n) at all K control
    instants, `every` of which is logged."""

    t: Array
    link: Coordinates
    motor: Coordinates
    friction: Array
    held: Array
    states: Array
    reported: Array
    applied: Array
    every: int
    period: float
    linear: bool

    def simulation(self, plant: Plant, lane: int, sensors: Sensors, seed: int) -> Simulation:
        """One run, with its sensors read."""

        def of(c: Coordinates) -> Coordinates:
            return Coordinates(c.q[:, lane], c.dq[:, lane], c.ddq[:, lane])

        return Simulation.of(
            plant.robot,
            self.t,
            of(self.link),
            of(self.motor),
            self.reported[:, lane],
            self.applied[:: self.every, lane],
            self.friction[:, lane],
            self.held[:, lane],
            self.states[:, lane],
            self.every,
            self.linear,
            sensors,
            seed,
        )


@dataclass(frozen=True, eq=False)
class _Logbook:
    """Room for a `Record` of K control instants, filled instant by instant; `kept`: motion of links and motors, and friction."""

    kept: tuple[Array, ...]
    held: Array
    states: Array
    reported: Array
    applied: Array
    every: int
    progress: Callable[[float], None] | None

    @classmethod
    def of(cls, count: int, every: int, lanes: int, n: int, states: int, progress: Callable[[float], None] | None) -> _Logbook:
        """For `count` control instants of B = `lanes` runs of n joints with so many states."""
        rows = (count - 1) // every + 1
        kept = tuple(np.empty((rows, lanes, n)) for _ in range(7))
        reported, applied = np.empty((2, count, lanes, n))
        return cls(kept, np.empty((rows, lanes, n), bool), np.empty((rows, lanes, states)), reported, applied, every, progress)

    def keep(self, k: int, dynamics: PlantDynamics, phase: Phase, applied: Array) -> None:
        """Control instant k, with the torque (B, n) that acts from then on."""
        self.applied[k] = applied
        if k % self.every:
            return
        row = k // self.every
        motion = dynamics.motion(phase.state, phase.response.a)
        parts = (motion.joint.q, motion.joint.dq, motion.joint.ddq, motion.motor.q, motion.motor.dq, motion.motor.ddq)
        for target, values in zip(self.kept, parts, strict=False):
            target[row] = values
        robot = dynamics.robot
        on_joint = phase.response.friction[:, : dynamics.n]
        self.kept[6][row] = on_joint if robot.transmission.measured == "joint" else on_joint @ robot.transmission.K
        self.held[row] = dynamics.dry.at_rest(phase.modes, phase.state.v)
        self.states[row] = phase.state.x
        if self.progress is not None:
            self.progress(k / (len(self.applied) - 1))

    def record(self, period: float, linear: bool) -> Record:
        """All of it."""
        t = np.arange(len(self.held)) * self.every * period
        link, motor, friction = Coordinates(*self.kept[:3]), Coordinates(*self.kept[3:6]), self.kept[6]
        return Record(t, link, motor, friction, self.held, self.states, self.reported, self.applied, self.every, period, linear)


def run(
    plant: Plant,
    q: Array,
    dq: Array,
    command: Command,
    linear: bool,
    count: int,
    period: float,
    step: float,
    actuators: tuple[Actuator, ...],
    every: int,
    progress: Callable[[float], None] | None,
) -> Record:
    """Integrate B runs from q, dq (B, n) over `count` control instants. `linear`: torque runs straight to its next value.

    What compiled code can do, it does: all of it, or else the periods between calls of the controller."""
    _require_known(step, linear, actuators)
    lanes, n = q.shape
    substeps = max(1, int(np.ceil(period / step - 1e-9)))
    h = period / substeps
    dynamics = plant.dynamics(0.0)
    state = dynamics.start(np.zeros(lanes), q, dq)
    _require_resolved(dynamics, state, h)
    if not actuators and len(plant.schedule.values) == 1:
        whole = _all_compiled(plant.compiled(), command, state, linear, period, substeps, every, progress)
        if whole is not None:
            return whole
    book = _Logbook.of(count, every, lanes, n, state.x.shape[1], progress)
    modes: Array | None = None
    guess: Array | None = None
    following = command(0, state, dynamics)
    loaded = _started(actuators, following)
    for k in range(count):
        t = k * period
        new = plant.dynamics(t)
        if new is not dynamics:
            dynamics, modes = new, None
        state = State(np.full(lanes, t), state.y, state.v, state.x)
        now = following if linear or k == 0 else command(k, state, dynamics)
        following = command(min(k + 1, count - 1), state, dynamics) if linear else now
        book.reported[k] = now
        begun = None if actuators or linear else _compiled_period(plant.compiled(t), state, modes, now, period, substeps, k == count - 1)
        if begun is not None:
            phase, state, modes = begun
            guess = phase.response.a
            book.keep(k, dynamics, phase, now)
            continue
        for i in range(substeps):
            first, loaded = _acted(actuators, now if not linear else now + i / substeps * (following - now), dynamics, state, loaded, h)
            last = first if not linear else Input(*(2 * [now + (i + 1) / substeps * (following - now)]))
            phase = begin(dynamics, state, first, modes, guess)
            if i == 0:
                if k % every == 0:
                    require_finite(state, t)
                book.keep(k, dynamics, phase, first.applied)
            if k == count - 1:
                break
            state, modes = advance(dynamics, phase, first, last, h)
            guess = phase.response.a
    return book.record(period, linear)


def _require_known(step: float, linear: bool, actuators: tuple[Actuator, ...]) -> None:
    if not step > 0:
        raise ConfigurationError(f"the integration step must be positive, not {step}.")
    if linear and actuators:
        raise ConfigurationError("actuators act on commands that are held; use them with Hold.ZERO_ORDER.")


def _require_resolved(dynamics: PlantDynamics, state: State, h: float) -> None:
    """Refuse steps that springs of the plant do not stand: between the flanks of a gap they would shake without end, not grow."""
    if dynamics.flexible is None:
        return
    rate, joint = dynamics.fastest_spring(state)
    if rate * h > _STABLE:
        raise ConfigurationError(
            f"joint {joint!r} is so stiff or so damped that drive and link move against each other at {rate:.3g} 1/s, too fast for an"
            f" integration step of {h:.3g} s: give simulate() step={1.0 / rate:.1g} or less, or a softer spring."
        )


def _started(actuators: tuple[Actuator, ...], command: Array) -> list[Array]:
    return [actuator.start(command) for actuator in actuators]


def _acted(
    actuators: tuple[Actuator, ...], command: Array, dynamics: PlantDynamics, state: State, loaded: list[Array], h: float
) -> tuple[Input, list[Array]]:
    """The torque that the actuators make of a command, and their states after the step."""
    if not actuators:
        return Input(command, command), loaded
    motion, torque, after = dynamics.motion(state), command, []
    for actuator, own in zip(actuators, loaded, strict=True):
        torque, new = actuator.apply(torque, motion, own, h)
        after.append(new)
    return Input(command, torque), after


def _all_compiled(
    compiled: CompiledPlant | None,
    command: Command,
    state: State,
    linear: bool,
    period: float,
    substeps: int,
    every: int,
    progress: Callable[[float], None] | None,
) -> Record | None:
    """All of it by compiled code, where it knows the plant and the command; else None."""
    script = None if compiled is None else command.script()
    if compiled is None or script is None:
        return None
    try:
        kept, _, _ = compiled.run(script, state, None, period=period, substeps=substeps, every=every, linear=linear, progress=progress)
    except UnfitError:
        return None
    return _record(compiled.dynamics, kept, script.side, every, period, linear)


def _compiled_period(
    compiled: CompiledPlant | None, state: State, modes: Array | None, torque: Array, period: float, substeps: int, ends: bool
) -> tuple[Phase, State, Array] | None:
    """The phase at the start of a control period, state and modes at its end, where compiled code knows the plant; else None."""
    try:
        return None if compiled is None else compiled.period(state, modes, torque, period, substeps, ends)
    except UnfitError:
        return None


def _record(dynamics: PlantDynamics, kept: Kept, side: Side, every: int, period: float, linear: bool) -> Record:
    """What compiled code kept, with all that follows from it."""
    transmission = dynamics.robot.transmission
    rates = dynamics.rates[Side.MOTOR].T
    motor = Coordinates(transmission.motor_position(kept.q), kept.dq @ rates, kept.ddq @ rates)
    torque = transmission.torque(kept.torque, side, transmission.measured)
    friction = transmission.torque(kept.friction, Side.JOINT, transmission.measured)
    instants = kept.q.shape[0] * kept.q.shape[1]
    held = dynamics.dry.at_rest(kept.modes.reshape(instants, dynamics.dry.count), kept.dq.reshape(instants, -1)).reshape(kept.q.shape)
    states = np.empty((*kept.q.shape[:2], 0))
    t = np.arange(len(held)) * every * period
    return Record(t, Coordinates(kept.q, kept.dq, kept.ddq), motor, friction, held, states, torque, torque, every, period, linear)
