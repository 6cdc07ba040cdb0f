"""What a model of joints and drives lacks, from logs of commands and positions without torque."""

from __future__ import annotations

from .diagnosis import diagnose_drives
from .result import DriveDiagnosis, DriveFinding

__all__ = ["DriveDiagnosis", "DriveFinding", "diagnose_drives"]
