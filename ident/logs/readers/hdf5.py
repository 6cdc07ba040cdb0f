"""HDF5 files and MATLAB 7.3 files (which are such) by h5py. Only what can be samples is read: never images."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError
from .arrays import ArrayTable, columns_of, leaves
from .damage import reason
from .mat import matlab_columns
from .stored import Chunked, LogFormat, Stored, register_log_format, split_inside

Array = np.ndarray
_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB = b"MATLAB 7.3"
#: A dataset of more numbers than this is none of a robot's channels.
_LARGEST = 1 << 28


def _opened(path: Path) -> Any:
    if find_spec("h5py") is None:
        raise ConfigurationError(f"log {path}: reading HDF5 needs h5py: pip install 'ident[hdf5]'. Or export the log as CSV.")
    import h5py

    try:
        return h5py.File(path, "r")
    except (OSError, ValueError) as error:
        raise DataError(f"log {path}: is not an HDF5 file ({reason(error)}).") from None


def _datasets(group: Any) -> dict[str, Any]:
    """Datasets of numbers below a group that may be channels over time, by path."""
    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if hasattr(item, "shape") and item.dtype.kind in "fiub" and len(item.shape) in (1, 2) and 0 < item.size <= _LARGEST:
            found[name] = item

    group.visititems(visit)
    return found


def _recordings(path: Path) -> Sequence[str]:
    """Groups beside each other that hold the same datasets (`data/demo_0`, `data/demo_1` …), if there are several."""
    with _opened(path) as file:
        rows = {name: item.shape[0] for name, item in _datasets(file).items()}
    alike: dict[tuple[str, str], dict[str, set[str]]] = {}
    for name in rows:
        parts = name.split("/")
        for k, part in enumerate(parts[:-1]):
            pattern = re.sub(r"\d+", "#", part)
            if pattern != part:
                key = "/".join(parts[:k]), pattern
                alike.setdefault(key, {}).setdefault("/".join(parts[: k + 1]), set()).add("/".join(parts[k + 1 :]))
                break
    for groups in alike.values():
        own = {f"{group}/{name}" for group, names in groups.items() for name in names}
        # With channels of the same length outside (a time), the groups are the joints of one recording.
        shared = {rows[name] for name in own} & {length for name, length in rows.items() if name not in own}
        if len(groups) > 1 and set.intersection(*groups.values()) and not shared:
            return sorted(groups, key=lambda g: [int(x) if x.isdecimal() else x for x in re.split(r"(\d+)", g)])
    return ()


def _read(path: Path) -> Stored:
    outer, inside = split_inside(path)
    with _opened(outer) as file:
        if inside and inside not in file:
            raise DataError(f"log {outer}: holds no group {inside!r}; it has {', '.join(list(file)[:8])}.")
        try:
            arrays = {name: np.asarray(item[()]) for name, item in _datasets(file[inside] if inside else file).items()}
        except (OSError, ValueError, MemoryError) as error:
            raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None
    if not inside:
        arrays = _one_level_up(arrays)
    return Stored(columns_of(arrays, f"log {path}"))


def _chunks(path: Path) -> Chunked:
    outer, inside = split_inside(path)

    def table(file: Any) -> ArrayTable:
        if inside and inside not in file:
            raise DataError(f"log {outer}: holds no group {inside!r}; it has {', '.join(list(file)[:8])}.")
        found = _datasets(file[inside] if inside else file)
        return ArrayTable.of(found if inside else _one_level_up(found), f"log {path}")

    def read(names: Sequence[str], first: int) -> Iterator[dict[str, Array]]:
        with _opened(outer) as file:
            yield from table(file).chunks(names, first)

    def sample(names: Sequence[str]) -> dict[str, Array]:
        with _opened(outer) as file:
            return table(file).sample(names)

    with _opened(outer) as file:
        whole = table(file)
        return Chunked(tuple(whole.places), read, sample, whole.rows)


def _one_level_up(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The same without groups that hold everything (`data/demo_1/`)."""
    parts = [name.split("/") for name in arrays]
    depth = 0
    while parts and all(len(p) > depth + 1 and p[depth] == parts[0][depth] for p in parts):
        depth += 1
    return {"/".join(p[depth:]): a for p, a in zip(parts, arrays.values(), strict=True)}


def _read_matlab(path: Path) -> Stored:
    with _opened(path) as file:
        try:
            content = {name: _value(file, item) for name, item in file.items() if not name.startswith("#")}
        except (OSError, ValueError, KeyError, RecursionError) as error:
            raise DataError(f"log {path}: is not a MAT file ({reason(error)}).") from None
    return matlab_columns(leaves(content), path)


def _value(file: Any, item: Any) -> Any:
    """A MATLAB value: arrays with the axes as MATLAB has them, structs as dicts, cells and arrays of structs as lists, text as str."""
    if hasattr(item, "items"):
        fields = {name: _value(file, member) for name, member in item.items()}
        lists = [v for v in fields.values() if isinstance(v, list)]
        # An array of structs is stored field by field.
        if fields and len(lists) == len(fields) and len({len(v) for v in lists}) == 1:
            return [dict(zip(fields, values, strict=True)) for values in zip(*fields.values(), strict=True)]
        return fields
    kind = item.attrs.get("MATLAB_class", b"")
    if item.dtype.kind == "O":
        return [_value(file, file[reference]) for reference in np.asarray(item[()]).reshape(-1)]
    if kind == b"char":
        return "".join(chr(int(c)) for c in np.asarray(item[()]).reshape(-1, order="F"))
    if item.attrs.get("MATLAB_empty", 0) or item.size > _LARGEST or item.dtype.kind not in "fiub":
        return np.zeros(0)
    array = np.asarray(item[()])
    return array.T if array.ndim > 1 else array


HDF5 = register_log_format(LogFormat("HDF5", lambda path, start: start.startswith(_MAGIC), _read, _recordings, _chunks))
MATLAB = register_log_format(LogFormat("MATLAB 7.3", lambda path, start: start.startswith(_MATLAB), _read_matlab))
