"""Faults of the catalogue: springs, loads, and a geometry other than declared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .arms import Arm
from .fault import Fault, Setting, fault, smooth_law
from .laws import Whole

Array = np.ndarray


@fault
def linear_spring(s: Setting) -> Fault:
    k, rest = 0.15 * s.size * s.tau[s.j] * s.ratio / np.ptp(s.reach[s.j]), float(s.rng.uniform(*s.reach[s.j]))
    return smooth_law(s, "linear_spring", lambda t, q, w: k * (q - rest), "joint", ks=k, ks0=-k * rest)


@fault
def nonlinear_spring(s: Setting) -> Fault:
    middle, half = s.reach[s.j].mean(), 0.5 * np.ptp(s.reach[s.j])
    level = 0.12 * s.size * s.tau[s.j] * s.ratio
    return smooth_law(
        s, "nonlinear_spring", lambda t, q, w: level * (((q - middle) / half) ** 3 + 0.5 * ((q - middle) / half) ** 2), "joint"
    )


@fault
def counterbalance(s: Setting) -> Fault | None:
    if s.arm.robot.joints[s.j].prismatic:
        return None
    angle, a, r = float(s.rng.uniform(-1, 1)), 0.25, 0.1
    stiffness = 0.5 * s.size * s.tau[s.j] * s.ratio / (a * r)
    free = 0.8 * (a - r)

    def f(t: float, q: float, w: float) -> float:
        # Hooks at distance a on the frame and r on the link; the spring's pull on the link, through its lever.
        alpha = q - angle
        px, py = r * np.cos(alpha), r * np.sin(alpha)
        length = np.hypot(a - px, py)
        pull = stiffness * (length - free)
        return pull * (a * py) / length  # moment about the axis of a force towards (a, 0)

    return smooth_law(s, "counterbalance", f, "joint", angle=angle, ratio=r / a)


@fault
def payload_step(s: Setting) -> Fault | None:
    names, robot = s.arm.model.names, s.arm.robot
    last = robot.tree_joints[-1].name
    values = s.arm.values.copy()
    mass = 0.06 * s.size * float(robot.nominal[0::10].sum()) * 0.5
    c = s.rng.uniform(-0.05, 0.05, 3) + np.array([0.0, 0.0, 0.08])
    inertia = mass * (c @ c * np.eye(3) - np.outer(c, c)) + mass * 2e-3 * np.eye(3)
    body = [mass, *(mass * c), inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2], inertia[2, 2]]
    for symbol, value in zip(("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"), body, strict=True):
        values[names.index(f"{symbol}_{last}")] += value
    at = float(s.rng.uniform(0.25, 0.55) * s.seconds)
    return Fault("payload_step", (last,), {"m": mass, "t_0": at}, changed=replace(s.arm, values=values), change_at=at)


def _other_gravity(s: Setting, gravity: Array) -> Arm:
    robot = s.arm.robot.with_gravity(gravity.tolist())
    return replace(s.arm, model=replace(s.arm.model, robot=robot))


@fault
def base_tilt(s: Setting) -> Fault:
    axis = s.rng.normal(size=2)
    axis = axis / np.linalg.norm(axis) * np.deg2rad(3.0) * s.size
    g = np.array([0.0, 0.0, -9.81])
    tilt = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])  # turn by (axis, 0)
    from scipy.linalg import expm

    return Fault("base_tilt", (), {"tiltx": axis[0], "tilty": axis[1]}, arm=_other_gravity(s, expm(tilt).T @ g))


@fault
def gravity_magnitude(s: Setting) -> Fault:
    d = s.sign() * 0.4 * s.size
    return Fault("gravity_magnitude", (), {"dg": d}, arm=_other_gravity(s, np.array([0.0, 0.0, -9.81 - d])))


@fault
def external_force(s: Setting) -> Fault:
    robot = s.arm.robot
    direction = s.rng.normal(size=3)
    force = direction / np.linalg.norm(direction) * 4.0 * s.size * float(robot.nominal[0::10].sum()) / 20.0
    from ident.regressor.rigid import inverse_dynamics

    body = robot.tree.nb - 1
    mass = np.zeros(10 * robot.tree.nb)
    mass[10 * body] = 1.0
    field_of = replace(robot.tree, gravity=np.asarray(force, float))

    def pull(j: int) -> Callable[[float, Array, Array], tuple[float, float]]:
        def f(t: float, q: Array, dq: Array) -> tuple[float, float]:
            at = robot.tree_position(q[None])
            still = np.zeros_like(at)
            return float((inverse_dynamics(field_of, mass, at, still, still) @ robot.loop.W)[0, j]), 0.0

        return f

    laws = tuple(Whole(j, "joint", pull(j)) for j in range(robot.n))
    truth = dict(zip(("fx", "fy", "fz"), map(float, force), strict=True))
    return Fault("external_force", (robot.joint_names[-1],), truth, laws=laws)


@fault
def link_length(s: Setting) -> Fault | None:
    robot = s.arm.robot
    model = robot.model.copy()
    placement = model.jointPlacements[model.getJointId(s.joint)]
    length = float(np.linalg.norm(placement.translation))
    if length < 0.05 or s.j == 0:
        return None
    d = s.sign() * 0.01 * s.size
    placement.translation = placement.translation * (1 + d / length)
    other = replace(s.arm, model=replace(s.arm.model, robot=replace(robot, model=model)))
    return Fault("link_length", (s.joint,), {"dL": d}, arm=other)
