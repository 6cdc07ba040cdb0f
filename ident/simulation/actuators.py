"""Actuators: what of the commanded torque reaches the drive."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..effects.motion import Motion
from ..errors import ConfigurationError

Array = np.ndarray


class Actuator(ABC):
    """From commanded to applied torque, on the measured side. Subclass it (a frozen dataclass is best) for one's own.

    Called at the start of every integration step with B parallel runs; its result holds during the step."""

    def start(self, command: Array) -> Array:
        """Own states (B, …) at the start, for the first command (B, n)."""
        return np.zeros((len(command), 0))

    @abstractmethod
    def apply(self, command: Array, motion: Motion, state: Array, h: float) -> tuple[Array, Array]:
        """Applied torque (B, n), and the states after the step of h seconds."""


@dataclass(frozen=True)
class TorqueLimit(Actuator):
    """Torque is clipped at ±limit (n,), N m or N on the measured side."""

    limit: tuple[float, ...]

    def apply(self, command: Array, motion: Motion, state: Array, h: float) -> tuple[Array, Array]:
        limit = np.asarray(self.limit)
        return np.clip(command, -limit, limit), state


@dataclass(frozen=True)
class Gain(Actuator):
    """Torque is `factor` (n,) times what the drive reports: a wrong torque constant."""

    factor: tuple[float, ...]

    def apply(self, command: Array, motion: Motion, state: Array, h: float) -> tuple[Array, Array]:
        return command * np.asarray(self.factor), state


@dataclass(frozen=True)
class CurrentLoop(Actuator):
    """Torque follows the command as a first-order lag of `time` seconds."""

    time: float

    def __post_init__(self) -> None:
        if not self.time > 0:
            raise ConfigurationError(f"a current loop's time constant must be positive, not {self.time} s.")

    def start(self, command: Array) -> Array:
        return command.copy()

    def apply(self, command: Array, motion: Motion, state: Array, h: float) -> tuple[Array, Array]:
        # The mean over the step of the exact response to a constant command.
        left = np.exp(-h / self.time)
        after = command + left * (state - command)
        mean = command + (state - command) * (1.0 - left) * self.time / h
        return mean, after
