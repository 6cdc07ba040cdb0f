"""Logs of a pendulum along a motion of eight harmonics, with anything added to its torque, and their diagnosis."""

from __future__ import annotations

import numpy as np

import ident

Array = np.ndarray
RATE, SECONDS = 200.0, 40.0
INERTIA, GRAVITY, VISCOUS, COULOMB = 9.0, 30.0, 6.0, 4.0
PENDULUM = """<robot name="one"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -.3"/><mass value="10"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" velocity="9" effort="900"/></joint></robot>"""


def motion(seed: int) -> tuple[Array, Array, Array, Array]:
    """Time, position, speed and acceleration of eight harmonics."""
    rng, t = np.random.default_rng(seed), np.arange(int(SECONDS * RATE)) / RATE
    w = 4 * np.pi * np.arange(1, 9) / SECONDS
    a, b = rng.normal(size=(2, 8)) / np.arange(1, 9)
    angle = np.outer(t, w)
    q = np.sin(angle) @ a + (np.cos(angle) - 1) @ b
    v = np.cos(angle) @ (a * w) - np.sin(angle) @ (b * w)
    return t, q, v, -np.sin(angle) @ (a * w**2) - np.cos(angle) @ (b * w**2)


def needed(q: Array, v: Array, acceleration: Array) -> Array:
    return INERTIA * acceleration + GRAVITY * np.sin(q) + VISCOUS * v + COULOMB * np.sign(v)


def recorded(seed: int, more) -> ident.LogSet:  # type: ignore[no-untyped-def]
    """A log of the motion with what `more(rng, t, q, v)` adds to the torque."""
    t, q, v, acceleration = motion(seed)
    rng = np.random.default_rng([seed, 1])
    tau = needed(q, v, acceleration) + 0.3 * rng.normal(size=t.size) + more(rng, t, q, v)
    return of(seed, t, q + 2e-6 * rng.normal(size=t.size), tau)


def of(seed: int, t: Array, q: Array, tau: Array) -> ident.LogSet:
    return ident.LogSet((ident.Log(f"run {seed}", t, q=q[:, None], tau={"joint": tau[:, None]}),), ident.Robot.from_urdf(PENDULUM))


def diagnosed(train: ident.LogSet, held: ident.LogSet) -> ident.Diagnosis:
    before = ident.fit(train, model=[ident.make_effect(e) for e in ("viscous", "coulomb")], held=0)
    prepare = ident.ZeroPhase(cutoff_hz=8.0)
    return ident.diagnose(before, prepare(held), fit=prepare(train))
