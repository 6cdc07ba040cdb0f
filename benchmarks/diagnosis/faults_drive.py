"""Faults of the catalogue: friction beyond Coulomb and viscous, drives and their torque reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.robots.transmission import Side
from ident.simulation.sensors import TorqueScale

from .distortions import Bent, Reading, Ripple
from .fault import Fault, Setting, dry_law, fault, motor_scales, on_one, smooth_law
from .laws import Bristle, Dry, Smooth, Soft, Whole
from .world import pinocchio_model

Array = np.ndarray
#: How link and rotor swing against each other on a flank of a gear with play: frequency, share of the critical damping.
_FLANK_HZ = 150.0
_FLANK_DAMPING = 0.4
_POSTURES = 64


@fault
def asymmetric_coulomb(s: Setting) -> Fault:
    d = s.sign() * 0.25 * s.size * motor_scales(s)[2]
    return smooth_law(s, "asymmetric_coulomb", lambda t, q, w: d, dFc=d)


@fault
def asymmetric_viscous(s: Setting) -> Fault:
    d = s.sign() * 0.4 * s.size * float(s.arm.drive["Fv"][s.j])
    return smooth_law(s, "asymmetric_viscous", lambda t, q, w: d * abs(w), dFv=d)


@fault
def stribeck(s: Setting) -> Fault:
    excess, v = 0.35 * s.size * motor_scales(s)[2], s.rng.uniform(0.06, 0.2) * s.speed[s.j]
    return dry_law(s, "stribeck", lambda t, q, w: excess * np.exp(-((w / v) ** 2)), Fs=excess, v_s=float(v))


@fault
def nonlinear_viscous(s: Setting) -> Fault:
    a = float(s.rng.choice([0.4, 0.5, 0.6, 1.6, 1.8, 2.0]))
    top = s.speed[s.j]
    level = 0.5 * s.size * motor_scales(s)[2] / top**a
    return dry_law(s, "nonlinear_viscous", lambda t, q, w: level * abs(w) ** a, Fn=level, a=a)


@fault
def load_dependent_friction(s: Setting) -> Fault:
    loss = np.zeros(s.arm.robot.n)
    loss[s.j] = 0.1 * s.size
    return Fault("load_dependent_friction", (s.joint,), {"Fl": 0.1 * s.size}, loss=loss)


@fault
def position_dependent_friction(s: Setting) -> Fault:
    level, phase = 0.3 * s.size * motor_scales(s)[2], s.rng.uniform(0, 2 * np.pi)
    span = np.ptp(s.reach[s.j])
    order = float(s.rng.uniform(8.0, 30.0) / span)
    K, zero = s.arm.robot.transmission.K, s.arm.robot.transmission.zero
    # On a joint that other motors turn too, the position is that of the joint.
    law = Whole(s.j, "motor", lambda t, q, w: (0.0, level * float(np.sin(order * (q @ K[s.j] + zero[s.j]) + phase))))
    return Fault("position_dependent_friction", (s.joint,), {"order": order}, laws=(law,))


@fault
def joint_side_friction(s: Setting) -> Fault | None:
    K = s.arm.robot.transmission.K
    if np.count_nonzero(K[s.j]) < 2:
        return None
    level = 0.5 * s.size * motor_scales(s)[2] * s.ratio
    slope = 0.3 * level / (s.speed[s.j] / s.ratio)
    laws = (Dry(s.j, "joint", lambda t, q, w: level), Smooth(s.j, "joint", lambda t, q, w: slope * w))
    return Fault("joint_side_friction", (s.joint,), {"Fc_link": level, "Fv_link": float(slope)}, laws=laws)


@fault
def presliding(s: Setting) -> Fault:
    level, span = motor_scales(s)[2], np.ptp(s.reach[s.j]) * s.ratio
    length = float(s.rng.uniform(0.004, 0.012) * span * min(s.size, 2.0))
    return Fault("presliding", (s.joint,), {"Fp": level, "z_s": length}, laws=(Bristle(s.j, "motor", level, length),))


@fault
def temperature_drift_viscous(s: Setting) -> Fault:
    d, T = 0.35 * s.size * float(s.arm.drive["Fv"][s.j]), float(s.rng.uniform(0.2, 0.6) * s.seconds)
    return smooth_law(s, "temperature_drift_viscous", lambda t, q, w: d * np.exp(-t / T) * w, Fvt=d, T=T)


@fault
def temperature_drift_coulomb(s: Setting) -> Fault:
    d, T = 0.3 * s.size * motor_scales(s)[2], float(s.rng.uniform(0.2, 0.6) * s.seconds)
    return dry_law(s, "temperature_drift_coulomb", lambda t, q, w: d * np.exp(-t / T), Fct=d, T=T)


@fault
def offset(s: Setting) -> Fault:
    d = s.sign() * 0.05 * s.size * motor_scales(s)[0]
    return Fault("offset", (s.joint,), {"offset": d}, distortions=(Reading(on_one(s, d), lambda t, m, x: x),))


@fault
def offset_drift(s: Setting) -> Fault:
    d = s.sign() * 0.1 * s.size * motor_scales(s)[0] / s.seconds
    return Fault("offset_drift", (s.joint,), {"drift": d}, distortions=(Reading(on_one(s, d), lambda t, m, x: x * t[:, None]),))


@fault
def offset_step(s: Setting) -> Fault:
    d, at = s.sign() * 0.06 * s.size * motor_scales(s)[0], float(s.rng.uniform(0.2, 0.6) * s.seconds)
    step = Reading(on_one(s, d), lambda t, m, x: x * (t[:, None] >= at))
    return Fault("offset_step", (s.joint,), {"step": d, "t_0": at}, distortions=(step,))


@fault
def cogging(s: Setting) -> Fault:
    level, phase = 0.08 * s.size * motor_scales(s)[0], s.rng.uniform(0, 2 * np.pi)
    order = 1.0 if s.rng.random() < 0.5 else float(s.rng.uniform(0.05, 0.3))  # a turn of the motor, or of a gear wheel behind it
    return smooth_law(s, "cogging", lambda t, q, w: level * np.sin(order * q + phase), order=order, amplitude=level)


@fault
def torque_ripple(s: Setting) -> Fault:
    share, phase = 0.08 * s.size, s.rng.uniform(0, 2 * np.pi)
    order = 1.0 if s.rng.random() < 0.3 else float(s.rng.uniform(0.05, 0.3))
    return Fault("torque_ripple", (s.joint,), {"order": order}, distortions=(Ripple(s.j, share, order, phase),))


@fault
def torque_constant(s: Setting) -> Fault:
    share = s.sign() * 0.08 * s.size
    factor = np.ones(s.arm.robot.n)
    factor[s.j] += share
    return Fault("torque_constant", (s.joint,), {"ekt": share}, distortions=(TorqueScale(tuple(factor)),))


@fault
def torque_nonlinearity(s: Setting) -> Fault:
    share, tau = s.sign() * 0.03 * s.size, motor_scales(s)[0]
    power = float(s.rng.choice([2.0, 3.0]))
    return Fault("torque_nonlinearity", (s.joint,), {"power": power}, distortions=(Bent(s.j, share, power, tau),))


@fault
def saturation(s: Setting) -> Fault:
    limit = np.full(s.arm.robot.n, np.inf)
    # What the motion asks more than for 1.5 to 6 % of the time: seldom enough that the controller catches up.
    limit[s.j] = np.quantile(np.abs(s.torque[:, s.j]), 1.0 - 0.03 * min(s.size, 2.0))
    return Fault("saturation", (s.joint,), {"limit": float(limit[s.j])}, limit=limit)


@fault
def gear_coupling(s: Setting) -> Fault | None:
    robot = s.arm.robot
    others = [i for i in range(robot.n) if i != s.j and robot.joints[i].prismatic == robot.joints[s.j].prismatic]
    near = [i for i in others if abs(i - s.j) == 1]
    if not near:
        return None
    i = int(s.rng.choice(near))
    K = robot.transmission.K.copy()
    value = s.sign() * 0.05 * s.size * abs(K[s.j, s.j])
    K[s.j, i] += value
    changed = robot.with_transmission(replace(robot.transmission, K=K))
    other = replace(s.arm, model=replace(s.arm.model, robot=changed))
    return Fault("gear_coupling", (s.joint,), {"K": value, "motor": float(i)}, arm=other)


@fault
def joint_elasticity(s: Setting) -> Fault | None:
    if np.count_nonzero(s.arm.robot.transmission.K[s.j]) > 1 or s.arm.robot.joints[s.j].prismatic:
        return None
    inertia = _link_inertia(s)
    hertz = float(s.rng.uniform(5.0, 8.0)) / min(max(s.size, 0.5), 2.0) ** 0.5
    stiffness = inertia * (2 * np.pi * hertz) ** 2
    damping = 2 * 0.05 * np.sqrt(stiffness * inertia)
    return Fault("joint_elasticity", (s.joint,), {"stiffness": stiffness}, soft=Soft(s.j, stiffness, damping))


@fault
def backlash(s: Setting) -> Fault | None:
    if np.count_nonzero(s.arm.robot.transmission.K[s.j]) > 1 or s.arm.robot.joints[s.j].prismatic:
        return None
    gap = 0.006 * s.size * float(np.ptp(s.reach[s.j]))
    # As stiff as the simulator's finest step allows in any posture.
    w = 2 * np.pi * _FLANK_HZ
    stiffness = _least_inertia_apart(s) * w**2
    return Fault("backlash", (s.joint,), {"gap": gap}, soft=Soft(s.j, stiffness, stiffness * 2 * _FLANK_DAMPING / w, gap))


def _least_inertia_apart(s: Setting) -> float:
    """Inertia against motion of link and rotor from each other while all other joints give way, the least of the postures."""
    import pinocchio as pin

    model, data = pinocchio_model(s.arm)
    inverse, rotors = s.arm.robot.transmission.K_inverse, s.arm.drive["Ia"].copy()
    rotor, rotors[s.j] = float(rotors[s.j]) * s.ratio**2, 0.0
    least = np.inf
    for q in np.random.default_rng(0).uniform(s.reach[:, 0], s.reach[:, 1], (_POSTURES, s.arm.robot.n)):
        upper = np.triu(pin.crba(model, data, q))
        links = upper + np.triu(upper, 1).T + inverse.T @ (rotors[:, None] * inverse)
        least = min(least, 1.0 / (float(np.linalg.inv(links)[s.j, s.j]) + 1.0 / rotor))
    return least


def _link_inertia(s: Setting) -> float:
    """Typical inertia of what the joint moves, its own rotor not counted."""
    from ident.simulation.controller import typical_inertia

    whole = float(typical_inertia(s.arm.model, s.arm.values, Side.JOINT)[s.j])
    return max(whole - float(s.arm.drive["Ia"][s.j]) * s.ratio**2, 1e-3)
