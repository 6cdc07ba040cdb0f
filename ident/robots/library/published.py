"""What was published for a built-in robot: base parameters with unit and source, and test plans."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from ...errors import unknown_name
from .folders import built_in_names, robot_folder


@dataclass(frozen=True)
class PublishedTable:
    """One published set of base and drive parameters.

    `values`: name → value; `units`: name → unit; `doubts`: name → why the value may be misread or cannot be right;
    `side`: what the drive parameters refer to."""

    id: str
    title: str
    source: str
    values: Mapping[str, float]
    units: Mapping[str, str]
    doubts: Mapping[str, str] = field(default_factory=dict)


def published_tables(name: str) -> dict[str, PublishedTable]:
    """Published tables of a built-in robot by their number ("1", "2", …); empty if there are none.

    Raises ConfigurationError for a robot that is not built in."""
    file = robot_folder(name) / "tables.json"
    if not file.is_file():
        return {}
    data = json.loads(file.read_text(encoding="utf-8"))
    units = data["units"]
    return {
        id_: PublishedTable(
            id_,
            table["title"],
            table.get("source", data["source"]),
            table["values"],
            {key: units[key[0]] for key in table["values"]},
            table.get("doubts", {}),
        )
        for id_, table in data["tables"].items()
    }


@dataclass(frozen=True)
class PublishedPlan:
    """The accelerated tests of a published step-by-step plan, in their order: joints that move, and the joint whose torque is read."""

    name: str
    title: str
    source: str
    accelerated: tuple[tuple[tuple[str, ...], str], ...]


def published_plan(robot: str, name: str) -> PublishedPlan:
    """A published plan of a built-in robot by its name. Raises ConfigurationError for one that is not known.

    Examples
    --------
    >>> from ident.robots.library.published import published_plan
    >>> len(published_plan("puma560", "yoshida1995").accelerated)
    13
    """
    plans = _plans(robot) if robot in built_in_names() else {}
    if name not in plans:
        raise unknown_name(f"published plan of robot {robot!r}", name, plans)
    return plans[name]


def plan_names() -> tuple[str, ...]:
    """Names of all published plans."""
    return tuple(dict.fromkeys(name for robot in built_in_names() for name in _plans(robot)))


def _plans(robot: str) -> dict[str, PublishedPlan]:
    file = robot_folder(robot) / "plans.json"
    if not file.is_file():
        return {}
    return {
        name: PublishedPlan(name, one["title"], one["source"], tuple((tuple(moving), row) for moving, row in one["accelerated"]))
        for name, one in json.loads(file.read_text(encoding="utf-8")).items()
    }
