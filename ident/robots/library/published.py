"""Base parameters that were published for a built-in robot: facts, with unit and source."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from .folders import robot_folder


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
