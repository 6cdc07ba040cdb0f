"""Effects as a drive's table declares them, and back."""

from __future__ import annotations

from dataclasses import fields
from enum import StrEnum
from typing import Any

from .._utils.toml import check_options
from ..robots.tables import DEFAULT_EFFECTS, DriveTable, effect_entries
from .base import Effect
from .registry import effect_types, make_effect


def declared_effects(drive: DriveTable) -> tuple[Effect, ...]:
    """The declared effects, or the usual ones where none are declared. Raises ConfigurationError for unknown ones."""
    known = effect_types()
    made = []
    for entry in drive.effects if drive.effects is not None else effect_entries(list(DEFAULT_EFFECTS)):
        name, options = entry["name"], {k: v for k, v in entry.items() if k != "name"}
        if name in known:
            check_options(known[name], options, f"effect {name!r} ([drive] effects)", {"name"})
        made.append(make_effect(name, **options))
    return tuple(made)


def effect_entry(effect: Effect) -> dict[str, Any]:
    """An effect as `[drive] effects` writes it: its name and whatever differs from the usual."""
    entry: dict[str, Any] = {"name": effect.name}
    for item in fields(effect):
        value = getattr(effect, item.name)
        if value != item.default:
            entry[item.name] = list(value) if isinstance(value, tuple) else str(value) if isinstance(value, StrEnum) else value
    return entry
