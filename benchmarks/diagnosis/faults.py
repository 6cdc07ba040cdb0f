"""What can be wrong with an arm that its declared model does not say: every catalogued effect, and some outside the catalogue.

Each fault is made for an arm, a joint and a size, from the physics as written in its room, without the toolkit's effects. The
order of the rooms is that of the faults in a suite of cases."""

from __future__ import annotations

from . import faults_drive, faults_structure, faults_sensors, faults_outside  # isort: skip  # noqa: F401 - they register their faults
from .fault import FAULTS, OUTSIDE, Fault, Setting

__all__ = ["FAULTS", "OUTSIDE", "Fault", "Setting"]
