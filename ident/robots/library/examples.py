"""Robots of the `example-robot-data` package: found by name among the files it installs."""

from __future__ import annotations

import difflib
import importlib.metadata
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

from ...errors import ConfigurationError, unknown_name
from .folders import built_in_names

_PACKAGE = "example-robot-data"
_WHY_NOT = {
    ".urdf": "has no moving joint",
    ".xacro": "ships only as a xacro template: expand it (`xacro FILE > robot.urdf`) and give the result as a URDF",
    ".sdf": "ships only as SDF: convert it and give the result as a URDF",
}
_MOVING = re.compile(r"""type\s*=\s*["'](revolute|continuous|prismatic)["']""")


@cache
def _files() -> tuple[Path, ...]:
    """Robot descriptions of the package (URDF, xacro, SDF), sorted. Raises ConfigurationError if it is not installed."""
    try:
        distribution = importlib.metadata.distribution(_PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        raise ConfigurationError(
            f"robots beside the built-in ones come with the package {_PACKAGE}: pip install 'ident[robots]'."
        ) from None
    found = (Path(str(distribution.locate_file(f))) for f in distribution.files or () if f.suffix in (".urdf", ".xacro", ".sdf"))
    return tuple(sorted(found))


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "_").replace(" ", "_")


def _folder(file: Path) -> str:
    """The robot's folder without what the packages append to it: `ur` for `ur_description/urdf/ur5_robot.urdf`."""
    name = _plain(file.parent.parent.name)
    return name.removesuffix("_description").removesuffix("_data")


def _stem(file: Path) -> str:
    return _plain(file.name.split(".")[0]).removesuffix("_robot")


@cache
def _by_name() -> dict[str, Path]:
    """Name → URDF: the file's stem where it is the only one of that stem, else folder/stem."""
    stems: dict[str, list[Path]] = defaultdict(list)
    for file in _files():
        if file.suffix == ".urdf" and _MOVING.search(file.read_text(encoding="utf-8", errors="replace")):
            stems[_stem(file)].append(file)
    return {(stem if len(same) == 1 else f"{_folder(file)}/{stem}"): file for stem, same in sorted(stems.items()) for file in same}


def example_names() -> tuple[str, ...]:
    """Names of the robots of example-robot-data; none if it is not installed."""
    try:
        return tuple(sorted(_by_name()))
    except ConfigurationError:
        return ()


def find_example(name: str) -> Path:
    """The URDF of a robot of example-robot-data.

    A name is a file's stem (`tiago`, `ur5` for ur5_robot.urdf), `folder/stem`, or a folder that holds one URDF; letter case
    and hyphens do not matter. Raises ConfigurationError: unknown (with the nearest names), several matches (with all of
    them), not a URDF, or package not installed."""
    if name.lower().endswith((".urdf", ".xml")):
        raise ConfigurationError(f"{name!r} is a file, not a robot's name; give it as a URDF (--urdf, urdf = …, Robot.from_urdf).")
    try:
        known, wanted = _by_name(), _plain(name).removesuffix("_robot")
    except ConfigurationError as missing:
        raise ConfigurationError(f"{unknown_name('robot', name, built_in_names())}. {str(missing).capitalize()}") from None
    if wanted in known:
        return known[wanted]
    full = {f"{_folder(file)}/{_stem(file)}": key for key, file in known.items()}
    if wanted in full:
        return known[full[wanted]]
    inside = [key for key, file in known.items() if _folder(file) == wanted or key.endswith(f"/{wanted}")]
    if not inside:  # a folder known by the first part of its name (`anymal_b` for anymal_b_simple), or the family of a file (`talos`)
        inside = [key for key, file in known.items() if _folder(file).startswith(f"{wanted}_") or key.startswith(f"{wanted}_")]
    if len(inside) == 1:
        return known[inside[0]]
    if inside:
        raise ConfigurationError(f"robot {name!r} is ambiguous; take one of: {', '.join(inside)}.")
    usable = set(known.values())
    other = [file for file in _files() if file not in usable and wanted in (_folder(file), _stem(file))]
    if other:
        raise ConfigurationError(f"robot {name!r} {_WHY_NOT[other[0].suffix]} ({other[0]}).")
    names = (*built_in_names(), *known)
    nearest = unknown_name("robot", name, {*built_in_names(), *difflib.get_close_matches(wanted, names, n=8, cutoff=0.4)})
    raise ConfigurationError(f"{nearest} … (ident.robot_names() lists all {len(names)}).")
