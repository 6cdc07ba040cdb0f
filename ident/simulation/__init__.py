"""Forward simulation: rigid body, forces with dry friction, integration with events, sensors and actuators."""

from __future__ import annotations

from .result import Simulation
from .simulate import Plant, simulate, simulate_batch

__all__ = ["Plant", "Simulation", "simulate", "simulate_batch"]
