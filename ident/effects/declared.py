"""Effects as a drive's table declares them, and back."""

from __future__ import annotations

from dataclasses import fields
from enum import StrEnum
from typing import Any

from .._utils.toml import check_options
from ..errors import ConfigurationError
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


def named_effects(text: str) -> tuple[dict[str, Any], ...]:
    """Entries of `[drive] effects` as a flag writes them: names separated by commas, or one with its joints and options,
    NAME:JOINT,…:KEY=VALUE,… Raises ConfigurationError for what is of neither form."""
    name, *rest = (part.strip() for part in text.split(":"))
    if not rest:
        return tuple({"name": one.strip()} for one in text.split(",") if one.strip())
    given = [part.split(",") for part in rest if part]
    if len(rest) > 2 or not name or any("=" in part for part in rest[:-1]) or any(len({"=" in x for x in part}) > 1 for part in given):
        raise ConfigurationError(
            f"effect {text!r}: is not of the form NAME:JOINTS:KEY=VALUE,… such as stribeck:joint3:v_s=0.1 (joints separated by commas; left"
            " out: every joint)."
        )
    entry: dict[str, Any] = {"name": name}
    for part in given:
        if "=" in part[0]:
            entry |= {key.strip(): _value(value.strip()) for key, _, value in (pair.partition("=") for pair in part)}
        else:
            entry["joints"] = [joint.strip() for joint in part]
    return (entry,)


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def effect_entry(effect: Effect) -> dict[str, Any]:
    """An effect as `[drive] effects` writes it: its name and whatever differs from the usual."""
    entry: dict[str, Any] = {"name": effect.name}
    for item in fields(effect):
        value = getattr(effect, item.name)
        if value != item.default:
            entry[item.name] = list(value) if isinstance(value, tuple) else str(value) if isinstance(value, StrEnum) else value
    return entry
