"""Simulation: forward dynamics through the transmission, driven by torque or by a controller, with sensors.

`simulate` makes a realistic log of one run; `simulate_batch` does several runs at once, which costs little more than one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from .._utils.text import counted
from .._utils.threads import with_one_blas_thread
from ..effects.motion import Coordinates
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError
from ..model import Model
from .actuators import Actuator
from .command import Command, Feedback, GivenTorque, Tracking
from .controller import Controller, PDFeedforward
from .plant import Plant
from .result import Simulation
from .runner import run
from .sensors import Sensors
from .trajectory import Trajectory

Array = np.ndarray
_EXACT = Feedback()


class Hold(StrEnum):
    """Torque between two given samples: kept, or a straight line."""

    ZERO_ORDER = "zero_order"
    FIRST_ORDER = "first_order"


@with_one_blas_thread
def simulate(
    plant: Plant,
    *,
    desired: Trajectory | Coordinates | None = None,
    controller: Controller | None = None,
    torque: Array | None = None,
    hold: Hold = Hold.ZERO_ORDER,
    start: tuple[Array, Array] | None = None,
    duration: float | None = None,
    rate: float = 500.0,
    control_rate: float | None = None,
    step: float = 1e-3,
    feedback: Feedback = _EXACT,
    actuators: Sequence[Actuator] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Simulation:
    """Simulate one run and what its sensors record.

    Either `desired`: a trajectory (or its samples (K, n) at `control_rate`) tracked by `controller`, by default a PD controller
    with feedforward from the plant's own rigid model; or `torque` (K, n) on the measured side, one row per period of
    `control_rate`, for the K−1 periods between them, started at `start` = (q, dq), each (n,).

    `rate`: samples per second of the result; `control_rate`: of controller or given torque, a multiple of `rate` (default: `rate`
    for torque, else the smallest multiple from 1000 Hz on). `step`: longest integration step. `hold`: torque between
    its samples. Raises ConfigurationError for requests that contradict each other, DataError where the motion diverges.

    Examples
    --------
    >>> import ident
    >>> from ident.robots import nominal_values
    >>> from ident.simulation import Plant
    >>> model = ident.load_robot("scara").rigid_body()
    >>> run = ident.simulate(Plant(model, nominal_values(model)), torque=[[0.0] * 4] * 51, start=([0.0] * 4, [0.0] * 4), rate=100)
    >>> run.link.q.shape
    (51, 4)
    """
    starts = None if start is None else (np.asarray(start[0], float)[None], np.asarray(start[1], float)[None])
    return simulate_batch(
        plant,
        desired=None if desired is None else [desired],
        controller=controller,
        torque=None if torque is None else np.asarray(torque, float)[:, None],
        hold=hold,
        start=starts,
        duration=duration,
        rate=rate,
        control_rate=control_rate,
        step=step,
        feedback=feedback,
        actuators=actuators,
        sensors=sensors,
        seeds=[seed],
        progress=progress,
    )[0]


def simulate_batch(
    plant: Plant,
    *,
    desired: Sequence[Trajectory | Coordinates] | None = None,
    controller: Controller | None = None,
    torque: Array | None = None,
    hold: Hold = Hold.ZERO_ORDER,
    start: tuple[Array, Array] | None = None,
    duration: float | None = None,
    rate: float = 500.0,
    control_rate: float | None = None,
    step: float = 1e-3,
    feedback: Feedback = _EXACT,
    actuators: Sequence[Actuator] = (),
    sensors: Sensors | None = None,
    seeds: Sequence[int] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Simulation, ...]:
    """`simulate` for B runs of one plant at once: B trajectories, or torque (K, B, n) and start (B, n) each; B `seeds`."""
    if (desired is None) == (torque is None):
        raise ConfigurationError("simulate needs either a desired motion (tracked by a controller) or torque, not both and not neither.")
    if control_rate is None:
        control_rate = rate if torque is not None else rate * max(1, int(np.ceil(1000.0 / rate - 1e-9)))
    every = round(control_rate / rate)
    if every < 1 or abs(every * rate - control_rate) > 1e-6 * control_rate:
        raise ConfigurationError(f"control_rate ({control_rate:g} Hz) must be a whole multiple of rate ({rate:g} Hz).")
    n = plant.robot.n
    if torque is not None:
        if start is None:
            raise ConfigurationError("a torque-driven simulation needs start = (q, dq).")
        given = np.asarray(torque, float)
        if given.ndim != 3 or given.shape[2] != n:
            raise ConfigurationError(f"torque must have {n} columns, one per joint of {plant.robot.name!r}, not shape {given.shape}.")
        if duration is not None:
            given = given[: round(duration * control_rate) + 1]
        command: Command = GivenTorque(given, plant.robot.transmission.measured)
        count, lanes = given.shape[:2]
        q0, dq0 = np.broadcast_to(start[0], (lanes, n)), np.broadcast_to(start[1], (lanes, n))
    else:
        assert desired is not None
        if Hold(hold) != Hold.ZERO_ORDER:
            raise ConfigurationError("a controller's torque is held between its instants; first-order hold is for given torque.")
        motion = _sampled(desired, control_rate, duration, n)
        count, lanes = motion.q.shape[:2]
        if start is None:
            start = motion.q[0], motion.dq[0]
        q0, dq0 = np.broadcast_to(start[0], (lanes, n)), np.broadcast_to(start[1], (lanes, n))
        if controller is None:
            controller = _default_controller(plant)
        command = Tracking(plant, controller, motion, feedback, 1.0 / control_rate)
    if count < 2:
        raise ConfigurationError("there is nothing to simulate: fewer than two control samples.")
    seeds = list(range(lanes)) if seeds is None else list(seeds)
    if len(seeds) != lanes:
        raise ConfigurationError(f"{len(seeds)} seeds are given for {lanes} runs.")

    linear = Hold(hold) == Hold.FIRST_ORDER
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that grows without bound is reported as such
        record = run(plant, q0, dq0, command, linear, count, 1.0 / control_rate, step, tuple(actuators), every, progress)
    return tuple(record.simulation(plant, lane, sensors or Sensors(), seeds[lane]) for lane in range(lanes))


def _sampled(desired: Sequence[Trajectory | Coordinates], control_rate: float, duration: float | None, n: int) -> Coordinates:
    """Desired motions (K, B, n) at the control instants; a shorter one stands still at its end."""
    if duration is None:
        duration = max(d.duration if isinstance(d, Trajectory) else (len(d.q) - 1) / control_rate for d in desired)
    count = round(duration * control_rate) + 1
    found = []
    for d in desired:
        motion = d.sample(np.arange(count) / control_rate) if isinstance(d, Trajectory) else d
        if motion.q.shape[1:] != (n,):
            raise ConfigurationError(f"the desired motion has shape {motion.q.shape}, but the robot has {counted(n, 'joint')}.")
        last = np.minimum(np.arange(count), len(motion.q) - 1)
        moving = (np.arange(count) < len(motion.q))[:, None]
        found.append((motion.q[last], motion.dq[last] * moving, motion.ddq[last] * moving))
    return Coordinates(*(np.stack(x, axis=1) for x in zip(*found, strict=True)))


def _default_controller(plant: Plant) -> Controller:
    model = plant.model
    keep = [(e, s) for e, s in zip(model.effects, model.slices, strict=True) if isinstance(e, RigidBody) or e.name == "rotor_inertia"]
    part = Model(model.robot, tuple(e for e, _ in keep))
    values = plant.schedule.values[0]
    return PDFeedforward.tuned(part, np.concatenate([values[s] for _, s in keep]))
