"""Laws of force for the test bed's simulator, written down apart from the toolkit's own effects.

A law's torque has the sign of friction: what the drive must supply for it. It has a smooth part, and a dry one that takes the
sign of its own joint's (motor's) speed and holds at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ident.effects.motion import Coordinates

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Law:
    """A torque on joint or motor `j` ("joint", "motor": `side`). `states`: own states that follow the path (`moved`)."""

    j: int
    side: str = "motor"
    states: int = field(default=0, init=False)

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        """Smooth torque and dry level at the motion (n,) of all joints (motors)."""
        raise NotImplementedError

    def moved(self, state: Array, step: float, dt: float) -> Array:
        """States after joint (motor) j has moved by `step` in `dt` seconds."""
        return state


@dataclass(frozen=True, eq=False)
class Smooth(Law):
    """`f(t, q, dq)` of the own motion."""

    f: Callable[[float, float, float], float] = lambda t, q, w: 0.0

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return self.f(t, float(x.q[self.j]), float(x.dq[self.j])), 0.0


@dataclass(frozen=True, eq=False)
class Dry(Law):
    """Dry friction of level `f(t, q, dq)` of the own motion; with base Coulomb friction it must not become negative."""

    f: Callable[[float, float, float], float] = lambda t, q, w: 0.0

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return 0.0, self.f(t, float(x.q[self.j]), float(x.dq[self.j]))


@dataclass(frozen=True, eq=False)
class Whole(Law):
    """`f(t, q, dq)` → (smooth, dry) of the motion (n,) of all joints (motors)."""

    f: Callable[[float, Array, Array], tuple[float, float]] = lambda t, q, w: (0.0, 0.0)

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return self.f(t, x.q, x.dq)


@dataclass(frozen=True, eq=False)
class Bristle(Law):
    """Coulomb friction of `level` that bends over `length` before it slides, in place of a dry one."""

    level: float = 0.0
    length: float = 1.0
    states: int = field(default=1, init=False)

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return self.level * float(state[0]), -self.level

    def moved(self, state: Array, step: float, dt: float) -> Array:
        toward = np.sign(step)
        return toward - (toward - state) * np.exp(-abs(step) / self.length) if step else state


@dataclass(frozen=True, eq=False)
class Play(Law):
    """A hose that drags along: a spring to a follower that lags by up to `width` (hysteresis whatever the speed)."""

    stiffness: float = 0.0
    width: float = 1.0
    states: int = field(default=1, init=False)

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return self.stiffness * float(state[0]), 0.0

    def moved(self, state: Array, step: float, dt: float) -> Array:
        return np.clip(state + step, -self.width, self.width)


@dataclass(frozen=True, eq=False)
class Slosh(Law):
    """A pendulum driven by the joint's speed: states swing and rate; torque in proportion to the swing."""

    gain: float = 0.0
    omega: float = 1.0
    states: int = field(default=2, init=False)

    def torque(self, t: float, x: Coordinates, state: Array) -> tuple[float, float]:
        return self.gain * float(state[0]), 0.0

    def moved(self, state: Array, step: float, dt: float) -> Array:
        # y'' + 2 z w y' + w² y = w × speed, exact for a constant speed over the step.
        w, z = self.omega, 0.08
        rest = step / dt / w
        c, d, decay = np.cos(w * dt), np.sin(w * dt), np.exp(-z * w * dt)
        y, v = state[0] - rest, state[1] / w
        return np.array([rest + decay * (c * y + d * v), w * decay * (c * v - d * y)])


@dataclass(frozen=True, eq=False)
class Soft:
    """A gear that gives: spring (and play) between motor and link of joint `j`, on the joint side."""

    j: int
    stiffness: float
    damping: float
    gap: float = 0.0

    def torque(self, deflection: float, rate: float) -> float:
        """Torque on the link at motor minus link position and speed."""
        half = 0.5 * self.gap
        if abs(deflection) <= half:
            return 0.0
        spring = self.stiffness * (deflection - np.sign(deflection) * half)
        # A flank can push, not pull.
        total = spring + self.damping * rate
        return total if half == 0.0 or np.sign(total) == np.sign(deflection) else 0.0


def ramp(low: float, high: float, x: float) -> float:
    """0 below `low`, 1 above `high`, a cubic between."""
    s = min(max((x - low) / (high - low), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)
