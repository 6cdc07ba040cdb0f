"""Singular values that are found wherever they exist: LAPACK's fast routine gives up on some matrices that its older one takes apart."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def svd(matrix: Array, full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """U, s, Vt of a finite matrix, as `numpy.linalg.svd`. Raises LinAlgError where a number is none.

    Examples
    --------
    >>> svd(np.diag([1.0, 3.0]))[1]
    array([3., 1.])
    """
    try:
        U, s, Vt = np.linalg.svd(matrix, full_matrices=full_matrices)
    except np.linalg.LinAlgError:  # of a matrix without full rank, as repeated or still columns make it
        if not np.isfinite(matrix).all():
            raise
        from scipy.linalg import svd as slower

        U, s, Vt = slower(matrix, full_matrices=full_matrices, lapack_driver="gesvd")
    return U, s, Vt


def singular_values(matrix: Array) -> Array:
    """The singular values of a finite matrix, the largest first."""
    try:
        return np.linalg.svd(matrix, compute_uv=False)
    except np.linalg.LinAlgError:
        return svd(matrix, full_matrices=False)[1]
