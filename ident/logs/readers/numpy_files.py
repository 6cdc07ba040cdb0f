"""NumPy's files: arrays by name (NPZ), of one recording or several, and a single table (NPY)."""

from __future__ import annotations

import io
import struct
import zipfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError, UnsupportedError
from .arrays import ArrayTable, columns_of
from .damage import damage_told
from .packed import Expansion
from .runs import grouped_by_run, of_one_run, run_name, runs_of
from .stored import Chunked, LogFormat, Stored, register_log_format, split_inside

Array = np.ndarray
_NO_ARRAYS = "is not a file of plain arrays"
#: Objects named in a message.
_SHOWN = 6


def _read_npz(path: Path) -> Stored:
    outer, inside = split_inside(path)
    arrays, objects = _loaded(outer, outer.stat().st_mtime_ns)
    if objects and not any(a.dtype.kind in "fiu" for a in arrays.values()):
        raise DataError(f"log {path}: holds Python objects ({', '.join(objects[:_SHOWN])}), which may run code; save plain arrays.")
    stored = columns_of(of_one_run(arrays, outer, inside), f"log {path}")
    left = [f"log {path}: {', '.join(objects[:_SHOWN])} hold Python objects, which may run code, and are not read."] if objects else []
    return replace(stored, notes=(*stored.notes, *left))


@lru_cache(maxsize=1)
def _loaded(path: Path, stamp: int) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Arrays by name (`run1.q` for `run1_q`), and the names of those that are Python objects."""
    unpacked = Expansion(path)
    with damage_told(path, _NO_ARRAYS):
        with zipfile.ZipFile(path) as members:
            for member in members.infolist():
                unpacked.add(member.file_size)
        with np.load(path, allow_pickle=False) as content:
            arrays, objects = dict[str, Array](), list[str]()
            for name in content.files:
                try:
                    arrays[name] = content[name]
                except ValueError as error:
                    if "pickle" not in str(error):
                        raise
                    objects.append(name)
    return grouped_by_run(arrays), tuple(objects)


def _recordings(path: Path) -> tuple[str, ...]:
    return tuple(map(run_name, runs_of(_loaded(path, path.stat().st_mtime_ns)[0])))


def _mapped(path: Path) -> dict[str, Array]:
    """The arrays of an NPZ file that is not packed, mapped into memory. Raises UnsupportedError for one that is."""
    out: dict[str, Array] = {}
    with zipfile.ZipFile(path) as members, path.open("rb") as file:
        if (bad := members.testzip()) is not None:  # what is mapped is not checked on the way
            raise DataError(f"log {path}: {_NO_ARRAYS} (Bad CRC-32 for file {bad!r}).")
        for member in members.infolist():
            if member.compress_type != zipfile.ZIP_STORED:
                raise UnsupportedError(
                    f"log {path}: compressed arrays cannot be streamed: read them into memory (--no-stream), or save them with numpy.savez."
                )
            file.seek(member.header_offset)
            name, extra = struct.unpack("<HH", file.read(30)[26:30])
            file.seek(name + extra, 1)
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, fortran, dtype = read(file)
            if dtype.kind in "US" and len(shape) == 1:
                with members.open(member) as text:
                    out[member.filename.removesuffix(".npy")] = np.load(io.BytesIO(text.read()), allow_pickle=False)
            elif dtype.kind in "fiu" and not shape:
                with members.open(member) as number:
                    out[member.filename.removesuffix(".npy")] = np.load(io.BytesIO(number.read()), allow_pickle=False)
            elif dtype.kind in "fiub" and shape and 0 not in shape:
                order: Any = "F" if fortran else "C"
                out[member.filename.removesuffix(".npy")] = np.memmap(path, dtype, "r", file.tell(), shape, order)
    return out


def _npz_chunks(path: Path) -> Chunked:
    outer, inside = split_inside(path)
    with damage_told(outer, _NO_ARRAYS):
        table = ArrayTable.of(of_one_run(grouped_by_run(_mapped(outer)), outer, inside), f"log {path}")
    return Chunked(tuple(table.places), table.chunks, table.sample, table.rows, notes=table.notes(f"log {path}"), constants=table.constants)


NPZ = register_log_format(LogFormat("NumPy arrays", lambda path, start: path.suffix.lower() == ".npz", _read_npz, _recordings, _npz_chunks))


def _read_npy(path: Path) -> Stored:
    unpacked = Expansion(path)
    with damage_told(path, _NO_ARRAYS):
        unpacked.add(path.stat().st_size)
        table = np.load(path, allow_pickle=False)
    if table.dtype.names:
        return columns_of({name: table[name] for name in table.dtype.names}, f"log {path}")
    if table.ndim != 2 or table.dtype.kind not in "fiub":
        raise DataError(f"log {path}: holds an array {table.shape} of {table.dtype}, which is not a table of samples.")
    return Stored({f"#{k}": column for k, column in enumerate((table if table.shape[0] >= table.shape[1] else table.T).T.astype(float))})


NPY = register_log_format(LogFormat("a NumPy array", lambda path, start: start.startswith(b"\x93NUMPY"), _read_npy))
