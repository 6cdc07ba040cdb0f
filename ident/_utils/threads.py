"""One thread for BLAS: ours are many small products, in which its threads do little but wait for each other.

On a machine whose other cores are busy that waiting took twenty times the work itself, and no less time alone. What has large arrays to
share among threads is compiled, and has threads of its own (IDENT_NUM_THREADS)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


@cache
def _blas() -> Any:
    """What sets the threads of NumPy's and SciPy's BLAS."""
    import scipy.linalg  # noqa: F401 - brings a BLAS of its own, which is found only once it is there
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """BLAS of this process has one thread meanwhile, and then as many as before."""
    with _blas().limit(limits=1):
        yield


def with_one_blas_thread(function: Callable[P, T]) -> Callable[P, T]:
    """The function, with one thread of BLAS while it runs."""

    @wraps(function)
    def alone(*given: P.args, **named: P.kwargs) -> T:
        with one_blas_thread():
            return function(*given, **named)

    return alone
