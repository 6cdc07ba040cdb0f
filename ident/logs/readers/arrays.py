"""Files of arrays: NPZ, and Parquet whose columns hold lists of one length (LeRobot). Rows of zeros that were never filled are cut."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from .damage import reason

Array = np.ndarray


def npz_columns(path: Path) -> dict[str, Array]:
    """Columns of the arrays in an NPZ file: (N,) as they are named, (N, n) as `name[0]` … Raises DataError."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except MemoryError:
        raise DataError(f"log {path}: asks for more memory than there is. Save fewer arrays; a damaged file may ask too.") from None
    except Exception as error:  # noqa: BLE001 - whatever NumPy makes of a damaged file
        raise DataError(f"log {path}: is not a file of plain arrays ({reason(error)}).") from None
    numbers = {k: a for k, a in arrays.items() if a.dtype.kind in "fiub" and a.ndim in (1, 2)}
    if not numbers:
        raise DataError(f"log {path}: holds no array of numbers.")
    lengths = [len(a) for a in numbers.values()]
    rows = max(set(lengths), key=lengths.count)
    return _filled({k: a.astype(float) for k, a in numbers.items() if len(a) == rows})


def _filled(arrays: dict[str, Array]) -> dict[str, Array]:
    """Columns without the zeros at the end that a recorder allocated and never wrote."""
    any_value = np.any([np.any(a.reshape(len(a), -1) != 0, axis=1) for a in arrays.values()], axis=0)
    last = int(np.flatnonzero(any_value)[-1]) + 1 if any_value.any() else 0
    columns: dict[str, Array] = {}
    for name, a in arrays.items():
        if a.ndim == 1:
            columns[name] = a[:last]
        else:
            columns |= {f"{name}[{j}]": a[:last, j] for j in range(a.shape[1])}
    return columns


def list_columns(name: str, values: Any) -> dict[str, Array] | None:
    """Columns `name[0]` … of an Arrow column of lists of one length; None where they differ, or hold no numbers."""
    try:
        flat = np.asarray(values.combine_chunks().flatten(), float)
    except (TypeError, ValueError, AttributeError):
        return None
    rows = len(values)
    if rows == 0 or len(flat) % rows:
        return None
    table = flat.reshape(rows, -1)
    return {f"{name}[{j}]": table[:, j] for j in range(table.shape[1])}
