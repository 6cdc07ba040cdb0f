"""The robots of the test bed, with all their true parameters, and the motions they are driven through."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import ident
from ident import friction as fr
from ident.model import Model
from ident.robots import DriveParameters, drive_parameters, nominal_values
from ident.robots.transmission import Side, Transmission
from ident.simulation.trajectory import FourierTrajectory, Trajectory

from . import motions

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot with its declared model (rigid body, rotor inertia, viscous and Coulomb friction) and the true values of it.

    `top_speed` (n,) rad/s (m/s) and `limits` (n, 2): the room that motions use; `counts`: encoder counts a motor turn; `style`:
    of its motion."""

    name: str
    model: Model
    values: Array
    limits: Array
    top_speed: Array
    counts: float
    frequency_hz: float
    style: str = "fourier"

    @property
    def robot(self) -> ident.Robot:
        return self.model.robot

    @cached_property
    def drive(self) -> dict[str, Array]:
        """Rotor inertia, viscous and Coulomb friction (n,) each, motor side."""
        names = self.model.names
        return {s: np.array([self.values[names.index(f"{s}_{j}")] for j in self.robot.joint_names]) for s in ("Ia", "Fv", "Fc")}

    def motion(self, seed: int, seconds: float) -> Trajectory:
        """A random motion within limits and speeds; by default of many frequencies, and never repeats."""
        if self.style != "fourier":
            return motions.motion(motions.Room(self.limits, self.top_speed), self.style, seed, seconds)
        rng = np.random.default_rng([seed, 7])
        n = self.robot.n
        base = 1.0 / seconds
        highest = max(4, int(0.5 * seconds))
        order = np.arange(1, highest + 1)
        # Slow waves for range, faster ones for speed: amplitudes of velocity fall off towards both ends.
        weight = np.exp(-0.5 * ((np.log(order * base) - np.log(0.18)) / 0.7) ** 2)[:, None]
        sine, cosine = rng.normal(size=(2, highest, n)) * weight
        raw = FourierTrajectory(np.zeros(n), sine, cosine, base).sample(np.linspace(0.0, seconds, 4000))
        middle = 0.5 * (raw.q.max(axis=0) + raw.q.min(axis=0))
        half = 0.5 * np.ptp(raw.q, axis=0)
        room = 0.5 * (self.limits[:, 1] - self.limits[:, 0])
        scale = np.minimum(0.95 * room / half, self.top_speed / np.abs(raw.dq).max(axis=0))
        place = self.limits.mean(axis=1) + rng.uniform(-1, 1, n) * (0.95 * room - scale * half)
        return FourierTrajectory(place - scale * middle, sine * scale, cosine * scale, base)


def _arm(name: str, robot: ident.Robot, drive: DriveParameters | None, limits: Array, speed: Array, counts: float, frequency: float) -> Arm:
    model = robot.rigid_body() + fr.RotorInertia() + fr.Viscous() + fr.Coulomb()
    values = nominal_values(model, drive)
    return Arm(name, model, values, np.asarray(limits, float), np.asarray(speed, float), counts, frequency)


def puma() -> Arm:
    """PUMA 560: six joints, coupled wrist, motor torque."""
    robot = ident.load_robot("puma560")
    # A transmission of the test bed's own, so that its logs outlast changes of the built-in robot's.
    K = np.diag([0.016, 0.00926, 0.0186, 0.013151595814636147, 0.013903758185837632, 0.013040189865164436])
    K[4, 3], K[5, 3], K[5, 4] = 0.00018285660796457526, -0.000138483530014709, 0.0025104007835540167
    robot = robot.with_transmission(Transmission(K, np.zeros(6), Side.MOTOR))
    limits = [[-2.0, 2.0], [-0.6, 2.6], [-0.6, 2.8], [-1.8, 2.0], [-1.6, 1.6], [-2.5, 2.5]]
    found = _arm("puma560", robot, drive_parameters("puma560"), limits, [1.8, 1.4, 2.2, 3.5, 3.5, 4.0], 1000.0, 8.0)
    # Rotor 1 merges with link 1 in every torque, and the published set gives it next to nothing; a usual share is its own.
    values, names = found.values.copy(), found.model.names
    share = 2e-4
    values[names.index("Izz_joint1")] -= (share - values[names.index("Ia_joint1")]) / robot.transmission.K[0, 0] ** 2
    values[names.index("Ia_joint1")] = share
    return replace(found, values=values)


def scara() -> Arm:
    """SCARA with a prismatic quill and a coupled spline, motor torque."""
    robot = ident.load_robot("scara")
    limits = [[-2.0, 2.0], [-2.2, 2.2], [-0.22, 0.0], [-3.0, 3.0]]
    return _arm("scara", robot, drive_parameters("scara"), limits, [3.0, 4.0, 0.5, 8.0], 4000.0, 8.0)


def _geared(name: str, ratio: Array, measured: Side, drive: dict[str, list[float]], limits: Array, speed: Array, counts: float) -> Arm:
    robot = ident.load_robot(name)
    robot = robot.with_transmission(Transmission.from_ratio(np.asarray(ratio, float), measured))
    units = {"Ia": "kg m^2", "Fv": "N m s/rad", "Fc": "N m"}
    values = {key: np.asarray(column, float) for key, column in drive.items()}
    parameters = DriveParameters(robot.joint_names, "motor", values, units, "round values of drives of this class")
    return _arm(name, robot, parameters, limits, speed, counts, 8.0)


def seven() -> Arm:
    """xArm 7: seven joints behind harmonic drives, torque on the joint side."""
    ratio = np.full(7, 100.0)
    drive = {
        "Ia": [2.0e-5, 2.0e-5, 1.2e-5, 1.2e-5, 6e-6, 6e-6, 4e-6],
        "Fv": [6e-4, 6e-4, 4e-4, 4e-4, 1.5e-4, 1.5e-4, 8e-5],
        "Fc": [0.05, 0.05, 0.035, 0.035, 0.015, 0.015, 0.01],
    }
    limits = [[-2.5, 2.5], [-1.8, 1.8], [-2.5, 2.5], [0.0, 3.6], [-2.5, 2.5], [-1.5, 2.9], [-3.0, 3.0]]
    return _geared("xarm7", ratio, Side.JOINT, drive, np.array(limits), np.full(7, 2.0), 4096.0)


def six() -> Arm:
    """UR5: six joints, torque on the motor side; kept for the final count."""
    drive = {
        "Ia": [7e-5, 7e-5, 7e-5, 2e-5, 2e-5, 2e-5],
        "Fv": [1.2e-3, 1.2e-3, 1.0e-3, 2.5e-4, 2.5e-4, 2.5e-4],
        "Fc": [0.09, 0.1, 0.07, 0.02, 0.02, 0.018],
    }
    limits = np.tile([-2.2, 2.2], (6, 1))
    return _geared("ur5", np.full(6, 101.0), Side.MOTOR, drive, limits, np.full(6, 1.8), 4096.0)


def _typical(name: str, ratio: float, limits: Array, speed: Array, counts: float, frequency: float, measured: Side) -> Arm:
    """Any robot with drives in proportion to the torque that its links ask for."""
    links = ident.load_robot(name)
    robot = links.with_transmission(Transmission.from_ratio(np.full(links.n, ratio), measured))
    body = robot.rigid_body()
    rng = np.random.default_rng(0)
    q = rng.uniform(limits[:, 0], limits[:, 1], (400, robot.n))
    dq, ddq = 0.6 * speed * rng.normal(size=q.shape), 3.0 * speed * rng.normal(size=q.shape)
    tau = robot.transmission.torque(body.inverse_dynamics(q, dq, ddq, nominal_values(body)), robot.transmission.measured, Side.JOINT)
    torque = np.sqrt(np.mean(tau**2, axis=0)) / ratio
    drive = {
        "Ia": (0.2 * torque / (3.0 * speed * ratio)).tolist(),
        "Fv": (0.15 * torque / (speed * ratio)).tolist(),
        "Fc": (0.12 * torque).tolist(),
    }
    return replace(_geared(name, np.full(robot.n, ratio), measured, drive, limits, speed, counts), frequency_hz=frequency)


def direct_drive() -> Arm:
    """Two joints without gears."""
    return _typical("double_pendulum", 1.0, np.tile([-2.5, 2.5], (2, 1)), np.full(2, 5.0), 65536.0, 6.0, Side.JOINT)


def leg() -> Arm:
    """Three joints behind gears of nine, as in light legs."""
    limits = np.array([[-1.2, 1.2], [-1.4, 1.4], [-2.6, 0.2]])
    return _typical("finger_edu", 9.0, limits, np.array([5.0, 6.0, 7.0]), 4096.0, 10.0, Side.MOTOR)


def ten() -> Arm:
    """UR10, torque on the joint side."""
    limits = np.tile([-2.2, 2.2], (6, 1))
    return _typical("ur10", 101.0, limits, np.full(6, 1.6), 4096.0, 7.0, Side.JOINT)


ARMS = {"puma560": puma, "xarm7": seven, "scara": scara, "ur5": six, "direct_drive": direct_drive, "leg": leg, "ur10": ten}


def arm(name: str) -> Arm:
    """One of the arms by its name, after a point the style of its motion: `puma560.task`."""
    plain, _, style = name.partition(".")
    return replace(ARMS[plain](), style=style or "fourier")


def with_robot(a: Arm, robot: ident.Robot) -> Arm:
    """The same arm on another robot (other gravity, other transmission): the truth of a plant that is not as declared."""
    return replace(a, model=Model(robot, a.model.effects))
