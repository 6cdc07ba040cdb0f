"""BLAS has one thread while we compute, and what it had before and after."""

from __future__ import annotations

import pytest
import scipy.linalg  # noqa: F401 - its BLAS is one of those that are counted
from threadpoolctl import ThreadpoolController

import ident
from ident._utils.threads import one_blas_thread, with_one_blas_thread


@pytest.fixture
def blas():
    """Threads of each BLAS of this process, which has two meanwhile."""
    controller = ThreadpoolController().select(user_api="blas")
    with controller.limit(limits=2):
        yield lambda: [one.num_threads for one in controller.lib_controllers]


def test_one_thread_meanwhile_and_two_again_after_an_error_too(blas) -> None:
    before = blas()
    if 2 not in before:
        pytest.skip("this BLAS has no threads to set")
    with one_blas_thread():
        assert set(blas()) == {1}
        with one_blas_thread():
            pass
        assert set(blas()) == {1}
    assert blas() == before

    @with_one_blas_thread
    def fails() -> None:
        assert set(blas()) == {1}
        raise ValueError("the end")

    with pytest.raises(ValueError, match="the end"):
        fails()
    assert blas() == before


def test_a_fit_has_one_and_leaves_two(blas, monkeypatch: pytest.MonkeyPatch) -> None:
    before = blas()
    if 2 not in before:
        pytest.skip("this BLAS has no threads to set")
    seen: list[set[int]] = []

    class Watching(ident.estimators.WeightedLeastSquares):
        def _solve(self, problem):
            seen.append(set(blas()))
            return super()._solve(problem)

    log, _ = ident.demo_logs()
    estimate = ident.fit(log, "puma560", method=Watching(), held=0)
    Watching().solve(estimate.problem)
    assert seen
    assert all(one == {1} for one in seen)
    assert blas() == before
