"""Singular values of matrices on which LAPACK's fast routine gives up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ident
from ident._utils.singular_values import singular_values, svd


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
