"""HDF5 files and MATLAB 7.3 files (which are such) by h5py. Only what can be samples is read: never images."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError
from .arrays import ArrayTable, columns_of, leaves
from .damage import damage_told
from .mat import matlab_columns
from .packed import Expansion
from .runs import grouped_by_run, run_name, runs_of
from .stored import Chunked, LogFormat, Stored, register_log_format, split_inside

Array = np.ndarray
_MAGIC = b"\x89HDF\r\n\x1a\n"
_MATLAB = b"MATLAB 7.3"
#: A dataset of more numbers than this is none of a robot's channels.
_LARGEST = 1 << 28
#: A list of more names than this is none of joints; the mark of an object of MATLAB's classes, which only MATLAB can read.
_NAMES, _OBJECT = 1024, "MATLAB_object_decode"


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The content of a file."""
    if find_spec("h5py") is None:
        raise ConfigurationError(f"log {path}: reading HDF5 needs h5py: pip install 'ident[hdf5]'. Or export the log as CSV.")
    import h5py

    with damage_told(path, "cannot be read as HDF5"), h5py.File(path, "r") as file:
        yield file


def _datasets(group: Any) -> dict[str, Any]:
    """Datasets of numbers below a group that may be channels over time, by path; fields of tables, and lists of names, as arrays."""
    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if not hasattr(item, "shape") or not 0 < item.size <= _LARGEST:
            return
        if item.dtype.names and len(item.shape) == 1:
            found.update({f"{name}/{field}": item[field] for field in item.dtype.names if item.dtype[field].base.kind in "fiub"})
        elif item.dtype.kind in "fiub" and len(item.shape) <= 2:
            found[name] = item
        elif item.dtype.kind in "OS" and len(item.shape) == 1 and item.size <= _NAMES and (told := _texts(item)) is not None:
            found[name] = told

    group.visititems(visit)
    return _pandas(found)


def _texts(item: Any) -> Array | None:
    """A short dataset of texts; None for one of something else."""
    values = item[()].tolist()
    if all(isinstance(x, (bytes, str)) for x in values):
        return np.array([x.decode("utf-8", "replace") if isinstance(x, bytes) else x for x in values])
    return None


def _pandas(found: dict[str, Any]) -> dict[str, Any]:
    """The same with the blocks of a DataFrame (`block0_items`, `block0_values`) as columns by their names."""
    out = dict(found)
    for name, item in found.items():
        block = re.match(r"^(?P<stem>.*block\d+)_values$", name)
        items = found.get(f"{block['stem']}_items") if block else None
        if items is not None and items.dtype.kind == "U" and len(item.shape) == 2 and item.shape[1] == len(items):
            values = np.asarray(out.pop(name)[()])
            out |= {str(column): values[:, k] for k, column in enumerate(items)}
    return out


def _units(file: Any, inside: str = "") -> dict[str, str]:
    """Units that datasets tell as an attribute, by path."""
    found: dict[str, str] = {}

    def visit(name: str, item: Any) -> None:
        told = item.attrs.get("units", item.attrs.get("unit")) if hasattr(item, "shape") else None
        told = told.decode("utf-8", "replace") if isinstance(told, bytes) else told
        if isinstance(told, str) and told.strip():
            found[name] = told.strip()

    (file[inside] if inside else file).visititems(visit)
    return found


def _constants(file: Any, inside: str) -> dict[str, float]:
    """Single numbers that the file, or a group on the way to `inside`, tells as attributes or as data sets."""
    found: dict[str, float] = {}
    parts = inside.split("/") if inside else []
    for group in [file, *(file["/".join(parts[: k + 1])] for k in range(len(parts)))]:
        held = [(name, item) for name, item in group.items() if hasattr(item, "shape") and item.size == 1]
        for name, value in (*group.attrs.items(), *((name, item[()]) for name, item in held)):
            number = np.asarray(value)
            if number.size == 1 and number.dtype.kind in "fiu":
                found[str(name)] = float(number.reshape(-1)[0])
    return found


def _recordings(path: Path) -> Sequence[str]:
    """Groups beside each other that hold the same datasets (`data/demo_0`, `data/demo_1` …), if there are several."""
    with _opened(path) as file:
        rows = {name: item.shape[0] for name, item in _datasets(file).items() if item.dtype.kind != "U" and item.shape}
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
    unpacked = Expansion(outer)
    with _opened(outer) as file:
        if inside and inside not in file:
            raise DataError(f"log {outer}: holds no group {inside!r}; it has {', '.join(list(file)[:8])}.")
        found = _datasets(file[inside] if inside else file)
        for item in found.values():
            unpacked.add(item.size * item.dtype.itemsize)
        arrays = {name: np.asarray(item[()]) for name, item in found.items()}
        units, constants = _units(file, inside), _constants(file, inside)
    if not inside:
        places = _one_level_up({name: name for name in arrays})
        arrays, units = {k: arrays[own] for k, own in places.items()}, {k: units.get(own, "") for k, own in places.items()}
    stored = columns_of(arrays, f"log {path}", units=units)
    return replace(stored, constants={**constants, **stored.constants})


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
        whole, told = table(file), _units(file, inside)
        places = {name: name for name in _datasets(file[inside] if inside else file)}
        units = whole.units({k: told.get(own, "") for k, own in (places if inside else _one_level_up(places)).items()})
        constants = {**_constants(file, inside), **whole.constants}
        return Chunked(tuple(whole.places), read, sample, whole.rows, units, whole.notes(f"log {path}"), constants)


def _one_level_up(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The same without groups that hold everything (`data/demo_1/`)."""
    parts = [name.split("/") for name in arrays]
    depth = 0
    while parts and all(len(p) > depth + 1 and p[depth] == parts[0][depth] for p in parts):
        depth += 1
    return {"/".join(p[depth:]): a for p, a in zip(parts, arrays.values(), strict=True)}


def _read_matlab(path: Path) -> Stored:
    outer, _ = split_inside(path)
    arrays, objects = _matlab_loaded(outer, outer.stat().st_mtime_ns)
    return matlab_columns(arrays, path, objects)


def _matlab_recordings(path: Path) -> tuple[str, ...]:
    return tuple(map(run_name, runs_of(_matlab_loaded(path, path.stat().st_mtime_ns)[0])))


@lru_cache(maxsize=1)
def _matlab_loaded(path: Path, stamp: int) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Arrays by path, and variables that are objects of MATLAB's classes."""
    unpacked = Expansion(path)
    with _opened(path) as file:
        plain = {name: item for name, item in file.items() if not name.startswith("#")}
        objects = [name for name, item in plain.items() if _OBJECT in item.attrs]
        content = {name: _value(file, item, unpacked) for name, item in plain.items()}
    return grouped_by_run(leaves(content)), tuple(objects)


def _value(file: Any, item: Any, unpacked: Expansion) -> Any:
    """A MATLAB value: arrays with the axes as MATLAB has them, structs as dicts, cells and arrays of structs as lists, text as str."""
    if hasattr(item, "items"):
        fields = {name: _value(file, member, unpacked) for name, member in item.items()}
        lists = [v for v in fields.values() if isinstance(v, list)]
        # An array of structs is stored field by field.
        if fields and len(lists) == len(fields) and len({len(v) for v in lists}) == 1:
            return [dict(zip(fields, values, strict=True)) for values in zip(*fields.values(), strict=True)]
        return fields
    kind = item.attrs.get("MATLAB_class", b"")
    unpacked.add(item.size * item.dtype.itemsize)
    if item.dtype.kind == "O":
        return [_value(file, file[reference], unpacked) for reference in np.asarray(item[()]).reshape(-1)]
    if kind == b"char":
        return "".join(chr(int(c)) for c in np.asarray(item[()]).reshape(-1, order="F"))
    if _OBJECT in item.attrs or item.attrs.get("MATLAB_empty", 0) or item.size > _LARGEST or item.dtype.kind not in "fiub":
        return np.zeros(0)
    array = np.asarray(item[()])
    return array.T if array.ndim > 1 else array


HDF5 = register_log_format(LogFormat("HDF5", lambda path, start: start.startswith(_MAGIC), _read, _recordings, _chunks))
MATLAB = register_log_format(LogFormat("MATLAB 7.3", lambda path, start: start.startswith(_MATLAB), _read_matlab, _matlab_recordings))
