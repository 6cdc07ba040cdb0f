"""A robot as a study file describes it: by name or URDF, behind its drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..errors import ConfigurationError
from .library.load import declared_drive, load_robot
from .robot import STANDARD_GRAVITY, Robot
from .tables import DriveTable, RobotTable


@dataclass(frozen=True)
class Description:
    """A robot, its drive and its linear loop closures (`[loop]`: dependent joint → {joint: factor, "offset": constant})."""

    robot: RobotTable = field(default_factory=RobotTable)
    drive: DriveTable = field(default_factory=DriveTable)
    loop: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def whole_drive(self) -> DriveTable:
        """The drive, completed by what a robot known by name says of itself."""
        return self.drive if self.robot.name is None else self.drive.over(declared_drive(self.robot.name))

    def build(self) -> Robot:
        """The robot, behind its drive. Raises ConfigurationError."""
        table = self.robot
        if table.name is not None:
            return load_robot(
                table.name,
                payload=table.payload,
                gravity=table.gravity,
                locked=table.locked,
                joints=table.joints,
                loop=self.loop or None,
                floating_base=table.floating_base,
                drive=self.drive,
            )
        if table.urdf is None:
            raise ConfigurationError("no robot is given; name it in [robot] (name or urdf), or with --robot or --urdf.")
        if table.payload is not None:
            raise ConfigurationError("[robot] payload chooses among those that a built-in robot offers; a URDF has none.")
        robot = Robot.from_urdf(
            table.urdf,
            gravity=STANDARD_GRAVITY if table.gravity is None else table.gravity,
            locked=table.locked,
            joints=table.joints,
            loop=self.loop,
            floating_base=table.floating_base,
        )
        return robot.with_transmission(self.drive.transmission(robot.n))
