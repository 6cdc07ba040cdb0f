"""Reading MAT files: names in, columns out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import DataError
from ..units import split_unit
from .damage import reason

Array = np.ndarray


def mat_columns(path: Path) -> dict[str, Array]:
    """Columns of a MAT file: vectors by name; a matrix `q` of n columns as q1 … qn, `q_deg` as q1_deg …; structs by their fields."""
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise DataError(f"log {path}: is a MATLAB 7.3 file, which is not read. Save it with -v7 (save('log.mat', '-v7')).") from None
    except MemoryError:
        raise DataError(
            f"log {path}: asks for more memory than there is. Save fewer columns, or in parts; a damaged file may ask too."
        ) from None
    except Exception as error:  # noqa: BLE001 - whatever SciPy makes of a damaged file
        raise DataError(f"log {path}: is not a MAT file ({reason(error)}).") from None
    arrays: dict[str, Array] = {}
    for name, value in content.items():
        if name.startswith("__"):
            continue
        fields = value.items() if isinstance(value, dict) else [(name, value)]
        arrays.update({k: v for k, v in fields if isinstance(v, np.ndarray) and v.dtype.kind in "fiub" and v.ndim in (1, 2)})
    if not arrays:
        raise DataError(f"log {path}: holds no numeric variable.")
    rows = max(a.size if 1 in a.shape or a.ndim == 1 else max(a.shape) for a in arrays.values())
    if rows < 2:
        raise DataError(f"log {path}: holds no series of samples.")
    columns: dict[str, Array] = {}
    for name, array in arrays.items():
        if array.size == rows:
            columns[name] = array.reshape(-1)
        elif array.ndim == 2 and rows in array.shape:
            matrix = array if array.shape[0] == rows else array.T
            columns.update({_indexed(name, j + 1): matrix[:, j] for j in range(matrix.shape[1])})
    return columns


def _indexed(name: str, j: int) -> str:
    """`q_deg`, 3 → `q3_deg`."""
    stem, unit = split_unit(name)
    # The m of q_m or tau_m means the motor side, not metres.
    if unit == "m" and stem.lower() in ("q", "dq", "ddq", "tau"):
        return f"{name}{j}"
    return f"{stem}{j}" + (f"_{unit}" if unit else "")
