"""Folders of the built-in robots: one a robot, beside this file."""

from __future__ import annotations

from pathlib import Path

from ...errors import unknown_name

_HERE = Path(__file__).parent


def built_in_names() -> tuple[str, ...]:
    """Names of the built-in robots."""
    return tuple(sorted(file.parent.name for file in _HERE.glob("*/robot.toml")))


def robot_folder(name: str) -> Path:
    """Folder of a built-in robot's data. Raises ConfigurationError with the nearest names."""
    if name not in built_in_names():
        raise unknown_name("built-in robot", name, built_in_names())
    return _HERE / name
