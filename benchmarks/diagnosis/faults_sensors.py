"""Faults of the catalogue: encoders, timing, and usual effects that were not declared."""

from __future__ import annotations

import numpy as np

from .distortions import JointEncoder, Lagged, Late
from .fault import Fault, Setting, fault, motor_scales


@fault
def encoder_offset(s: Setting) -> Fault:
    d = s.sign() * np.deg2rad(1.5) * s.size * (0.1 if s.arm.robot.joints[s.j].prismatic else 1.0)
    return Fault("encoder_offset", (s.joint,), {"eoff": d}, distortions=(JointEncoder(s.j, offset=d),))


@fault
def encoder_scale(s: Setting) -> Fault:
    d = s.sign() * 0.015 * s.size
    return Fault("encoder_scale", (s.joint,), {"escale": d}, distortions=(JointEncoder(s.j, scale=d),))


@fault
def encoder_eccentricity(s: Setting) -> Fault:
    d, phase = np.deg2rad(0.5) * s.size, float(s.rng.uniform(0, 2 * np.pi))
    if s.arm.robot.joints[s.j].prismatic:
        return Fault(
            "encoder_eccentricity",
            (s.joint,),
            {"order": 60.0},
            distortions=(JointEncoder(s.j, amplitude=3e-4 * s.size, order=60.0, phase=phase),),
        )
    order = float(s.rng.choice([1.0, 2.0]))
    return Fault(
        "encoder_eccentricity", (s.joint,), {"order": order}, distortions=(JointEncoder(s.j, amplitude=d, order=order, phase=phase),)
    )


@fault
def delay(s: Setting) -> Fault:
    late = np.zeros(s.arm.robot.n)
    late[s.j] = 0.008 * s.size
    return Fault("delay", (s.joint,), {"delay": 0.008 * s.size}, distortions=(Late(s.j, 0.008 * s.size),))


@fault
def filter_lag(s: Setting) -> Fault:
    T = 0.02 * s.size
    return Fault("filter_lag", (s.joint,), {"T": T}, distortions=(Lagged(s.j, T),))


@fault
def viscous(s: Setting) -> Fault:
    return Fault("viscous", (s.joint,), {"Fv": float(s.arm.drive["Fv"][s.j])}, undeclared="viscous")


@fault
def coulomb(s: Setting) -> Fault:
    return Fault("coulomb", (s.joint,), {"Fc": motor_scales(s)[2]}, undeclared="coulomb")


@fault
def rotor_inertia(s: Setting) -> Fault:
    return Fault("rotor_inertia", (s.joint,), {"Ia": float(s.arm.drive["Ia"][s.j])}, undeclared="rotor_inertia")
