"""A user's own mapping of columns: the [columns] table of a study file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ..errors import ConfigurationError, unknown_name
from .names import LOCKED, TEXT, Column, JointNames, known_units, parse_name
from .units import Unit, bracketed, expected_units, is_unit, split_unit, unit_of


def take_mapped(
    mapping: Mapping[str, Any] | None,
    header: Sequence[str],
    joints: JointNames | None,
    where: str,
    notes: list[str],
    found: dict[tuple[str, int], Column],
    idle: list[str],
) -> bool:
    """Put the columns that [columns] names into `found`, those of locked joints into `idle`. Whether numbers of unmapped columns still
    count the robot's joints."""
    automatic = True
    for key, value in (mapping or {}).items():
        target = parse_name(key, joints)
        if target is not None and target.joint == LOCKED:
            idle.append(key)
            continue
        column = _mapped(key, value, header, joints, where, notes)
        found[column.quantity, column.joint] = column
        own = parse_name(column.source, joints)
        if own is not None and own.quantity == column.quantity != "t" and own.joint != column.joint:
            automatic = False  # the mapping renumbers joints: unmapped numbered columns keep a numbering that is not the robot's
    return automatic


def _mapped(key: str, value: Any, header: Sequence[str], joints: JointNames | None, where: str, notes: list[str]) -> Column:
    """One entry of the [columns] table."""
    target = parse_name(key, joints)
    if target is not None and target.joint < 0:
        raise ConfigurationError(f"[columns] {key}: joints are counted from 1.")
    if target is None:
        known = ["t", *(f"{s}1" for s in ("q", "dq", "ddq", "tau", "tau_m", "i", "q_m", "dq_m")), *(joints.names if joints else ())]
        raise unknown_name("quantity in [columns]", key, known)
    options: Mapping[str, Any] = {"column": value} if isinstance(value, str) else value
    if (
        not isinstance(options, Mapping)
        or not isinstance(options.get("column"), str)
        or set(options) - {"column", "unit", "scale", "offset"}
    ):
        raise ConfigurationError(
            f"[columns] {key}: give the name of a column as text, not {value!r}. A unit may be part of the key, as in q1_deg."
            ' From Python also a dict of "column" and any of "unit", "scale", "offset".'
        )
    source = options["column"]
    if source not in header:
        unknown = unknown_name(f"column of {where} in [columns] {key} =", source, header)
        raise ConfigurationError(
            f"{unknown}. [columns] applies to every log, validation logs included: rename the columns of a log that differs."
        )
    suffix = options.get("unit") or target.unit or None
    if suffix is not None and not is_unit(suffix):
        raise unknown_name(f"unit in [columns] {key}", suffix, known_units(target.quantity))
    guessed = split_unit(source)[1] if suffix is None else None
    if guessed is not None and unit_of(guessed).dimension in expected_units(target.quantity):
        suffix = guessed
    elif guessed is not None and not (len(guessed) == 1 and not source.endswith((guessed, f"{guessed}]", f"{guessed})"))):
        notes.append(f"{where}: column {source!r} ends in {guessed}, which is not a unit of {TEXT[target.quantity]}; SI is assumed.")
    elif suffix is None and "scale" not in options and bracketed(source)[1] and not _is_element(source, header):
        notes.append(f"{where}: the text in the brackets of {source!r} is not a known unit; SI is assumed.")
    own = split_unit(source)[1]
    if suffix is not None and own is not None and unit_of(own).dimension == unit_of(suffix).dimension and own != unit_of(suffix).name:
        notes.append(f"{where}: column {source!r} says {own}, but [columns] {key} says {unit_of(suffix).name}, which takes precedence.")
    unit = Unit("", "", 1.0)
    if suffix is not None:
        replace(target, unit=suffix).column(source, where)  # refuses a unit of something else
        unit = unit_of(suffix)
    try:
        scale, offset = float(options.get("scale", 1.0)), float(options.get("offset", 0.0))
    except (TypeError, ValueError):
        raise ConfigurationError(f"[columns] {key}: scale and offset must be numbers.") from None
    return Column(source, target.quantity, target.joint, unit.scale * scale, unit.scale * offset, suffix or "")


def _is_element(source: str, header: Sequence[str]) -> bool:
    """Whether what stands in the brackets of a column's name counts or names an element: other columns differ from it in that alone."""
    stem, inside = bracketed(source)
    return any(stem == other and inside != told for other, told in map(bracketed, header))


def columns_of(mapping: Mapping[str, Any] | None) -> set[Any]:
    """The file's columns that a mapping names."""
    return {value.get("column") if isinstance(value, Mapping) else value for value in (mapping or {}).values()}
