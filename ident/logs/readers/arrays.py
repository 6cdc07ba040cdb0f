"""Arrays of one recording as columns: which belong together, which way they lie, and what was never filled."""

from __future__ import annotations

import struct
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError, IdentError, UnsupportedError
from .damage import reason
from .stored import Chunked, LogFormat, Stored, register_log_format

Array = np.ndarray
#: Rows of a chunk, and of a stretch by which columns are recognised, of which there are so many.
CHUNK, STRETCH, _STRETCHES = 1 << 16, 4096, 16
#: Arrays beyond so many columns are images and the like.
_WIDEST = 1024


def element(name: str, k: int) -> str:
    """The name of the column that holds element k of an array."""
    return f"{name}[{k}]"


def columns_of(arrays: Mapping[str, Array], where: str, named: Callable[[str, int], str] = element) -> dict[str, Array]:
    """Columns of arrays of numbers: those that have the length most of them have, samples along either axis.

    Zeros at the end that a recorder allocated and never filled are cut. Raises DataError where there is no series of samples."""
    table = ArrayTable.of(arrays, where, named)
    return table.part([*table.places], 0, table.rows)


@dataclass(frozen=True, eq=False)
class ArrayTable:
    """Arrays of numbers, in memory or on disk (what has a shape, a dtype and slices), as a table of `rows`; `places`: column → array, and
    which of its series (-1: it is one); `across`: arrays with samples along the second axis."""

    arrays: Mapping[str, Any]
    rows: int
    places: Mapping[str, tuple[str, int]]
    across: frozenset[str]

    @classmethod
    def of(cls, arrays: Mapping[str, Any], where: str, named: Callable[[str, int], str] = element) -> ArrayTable:
        """As `columns_of`."""
        numbers = {k: a for k, a in arrays.items() if a.dtype.kind in "fiub" and a.size and a.ndim in (1, 2)}
        numbers = {k: a for k, a in numbers.items() if a.ndim == 1 or min(a.shape) <= _WIDEST}
        if not numbers:
            raise DataError(f"{where}: holds no array of numbers.")
        lengths = Counter(max(a.shape) for a in numbers.values())
        rows = max(lengths, key=lambda length: (lengths[length] if length > 1 else 0, length))
        if rows < 2:
            raise DataError(f"{where}: holds no series of samples.")
        kept = {k: a for k, a in numbers.items() if rows in a.shape}
        places: dict[str, tuple[str, int]] = {}
        for name, a in kept.items():
            series = 1 if a.ndim == 1 else a.size // rows
            places |= {name: (name, -1)} if series == 1 else {named(name, j): (name, j) for j in range(series)}
        whole = cls(kept, rows, places, frozenset(k for k, a in kept.items() if a.shape[0] != rows))
        return replace(whole, rows=whole._filled())

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
        return rows.astype(float).reshape(stop - start, -1)

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
    """Arrays of nested dicts and lists by path (`rec.pos`, `signals[0].values`); a dict of `values` and `label` goes by its label."""
    if isinstance(content, Mapping):
        label = content.get("label")
        if isinstance(label, str) and label.strip() and isinstance(content.get("values"), np.ndarray):
            return {label.strip(): content["values"]}
        out: dict[str, Array] = {}
        for key, value in content.items():
            out |= leaves(value, f"{name}.{key}" if name else str(key))
        return out
    if isinstance(content, np.ndarray) and content.dtype != object:
        return {name: content}
    if isinstance(content, (list, np.ndarray)):
        out = {}
        for k, value in enumerate(content):
            out |= leaves(value, element(name, k))
        return out
    return {}


def shortest(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """The same arrays by the last part of their path, where that tells them apart."""
    last = {name: name.rsplit(".", 1)[-1] if "[" not in name else name for name in arrays}
    counts = Counter(last.values())
    return {last[name] if counts[last[name]] == 1 else name: a for name, a in arrays.items()}


def _read_npz(path: Path) -> Stored:
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except MemoryError:
        raise DataError(f"log {path}: asks for more memory than there is. Save fewer arrays; a damaged file may ask too.") from None
    except Exception as error:  # noqa: BLE001 - whatever NumPy makes of a damaged file
        raise DataError(f"log {path}: is not a file of plain arrays ({reason(error)}).") from None
    return Stored(columns_of(arrays, f"log {path}"))


def _mapped(path: Path) -> dict[str, Array]:
    """The arrays of an NPZ file that is not packed, mapped into memory. Raises UnsupportedError for one that is."""
    out: dict[str, Array] = {}
    with zipfile.ZipFile(path) as members, path.open("rb") as file:
        for member in members.infolist():
            if member.compress_type != zipfile.ZIP_STORED:
                raise UnsupportedError(f"log {path}: arrays that are packed are read whole (--no-stream); save them with numpy.savez.")
            file.seek(member.header_offset)
            name, extra = struct.unpack("<HH", file.read(30)[26:30])
            file.seek(name + extra, 1)
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, dtype = read(file)
            if dtype.kind in "fiub" and shape and 0 not in shape:
                order: Any = "F" if fortran else "C"
                out[member.filename.removesuffix(".npy")] = np.memmap(path, dtype, "r", file.tell(), shape, order)
    return out


def _npz_chunks(path: Path) -> Chunked:
    try:
        table = ArrayTable.of(_mapped(path), f"log {path}")
    except IdentError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever NumPy makes of a damaged file
        raise DataError(f"log {path}: is not a file of plain arrays ({reason(error)}).") from None
    return Chunked(tuple(table.places), table.chunks, table.sample, table.rows)


NPZ = register_log_format(LogFormat("NumPy arrays", lambda path, start: path.suffix.lower() == ".npz", _read_npz, chunks=_npz_chunks))
