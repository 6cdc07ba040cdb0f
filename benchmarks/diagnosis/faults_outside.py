"""Faults that the catalogue does not hold."""

from __future__ import annotations

from typing import Any

import numpy as np

from .distortions import DeadZone, Reading, Slip
from .fault import Fault, Setting, motor_scales, on_one, outside
from .laws import Dry, Law, Play, Slosh, Smooth, Whole, ramp

Array = np.ndarray


def _out(s: Setting, name: str, *laws: Law, **more: Any) -> Fault:
    return Fault(name, (s.joint,), laws=laws, outside=True, **more)


@outside
def bumper(s: Setting) -> Fault:
    """A rubber stop that the joint touches near the end of its range."""
    edge = s.reach[s.j, 0] + 0.8 * np.ptp(s.reach[s.j])
    k = 1.2 * s.size * s.tau[s.j] * s.ratio / (0.2 * np.ptp(s.reach[s.j]))
    return _out(s, "bumper", Smooth(s.j, "joint", lambda t, q, w: k * max(q - edge, 0.0)))


@outside
def memory(s: Setting) -> Fault:
    """A hose that drags: hysteresis over a tenth of the range."""
    width = 0.12 * np.ptp(s.reach[s.j])
    return _out(s, "memory", Play(s.j, "joint", 0.15 * s.size * s.tau[s.j] * s.ratio / width, width))


@outside
def deadzone(s: Setting) -> Fault:
    """A torque sensor that reads nothing below a small torque."""
    return _out(s, "deadzone", distortions=(DeadZone(s.j, 0.3 * s.size * float(s.tau[s.j])),))


@outside
def slip(s: Setting) -> Fault:
    """An encoder coupling that slips by a few degrees on the way."""
    at = float(s.rng.uniform(0.3, 0.6) * s.seconds)
    return _out(s, "slip", distortions=(Slip(s.j, np.deg2rad(5.0) * s.size * (0.05 if s.arm.robot.joints[s.j].prismatic else 1.0), at),))


@outside
def hum(s: Setting) -> Fault:
    """A tone in the torque reading at a fixed frequency."""
    hertz, phase = float(s.rng.uniform(1.5, 6.0)), float(s.rng.uniform(0, 6.28))
    d = 0.08 * s.size * motor_scales(s)[0]
    return _out(s, "hum", distortions=(Reading(on_one(s, d), lambda t, m, x: x * np.sin(2 * np.pi * hertz * t + phase)[:, None]),))


@outside
def knocks(s: Setting) -> Fault:
    """Something knocks against the arm now and then."""
    times = np.sort(s.rng.uniform(0.05, 0.95, 14)) * s.seconds
    level = s.rng.normal(size=14) * 1.0 * s.size * motor_scales(s)[0]

    def f(t: float, q: float, w: float) -> float:
        return float((level * np.exp(-0.5 * ((t - times) / 0.08) ** 2)).sum())

    return _out(s, "knocks", Smooth(s.j, "motor", f))


@outside
def neighbour_friction(s: Setting) -> Fault | None:
    """Dry friction that depends on where another joint stands (a cable bundle)."""
    i = s.j - 1 if s.j > 0 else 1
    level, span = 0.5 * s.size * motor_scales(s)[2], np.ptp(s.reach[i])
    K, zero = s.arm.robot.transmission.K, s.arm.robot.transmission.zero

    def f(t: float, q: Array, dq: Array) -> tuple[float, float]:
        other = (q @ K[i] + zero[i] - s.reach[i].mean()) / span
        return 0.0, level * 2 * float(other)

    return _out(s, "neighbour_friction", Whole(s.j, "motor", f))


@outside
def wandering_friction(s: Setting) -> Fault:
    """Dry friction whose level wanders irregularly in time."""
    knots = np.linspace(0, s.seconds, 14)
    level = 0.35 * s.size * motor_scales(s)[2] * s.rng.normal(size=14)
    from scipy.interpolate import CubicSpline

    wander = CubicSpline(knots, level)
    return _out(s, "wandering_friction", Dry(s.j, "motor", lambda t, q, w: float(wander(t))))


@outside
def crosstalk(s: Setting) -> Fault | None:
    """A torque sensor that also reads a share of another joint's speed (no energy in it)."""
    i = s.j - 1 if s.j > 0 else 1
    d = 0.12 * s.size * motor_scales(s)[0] / s.speed[i]
    return _out(s, "crosstalk", Whole(s.j, "motor", lambda t, q, w: (d * float(w[i]), 0.0)))


@outside
def rough_spot(s: Setting) -> Fault:
    """A damaged tooth: a narrow bump of friction at one position."""
    at = s.reach[s.j].mean() + 0.15 * np.ptp(s.reach[s.j]) * s.rng.uniform(-1, 1)
    width, level = 0.025 * np.ptp(s.reach[s.j]), 1.0 * s.size * motor_scales(s)[2] * s.ratio
    return _out(s, "rough_spot", Dry(s.j, "joint", lambda t, q, w: level * np.exp(-(((q - at) / width) ** 2))))


@outside
def liquid(s: Setting) -> Fault:
    """A load that sloshes: it swings behind the joint's acceleration at its own slow frequency (seen on this joint)."""
    return _out(s, "liquid", Slosh(s.j, "joint", 0.5 * s.size * s.tau[s.j] * s.ratio, 2 * np.pi * float(s.rng.uniform(0.8, 1.6))))


@outside
def brake(s: Setting) -> Fault:
    """A brake that drags for some seconds in the middle of the log."""
    a0, b0 = 0.35 * s.seconds, 0.35 * s.seconds + 5.0
    level = 0.6 * s.size * motor_scales(s)[2]
    return _out(s, "brake", Dry(s.j, "motor", lambda t, q, w: level * ramp(a0, a0 + 1.0, t) * (1 - ramp(b0, b0 + 1.0, t))))
