"""Singular values of matrices on which LAPACK's fast routine gives up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ident
from ident._utils.singular_values import condition, lstsq, matrix_rank, pinv, singular_values, svd


def _gives_up(*_: Any, **__: Any) -> Any:
    raise np.linalg.LinAlgError("SVD did not converge")


def test_the_older_routine_takes_over(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(40, 3)) @ rng.normal(size=(3, 6))
    sizes = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix.T @ matrix)[::-1], 0.0))
    monkeypatch.setattr(np.linalg, "svd", _gives_up)
    U, s, Vt = svd(matrix, full_matrices=False)
    np.testing.assert_allclose(s[:3], sizes[:3], rtol=1e-9)
    np.testing.assert_allclose(U * s @ Vt, matrix, atol=1e-12)
    np.testing.assert_allclose(singular_values(matrix), s, atol=1e-12)


def test_numbers_that_are_none_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(np.linalg, "svd", _gives_up)
    with pytest.raises(np.linalg.LinAlgError):
        svd(np.array([[1.0, np.nan]]))


def test_an_audit_does_not_end_where_the_fast_routine_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """One log in two thousand once ended `ident fit` with a fault of ours."""
    log = ident.demo_logs()[0]
    expected = [str(f) for f in ident.audit(log, ident.load_robot("puma560")).findings]
    monkeypatch.setattr(np.linalg, "svd", _gives_up)
    assert [str(f) for f in ident.audit(log, ident.load_robot("puma560")).findings] == expected


def test_what_is_made_of_singular_values_is_found_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a matrix of rank 3, alone and in a stack: as numpy's own, which gives up."""
    rng = np.random.default_rng(1)
    A, b = rng.normal(size=(9, 3)) @ rng.normal(size=(3, 5)), rng.normal(size=(9, 2))
    stack = np.stack([A, np.outer(A[:, 0], A[0])])
    made = {"lstsq": lambda: lstsq(A, b, rcond=1e-9), "pinv": lambda: pinv(A, 1e-9), "matrix_rank": lambda: matrix_rank(stack)}
    made |= {"several": lambda: pinv(stack, 1e-9), "one": lambda: lstsq(A, b[:, 0], rcond=1e-9), "tol": lambda: matrix_rank(A, tol=1e-9)}
    expected = {name: work() for name, work in made.items()}
    np.testing.assert_array_equal(expected["matrix_rank"], [3, 1])
    np.testing.assert_allclose(A.T @ (A @ expected["lstsq"] - b), 0.0, atol=1e-12)
    for name in ("svd", "lstsq", "pinv", "matrix_rank"):
        monkeypatch.setattr(np.linalg, name, _gives_up)
    for name, work in made.items():
        np.testing.assert_allclose(work(), expected[name], atol=1e-12, err_msg=name)
    assert condition(np.diag([1.0, 4.0])) == 4.0
    assert condition(np.zeros((2, 2))) == np.inf
