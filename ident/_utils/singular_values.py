"""Singular values, and what is made of them, wherever they exist: LAPACK's fast routine gives up on some matrices that its older one takes
apart."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
_EPS = float(np.finfo(float).eps)


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
    """The singular values of a finite matrix (..., M, N), the largest first."""
    try:
        return np.linalg.svd(matrix, compute_uv=False)
    except np.linalg.LinAlgError:
        if matrix.ndim > 2:
            return np.stack([singular_values(one) for one in matrix])
        return svd(matrix, full_matrices=False)[1]


def lstsq(A: Array, b: Array, rcond: float | None = None) -> Array:
    """The shortest x that makes ‖A x − b‖ least, as `numpy.linalg.lstsq`: singular values below `rcond` of the largest are none.

    Examples
    --------
    >>> lstsq(np.array([[2.0], [0.0]]), np.array([3.0, 1.0]))
    array([1.5])
    """
    try:
        return np.linalg.lstsq(A, b, rcond=rcond)[0]
    except np.linalg.LinAlgError:
        U, s, Vt = svd(A, full_matrices=False)
        kept = s > (_EPS * max(A.shape) if rcond is None else rcond) * s[0]
        return Vt[kept].T @ ((U[:, kept].T @ b).T / s[kept]).T


def pinv(matrix: Array, rcond: float = 1e-15, *, hermitian: bool = False) -> Array:
    """The pseudo-inverse of finite matrices (..., M, N), as `numpy.linalg.pinv`.

    Examples
    --------
    >>> pinv(np.diag([2.0, 0.0]))
    array([[0.5, 0. ],
           [0. , 0. ]])
    """
    try:
        return np.linalg.pinv(matrix, rcond=rcond, hermitian=hermitian)
    except np.linalg.LinAlgError:
        if matrix.ndim > 2:
            return np.stack([pinv(one, rcond) for one in matrix])
        U, s, Vt = svd(matrix, full_matrices=False)
        kept = s > rcond * s[0]
        return Vt[kept].T / s[kept] @ U[:, kept].T


def matrix_rank(matrix: Array, tol: float | None = None) -> Array:
    """The rank of finite matrices (..., M, N), as `numpy.linalg.matrix_rank`: how many singular values are above `tol`.

    Examples
    --------
    >>> int(matrix_rank(np.ones((3, 2))))
    1
    """
    try:
        return np.asarray(np.linalg.matrix_rank(matrix, tol=tol))
    except np.linalg.LinAlgError:
        s = singular_values(matrix)
        least = s.max(axis=-1, keepdims=True) * max(matrix.shape[-2:]) * _EPS if tol is None else tol
        return np.asarray(np.count_nonzero(s > least, axis=-1))


def condition(matrix: Array) -> float:
    """The largest singular value by the smallest; infinite for a matrix that is singular.

    Examples
    --------
    >>> condition(np.diag([1.0, 4.0]))
    4.0
    """
    s = singular_values(matrix)
    return float(s[0] / s[-1]) if s[-1] > 0 else np.inf
