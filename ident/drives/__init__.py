"""Drives without a torque reading: laws from command to torque, identified with the joints by simulation in closed loop.

>>> import ident
>>> robot = ident.load_robot("scara", transmission=[1.0, 1.0, 1.0, 1.0])
>>> law = ident.drives.DriveLaw.of(robot, kp=25.0, kd="identify")
>>> law.kind
'pd_position'
"""

from __future__ import annotations

from .commands import DriveLog
from .fit import fit_drives
from .law import DriveLaw
from .result import DriveFit

__all__ = ["DriveFit", "DriveLaw", "DriveLog", "fit_drives"]
