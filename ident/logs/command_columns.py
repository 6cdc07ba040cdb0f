"""Columns of what drives were sent: their names, and a user's own mapping of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..errors import ConfigurationError, unknown_name
from .units import split_unit

Array = np.ndarray
#: Names of commands of the n-th joint, without their unit.
_COMMAND = re.compile(r"^(?P<what>q_cmd|dq_cmd|tau_ff|torque_enable|supply|voltage)_?(?P<joint>[0-9]+)$", re.IGNORECASE)
_SHARED = "supply"


def command_of(name: str) -> tuple[str, int] | None:
    """What a column's name, with a unit or without, says of commands: which, and of which joint (from 0; -1: of all); None: nothing."""
    stem, _ = split_unit(name.strip())
    if stem.lower() == _SHARED:
        return _SHARED, -1
    match = _COMMAND.match(stem) or _COMMAND.match(name.strip())
    return None if match is None else (match["what"].lower(), int(match["joint"]) - 1)


def without_commands(mapping: Mapping[str, Any] | None) -> tuple[Mapping[str, Any] | None, dict[str, str]]:
    """The [columns] table without entries for commands, and these: name of the command (`q_cmd1_deg`) → column of the file."""
    commands = {key: value for key, value in (mapping or {}).items() if command_of(key)}
    for key, value in commands.items():
        if not isinstance(value, str):
            raise ConfigurationError(f"[columns] {key}: give the name of a column as text, with its unit in the key (q_cmd1_deg).")
    rest = {key: value for key, value in (mapping or {}).items() if key not in commands}
    return (rest or None) if commands else mapping, commands


def named_commands(extras: Mapping[str, Array], commands: Mapping[str, str], header: Iterable[str], where: str) -> dict[str, Array]:
    """Further columns by name, those that [columns] names as commands under that name; a unit of the file's own name is kept."""
    out = dict(extras)
    for key, source in commands.items():
        if source not in out:
            raise unknown_name(f"column of {where} in [columns] {key} =", source, header)
        own, unit = split_unit(source)[1], split_unit(key)[1]
        out[key if unit or not own else f"{key}_{own}"] = out.pop(source)
    return out
