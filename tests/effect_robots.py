"""Small robots and motions for the tests of effects: written here, so that the tests need no data."""

from __future__ import annotations

import numpy as np

from ident.effects.base import Effect
from ident.effects.motion import Motion
from ident.effects.offset import Offset
from ident.effects.reference import Reference
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.model import Model
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission


def _link(name: str, rng: np.random.Generator) -> str:
    mass, com = rng.uniform(1.0, 5.0), rng.uniform(-0.1, 0.1, 3)
    inertia = rng.uniform(0.02, 0.06, 3)
    return (
        f'<link name="{name}"><inertial><origin xyz="{com[0]} {com[1]} {com[2]}"/><mass value="{mass}"/>'
        f'<inertia ixx="{inertia[0]}" iyy="{inertia[1]}" izz="{inertia[2]}" ixy="0.001" ixz="0.002" iyz="-0.001"/></inertial></link>'
    )


def chain(name: str, joints: list[tuple[str, str, str, str]]) -> str:
    """URDF of a chain: (kind, xyz, rpy, axis) of each joint."""
    rng = np.random.default_rng(len(joints))
    parts = [f'<robot name="{name}">', '<link name="base"/>']
    for i, (kind, xyz, rpy, axis) in enumerate(joints):
        low, high = (0.0, 0.4) if kind == "prismatic" else (-2.5, 2.5)
        parts.append(_link(f"l{i + 1}", rng))
        parts.append(
            f'<joint name="j{i + 1}" type="{kind}"><parent link="{"base" if i == 0 else f"l{i}"}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}" velocity="5" effort="100"/></joint>'
        )
    return "".join([*parts, "</robot>"])


_SEVEN = [
    ("revolute", "0 0 0.3", "0 0 0", "0 0 1"),
    ("revolute", "0 0 0.2", "-1.5707963267948966 0 0", "0 0 1"),
    ("revolute", "0 -0.4 0", "1.5707963267948966 0 0", "0 0 1"),
    ("revolute", "0.05 0 0.1", "1.5707963267948966 0 0", "0 0 1"),
    ("revolute", "0 0.35 0", "-1.5707963267948966 0 0", "0 0 1"),
    ("revolute", "0 0 0.1", "1.5707963267948966 0 0", "0 0 1"),
    ("revolute", "0.09 0 0", "1.5707963267948966 0 0", "0 0 1"),
]
_SCARA = [
    ("revolute", "0 0 0.4", "0 0 0", "0 0 1"),
    ("revolute", "0.4 0 0", "0 0 0", "0 0 1"),
    ("prismatic", "0.3 0 0", "0 0 0", "0 0 -1"),
    ("revolute", "0 0 -0.1", "0 0 0", "0 0 1"),
]


def pendulum() -> Robot:
    """One joint, horizontal axis, direct drive."""
    return Robot.from_urdf(chain("pendulum", [("revolute", "0 0 1", "0 0 0", "0 1 0")]))


def slide() -> Robot:
    """One prismatic joint that climbs, behind a spindle, torque measured at the motor."""
    urdf = chain("slide", [("prismatic", "0 0 1", "0 0.4 0", "0 0 1")])
    return Robot.from_urdf(urdf, transmission=np.array([-300.0]), measured=Side.MOTOR)


def seven() -> Robot:
    """Seven joints behind gears, torque on the joint side, gravity askew."""
    ratio = np.array([100.0, -120.0, 80.0, 80.0, 50.0, 50.0, 30.0])
    return Robot.from_urdf(chain("seven", _SEVEN), transmission=ratio, measured=Side.JOINT, gravity=(1.0, -2.0, -9.5))


def scara() -> Robot:
    """Four joints, the third a slide whose spindle is coupled to the last joint; torque at the motors."""
    K = np.diag([1 / 50, 1 / 40, 1 / 300, 1 / 20])
    K[2, 3] = 0.002
    return Robot.from_urdf(chain("scara", _SCARA), transmission=Transmission(K, np.array([0.1, 0.0, 0.05, 0.0]), Side.MOTOR))


def wrist() -> Robot:
    """Three joints behind a transmission that couples them all ways, torque at the motors."""
    K = np.array([[0.02, 0.0, 0.0], [0.003, 0.025, 0.0], [-0.001, 0.004, -0.03]])
    return Robot.from_urdf(chain("wrist", _SEVEN[3:6]), transmission=Transmission(K, np.zeros(3), Side.MOTOR))


ROBOTS = {robot.__name__: robot for robot in (pendulum, slide, seven, scara, wrist)}


def smooth(robot: Robot, samples: int = 400, rate: float = 200.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t, q, dq, ddq of sums of sines within the limits, with exact derivatives."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / rate
    low, high = np.array([j.lower for j in robot.joints]), np.array([j.upper for j in robot.joints])
    q, dq, ddq = (np.zeros((samples, robot.n)) for _ in range(3))
    q += 0.5 * (low + high)
    for _ in range(3):
        size = rng.uniform(0.3, 1.0, robot.n) * (high - low) / 8.0
        w, p = 2.0 * np.pi * rng.uniform(0.3, 1.2, robot.n), rng.uniform(0.0, 6.0, robot.n)
        x = np.multiply.outer(t, w) + p
        q += size * np.sin(x)
        dq += size * w * np.cos(x)
        ddq -= size * w**2 * np.sin(x)
    return t, q, dq, ddq


def declared(robot: Robot, *more: Effect) -> tuple[Model, np.ndarray]:
    """Rigid body, rotor, viscous and Coulomb friction, offset (and more), with plausible values."""
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb() + Offset()
    for effect in more:
        model = model + effect
    rng = np.random.default_rng(5)
    values = rng.uniform(0.05, 0.2, len(model.parameters))
    values[: len(robot.nominal)] = robot.nominal
    return model, values


def motion_of(robot: Robot, samples: int = 400, rate: float = 200.0, seed: int = 0) -> Motion:
    """A smooth motion with everything an effect may need: prediction, load, a measured torque."""
    t, q, dq, ddq = smooth(robot, samples, rate, seed)
    model, values = declared(robot)
    motion = Motion.of(robot, q, dq, ddq, t, rate=rate)
    torque = model.torque(motion, values) + np.random.default_rng(1).normal(size=q.shape) * 0.01
    return Motion.of(robot, q, dq, ddq, t, rate=rate, torque=torque).with_reference(Reference(model, values))


def two_arms() -> Robot:
    """A waist that carries two arms of three joints each: links `left1` … `left3` and, last in the tree, `right1` … `right3`."""
    rng = np.random.default_rng(8)
    parts = ['<robot name="two_arms">', '<link name="base"/>', _link("waist", rng)]
    joints = [("waist", "base", "0 0 0.5", "0 0 0", "0 0 1")]
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts += [_link(f"{side}{i}", rng) for i in (1, 2, 3)]
        joints.append((f"{side}1", "waist", f"0 {y} 0.4", "1.5707963267948966 0 0", "0 0 1"))
        joints.append((f"{side}2", f"{side}1", "0.35 0 0", "1.5707963267948966 0 0", "0 0 1"))
        joints.append((f"{side}3", f"{side}2", "0 0.1 0.3", "0 1.5707963267948966 0", "0 0 1"))
    parts += [
        f'<joint name="j_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" velocity="5" effort="100"/></joint>'
        for child, parent, xyz, rpy, axis in joints
    ]
    return Robot.from_urdf("".join([*parts, "</robot>"]))
