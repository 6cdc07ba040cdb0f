"""Arrays of one recording as columns: which belong together, which way they lie, and what was never filled."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import DataError
from ..words import words_of
from .stored import Stored

Array = np.ndarray
#: Rows of a chunk, and of a stretch by which columns are recognised, of which there are so many.
CHUNK, STRETCH, _STRETCHES = 1 << 16, 4096, 16
#: Arrays beyond so many columns are images and the like.
_WIDEST = 1024
#: What stands before every path of a model in dSPACE.
_ROOT = re.compile(r'^"?Model Root"?/')
#: Words by which a list tells the joints, or names of something.
_OF_JOINTS, _NAMES = {"joint", "joints", "dof", "dofs", "motor", "motors", "actuator", "actuators"}, {"name", "names", "label", "labels"}
#: Series of this share of the rest's samples are said when they are left out, so many by name.
_PART, _SHOWN = 0.2, 6


def element(name: str, k: int) -> str:
    """The name of the column that holds element k of an array."""
    return f"{name}[{k}]"


def columns_of(
    arrays: Mapping[str, Array], where: str, named: Callable[[str, int], str] = element, units: Mapping[str, str] | None = None
) -> Stored:
    """Columns of arrays of numbers: those that have the length most of them have, samples along either axis; `units`: told of arrays.

    Series of a matrix go by names where a list of as many names of joints is among the arrays (`joint_names`). Zeros at the end that a
    recorder allocated and never filled are cut. Raises DataError where there is no series of samples."""
    table = ArrayTable.of(arrays, where, named)
    return Stored(table.part([*table.places], 0, table.rows), table.units(units or {}), table.notes(where), table.constants)


def _labels(arrays: Mapping[str, Any]) -> dict[int, tuple[str, ...]]:
    """Lists of names among the arrays, by their length: of joints before others."""
    found: dict[int, tuple[str, ...]] = {}
    for name in sorted(arrays, key=lambda name: not words_of(name) & _OF_JOINTS):
        a = arrays[name]
        if a.dtype.kind in "US" and len(a.shape) == 1 and 1 < a.shape[0] <= _WIDEST and words_of(name) & (_OF_JOINTS | _NAMES):
            told = tuple(x.decode("utf-8", "replace") if isinstance(x, bytes) else str(x) for x in np.asarray(a).tolist())
            if all(told) and len(set(told)) == len(told):
                found.setdefault(len(told), told)
    return found


@dataclass(frozen=True, eq=False)
class ArrayTable:
    """Arrays of numbers, in memory or on disk (what has a shape, a dtype and slices), as a table of `rows`; `places`: column → array, and
    which of its series (-1: it is one); `across`: arrays with samples along the second axis; `left`: series of another length;
    `constants`: single numbers."""

    arrays: Mapping[str, Any]
    rows: int
    places: Mapping[str, tuple[str, int]]
    across: frozenset[str]
    left: tuple[str, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, arrays: Mapping[str, Any], where: str, named: Callable[[str, int], str] = element) -> ArrayTable:
        """As `columns_of`."""
        constants = {k: float(np.asarray(a[()]).reshape(-1)[0]) for k, a in arrays.items() if a.dtype.kind in "fiu" and a.size == 1}
        numbers = {k: a for k, a in arrays.items() if a.dtype.kind in "fiub" and a.size and len(a.shape) in (1, 2)}
        labels = _labels(arrays)
        numbers = {k: a for k, a in numbers.items() if len(a.shape) == 1 or min(a.shape) <= _WIDEST}
        if not numbers:
            raise DataError(f"{where}: holds no array of numbers.")
        lengths = Counter(max(a.shape) for a in numbers.values())
        rows = max(lengths, key=lambda length: (lengths[length] if length > 1 else 0, length))
        if rows < 2:
            raise DataError(f"{where}: holds no series of samples.")
        kept = {k: a for k, a in numbers.items() if rows in a.shape}
        places: dict[str, tuple[str, int]] = {}
        for name, a in kept.items():
            series = 1 if len(a.shape) == 1 else a.size // rows
            told = labels.get(series, ())
            if len(a.shape) == 1:
                places[name] = name, -1
            else:
                places |= {f"{name}[{told[j]}]" if told else named(name, j) if series > 1 else name: (name, j) for j in range(series)}
        left = tuple(k for k, a in numbers.items() if k not in kept and max(a.shape) > _PART * rows)
        whole = cls(kept, rows, places, frozenset(k for k, a in kept.items() if a.shape[0] != rows), left, constants)
        return replace(whole, rows=whole._filled())

    def notes(self, where: str) -> tuple[str, ...]:
        """What to say of series that are left out."""
        if not self.left:
            return ()
        return (f"{where}: {', '.join(self.left[:_SHOWN])} have a different number of samples from the {self.rows} of the rest; not used.",)

    def units(self, told: Mapping[str, str]) -> dict[str, str]:
        """Units of columns, of those told of arrays."""
        return {column: told[name] for column, (name, _) in self.places.items() if told.get(name)}

    def part(self, names: Sequence[str], start: int, stop: int) -> dict[str, Array]:
        """Some rows of some columns."""
        found: dict[str, Array] = {}
        out = {}
        for name in names:
            own, k = self.places[name]
            if own not in found:
                found[own] = self._slice(own, start, min(stop, self.rows))
            out[name] = found[own][:, max(k, 0)]
        return out

    def chunks(self, names: Sequence[str], first: int) -> Iterator[dict[str, Array]]:
        """Some columns from a row on."""
        for start in range(first, self.rows, CHUNK):
            yield self.part(names, start, start + CHUNK)

    def sample(self, names: Sequence[str]) -> dict[str, Array]:
        """Stretches of some columns from all over the table."""
        starts = stretches(self.rows)
        parts = [self.part(names, start, start + (self.rows if len(starts) == 1 else STRETCH)) for start in starts]
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def _slice(self, name: str, start: int, stop: int) -> Array:
        a = self.arrays[name]
        rows = np.asarray(a[:, start:stop]).T if name in self.across else np.asarray(a[start:stop])
        return rows.astype(float).reshape(len(rows), math.prod(rows.shape[1:]))  # of no rows, -1 would be no number of columns

    def _filled(self) -> int:
        """Rows without those at the end that are zero in every array."""
        stop = self.rows
        while stop > 0:
            start = max(0, stop - CHUNK)
            filled = np.any([np.any(self._slice(name, start, stop) != 0, axis=1) for name in self.arrays], axis=0)
            if filled.any():
                return start + int(np.flatnonzero(filled)[-1]) + 1
            stop = start
        return 0


def stretches(rows: int) -> list[int]:
    """Where stretches of `STRETCH` rows begin that tell what a table of so many rows holds; one, from the start, for a short one."""
    if rows <= _STRETCHES * STRETCH:
        return [0]
    return [int(x) for x in np.linspace(0, rows - STRETCH, _STRETCHES)]


def leaves(content: Any, name: str = "") -> dict[str, Array]:
    """Arrays of nested dicts and lists by path (`rec.pos`, `signals[0].values`); a dict of values and a label (dSPACE: data and a name)
    goes by that, with its unit in brackets; lists of dicts that tell their own names by these, lists of text as arrays."""
    if isinstance(content, Mapping):
        if labelled := _labelled(content):
            return labelled
        out: dict[str, Array] = {}
        for key, value in content.items():
            out |= leaves(value, f"{name}.{key}" if name else str(key))
        return out
    if isinstance(content, np.ndarray) and content.dtype != object:
        return {name: content}
    if isinstance(content, (int, float, np.number)) and not isinstance(content, bool):
        return {name: np.array(float(content))}
    if isinstance(content, (list, np.ndarray)):
        items = list(content)
        if items and all(isinstance(x, str) for x in items):
            return {name: np.array(items)}
        named = names_told(items)
        out = {}
        for k, value in enumerate(items):
            out |= leaves(value, f"{name}[{named[k]}]" if named else element(name, k))
        return out
    return {}


def _labelled(content: Mapping[str, Any]) -> dict[str, Array]:
    """The values of a signal that tells its label, by that; {} for another dict."""
    plain = {str(key).lower(): value for key, value in content.items()}
    for label, values in (("label", "values"), ("name", "data")):
        told, held = plain.get(label), plain.get(values)
        if isinstance(told, str) and told.strip() and isinstance(held, np.ndarray) and held.dtype != object:
            unit = plain.get("unit", plain.get("units"))
            told = _ROOT.sub("", told)
            return {f"{told.strip()} [{unit.strip()}]" if isinstance(unit, str) and unit.strip() else told.strip(): held}
    return {}


def names_told(items: Sequence[Any]) -> tuple[str, ...]:
    """The names that dicts of a list tell of themselves, each its own (`{"name": "elbow", "angle": 0.1}`); () where they do not."""
    told = tuple(x.get("name", x.get("joint_name", x.get("joint"))) if isinstance(x, Mapping) else None for x in items)
    return tuple(map(str, told)) if len(told) > 1 and all(isinstance(x, str) and x for x in told) and len(set(told)) == len(told) else ()


def shortest(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """The same arrays by the last part of their path, where that tells them apart."""
    last = {name: name.rsplit(".", 1)[-1] if "[" not in name else name for name in arrays}
    counts = Counter(last.values())
    return {last[name] if counts[last[name]] == 1 else name: a for name, a in arrays.items()}
