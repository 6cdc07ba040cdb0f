"""Drives that integrate their error: what a log of them determines, where the integral begins, and what the limit does to it."""

from __future__ import annotations

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import PENDULUM, command
from ident.drives import DriveFit, DriveLaw, fit_drives

pytestmark = needs_native

TRUTH = {"kp": 20.0, "ki": 40.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006, "offset": 0.0}
#: Of the pendulum's link about its joint (kg m²), and its weight's torque (N m) when it is level.
_INERTIA, _WEIGHT = 0.002 + 0.6 * 0.2**2, 0.6 * 0.2 * 9.81


@pytest.fixture(scope="module")
def robot():
    return ident.Robot.from_urdf(PENDULUM)


def model_of(robot):
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


def held_position(
    seed: int = 0, *, seconds: float = 6.0, rate: int = 200, noise: float = 5e-4, limit: float = np.inf, off: tuple[float, float] = (0.0, 0.0),
    start: float = 0.0, **other: float,
) -> ident.Log:  # fmt: skip
    """A log of the pendulum under a drive that integrates its error, in steps of 20 µs. `start`: the integral at first (N m); `off`:
    seconds between which the drive is switched off."""
    own = TRUTH | other
    sent = command(seed, seconds, rate, 1)[:, 0]
    every = 50_000 // rate
    h, late = 1.0 / (rate * every), round(own["delay"] * rate * every)
    inertia, q, dq, wound, out = _INERTIA + own["Ia"], 0.0, 0.0, start, []
    for k in range(len(sent) * every):
        if k % every == 0:
            out.append(q)
        on = not off[0] <= (k // every) / rate < off[1]
        error = sent[max(k - late, 0) // every] - q
        asked = own["kp"] * error + wound - own["kd"] * dq
        given = min(max(asked, -limit), limit)
        if given == asked or error * asked < 0.0:
            wound += h * own["ki"] * error
        wound *= on
        torque = on * given - own["Fv"] * dq - own["offset"] - _WEIGHT * np.sin(q)
        moved, most = dq + h * torque / inertia, h * own["Fc"] / inertia
        dq = 0.0 if abs(moved) <= most else moved - (most if moved > 0.0 else -most)
        q += h * dq
    q = np.array(out) + noise * np.random.default_rng([seed, 1]).standard_normal(len(out))
    t = np.arange(len(sent)) / rate
    extra = {"q_cmd1": sent} | ({"torque_enable1": 1.0 - ((off[0] <= t) & (t < off[1]))} if off[1] else {})
    return ident.Log(f"run{seed}", t=t, q=q[:, None], extra=extra)
