"""Robots as data: kinematic tree, joints, transmission, and the built-in and example robots by name.

>>> import ident
>>> ident.robots.load_robot("scara").joint_names
('joint1', 'joint2', 'joint3', 'joint4')
"""

from __future__ import annotations

from .joints import Joint, Loop
from .library.folders import built_in_names, robot_folder
from .library.load import declared_drive, load_robot, payloads, robot_names
from .library.nominal import DriveParameters, drive_parameters, nominal_values
from .library.payloads import PayloadData
from .library.published import PublishedTable, published_tables
from .parameters import Parameter, ShapeParameter
from .robot import Robot
from .transmission import Side, Transmission

__all__ = [
    "DriveParameters",
    "Joint",
    "Loop",
    "Parameter",
    "PayloadData",
    "PublishedTable",
    "Robot",
    "ShapeParameter",
    "Side",
    "Transmission",
    "built_in_names",
    "declared_drive",
    "drive_parameters",
    "load_robot",
    "nominal_values",
    "payloads",
    "published_tables",
    "robot_folder",
    "robot_names",
]
