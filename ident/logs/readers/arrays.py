"""Arrays of one recording as columns: which belong together, which way they lie, and what was never filled."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from .damage import reason
from .packed import Expansion
from .stored import LogFormat, Stored, register_log_format

Array = np.ndarray
#: Arrays beyond so many columns are images and the like.
_WIDEST = 1024


def element(name: str, k: int) -> str:
    """The name of the column that holds element k of an array."""
    return f"{name}[{k}]"


def columns_of(arrays: Mapping[str, Array], where: str, named: Callable[[str, int], str] = element) -> dict[str, Array]:
    """Columns of arrays of numbers: those that have the length most of them have, samples along either axis.

    Zeros at the end that a recorder allocated and never filled are cut. Raises DataError where there is no series of samples."""
    numbers = {k: _plain(a) for k, a in arrays.items() if a.dtype.kind in "fiub" and a.size}
    numbers = {k: a for k, a in numbers.items() if a.ndim == 1 or (a.ndim == 2 and min(a.shape) <= _WIDEST)}
    if not numbers:
        raise DataError(f"{where}: holds no array of numbers.")
    lengths = Counter(max(a.shape) for a in numbers.values())
    rows = max(lengths, key=lambda length: (lengths[length] if length > 1 else 0, length))
    if rows < 2:
        raise DataError(f"{where}: holds no series of samples.")
    kept = {k: (a if len(a) == rows else a.T).astype(float) for k, a in numbers.items() if rows in a.shape}
    any_value = np.any([np.any(a.reshape(rows, -1) != 0, axis=1) for a in kept.values()], axis=0)
    last = int(np.flatnonzero(any_value)[-1]) + 1 if any_value.any() else 0
    columns: dict[str, Array] = {}
    for name, a in kept.items():
        if a.ndim == 1:
            columns[name] = a[:last]
        else:
            columns |= {named(name, j): a[:last, j] for j in range(a.shape[1])}
    return columns


def _plain(a: Array) -> Array:
    """A vector that lies in a matrix, as a vector."""
    return a.reshape(-1) if a.ndim == 2 and 1 in a.shape else a


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
    unpacked = Expansion(path)
    try:
        with zipfile.ZipFile(path) as members:
            for member in members.infolist():
                unpacked.add(member.file_size)
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except DataError:
        raise
    except MemoryError:
        raise DataError(f"log {path}: asks for more memory than there is. Save fewer arrays; a damaged file may ask too.") from None
    except Exception as error:  # noqa: BLE001 - whatever NumPy makes of a damaged file
        raise DataError(f"log {path}: is not a file of plain arrays ({reason(error)}).") from None
    return Stored(columns_of(arrays, f"log {path}"))


NPZ = register_log_format(LogFormat("NumPy arrays", lambda path, start: path.suffix.lower() == ".npz", _read_npz))
