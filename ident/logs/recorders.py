"""Recorders that are known by the names of their channels, and what these names do not tell: a table (recorders.toml), not code."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from fnmatch import translate
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..errors import ConfigurationError, unknown_name

_CHANNELS = ("q", "dq", "tau", "i", "q_ref", "dq_ref", "ddq_ref")
#: What a torque-like channel may be, in words.
EFFORTS = {
    "link": "torque on the joint side of the gears",
    "motor": "torque of the motors",
    "current": "motor current",
    "estimated": "torque estimated from the current",
}


@dataclass(frozen=True)
class Recorder:
    """What is known of a recorder: patterns of its `columns`, and what they do not tell (docs/logs.md).

    `effort`: a key of `EFFORTS`, "" if none is known; `effort_scale`: SI value of one unit of it; `rate_hz`: what it usually runs at;
    `counts` of position a turn, of which `centre` is zero (1: positions are turns); `joints` in its order; `channels`: quantity
    (`q`, `dq`, `tau`, `i`, `q_ref`, `dq_ref`) → a column's name with {} for the joint's number, where words do not tell it; `desired`:
    "command" where what was asked for is what the drives were sent (`q_cmd`); `say`: what a user has to know.
    """

    name: str
    columns: tuple[str, ...]
    effort: str = ""
    effort_scale: float = 1.0
    rate_hz: float | None = None
    counts: int | None = None
    centre: float = 0.0
    joints: tuple[str, ...] = ()
    channels: Mapping[str, str] = field(default_factory=dict)
    desired: str = ""
    say: str = ""

    def wrote(self, names: Sequence[str]) -> bool:
        """Whether columns of these names are its."""
        patterns = [re.compile(translate(pattern), re.IGNORECASE) for pattern in self.columns]
        return all(any(pattern.match(name) for name in names) for pattern in patterns)


def read_recorders(path: Path) -> tuple[Recorder, ...]:
    """The `[[recorder]]` tables of a TOML file. Raises ConfigurationError."""
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(f"recorders {path}: {error}") from None
    tables = content.get("recorder")
    if not isinstance(tables, list) or set(content) != {"recorder"}:
        raise ConfigurationError(f"recorders {path}: holds [[recorder]] tables, and nothing else (docs/logs.md).")
    return tuple(_recorder(table, path) for table in tables)


def _recorder(table: Mapping[str, Any], path: Path) -> Recorder:
    known = [f.name for f in fields(Recorder)]
    for key in table:
        if key not in known:
            raise ConfigurationError(f"recorders {path}: {unknown_name('key', key, known)}")
    if not isinstance(table.get("name"), str) or not isinstance(table.get("columns"), list) or not table["columns"]:
        raise ConfigurationError(f"recorders {path}: each [[recorder]] has a name, and patterns of columns.")
    effort = table.get("effort", "")
    if effort and effort not in EFFORTS:
        raise ConfigurationError(f"recorders {path}: {unknown_name('effort', effort, tuple(EFFORTS))}")
    if table.get("desired", "command") != "command":
        raise ConfigurationError(f'recorders {path}: desired of {table["name"]!r} may be "command" (what the drives were sent).')
    for key in ("effort_scale", "rate_hz", "counts", "centre"):
        if key in table and (isinstance(table[key], bool) or not isinstance(table[key], (int, float))):
            raise ConfigurationError(f"recorders {path}: {key} of {table['name']!r} must be a number.")
    channels = table.get("channels", {})
    if not isinstance(channels, dict) or not all(k in _CHANNELS and isinstance(v, str) and "{}" in v for k, v in channels.items()):
        raise ConfigurationError(
            f"recorders {path}: channels of {table['name']!r} give, for any of {', '.join(_CHANNELS)}, a name with {{}} for the"
            " joint's number."
        )
    listed = {key: tuple(str(x) for x in table[key]) for key in ("columns", "joints") if key in table}
    return Recorder(**{**table, **listed})


@lru_cache(maxsize=1)
def built_in() -> tuple[Recorder, ...]:
    """The recorders that are known."""
    return read_recorders(Path(__file__).with_name("recorders.toml"))


_ADDED: list[Recorder] = []


def add_recorders(path: Path) -> None:
    """Know the recorders of a file, before those that are there."""
    new = read_recorders(path)
    _ADDED[:] = [*new, *(r for r in _ADDED if r not in new)]


def recorder_of(names: Sequence[str]) -> Recorder | None:
    """The first that wrote columns of these names."""
    return next((r for r in (*_ADDED, *built_in()) if r.wrote(names)), None)
