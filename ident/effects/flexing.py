"""How springs with a mass on them deflect under a load: an exact recursion over samples, compiled where it was built."""

from __future__ import annotations

import numpy as np

from .._native.choice import compiled

Array = np.ndarray


def responses(load: Array, inertia: Array, stiffness: Array, damping: Array, step: float, first: float) -> tuple[Array, Array, Array]:
    """Deflections δ of several springs under one load and their two derivatives, (N, L) each.

    `load` (N,): torque over inertia in rad/s² (m/s²), linear between samples; `inertia` (N,) on the spring; `stiffness`, `damping`
    (share of the critical one), (L,) each; `first`: the load under which each starts at rest; `step`: s. Each step is solved exactly."""
    omega = np.sqrt(stiffness / inertia[:, None])
    force = np.ascontiguousarray(np.broadcast_to(-load[:, None], omega.shape))
    position, velocity = np.empty(force.shape), np.zeros(force.shape)
    if len(force):
        position[0] = -first / omega[0] ** 2
        _follow(force, np.stack(_spring_step(omega, damping, step)), position, velocity)
    return position, velocity, force - omega**2 * position - 2.0 * damping * omega * velocity


def _follow(force: Array, coefficients: Array, position: Array, velocity: Array) -> None:
    """Fill position and velocity (N, L) from their first rows on, for force (N, L) and step coefficients (8, N, L)."""
    recursions = compiled("_recursions")
    if recursions is None:
        _follow_plainly(force, coefficients, position, velocity)
    else:
        recursions.springs(force, coefficients, *force.shape, position, velocity)


def _follow_plainly(force: Array, coefficients: Array, position: Array, velocity: Array) -> None:
    """`_follow` in NumPy, all springs at a time."""
    a11, a12, a21, a22, b10, b11, b20, b21 = coefficients
    for k in range(len(force) - 1):
        x, v, f0, f1 = position[k], velocity[k], force[k], force[k + 1]
        position[k + 1] = a11[k] * x + a12[k] * v + b10[k] * f0 + b11[k] * f1
        velocity[k + 1] = a21[k] * x + a22[k] * v + b20[k] * f0 + b21[k] * f1


def _spring_step(omega: Array, damping: Array | float, h: float) -> tuple[Array, ...]:
    """Exact step h of y'' = f − ω² y − 2ζω y' with f linear in between: (y, y')_1 = A (y, y')_0 + b_0 f_0 + b_1 f_1."""
    damped = omega * np.sqrt(np.maximum(1.0 - damping**2, 1e-12))
    decay = np.exp(-damping * omega * h)
    c, s = decay * np.cos(damped * h), decay * np.sin(damped * h) / damped
    zw = damping * omega
    a11, a12, a21, a22 = c + zw * s, s, -(omega**2) * s, c - zw * s
    # A constant force shifts the rest position by f/ω²; a ramp r t moves it along (r/ω²)(t − 2ζ/ω).
    lag = 2.0 * damping / omega
    w2 = omega**2
    slope = 1.0 / (h * w2)
    b1_y = slope * (h - lag + a11 * lag - a12)
    b1_v = slope * (1.0 + a21 * lag - a22)
    b0_y = (1.0 - a11) / w2 - b1_y
    b0_v = -a21 / w2 - b1_v
    return a11, a12, a21, a22, b0_y, b1_y, b0_v, b1_v
