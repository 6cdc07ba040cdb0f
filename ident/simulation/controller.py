"""Joint controllers as simulation declares them: discrete laws that track a desired motion, on the joint or the motor side."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from .._utils.singular_values import pinv
from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..robots.reach import reach
from ..robots.transmission import Side
from ..robots.tree import link_names
from .plant import Plant
from .script import Script

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray
#: Eigenvalues of H⁻¹ D that loops of some 10 Hz at some 1000 instants a second bear well.
_GIVING_WAY = 8.0
#: Torque (B, n) on the controller's side at a control instant (its index) from measured position and speed (B, n) on that side.
Law = Callable[[int, Array, Array], Array]


def _gains(name: str, values: object, n: int) -> Array:
    array = np.asarray(values, float)
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,) or not np.all(np.isfinite(array)) or np.any(array < 0):
        raise ConfigurationError(f"controller: {name} must be one number, or {n} (one per joint), finite and not negative.")
    return array


@dataclass(frozen=True, kw_only=True)
class Controller(ABC):
    """A tracking controller. `side`: the side on which it measures and acts; `limit` (n,): its torque saturates there, if given."""

    side: Side = Side.MOTOR
    limit: tuple[float, ...] | None = None

    @abstractmethod
    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        """The running controller for a desired motion (K, B, n) on the joint side, sampled every `period` seconds."""

    def script(self, robot: Robot, desired: Coordinates) -> Script | None:
        """The law as gains and numbers, where it is no more than that: compiled simulation then needs no call an instant."""
        return None

    def saturated(self, torque: Array) -> Array:
        """Torque (B, n) within the limit."""
        return torque if self.limit is None else np.clip(torque, -np.asarray(self.limit), np.asarray(self.limit))


def on_side(robot: Robot, desired: Coordinates, side: Side) -> Coordinates:
    """A joint-side motion (…, n) seen from a side of the transmission."""
    if side == Side.JOINT:
        return desired
    t = robot.transmission
    return Coordinates(t.motor_position(desired.q), t.motor_rate(desired.dq), t.motor_rate(desired.ddq))


def typical_inertia(model: Model, values: Array, side: Side) -> Array:
    """What each joint (n,) has to move on a side, drives included: the mean diagonal of the inertia matrix over postures within the joint
    limits, or less, where others give way: two wrist joints in line share one inertia, and gains that each has for all of it are
    too much for both. Then what a joint moves by itself, D_i = s / (H⁻¹)_ii in the worst posture, s as large as λ(H⁻¹ D) allows."""
    robot = model.robot
    rng = np.random.default_rng(0)
    low, high = reach(robot.joints, stroke=np.pi)
    lower, upper = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    beyond = lower >= upper  # all of the range lies more than half a turn from zero
    q = rng.uniform(np.where(beyond, low, lower), np.where(beyond, high, upper), (32, robot.n))
    dynamics = Plant(model, values).dynamics()
    n = robot.n
    H = dynamics.rigid.terms(q, np.zeros_like(q))[0] + dynamics.inertia[:n, :n]
    if side == Side.MOTOR:
        H = robot.transmission.K.T @ H @ robot.transmission.K
    diagonal = np.diagonal(H, axis1=1, axis2=2).mean(axis=0)
    _require_inertia(model, H)
    inverse = pinv(H, hermitian=True)
    alone = 1.0 / np.maximum(np.diagonal(inverse, axis1=1, axis2=2).max(axis=0), 1e-300)
    root = np.linalg.cholesky(inverse + 1e-12 * np.eye(n) * np.trace(inverse, axis1=1, axis2=2)[:, None, None])

    def light(own: Array) -> bool:
        return float(np.linalg.eigvalsh(np.swapaxes(root, 1, 2) @ (own[:, None] * root)).max()) <= _GIVING_WAY

    for share in np.geomspace(1e6, 1.0, 61):
        if light(own := np.minimum(diagonal, share * alone)):
            return np.asarray(own)
    return np.minimum(diagonal, alone)


def _require_inertia(model: Model, H: Array) -> None:
    """Raises ConfigurationError where inertia matrices (m, n, n) leave a motion without inertia: nothing can follow a command then."""
    robot = model.robot
    scale = np.sqrt(np.abs(np.diagonal(H, axis1=1, axis2=2)).max(axis=0))
    scaled = H / np.outer(np.where(scale > 0, scale, 1.0), np.where(scale > 0, scale, 1.0))
    values, vectors = np.linalg.eigh(scaled)
    worst = int(np.argmin(values[:, 0]))
    if values[worst, 0] > 1e-12:
        return
    joint = robot.joint_names[int(np.argmax(np.abs(vectors[worst, :, 0])))]
    names = dict(zip(robot.model.names[1:], link_names(robot.model), strict=True))
    raise ConfigurationError(
        f"the model's inertia is not positive: nothing, or less, resists motion of joint {joint!r} in some posture. Look at the <inertial>"
        f" of link {names[joint]!r} and of those beyond it, or give a saved fit."
    )


@dataclass(frozen=True, kw_only=True)
class PDFeedforward(Controller):
    """τ = kp e + kd de/dt + feedforward, e the tracking error.

    `kp`, `kd`: one number or one a joint, on `side`. `model` and `values` (k,), if given: its inverse dynamics along the
    desired motion is fed forward."""

    kp: tuple[float, ...] | float
    kd: tuple[float, ...] | float
    model: Model | None = None
    values: Array | None = None

    @classmethod
    def tuned(
        cls, model: Model, values: Array, frequency_hz: float = 5.0, damping: float = 1.0, side: Side = Side.MOTOR, feedforward: bool = True
    ) -> Self:
        """Gains that give each joint alone this natural frequency and damping ratio; feedforward from the same model."""
        w = 2.0 * np.pi * frequency_hz
        inertia = typical_inertia(model, values, side)
        kp, kd = tuple((w**2 * inertia).tolist()), tuple((2.0 * damping * w * inertia).tolist())
        return cls(side=side, kp=kp, kd=kd, model=model if feedforward else None, values=values if feedforward else None)

    def script(self, robot: Robot, desired: Coordinates) -> Script:
        kp, kd = _gains("kp", self.kp, robot.n), _gains("kd", self.kd, robot.n)
        own = on_side(robot, desired, self.side)
        forward = feedforward(robot, desired, self.model, self.values, self.side)
        limit = None if self.limit is None else np.broadcast_to(np.asarray(self.limit, float), (robot.n,)).copy()
        return Script(self.side, forward, own.q, own.dq, kp, kd, limit)

    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        told = PDFeedforward.script(self, robot, desired)
        q_wanted, dq_wanted, kp, kd = told.q, told.dq, told.kp, told.kd
        assert q_wanted is not None
        assert dq_wanted is not None

        def torque(k: int, q: Array, dq: Array) -> Array:
            return self.saturated(told.forward[k] + kp * (q_wanted[k] - q) + kd * (dq_wanted[k] - dq))

        return torque


def feedforward(robot: Robot, desired: Coordinates, model: Model | None, values: Array | None, side: Side) -> Array:
    """Inverse dynamics (K, B, n) of a model along a desired motion, on a side; zero without a model."""
    if model is None:
        return np.zeros(desired.q.shape)
    if values is None:
        raise ConfigurationError("controller: feedforward needs the values of its model's parameters.")
    flat = [x.reshape(-1, robot.n) for x in (desired.q, desired.dq, desired.ddq)]
    torque = model.inverse_dynamics(flat[0], flat[1], flat[2], np.asarray(values, float)).reshape(desired.q.shape)
    return robot.transmission.torque(torque, robot.transmission.measured, side)


@dataclass(frozen=True, kw_only=True)
class CascadedPPI(Controller):
    """The industrial cascade: position P, velocity PI: τ = kv (v − dq) + ki ∫(v − dq), v = kp e + dq_desired.

    `kp` 1/s, `kv` torque per speed, `ki` torque per angle: one number or one a joint, on `side`. The integral stops while
    the torque is saturated."""

    kp: tuple[float, ...] | float
    kv: tuple[float, ...] | float
    ki: tuple[float, ...] | float

    @classmethod
    def tuned(cls, model: Model, values: Array, frequency_hz: float = 15.0, side: Side = Side.MOTOR) -> Self:
        """Velocity loop of this bandwidth, integral and position loops a quarter of it."""
        w = 2.0 * np.pi * frequency_hz
        kv = w * typical_inertia(model, values, side)
        return cls(side=side, kp=w / 4.0, kv=tuple(kv.tolist()), ki=tuple((kv * w / 4.0).tolist()))

    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        kp, kv, ki = _gains("kp", self.kp, robot.n), _gains("kv", self.kv, robot.n), _gains("ki", self.ki, robot.n)
        own = on_side(robot, desired, self.side)
        integral = np.zeros(own.q.shape[1:])

        def torque(k: int, q: Array, dq: Array) -> Array:
            nonlocal integral
            error = kp * (own.q[k] - q) + own.dq[k] - dq
            wanted = kv * error + ki * integral
            given = self.saturated(wanted)
            integral = integral + period * np.where(wanted == given, error, 0.0)
            return given

        return torque


@dataclass(frozen=True, kw_only=True)
class ComputedTorque(Controller):
    """τ = H(q) (ddq_desired + kd de/dt + kp e) + h(q, dq): inverse dynamics of a rigid model with its rotor inertia, at the measured state.

    `kp` 1/s², `kd` 1/s: one number or one a joint, on the joint side, where this controller acts."""

    side: Side = Side.JOINT
    model: Model
    values: Array
    kp: tuple[float, ...] | float
    kd: tuple[float, ...] | float

    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        if self.side != Side.JOINT:
            raise ConfigurationError("a computed-torque controller acts on the joint side.")
        kp, kd = _gains("kp", self.kp, robot.n), _gains("kd", self.kd, robot.n)
        dynamics = Plant(self.model, self.values).dynamics()
        inertia = dynamics.inertia[: robot.n, : robot.n]

        def torque(k: int, q: Array, dq: Array) -> Array:
            H, h = dynamics.rigid.terms(q, dq)
            wanted = desired.ddq[k] + kd * (desired.dq[k] - dq) + kp * (desired.q[k] - q)
            return self.saturated(((H + inertia) @ wanted[..., None])[..., 0] + h)

        return torque
