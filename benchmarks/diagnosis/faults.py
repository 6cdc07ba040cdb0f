"""What can be wrong with an arm that its declared model does not say: every catalogued effect, and some outside the catalogue.

Each fault is made for an arm, a joint and a size, from the physics as written here, without the toolkit's effects. Size 1 is
a typical fault; the unit of torque is the joint's own root mean square torque over the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.motion import Coordinates
from ident.simulation.sensors import Distortion, Readings, TorqueScale
from ident.transmission import Side

from .arms import Arm
from .laws import Bristle, Dry, Law, Play, Slosh, Smooth, Soft, Whole, ramp

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Setting:
    """Where a fault goes: the arm, joint `j`, size, a generator of random choices, and the scales of the motion.

    Motor side: `tau` (n,) rms torque, `speed` (n,) 95th percentile of speed. `seconds` of the log; `reach` (n, 2) of q."""

    arm: Arm
    j: int
    size: float
    rng: np.random.Generator
    tau: Array
    speed: Array
    reach: Array
    seconds: float

    @property
    def joint(self) -> str:
        return self.arm.robot.joint_names[self.j]

    @property
    def ratio(self) -> float:
        """Motor turns per joint turn."""
        return float(abs(self.arm.robot.transmission.K_inverse[self.j, self.j]))

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))


@dataclass(frozen=True, eq=False)
class Fault:
    """`effect`: its name in the catalogue, or what it is ("outside" tells); `joints` it sits on; `truth`: parameter symbol → value.

    How it comes about: `laws`, `limit` (n,) of the drive, `loss` (n,) of the gears, `distortions` of the sensors, another true
    `arm`, or one that is `changed` at a time, or a `soft` joint; `undeclared`: an effect left out of the declared model there."""

    effect: str
    joints: tuple[str, ...]
    truth: dict[str, float] = field(default_factory=dict)
    laws: tuple[Law, ...] = ()
    limit: Array | None = None
    loss: Array | None = None
    distortions: tuple[Distortion, ...] = ()
    arm: Arm | None = None
    changed: Arm | None = None
    change_at: float = np.inf
    soft: Soft | None = None
    undeclared: str = ""
    outside: bool = False


FAULTS: dict[str, Callable[[Setting], Fault | None]] = {}
OUTSIDE: dict[str, Callable[[Setting], Fault | None]] = {}


def fault(make: Callable[[Setting], Fault | None]) -> Callable[[Setting], Fault | None]:
    """Register a fault of the catalogue under the function's name."""
    FAULTS[make.__name__] = make
    return make


def outside(make: Callable[[Setting], Fault | None]) -> Callable[[Setting], Fault | None]:
    """Register a fault that the catalogue does not hold."""
    OUTSIDE[make.__name__] = make
    return make


def _law(s: Setting, effect: str, f: Callable[[float, float, float], float], side: str = "motor", **truth: float) -> Fault:
    return Fault(effect, (s.joint,), truth, laws=(Smooth(s.j, side, f),))


def _dry(s: Setting, effect: str, f: Callable[[float, float, float], float], side: str = "motor", **truth: float) -> Fault:
    return Fault(effect, (s.joint,), truth, laws=(Dry(s.j, side, f),))


def _motor(s: Setting) -> tuple[float, float, float]:
    """Torque, speed and Coulomb friction of the joint's motor."""
    return float(s.tau[s.j]), float(s.speed[s.j]), float(s.arm.drive["Fc"][s.j])


# --- friction -------------------------------------------------------------------------------------------------------------


@fault
def asymmetric_coulomb(s: Setting) -> Fault:
    d = s.sign() * 0.25 * s.size * _motor(s)[2]
    return _law(s, "asymmetric_coulomb", lambda t, q, w: d, dFc=d)


@fault
def asymmetric_viscous(s: Setting) -> Fault:
    d = s.sign() * 0.4 * s.size * float(s.arm.drive["Fv"][s.j])
    return _law(s, "asymmetric_viscous", lambda t, q, w: d * abs(w), dFv=d)


@fault
def stribeck(s: Setting) -> Fault:
    excess, v = 0.35 * s.size * _motor(s)[2], s.rng.uniform(0.06, 0.2) * s.speed[s.j]
    return _dry(s, "stribeck", lambda t, q, w: excess * np.exp(-((w / v) ** 2)), Fs=excess, v_s=float(v))


@fault
def nonlinear_viscous(s: Setting) -> Fault:
    a = float(s.rng.choice([0.4, 0.5, 0.6, 1.6, 1.8, 2.0]))
    top = s.speed[s.j]
    level = 0.5 * s.size * _motor(s)[2] / top**a
    return _dry(s, "nonlinear_viscous", lambda t, q, w: level * abs(w) ** a, Fn=level, a=a)


@fault
def load_dependent_friction(s: Setting) -> Fault:
    loss = np.zeros(s.arm.robot.n)
    loss[s.j] = 0.1 * s.size
    return Fault("load_dependent_friction", (s.joint,), {"Fl": 0.1 * s.size}, loss=loss)


@fault
def position_dependent_friction(s: Setting) -> Fault:
    level, phase = 0.3 * s.size * _motor(s)[2], s.rng.uniform(0, 2 * np.pi)
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
    level = 0.5 * s.size * _motor(s)[2] * s.ratio
    slope = 0.3 * level / (s.speed[s.j] / s.ratio)
    laws = (Dry(s.j, "joint", lambda t, q, w: level), Smooth(s.j, "joint", lambda t, q, w: slope * w))
    return Fault("joint_side_friction", (s.joint,), {"Fc_link": level, "Fv_link": float(slope)}, laws=laws)


@fault
def presliding(s: Setting) -> Fault:
    level, span = _motor(s)[2], np.ptp(s.reach[s.j]) * s.ratio
    length = float(s.rng.uniform(0.004, 0.012) * span * min(s.size, 2.0))
    return Fault("presliding", (s.joint,), {"Fp": level, "z_s": length}, laws=(Bristle(s.j, "motor", level, length),))


@fault
def temperature_drift_viscous(s: Setting) -> Fault:
    d, T = 0.35 * s.size * float(s.arm.drive["Fv"][s.j]), float(s.rng.uniform(0.2, 0.6) * s.seconds)
    return _law(s, "temperature_drift_viscous", lambda t, q, w: d * np.exp(-t / T) * w, Fvt=d, T=T)


@fault
def temperature_drift_coulomb(s: Setting) -> Fault:
    d, T = 0.3 * s.size * _motor(s)[2], float(s.rng.uniform(0.2, 0.6) * s.seconds)
    return _dry(s, "temperature_drift_coulomb", lambda t, q, w: d * np.exp(-t / T), Fct=d, T=T)


# --- drive and reading ----------------------------------------------------------------------------------------------------


@fault
def offset(s: Setting) -> Fault:
    d = s.sign() * 0.05 * s.size * _motor(s)[0]
    return Fault("offset", (s.joint,), {"offset": _measured(s, d)}, distortions=(Reading(_one(s, d), lambda t, m, x: x),))


@fault
def offset_drift(s: Setting) -> Fault:
    d = s.sign() * 0.1 * s.size * _motor(s)[0] / s.seconds
    return Fault("offset_drift", (s.joint,), {"drift": _measured(s, d)}, distortions=(Reading(_one(s, d), lambda t, m, x: x * t[:, None]),))


@fault
def offset_step(s: Setting) -> Fault:
    d, at = s.sign() * 0.06 * s.size * _motor(s)[0], float(s.rng.uniform(0.2, 0.6) * s.seconds)
    step = Reading(_one(s, d), lambda t, m, x: x * (t[:, None] >= at))
    return Fault("offset_step", (s.joint,), {"step": _measured(s, d), "t_0": at}, distortions=(step,))


@fault
def cogging(s: Setting) -> Fault:
    level, phase = 0.08 * s.size * _motor(s)[0], s.rng.uniform(0, 2 * np.pi)
    order = 1.0 if s.rng.random() < 0.5 else float(s.rng.uniform(0.05, 0.3))  # a turn of the motor, or of a gear wheel behind it
    return _law(s, "cogging", lambda t, q, w: level * np.sin(order * q + phase), order=order, amplitude=level)


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
    if s.arm.robot.transmission.measured == Side.MOTOR:
        return Fault("torque_constant", (s.joint,), {"ekt": share}, distortions=(TorqueScale(tuple(factor)),))
    return Fault("torque_constant", (s.joint,), {"ekt": share}, distortions=(TorqueScale(tuple(factor)),))


@fault
def torque_nonlinearity(s: Setting) -> Fault:
    share, tau = s.sign() * 0.03 * s.size, _motor(s)[0]
    power = float(s.rng.choice([2.0, 3.0]))
    return Fault("torque_nonlinearity", (s.joint,), {"power": power}, distortions=(Bent(s.j, share, power, tau),))


@fault
def saturation(s: Setting) -> Fault:
    limit = np.full(s.arm.robot.n, np.inf)
    limit[s.j] = (2.2 - 0.35 * min(s.size, 2.0)) * s.tau[s.j]
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
    # As stiff as the simulator's step allows: the lighter side swings at 60 Hz on the flank.
    lighter = min(float(s.arm.drive["Ia"][s.j]) * s.ratio**2, _link_inertia(s))
    stiffness = lighter * (2 * np.pi * 60.0) ** 2
    return Fault("backlash", (s.joint,), {"gap": gap}, soft=Soft(s.j, stiffness, stiffness * 2e-3, gap))


def _link_inertia(s: Setting) -> float:
    """Typical inertia of what the joint moves, its own rotor not counted."""
    from ident.controller import typical_inertia

    whole = float(typical_inertia(s.arm.model, s.arm.values, Side.JOINT)[s.j])
    return max(whole - float(s.arm.drive["Ia"][s.j]) * s.ratio**2, 1e-3)


# --- structure and load ---------------------------------------------------------------------------------------------------


@fault
def linear_spring(s: Setting) -> Fault:
    k, rest = 0.15 * s.size * s.tau[s.j] * s.ratio / np.ptp(s.reach[s.j]), float(s.rng.uniform(*s.reach[s.j]))
    return _law(s, "linear_spring", lambda t, q, w: k * (q - rest), "joint", ks=k, ks0=-k * rest)


@fault
def nonlinear_spring(s: Setting) -> Fault:
    middle, half = s.reach[s.j].mean(), 0.5 * np.ptp(s.reach[s.j])
    level = 0.12 * s.size * s.tau[s.j] * s.ratio
    return _law(s, "nonlinear_spring", lambda t, q, w: level * (((q - middle) / half) ** 3 + 0.5 * ((q - middle) / half) ** 2), "joint")


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

    return _law(s, "counterbalance", f, "joint", angle=angle, ratio=r / a)


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


# --- sensors and timing ---------------------------------------------------------------------------------------------------


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
    return Fault("coulomb", (s.joint,), {"Fc": _motor(s)[2]}, undeclared="coulomb")


@fault
def rotor_inertia(s: Setting) -> Fault:
    return Fault("rotor_inertia", (s.joint,), {"Ia": float(s.arm.drive["Ia"][s.j])}, undeclared="rotor_inertia")


# --- outside the catalogue --------------------------------------------------------------------------------------------------


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
    d = 0.08 * s.size * _motor(s)[0]
    return _out(s, "hum", distortions=(Reading(_one(s, d), lambda t, m, x: x * np.sin(2 * np.pi * hertz * t + phase)[:, None]),))


@outside
def knocks(s: Setting) -> Fault:
    """Something knocks against the arm now and then."""
    times = np.sort(s.rng.uniform(0.05, 0.95, 14)) * s.seconds
    level = s.rng.normal(size=14) * 1.0 * s.size * _motor(s)[0]

    def f(t: float, q: float, w: float) -> float:
        return float((level * np.exp(-0.5 * ((t - times) / 0.08) ** 2)).sum())

    return _out(s, "knocks", Smooth(s.j, "motor", f))


@outside
def neighbour_friction(s: Setting) -> Fault | None:
    """Dry friction that depends on where another joint stands (a cable bundle)."""
    i = s.j - 1 if s.j > 0 else 1
    level, span = 0.5 * s.size * _motor(s)[2], np.ptp(s.reach[i])
    K, zero = s.arm.robot.transmission.K, s.arm.robot.transmission.zero

    def f(t: float, q: Array, dq: Array) -> tuple[float, float]:
        other = (q @ K[i] + zero[i] - s.reach[i].mean()) / span
        return 0.0, level * 2 * float(other)

    return _out(s, "neighbour_friction", Whole(s.j, "motor", f))


@outside
def wandering_friction(s: Setting) -> Fault:
    """Dry friction whose level wanders irregularly in time."""
    knots = np.linspace(0, s.seconds, 14)
    level = 0.35 * s.size * _motor(s)[2] * s.rng.normal(size=14)
    from scipy.interpolate import CubicSpline

    wander = CubicSpline(knots, level)
    return _out(s, "wandering_friction", Dry(s.j, "motor", lambda t, q, w: float(wander(t))))


@outside
def crosstalk(s: Setting) -> Fault | None:
    """A torque sensor that also reads a share of another joint's speed (no energy in it)."""
    i = s.j - 1 if s.j > 0 else 1
    d = 0.12 * s.size * _motor(s)[0] / s.speed[i]
    return _out(s, "crosstalk", Whole(s.j, "motor", lambda t, q, w: (d * float(w[i]), 0.0)))


@outside
def rough_spot(s: Setting) -> Fault:
    """A damaged tooth: a narrow bump of friction at one position."""
    at = s.reach[s.j].mean() + 0.15 * np.ptp(s.reach[s.j]) * s.rng.uniform(-1, 1)
    width, level = 0.025 * np.ptp(s.reach[s.j]), 1.0 * s.size * _motor(s)[2] * s.ratio
    return _out(s, "rough_spot", Dry(s.j, "joint", lambda t, q, w: level * np.exp(-(((q - at) / width) ** 2))))


@outside
def liquid(s: Setting) -> Fault:
    """A load that sloshes: it swings behind the joint's acceleration at its own slow frequency (seen on this joint)."""
    return _out(s, "liquid", Slosh(s.j, "joint", 0.5 * s.size * s.tau[s.j] * s.ratio, 2 * np.pi * float(s.rng.uniform(0.8, 1.6))))


@outside
def brake(s: Setting) -> Fault:
    """A brake that drags for some seconds in the middle of the log."""
    a0, b0 = 0.35 * s.seconds, 0.35 * s.seconds + 5.0
    level = 0.6 * s.size * _motor(s)[2]
    return _out(s, "brake", Dry(s.j, "motor", lambda t, q, w: level * ramp(a0, a0 + 1.0, t) * (1 - ramp(b0, b0 + 1.0, t))))


# --- readings ---------------------------------------------------------------------------------------------------------------


def _one(s: Setting, value: float) -> Array:
    """(n,) on the measured side with a motor-side torque at the joint's motor."""
    out = np.zeros(s.arm.robot.n)
    out[s.j] = _measured(s, value)
    return out


def _measured(s: Setting, motor_torque: float) -> float:
    return motor_torque if s.arm.robot.transmission.measured == Side.MOTOR else motor_torque * s.ratio


@dataclass(frozen=True, eq=False)
class Reading(Distortion):
    """Torque reads more by `f(t, motion, size)` (N, n), size (n,)."""

    size: Array
    f: Callable[[Array, Coordinates, Array], Array]

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        return replace(readings, tau=readings.tau + self.f(readings.t, readings.motion, self.size))


@dataclass(frozen=True, eq=False)
class Ripple(Distortion):
    """Torque of joint j reads 1 + share sin(order φ + phase) times too much, φ the motor's angle."""

    j: int
    share: float
    order: float
    phase: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        transmission = readings.robot.transmission
        q = readings.motion.q
        angle = q if readings.side == Side.MOTOR else transmission.motor_position(q)
        tau = readings.tau.copy()
        tau[:, self.j] *= 1.0 + self.share * np.sin(self.order * angle[:, self.j] + self.phase)
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Bent(Distortion):
    """Torque of joint j reads τ + share |τ/τ0|^(power−1) τ."""

    j: int
    share: float
    power: float
    motor_tau: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        x = tau[:, self.j]
        scale = np.sqrt(np.mean(x**2))
        tau[:, self.j] = x * (1.0 + self.share * np.abs(x / scale) ** (self.power - 1.0))
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class DeadZone(Distortion):
    """Torque of joint j reads zero below `width` (motor side), and so much less above."""

    j: int
    width: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        transmission = readings.robot.transmission
        width = self.width if transmission.measured == Side.MOTOR else self.width * abs(transmission.K_inverse[self.j, self.j])
        x = tau[:, self.j]
        tau[:, self.j] = np.sign(x) * np.maximum(np.abs(x) - width, 0.0)
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Late(Distortion):
    """Torque of joint j is `seconds` old."""

    j: int
    seconds: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        tau[:, self.j] = np.interp(readings.t - self.seconds, readings.t, tau[:, self.j])
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Lagged(Distortion):
    """Torque of joint j passes an RC low-pass of `seconds`."""

    j: int
    seconds: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        x = readings.tau[:, self.j]
        y = np.empty_like(x)
        y[0] = x[0]
        step = np.diff(readings.t)
        for i in range(1, len(x)):
            keep = np.exp(-step[i - 1] / self.seconds)
            y[i] = keep * y[i - 1] + (1 - keep) * 0.5 * (x[i] + x[i - 1])
        tau = readings.tau.copy()
        tau[:, self.j] = y
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class JointEncoder(Distortion):
    """The position of joint j reads wrong; the encoder's side may be the motor's."""

    j: int
    offset: float = 0.0
    scale: float = 0.0
    amplitude: float = 0.0
    order: float = 1.0
    phase: float = 0.0

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        transmission = readings.robot.transmission
        on_joint = readings.side == Side.JOINT
        q = readings.motion.q if on_joint else transmission.joint_position(readings.motion.q)
        x = q[:, self.j]
        error = np.zeros_like(q)
        error[:, self.j] = self.offset + self.scale * x + self.amplitude * np.sin(self.order * x + self.phase)
        if not on_joint:
            error = error @ transmission.K_inverse.T
        c = readings.motion
        return replace(readings, motion=Coordinates(c.q + error, c.dq, c.ddq))


@dataclass(frozen=True, eq=False)
class Slip(Distortion):
    """From `at` on the position of joint j reads `angle` too much."""

    j: int
    angle: float
    at: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        late = (readings.t >= self.at)[:, None]
        moved = JointEncoder(self.j, offset=self.angle).apply(readings, rng).motion.q
        c = readings.motion
        return replace(readings, motion=Coordinates(np.where(late, moved, c.q), c.dq, c.ddq))
