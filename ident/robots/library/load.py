"""Robots by name: built-in ones (a folder of data each, beside this file) and those of `example-robot-data`.

A built-in robot's folder holds `robot.toml` (`[robot]`, `[drive]`, `[loop]` as in a study file, and the payloads it offers),
its URDF, and, where known, `drive.json` (rotor inertia and friction) and `tables.json` (published base parameters)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..._utils.toml import load_toml
from ...errors import ConfigurationError, unknown_name
from ..robot import STANDARD_GRAVITY, Robot
from ..tables import DriveTable, RobotTable, read_loop
from ..transmission import Side, Transmission
from .examples import example_names, find_example
from .folders import built_in_names, robot_folder
from .payloads import PayloadData, read_payloads, with_payload

Array = np.ndarray


@dataclass(frozen=True)
class _Own:
    """What a robot's own folder says of it."""

    robot: RobotTable
    drive: DriveTable = field(default_factory=DriveTable)
    loop: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def robot_names() -> tuple[str, ...]:
    """Every name that `load_robot` takes.

    Returns
    -------
    tuple of str
        Built-in robots first, then those of example-robot-data, if it is installed.

    Examples
    --------
    >>> import ident
    >>> ident.robot_names()[:3]
    ('palletiser', 'puma560', 'scara')
    """
    mine = built_in_names()
    return (*mine, *(name for name in example_names() if name not in mine))


def declared_drive(name: str) -> DriveTable:
    """The `[drive]` table of a robot: of a built-in one as its `robot.toml` has it, else empty."""
    return _read(robot_folder(name))[0].drive if name in built_in_names() else DriveTable()


def payloads(name: str) -> dict[str, str]:
    """PayloadData name → what it is, for a built-in robot."""
    return {p.name: p.description for p in _read(robot_folder(name))[1].values()}


def load_robot(
    name: str,
    *,
    payload: str | None = None,
    transmission: Transmission | Array | None = None,
    measured: Side | str | None = None,
    gravity: Sequence[float] | None = None,
    locked: Mapping[str, float] | None = None,
    joints: Sequence[str] | None = None,
    loop: Mapping[str, Mapping[str, float]] | None = None,
    floating_base: bool = False,
    drive: DriveTable | None = None,
) -> Robot:
    """A robot by name: a built-in one, or one of example-robot-data.

    What is given replaces what the robot's own description says, argument by argument; `Robot.from_urdf` says what each means.

    Parameters
    ----------
    name : str
        See `robot_names`.
    payload : str, optional
        One of those that the built-in robot offers (`ident.robots.payloads(name)`).
    transmission : Transmission or array, optional
        (n,) signed gear ratios, or (n, n) the matrix K of θ = K θ_m.
    measured : Side or str, optional
        Side of the logged torque, where `transmission` is an array.
    gravity : sequence of float, optional
        In the base frame, m/s².
    locked : mapping of str to float, optional
        Joints that are not identified, and where they stand (rad, m).
    joints : sequence of str, optional
        The joints to keep; all others are locked.
    loop : mapping, optional
        Dependent joint → {independent joint: factor, "offset": constant}.
    floating_base : bool
        The base moves freely.
    drive : DriveTable, optional
        A `[drive]` table that completes or replaces the robot's own.

    Returns
    -------
    Robot

    Raises
    ------
    ConfigurationError
        An unknown name (with the nearest), several matches (with the candidates), a package to install, arguments that do not fit.

    Examples
    --------
    >>> import ident
    >>> ident.load_robot("puma560").n
    6
    """
    name = os.fspath(name)
    if drive is not None and (transmission is not None or measured is not None):
        raise ConfigurationError("give either a drive table or transmission and measured, not both.")
    given = {"gravity": gravity, "locked": locked, "joints": joints, "loop": loop, "floating_base": floating_base}
    return _loaded(name, payload, given, transmission, measured, drive)


def _loaded(
    name: str,
    payload: str | None,
    given: Mapping[str, Any],
    transmission: Transmission | Array | None,
    measured: Side | str | None,
    drive: DriveTable | None,
) -> Robot:
    """The robot of a name; what is `given`, unless it is None, replaces what its own description says."""
    if name in built_in_names():
        own, offered = _read(robot_folder(name))
    else:
        own, offered = _Own(RobotTable(urdf=find_example(name))), {}
    arguments: dict[str, Any] = {
        "gravity": next(g for g in (given["gravity"], own.robot.gravity, STANDARD_GRAVITY) if g is not None),
        "loop": own.loop if given["loop"] is None else given["loop"],
        "floating_base": given["floating_base"] or own.robot.floating_base,
        "name": name,
    }
    kept = {key: getattr(own.robot, key) if given[key] is None else given[key] for key in ("locked", "joints")}
    robot = Robot.from_urdf(_urdf(own, payload, offered, name), **kept, **arguments)
    robot = replace(robot, source={**robot.source, "robot": name, "payload": payload})
    if transmission is not None:
        return robot.with_transmission(Transmission.of(transmission, measured or Side.JOINT))
    drive = drive or DriveTable(measured=None if measured is None else Side(measured).value)
    return robot.with_transmission(_transmission(robot, drive, own, arguments))


def _urdf(own: _Own, payload: str | None, offered: Mapping[str, PayloadData], name: str) -> Path | str:
    """The URDF of a robot, with one of the payloads that it offers."""
    assert own.robot.urdf is not None
    if payload is None:
        return own.robot.urdf
    if payload not in offered:
        hint = "" if offered else f" (robot {name!r} offers none)"
        raise unknown_name(f"payload{hint}", payload, offered)
    return with_payload(own.robot.urdf, payload, offered)


def _transmission(robot: Robot, drive: DriveTable, own: _Own, arguments: dict[str, Any]) -> Transmission:
    """The asked-for drive over the robot's own; where fewer joints move, its own is cut down to them."""
    if drive.moves or not own.drive.moves:
        return drive.over(own.drive).transmission(robot.n)
    assert own.robot.urdf is not None
    whole = Robot.from_urdf(own.robot.urdf, locked=own.robot.locked, joints=own.robot.joints, **arguments)
    if whole.n == robot.n:
        return drive.over(own.drive).transmission(robot.n)
    part = own.drive.transmission(whole.n).restricted([whole.joint_index(j) for j in robot.joint_names])
    gearing = DriveTable(
        measured=part.measured.value,
        K=tuple(map(tuple, part.K.tolist())),
        zero=tuple(part.zero.tolist()),
        torque_constants=None if part.torque_constants is None else tuple(part.torque_constants.tolist()),
    )
    return drive.over(gearing).transmission(robot.n)


def _read(folder: Path) -> tuple[_Own, dict[str, PayloadData]]:
    """A built-in robot's description, and the payloads it offers."""
    file = folder / "robot.toml"
    where = f"robot file {file}"
    data = load_toml(file, "robot file")
    for table in data:
        if table not in ("robot", "drive", "loop", "payload"):
            raise unknown_name(f"table ({where})", table, ("robot", "drive", "loop", "payload"))
    robot = RobotTable.read(data.get("robot", {}), folder, where)
    if robot.urdf is None:
        raise ConfigurationError(f"{where}: [robot] names no urdf.")
    own = _Own(robot, DriveTable.read(data.get("drive", {}), where), read_loop(data.get("loop", {}), where))
    return own, read_payloads(data.get("payload", {}), where)
