"""Files that are read as a whole: what a reader of such a format gives, and the register of formats, which a plug-in may extend."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .damage import DAMAGED
from .packed import open_binary

Array = np.ndarray
#: Bytes (unpacked) at the beginning of a file by which formats are told.
_START = 512


@dataclass(frozen=True)
class Stored:
    """What a file holds: `columns` by name → (N,), all of one length; `units` of those that have one; `notes` on what was left out;
    `constants`: single numbers beside them, by name.

    Columns of an array are named `name[0]`, `name[1]` …, or `name[joint]` where the file names its joints.

    Examples
    --------
    >>> import numpy as np
    >>> from ident.logs import Stored
    >>> Stored({"t": np.arange(3.0), "angle[elbow]": np.zeros(3)}, {"angle[elbow]": "deg"}).names
    ('t', 'angle[elbow]')
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.columns)


@dataclass(frozen=True, eq=False)
class Chunked:
    """A file whose columns can be read in chunks, in memory that does not grow with it; all of them are what `LogFormat.read` gives.

    `names`, `units` and `constants` as in `Stored`; `read`: (names, first row) → chunks of columns, in order; `sample`: names → rows from
    all over the file, by which columns are recognised (all of a file that is not long); `rows`: how many there are, 0 where that is not
    known; `notes` on what was left out."""

    names: tuple[str, ...]
    read: Callable[[Sequence[str], int], Iterator[dict[str, Array]]]
    sample: Callable[[Sequence[str]], dict[str, Array]]
    rows: int = 0
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)


def _one(path: Path) -> Sequence[str]:
    return ()


@dataclass(frozen=True)
class LogFormat:
    """A kind of file that holds logs.

    Parameters
    ----------
    name : str
        What people call it.
    recognises : callable
        (path, first bytes) → whether a file, or a folder (no bytes), is one.
    read : callable
        path → `Stored`. Raises DataError for a file that cannot be used.
    recordings : callable, optional
        path → names of the recordings in a file that holds several; each is then read as `path/name`.
    chunks : callable, optional
        path → `Chunked`, for files that `--stream` can read in chunks.

    Examples
    --------
    >>> from ident.logs import LogFormat, Stored
    >>> LogFormat("rig", lambda path, start: path.suffix == ".rig", lambda path: Stored({})).name
    'rig'
    """

    name: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Path], Stored]
    recordings: Callable[[Path], Sequence[str]] = _one
    chunks: Callable[[Path], Chunked] | None = None


_FORMATS: list[LogFormat] = []


def register_log_format(added: LogFormat) -> LogFormat:
    """Let `read_logs` and every command read one more format; it is asked before those that are there.

    Parameters
    ----------
    added : LogFormat
        One of the same name is replaced.

    Returns
    -------
    LogFormat
        The same.

    Examples
    --------
    >>> import numpy as np
    >>> from ident.logs import LogFormat, Stored, register_log_format
    >>> def read(path):
    ...     t, q, tau = np.fromfile(path).reshape(-1, 3).T
    ...     return Stored({"t": t, "q1": q, "tau1": tau})
    >>> added = register_log_format(LogFormat("our rig", lambda path, start: path.suffix == ".ourrig", read))
    """
    _FORMATS[:] = [added, *(known for known in _FORMATS if known.name != added.name)]
    return added


def format_of(path: Path) -> LogFormat | None:
    """The format of a file or folder that is read as a whole; None for tables of text, plain Parquet, and what is not there."""
    outer, _ = split_inside(path)
    start = b""
    if outer.is_file():
        try:
            with open_binary(outer) as stream:
                start = stream.read(_START)
        except DAMAGED:
            start = b""
    elif not outer.is_dir():
        return None
    return next((known for known in _FORMATS if known.recognises(outer, start)), None)


def split_inside(path: Path) -> tuple[Path, str]:
    """A path that goes on inside a file (`demo.hdf5/data/demo_1`): the file, and the rest; ("", for others)."""
    if path.exists():
        return path, ""
    for outer in path.parents:
        if outer.is_file():
            return outer, str(path.relative_to(outer))
    return path, ""
