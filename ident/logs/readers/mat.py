"""MAT files up to version 7: vectors and matrices by name, structs by their fields, Simulink signals by their labels."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...errors import DataError
from ..units import bracketed, split_unit
from .arrays import columns_of, leaves, shortest
from .damage import damage_told
from .mat_structure import check_structure
from .packed import Expansion
from .runs import grouped_by_run, of_one_run, run_name, runs_of
from .stored import LogFormat, Stored, register_log_format, split_inside

Array = np.ndarray
_SYMBOLS = ("q", "dq", "ddq", "tau")
_HDF5 = b"MATLAB 7.3"
#: Of MATLAB 5 to 7: bytes of the head, the type of a packed element, how many times its size zlib can unpack, and bytes unpacked at a time.
_HEAD, _PACKED, _ZLIB, _PIECE = 128, 15, 1032, 1 << 20


def _read(path: Path) -> Stored:
    outer, _ = split_inside(path)
    arrays, objects = _loaded(outer, outer.stat().st_mtime_ns)
    return matlab_columns(arrays, path, objects)


@lru_cache(maxsize=1)
def _loaded(path: Path, stamp: int) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Arrays by path, and variables that are objects of MATLAB's classes."""
    from scipy.io import loadmat

    with damage_told(path, "is not a MAT file"):
        _bound(path)
        check_structure(path)
        content = loadmat(path, simplify_cells=True)
    plain = {name: value for name, value in content.items() if not str(name).startswith("__") and name != "None"}
    return grouped_by_run(leaves(plain)), ("one",) if "None" in content else ()


def _recordings(path: Path) -> tuple[str, ...]:
    return tuple(map(run_name, runs_of(_loaded(path, path.stat().st_mtime_ns)[0])))


def _bound(path: Path) -> None:
    """Unpack what is packed, keeping none of it, to count its bytes. Raises DataError for more than a log may have."""
    unpacked = Expansion(path)
    size = path.stat().st_size
    if _ZLIB * size <= unpacked.most:
        return
    with path.open("rb") as file:
        order = "<" if file.read(_HEAD)[-2:] == b"IM" else ">"
        while len(head := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", head)
            end = file.tell() + length
            if kind == _PACKED:
                stream = zlib.decompressobj()
                while not stream.eof and (rest := stream.unconsumed_tail or file.read(min(_PIECE, end - file.tell()))):
                    unpacked.add(len(stream.decompress(rest, _PIECE)))
            file.seek(end)


def matlab_columns(arrays: dict[str, Array], path: Path, objects: Sequence[str] = ()) -> Stored:
    """Columns of MATLAB's arrays: of a matrix `q` of n columns q1 … qn, of `q_deg` q1_deg …; units from labels such as `q_meas [deg]`.
    Of a path that goes on inside the file (`runs(2)`), those of that recording. `objects`: variables that are objects of MATLAB's classes,
    which only MATLAB can read. Raises DataError."""
    outer, inside = split_inside(path)
    arrays = {name: a.squeeze() if a.ndim > 2 else a for name, a in of_one_run(arrays, outer, inside).items()}  # Simulink's (n, 1, N)
    numeric = {name: a for name, a in arrays.items() if a.dtype.kind in "fiub" and a.ndim in (1, 2)}
    what = "it holds MATLAB objects (timeseries, timetable, Dataset), which only MATLAB can read: save their Time and Data as arrays"
    if not any(max(a.shape, default=0) > 1 for a in numeric.values()):
        raise DataError(f"log {path}: holds no numeric variable{f'; {what}' if objects else ''}.")
    bare: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, a in shortest(numeric).items():
        stem, unit = bracketed(name)
        told = bool(unit) and not unit.isdecimal() and " " in name
        bare[stem if told else name] = a
        if told:
            units[stem] = unit
    others = {name: a for name, a in arrays.items() if a.dtype.kind in "US" or (a.dtype.kind in "fiu" and a.ndim == 0)}
    stored = columns_of(bare | others, f"log {path}", _indexed, units)
    return replace(stored, notes=(*stored.notes, *([f"log {path}: {what}."] if objects else [])))


def _indexed(name: str, k: int) -> str:
    """`q_deg`, 2 → `q3_deg`: MATLAB counts from one."""
    stem, unit = split_unit(name)
    # The m of q_m or tau_m means the motor side, not metres; the s of deg_per_s is half a unit.
    if (unit == "m" and stem.lower() in _SYMBOLS) or stem.endswith("_per"):
        return f"{name}{k + 1}"
    return f"{stem}{k + 1}" + (f"_{unit}" if unit else "")


def _is_one(path: Path, start: bytes) -> bool:
    return split_inside(path)[0].suffix.lower() == ".mat" and not start.startswith(_HDF5)


MAT = register_log_format(LogFormat("MATLAB", _is_one, _read, _recordings))
