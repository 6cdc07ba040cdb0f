"""Drives without a torque reading: laws from command to torque, identified with the joints by simulation in closed loop."""

from __future__ import annotations

from .commands import DriveLog
from .fit import fit_drives
from .law import DriveLaw
from .result import DriveFit

__all__ = ["DriveFit", "DriveLaw", "DriveLog", "fit_drives"]
