"""Arrays that are handed to the kernels, checked: shapes, finite numbers, quaternions of length one."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ConfigurationError, DataError
from ..robots.tree import RigidBodyTree

Array = np.ndarray


def extra_columns(extra: Any, pattern: Any, shape: tuple[int, int]) -> tuple[Array, Array]:
    """Checked extra columns and their pattern; a full array of columns gets the pattern of those that are not zero."""
    if extra is None:
        return np.zeros((shape[0], 0)), np.zeros((shape[1], 0))
    extra = np.ascontiguousarray(extra, dtype=np.float64)
    if extra.ndim == 3 and extra.shape[:2] == shape:
        # Which columns are zero throughout is worth asking for many samples only; few at a time may have zeros by chance.
        live = np.any(extra != 0.0, axis=0) if shape[0] >= 256 else np.ones(extra.shape[1:])
        return extra, np.ascontiguousarray(live, dtype=np.float64)
    pattern = None if pattern is None else finite_numbers("pattern", pattern)
    if extra.ndim == 2 and len(extra) == shape[0] and pattern is not None and pattern.shape == (shape[1], extra.shape[1]):
        return extra, pattern
    given = "none" if pattern is None else str(pattern.shape)
    n, r = shape
    raise ConfigurationError(
        f"extra: expected shape ({n}, {r}, e), or ({n}, e) with pattern ({r}, e), but it is {extra.shape} with pattern {given}."
    )


def numbers(name: str, values: Any) -> Array:
    """`values` as contiguous float64."""
    return np.ascontiguousarray(values, dtype=np.float64)


def finite_numbers(name: str, values: Any) -> Array:
    """`values` as contiguous float64 without NaN or infinity."""
    array = numbers(name, values)
    # The sum is finite unless some entry is not (or the sum overflows): one pass, no boolean array.
    if array.size and not np.isfinite(array.sum()):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            where = ", ".join(str(int(i)) for i in bad[0])
            raise DataError(
                f"{name}: {len(bad)} value(s) are not finite, the first at [{where}] ({array[tuple(bad[0])]});"
                " leave these samples out or repair them first."
            )
    return array


def inertia_of(tree: RigidBodyTree, inertia: Any) -> Array:
    """Checked inertial parameters (10 nb,)."""
    array = finite_numbers("inertia", inertia)
    if array.shape != (10 * tree.nb,):
        raise ConfigurationError(f"inertia: expected shape ({10 * tree.nb},), ten per moving body, but it is {array.shape}.")
    return array


def added_inertia(tree: RigidBodyTree, added: Any) -> Array:
    """Checked symmetric matrix (nv, nv) that is added to the mass matrix; zeros for None."""
    nv = tree.nv
    array = np.zeros((nv, nv)) if added is None else finite_numbers("added", added)
    if array.shape != (nv, nv):
        raise ConfigurationError(f"added: expected shape ({nv}, {nv}), one row per velocity, but it is {array.shape}.")
    if not np.allclose(array, array.T, rtol=1e-12, atol=1e-12 * float(np.abs(array).max(initial=0.0))):
        raise ConfigurationError("added: must be symmetric (K^-T R K^-1 is), but it is not.")
    return array


def states(tree: RigidBodyTree, q: Any, *, finite: bool = True, **rates: Any) -> list[Array]:
    """Checked arrays of positions (N, nq) and of the rates or torques (N, nv) given by name; `finite`: their numbers too."""
    taken = finite_numbers if finite else numbers
    arrays = [taken("q", q)]
    if arrays[0].ndim != 2 or arrays[0].shape[1] != tree.nq:
        raise ConfigurationError(f"q: expected shape (N, {tree.nq}), samples by positions, but it is {arrays[0].shape}.")
    samples = len(arrays[0])
    for name, values in rates.items():
        array = taken(name, values)
        if array.shape != (samples, tree.nv):
            raise ConfigurationError(f"{name}: expected shape ({samples}, {tree.nv}), samples by velocities, but it is {array.shape}.")
        arrays.append(array)
    if tree.floating:
        norm = np.linalg.norm(arrays[0][:, 3:7], axis=1)
        if np.any(np.abs(norm - 1.0) > 1e-3):  # NaN passes, and is refused as such
            worst = int(np.argmax(np.abs(norm - 1.0)))
            raise DataError(f"q: the quaternion (columns 3 to 6, x y z w) of sample {worst} has length {norm[worst]:.6g} instead of 1.")
    return arrays
