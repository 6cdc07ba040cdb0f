"""The manifest of a plan: one TOML table for the plan, one for each test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .._utils.fields import Field
from .._utils.files import write_atomic
from .._utils.toml import load_toml, to_toml
from ..errors import ConfigurationError, unknown_name
from ..robots.transmission import Side
from .sequence import SCHEMA, SWEEP_KEYS, SWING_KEYS, Plan
from .trials import MotionKind, PlannedTest, Sweep, Swing

_PLAN = ("robot", "joints", "effects", "base", "rank", "velocity", "acceleration", "notes", "schema")
_TEST = ("kind", "moving", "row", "side", "log", "reveals", "gain", "strength", "postures", "segments")


def write_manifest(plan: Plan, path: Path, *, force: bool) -> Path:
    """Write the manifest, completely or not at all."""
    return write_atomic(path, to_toml(plan.tables()), force=force)


def read_manifest(path: Path) -> dict[str, Any]:
    """Fields of the plan that a manifest holds. Raises ConfigurationError."""
    tables = load_toml(path, "plan")
    head = tables.pop("plan", None)
    if not isinstance(head, dict) or head.get("schema") != SCHEMA:
        raise ConfigurationError(f"plan {path}: there is no table [plan] with schema = {SCHEMA!r}; this is not a manifest of a plan.")
    _known(head, _PLAN, f"[plan] ({path})")
    where = f"plan {path}: [plan]"
    joints = _field(head, "joints", where).texts()
    tests = tuple(_test(name, table, joints, path) for name, table in tables.items())
    return {
        "robot": _field(head, "robot", where).text(),
        "joints": joints,
        "effects": _field(head, "effects", where).texts(),
        "base": _field(head, "base", where).texts(),
        "tests": tests,
        "rank": _field(head, "rank", where).whole(),
        "velocity": _limits(head, "velocity", len(joints), where),
        "acceleration": _limits(head, "acceleration", len(joints), where),
        "notes": _field(head, "notes", where, []).texts(),
    }


def _test(name: str, table: Any, joints: tuple[str, ...], path: Path) -> PlannedTest:
    where = f"plan {path}: test [{name}]"
    if not isinstance(table, dict):
        raise ConfigurationError(f"{where} must be a table.")
    kind = _member(MotionKind, _need(table, "kind", where), where)
    _known(table, (*_TEST, *(SWING_KEYS if kind == MotionKind.ACCELERATED else SWEEP_KEYS)), where)
    n = len(joints)
    moving, row = _field(table, "moving", where).texts(), _field(table, "row", where).text()
    for joint in (*moving, row):
        if joint not in joints:
            raise unknown_name(f"joint in {where}", joint, joints)
    postures = _array(table, "postures", (None, n), where)
    motion: Sweep | Swing
    if kind == MotionKind.ACCELERATED:
        sine = _array(table, "sine", (None, n), where)
        base_hz = _positive(_field(table, "base_hz", where).number(), "base_hz", where)
        motion = Swing(sine, _array(table, "cosine", sine.shape, where), base_hz)
    else:
        speeds, reach = (tuple(_field(table, key, where).numbers(-1).tolist()) for key in ("speeds", "reach"))
        if len(speeds) != len(reach):
            raise ConfigurationError(f"{where}: speeds and reach must have the same number of entries.")
        for key, values in (("speeds", speeds), ("reach", reach)):
            for value in values:
                _positive(value, key, where)
        motion = Sweep(_array(table, "direction", (n,), where), speeds, reach)
    return PlannedTest(
        name,
        kind,
        moving,
        row,
        _member(Side, _need(table, "side", where), where),
        postures,
        motion,
        _field(table, "reveals", where, []).texts(),
        _field(table, "gain", where, 0).whole(),
        _field(table, "strength", where, 0.0).number(),
        _field(table, "log", where).text(),
    )


def _limits(table: dict[str, Any], key: str, n: int, where: str) -> np.ndarray:
    limits = _array(table, key, (n,), where)
    for value in limits.tolist():
        _positive(value, key, where)
    return limits


def _positive(value: float, key: str, where: str) -> float:
    if not value > 0:
        raise ConfigurationError(f"{where}: {key} must be positive, not {value:g}: the motion would never end.")
    return value


def _known(table: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in keys:
            raise unknown_name(f"key of {where}", key, keys)


def _need(table: dict[str, Any], key: str, where: str) -> Any:
    if key not in table:
        raise ConfigurationError(f"{where}: the key {key!r} is missing.")
    return table[key]


def _field(table: dict[str, Any], key: str, where: str, default: Any = None) -> Field:
    """An entry that must be there, unless there is a default, and is asked for its kind."""
    return Field(_need(table, key, where) if default is None else table.get(key, default), where, key)


def _member(kind: Any, value: Any, where: str) -> Any:
    try:
        return kind(value)
    except ValueError:
        raise unknown_name(f"{kind.__name__.lower()} in {where}", str(value), [m.value for m in kind]) from None


def _array(table: dict[str, Any], key: str, shape: tuple[int | None, ...], where: str) -> np.ndarray:
    try:
        array = np.asarray(_need(table, key, where), float)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{where}: {key} must be numbers.") from None
    fits = array.ndim == len(shape) and all(want in (None, size) for want, size in zip(shape, array.shape, strict=True))
    if not fits or not np.all(np.isfinite(array)):
        wanted = " x ".join("any" if s is None else str(s) for s in shape)
        raise ConfigurationError(f"{where}: {key} must be {wanted} finite numbers, not shape {array.shape}.")
    return array
