"""Logs of robots under feedback whose friction fluctuates: sampled controller on encoder counts, current loop, coloured torque noise.

Many runs of one robot are simulated side by side; each may lack one or more effects of the catalogue, or a law outside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

import ident
from ident.effects.motion import Motion
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots.transmission import Side
from ident.simulation.actuators import Actuator
from ident.simulation.command import Feedback
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.simulate import simulate_batch
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray


@dataclass(frozen=True)
class FluctuatingFriction(Actuator):
    """Friction that fluctuates about its law: a share of Coulomb friction, AR(1) of `time` seconds; and what else acts (`law`).

    `coulomb` (n,) on the measured side; `slow` (n,): motor speed below which it dies away; `seeds`: one for each run.
    `law(motion, t)` → (B, n), on the measured side."""

    coulomb: tuple[float, ...]
    seeds: tuple[int, ...]
    share: float = 0.015
    time: float = 0.06
    lag: float = 0.0005
    slow: tuple[float, ...] | float = 0.1
    law: object = None
    _rng: list[np.random.Generator] = field(default_factory=list)

    def start(self, command: Array) -> Array:
        self._rng[:] = [np.random.default_rng(seed) for seed in self.seeds]
        B, n = command.shape
        return np.concatenate([command, np.zeros((B, n)), np.zeros((B, 1))], axis=1)

    def apply(self, command: Array, motion: Motion, state: Array, h: float) -> tuple[Array, Array]:
        n = command.shape[1]
        torque, ar, t = state[:, :n], state[:, n : 2 * n], state[:, 2 * n]
        a, left = np.exp(-h / self.time), np.exp(-h / self.lag)
        noise = np.stack([rng.normal(size=n) for rng in self._rng])
        torque = command + left * (torque - command)
        ar = a * ar + np.sqrt(1.0 - a * a) * noise
        speed = motion.motor.dq
        applied = torque - self.share * np.asarray(self.coulomb) * ar * np.tanh(speed / np.asarray(self.slow))
        if callable(self.law):
            applied = applied - self.law(motion, t)
        return applied, np.concatenate([torque, ar, (t + h)[:, None]], axis=1)


@dataclass(frozen=True, eq=False)
class Case:
    """A log with its truth: the effects that the declared model lacks."""

    name: str
    robot: ident.Robot
    model: ident.Model
    log: ident.Log
    held: ident.Log
    missing: tuple[ident.Effect, ...]
    sizes: tuple[float, ...] = ()


def motion_of(robot: ident.Robot, seed: int, seconds: float, top_hz: float = 0.8) -> FourierTrajectory:
    """Random Fourier motion within the joint ranges and below 0.9 of the speed limits."""
    rng = np.random.default_rng(seed)
    periods = max(1, round(seconds * 0.08))
    harmonics = max(2, int(top_hz * seconds / periods))
    lower, upper = (np.array([getattr(j, side) for j in robot.joints]) for side in ("lower", "upper"))
    widest = np.array([0.5 if j.prismatic else np.pi for j in robot.joints])
    middle = np.where(np.isfinite(lower + upper), (lower + upper) / 2, 0.0)
    half = np.minimum(np.where(np.isfinite(upper - lower), (upper - lower) / 2, widest), 0.6 * widest)
    sine, cosine = rng.normal(size=(2, harmonics, robot.n)) / np.sqrt(np.arange(1, harmonics + 1))[None, :, None]
    unit = FourierTrajectory(np.zeros(robot.n), sine, cosine, periods / seconds, periods).sample(np.linspace(0.0, seconds, 4001))
    speed = np.array([min(j.velocity, 3.0 if not j.prismatic else 0.5) for j in robot.joints])
    scale = np.minimum(1.8 * half / np.ptp(unit.q, axis=0), 0.9 * speed / np.abs(unit.dq).max(axis=0))
    centre = middle - scale * (unit.q.max(axis=0) + unit.q.min(axis=0)) / 2
    return FourierTrajectory(centre, scale * sine, scale * cosine, periods / seconds, periods)


def coloured(rng: np.random.Generator, n: int, std: Array, pole: float = 0.4) -> Array:
    """AR(1) noise (N, n) of a current sensor."""
    from scipy.signal import lfilter

    white = rng.normal(size=(n + 50, len(std)))
    return np.asarray(lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], white, axis=0)[50:] * std)


def simulated(
    robot: ident.Robot,
    drive: dict[str, Array],
    missing: Sequence[tuple[ident.Effect, Array]],
    seeds: Sequence[int],
    *,
    seconds: float = 38.0,
    rate: float = 500.0,
    counts: float = 4000.0,
    loop_hz: float = 6.0,
    noise: float = 0.01,
    fluctuation: float = 0.015,
    reference: bool = False,
    law: object = None,
    top_hz: float = 0.8,
) -> list[Case]:
    """Cases of one robot, one for each seed; all lack the same effects. Half of the seed's motion is fitted, another held out."""
    from ident.robots import nominal_values

    declared = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    rigid = nominal_values(robot.rigid_body())
    values = np.concatenate([rigid, drive["Ia"], drive["Fv"], drive["Fc"]])
    true, own = declared, values
    for effect, value in missing:
        true, own = true + effect, np.concatenate([own, np.atleast_1d(value)])
    inertial = robot.rigid_body() + RotorInertia()
    controller = PDFeedforward.tuned(inertial, values[: len(rigid) + robot.n], frequency_hz=loop_hz, damping=0.9, side=Side.MOTOR)
    example = motion_of(robot, 1000 * seeds[0], seconds, top_hz).sample(np.linspace(0.0, seconds, 2000))
    speed = np.abs(robot.transmission.motor_rate(example.dq)).max(axis=0)
    slow = tuple((0.002 * speed).tolist())
    every = [seed for seed in seeds for _ in range(2)]
    motions = [motion_of(robot, 1000 * seed + part, seconds, top_hz) for seed in seeds for part in (0, 1)]
    friction = FluctuatingFriction(
        tuple(drive["Fc"]), tuple(10 * seed + k for k, seed in enumerate(every)), share=fluctuation, law=law, slow=slow
    )
    runs = simulate_batch(
        Plant(true, own),
        desired=motions,
        controller=controller,
        rate=rate,
        control_rate=1000.0,
        feedback=Feedback(counts=counts),
        actuators=(friction,),
        seeds=tuple(range(len(every))),
    )
    logs = []
    for k, (seed, run) in enumerate(zip(every, runs, strict=True)):
        rng = np.random.default_rng([seed, k % 2, 77])
        tau = robot.transmission.torque(run.tau, robot.transmission.measured, Side.MOTOR)
        tau = tau + coloured(rng, len(tau), noise * np.sqrt(np.mean(tau**2, axis=0)))
        step = 2 * np.pi / counts
        motor = np.round(robot.transmission.motor_position(run.link.q) / step) * step
        q = robot.transmission.joint_position(motor)
        tau = robot.transmission.torque(tau, Side.MOTOR, robot.transmission.measured)
        wanted = motions[k].sample(run.t).q
        side = robot.transmission.measured.value
        extra = {f"q_ref{j + 1}": wanted[:, j] for j in range(robot.n)} if reference else {}
        logs.append(ident.Log(f"run{seed}_{k % 2}", t=run.t, q=q, tau={side: tau}, extra=extra))
    return [
        Case(
            f"{robot.name}-{seed}",
            robot,
            declared,
            logs[2 * i],
            logs[2 * i + 1],
            tuple(e for e, _ in missing),
            tuple(float(np.atleast_1d(v)[0]) for _, v in missing),
        )
        for i, seed in enumerate(seeds)
    ]


def puma() -> tuple[ident.Robot, dict[str, Array]]:
    """The PUMA 560 with its published drive."""
    from ident.robots import nominal_values

    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    n = robot.n
    return robot, {"Ia": values[-3 * n : -2 * n], "Fv": values[-2 * n : -n], "Fc": values[-n:]}


def geared(name: str, ratio: float, seed: int = 0, friction: float = 0.08) -> tuple[ident.Robot, dict[str, Array]]:
    """Any robot behind gears, torque logged on the joint side, friction as a share of its typical torque."""
    from ident.robots import nominal_values

    robot = ident.load_robot(name, transmission=np.full(ident.load_robot(name).n, ratio), measured="joint")
    c = motion_of(robot, seed, 20.0).sample(np.linspace(0.0, 20.0, 500))
    body = robot.rigid_body()
    torque = np.sqrt(np.mean(body.inverse_dynamics(c.q, c.dq, c.ddq, nominal_values(body)) ** 2, axis=0)) + 1e-3
    motor = torque / ratio
    speed = np.sqrt(np.mean((c.dq * ratio) ** 2, axis=0))
    inertia = np.sqrt(np.mean((c.ddq * ratio) ** 2, axis=0))
    return robot, {"Ia": 0.3 * motor / inertia, "Fv": friction * motor / speed, "Fc": friction * 2 * motor}
