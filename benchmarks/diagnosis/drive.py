"""What asks the motors for torque: an ideal drive, or a sampled controller on encoder counts with a current loop and restless friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Wanted:
    """The motion wanted of B runs, motor side: positions, speeds and torque known beforehand (K, B, n), one for each step; gains (n,)."""

    phi: Array
    speed: Array
    ahead: Array
    kp: Array
    kd: Array


class Running:
    """A drive at work. `torque(k, phi, speed)` (B, n) of step k; `friction(phi)`: by which share dry friction is above its level."""

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted

    def torque(self, k: int, phi: Array, speed: Array) -> Array:
        w = self.wanted
        return w.ahead[k] + w.kp * (w.phi[k] - phi) + w.kd * (w.speed[k] - speed)

    def friction(self, phi: Array) -> Array | float:
        return 0.0


@dataclass(frozen=True)
class Drive:
    """Knows the motion at every step and gives what is asked."""

    def begin(self, wanted: Wanted, h: float) -> Running:
        """At work, in steps of `h` seconds."""
        return Running(wanted)


@dataclass(frozen=True)
class SampledDrive(Drive):
    """A controller of `hertz` that reads `counts` a motor turn and differences them behind a low-pass (`speed_lag` s); its torque
    follows `current_lag` s late. Dry friction fluctuates about its level: by `restless`
    (standard deviation, share) in time, with `memory` s, and by `rough` along the motor's angle."""

    hertz: float = 1000.0
    counts: float = 4096.0
    speed_lag: float = 0.002
    current_lag: float = 0.0005
    restless: float = 0.015
    memory: float = 0.06
    rough: float = 0.0
    seed: int = 0

    def begin(self, wanted: Wanted, h: float) -> Running:
        return _Sampled(self, wanted, h)


class _Sampled(Running):
    def __init__(self, drive: SampledDrive, wanted: Wanted, h: float) -> None:
        super().__init__(wanted)
        self.drive, self.every = drive, max(1, round(1.0 / (drive.hertz * h)))
        self.period = self.every * h
        self.left = np.exp(-h / drive.current_lag)
        self.weight = 1.0 - np.exp(-self.period / drive.speed_lag)
        self.keep = np.exp(-h / drive.memory)
        self.rng = np.random.default_rng([drive.seed, 31])
        _, B, n = wanted.phi.shape
        self.asked, self.given = np.zeros((B, n)), wanted.ahead[0].copy()
        self.last: Array | None = None
        self.speed = np.zeros((B, n))
        self.wander = self.rng.normal(size=(B, n))
        # Roughness: a dozen incommensurate orders of the motor's angle with random phases.
        self.orders = self.rng.uniform(0.1, 3.0, size=(12, n))
        self.phases = self.rng.uniform(0.0, 2.0 * np.pi, size=(12, n))

    def torque(self, k: int, phi: Array, speed: Array) -> Array:
        if k % self.every == 0:
            size = 2.0 * np.pi / self.drive.counts
            seen = np.round(phi / size) * size
            if self.last is None:
                self.speed = speed.copy()
            else:
                self.speed += self.weight * ((seen - self.last) / self.period - self.speed)
            self.last = seen
            self.asked = super().torque(k, seen, self.speed)
        self.given = self.asked + self.left * (self.given - self.asked)
        return self.given

    def friction(self, phi: Array) -> Array:
        d = self.drive
        self.wander = self.keep * self.wander + np.sqrt(1.0 - self.keep**2) * self.rng.normal(size=phi.shape)
        share = d.restless * self.wander
        if d.rough:
            share = share + d.rough * np.sqrt(2.0 / 12) * np.sin(phi[:, None] * self.orders + self.phases).sum(axis=1)
        return share
