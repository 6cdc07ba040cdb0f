"""Forward simulation: rigid body, forces with dry friction, integration with events, sensors and actuators."""

from __future__ import annotations

from .exceeded import ExceededLimit, exceeded_limits
from .plant import Plant
from .result import Simulation
from .simulate import simulate, simulate_batch

__all__ = ["ExceededLimit", "Plant", "Simulation", "exceeded_limits", "simulate", "simulate_batch"]
