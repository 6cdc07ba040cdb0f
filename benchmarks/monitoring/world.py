"""Pairs of logs of one robot: one that is fitted, and a later one, in which one known thing has changed, or nothing has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ident
from benchmarks.diagnosis.feedback.world import FluctuatingFriction, coloured, geared, motion_of, puma
from ident.effects.motion import Motion
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.robots.transmission import Side
from ident.simulation.command import Feedback
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.simulate import simulate_batch

Array = np.ndarray
Place = tuple[str, tuple[str, ...]]
COUNTS = 4000.0
LOOP_HZ = 6.0
NOISE = 0.01


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot with its drive. `feedback`: simulated in closed loop; else along an exact motion."""

    name: str
    robot: ident.Robot
    drive: dict[str, Array]
    seconds: float
    rate: float
    feedback: bool = True

    @property
    def declared(self) -> ident.Model:
        """Rigid body with rotor inertia, viscous and Coulomb friction."""
        return self.robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()

    @property
    def values(self) -> Array:
        return np.concatenate([nominal_values(self.robot.rigid_body()), *(self.drive[k] for k in ("Ia", "Fv", "Fc"))])


@dataclass(frozen=True, eq=False)
class Pair:
    """`before` is fitted, `after` is watched; `right`: effects on joints that are a right name of the change, () where nothing changed."""

    kind: str
    arm: Arm
    seed: int
    before: ident.Log
    after: ident.Log
    right: tuple[Place, ...]

    @property
    def name(self) -> str:
        return f"{self.arm.name}: {self.kind}, seed {self.seed}"


def arms() -> Iterator[Arm]:
    """A coupled wrist and an arm with gears under feedback, one with a slide in open loop."""
    yield Arm("puma560", *puma(), 30.0, 250.0)
    yield Arm("scara", *geared("scara", 50.0), 30.0, 250.0)
    yield Arm("open", *open_arm(), 25.0, 200.0, feedback=False)


def open_arm() -> tuple[ident.Robot, dict[str, Array]]:
    """The six-joint UR5's inertials behind gears, torque on the joint side; its logs are of an exact motion."""
    return geared("ur5", 100.0, friction=0.12)


#: Kinds of change: what is scaled or added, and by which names it is told rightly.
KINDS = ("friction of all", "friction", "viscous", "coulomb", "payload", "offset", "encoder offset", "torque scale", "stiction")


def pairs(arm: Arm, kind: str, seed: int) -> Pair:
    """The pair of an arm for a kind of change ("unchanged" or one of `KINDS`)."""
    robot = arm.robot
    j = 1 + seed % 2
    joint = robot.joint_names[j]
    model, values = arm.declared, arm.values
    later, changed = model, values.copy()
    place = {p: i for i, p in enumerate(model.names)}
    viscous, dry = ([place[p] for p in model.names if p.startswith(symbol)] for symbol in ("Fv", "Fc"))
    if kind == "friction of all":
        changed[[*viscous, *dry]] *= 1.3
    elif kind == "friction":
        changed[[viscous[j], dry[j]]] *= 1.3
    elif kind == "viscous":
        changed[viscous[j]] *= 1.4
    elif kind == "coulomb":
        changed[dry[j]] *= 1.3
    elif kind == "offset":
        later, changed = model + ident.make_effect("offset", joints=[joint]), np.append(values, 0.3 * arm.drive["Fc"][j])
    elif kind == "stiction":
        speed = np.quantile(np.abs(robot.transmission.motor_rate(motion_of(robot, 1, 30.0).sample(np.linspace(0, 30, 900)).dq)), 0.98, 0)
        later = model + ident.make_effect("stribeck", joints=[joint], v_s=0.05 * speed[j])
        changed = np.append(values, 0.6 * arm.drive["Fc"][j])
    elif kind == "payload":
        mass = 0.06 * float(np.asarray(robot.nominal)[::10].sum()) if arm.name != "puma560" else 1.2
        r = np.array([0.02, 0.03, 0.05])
        own = 1e-3 * mass * np.eye(3) + mass * (r @ r * np.eye(3) - np.outer(r, r))
        body = [mass, *(mass * r), own[0, 0], own[0, 1], own[1, 1], own[0, 2], own[1, 2], own[2, 2]]
        later, changed = model + ident.make_effect("payload"), np.append(values, body)
    before = _log(arm, model, values, 10 * seed + 1)
    after = _log(arm, later, changed, 10 * seed + 2)
    if kind == "encoder offset":
        q = after.q.copy()
        q[:, j] += 0.03
        after = ident.Log(after.name, t=after.t, q=q, tau=after.tau)
    if kind == "torque scale":
        tau = {side: x.copy() for side, x in after.tau.items()}
        for x in tau.values():
            x[:, j] *= 1.08
        after = ident.Log(after.name, t=after.t, q=after.q, tau=tau)
    return Pair(kind, arm, seed, before, after, rights(arm, kind, seed))


def rights(arm: Arm, kind: str, seed: int) -> tuple[Place, ...]:
    """By which names a change is told rightly, and on which joints."""
    every = arm.robot.joint_names
    one = (every[1 + seed % 2],)
    if kind in ("friction", "friction of all"):
        where = [one] if kind == "friction" else [every, *((joint,) for joint in every)]
        return tuple((name, place) for place in where for name in ("viscous", "coulomb"))
    names = {"encoder offset": "encoder_offset", "torque scale": "torque_constant", "stiction": "stribeck", "unchanged": ""}
    name = names.get(kind, kind)
    places: list[tuple[str, ...]] = [(), (every[-1],)] if kind == "payload" else [one]
    return tuple((name, place) for place in places) if name else ()


def _log(arm: Arm, model: ident.Model, values: Array, seed: int) -> ident.Log:
    """A log of the true model along a motion of its own."""
    robot = arm.robot
    motion = motion_of(robot, 1000 * seed, arm.seconds)
    rng = np.random.default_rng([seed, 77])
    side = robot.transmission.measured
    if not arm.feedback:
        t = np.arange(round(arm.seconds * arm.rate)) / arm.rate
        c = motion.sample(t)
        tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=arm.rate), values)
        tau = tau + NOISE * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
        step = 2 * np.pi / 20000
        return ident.Log(f"log{seed}", t=t, q=c.q + step * rng.uniform(-0.5, 0.5, c.q.shape), tau={side.value: tau})
    inertial = robot.rigid_body() + RotorInertia()
    own = arm.values
    count = len(nominal_values(robot.rigid_body())) + robot.n
    controller = PDFeedforward.tuned(inertial, own[:count], frequency_hz=LOOP_HZ, damping=0.9, side=Side.MOTOR)
    speed = np.abs(robot.transmission.motor_rate(motion.sample(np.linspace(0.0, arm.seconds, 2000)).dq)).max(axis=0)
    friction = FluctuatingFriction(tuple(arm.drive["Fc"]), (10 * seed,), slow=tuple((0.002 * speed).tolist()))
    (run,) = simulate_batch(
        Plant(model, values), desired=[motion], controller=controller, rate=arm.rate, control_rate=1000.0,
        feedback=Feedback(counts=COUNTS), actuators=(friction,), seeds=(seed,),
    )  # fmt: skip
    tau = robot.transmission.torque(run.tau, side, Side.MOTOR)
    tau = tau + coloured(rng, len(tau), NOISE * np.sqrt(np.mean(tau**2, axis=0)))
    step = 2 * np.pi / COUNTS
    motor = np.round(robot.transmission.motor_position(run.link.q) / step) * step
    return ident.Log(
        f"log{seed}", t=run.t, q=robot.transmission.joint_position(motor),
        tau={side.value: robot.transmission.torque(tau, Side.MOTOR, side)},
    )  # fmt: skip


def kept(folder: Path, arm: Arm, kind: str, seed: int) -> Pair:
    """The pair from a folder of logs; made, and kept there, where it is missing."""
    import pickle

    file = folder / f"{arm.name}-{kind.replace(' ', '_')}-{seed}.pickle"
    if file.is_file():
        before, after, _ = pickle.loads(file.read_bytes())
        return Pair(kind, arm, seed, before, after, rights(arm, kind, seed))
    made = pairs(arm, kind, seed)
    folder.mkdir(parents=True, exist_ok=True)
    file.write_bytes(pickle.dumps((made.before, made.after)))
    return made
