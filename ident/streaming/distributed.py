"""Streamed work on the workers of a Dask cluster: the same pieces, the same order, hence the same numbers.

    from dask.distributed import Client
    session = StreamedSession.of(study, out=folder, workers=DaskWorkers(Client(address)))

Every worker must see the logs and the scratch folder (`out`) under the same paths: a shared file system, beyond one machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import ConfigurationError, DataError, IdentError

if TYPE_CHECKING:
    from dask.distributed import Client

_T = TypeVar("_T")
_R = TypeVar("_R")


@dataclass(frozen=True)
class DaskWorkers:
    """The workers of a cluster. `retries`: how often a piece whose worker failed is given to another one."""

    client: Client
    retries: int = 2

    def __post_init__(self) -> None:
        if find_spec("distributed") is None:
            raise ConfigurationError("Dask is not installed: pip install 'ident[dask]'.")

    @property
    def threads(self) -> int:
        """A worker reads one file at a time."""
        return 1

    def map(self, work: Callable[[_T], _R], pieces: Sequence[_T]) -> Iterator[_R]:
        """`work` of every piece as one graph, results in order. Raises what it raises; DataError, naming the piece, where workers fail."""
        # What all pieces have in common travels once.
        shared = self.client.scatter(work, broadcast=True, hash=False)
        futures = [self.client.submit(_call, shared, piece, retries=self.retries, pure=False) for piece in pieces]
        try:
            for piece, future in zip(pieces, futures, strict=True):
                yield _result(future, piece)
                future.release()
        finally:
            self.client.cancel([f for f in futures if not f.done()])


def _call(work: Callable[[Any], Any], piece: Any) -> Any:
    return work(piece)


def _result(future: Any, piece: Any) -> Any:
    try:
        return future.result()
    except IdentError:
        raise
    except Exception as error:  # not narrower: a worker dies of anything (killed, connection lost, an error of its own); chained
        raise DataError(f"{_named(piece)}: the cluster's worker failed ({type(error).__name__}: {error}).") from error


def _named(piece: Any) -> str:
    """What a piece is of: its file."""
    path = getattr(piece, "path", None)
    run = getattr(piece, "run", None)
    if run is not None:
        return f"log {run.run.log.source}"
    return f"log {path}"
