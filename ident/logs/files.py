"""Which files hold the logs that were asked for: patterns, folders, recordings inside a file, and pairs of files of one run."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import DataError
from .readers.stored import split_inside
from .readers.tables import recordings_in
from .readers.topics import is_bag
from .words import DESIRED, MEASURED, words_of

_SUFFIXES = {
    ".csv",
    ".txt",
    ".tsv",
    ".dat",
    ".parquet",
    ".pq",
    ".arrow",
    ".feather",
    ".mat",
    ".npz",
    ".bag",
    ".mcap",
    ".db3",
    ".hdf5",
    ".h5",
    ".jsonl",
    ".json",
    ".xml",
}
_PACKED = {".gz", ".bz2", ".xz", ".zst"}


@dataclass(frozen=True)
class LogFile:
    """A log's file (or a recording inside it), and the file beside it that holds what was desired in the same run, if there is one."""

    path: Path
    desired: Path | None = None


def log_files(paths: str | Path | Sequence[str | Path]) -> list[LogFile]:
    """Files of names, patterns and folders. Raises DataError where there are none."""
    try:
        return _expanded([paths] if isinstance(paths, (str, Path)) else paths)
    except (OSError, ValueError) as error:  # a name that is too long, or holds a NUL
        if isinstance(error, DataError):
            raise
        raise DataError(f"log: not a valid file name ({getattr(error, 'strerror', None) or error}).") from None


def _expanded(paths: Sequence[str | Path]) -> list[LogFile]:
    out: list[LogFile] = []
    for entry in paths:
        text = str(entry)
        if any(c in text for c in "*?[") and not Path(text).exists():
            found = sorted(glob.glob(text, recursive=True))
            if not found:
                raise DataError(f"log {text}: no file matches.")
            out += [LogFile(inside) for f in found for inside in recordings_in(Path(f))]
        elif Path(text).is_dir() and not is_bag(Path(text)):
            out += _in_folder(Path(text))
        else:
            out += [LogFile(inside) for inside in recordings_in(Path(text))]
    if not out:
        raise DataError("no log file was given.")
    return out


def _in_folder(folder: Path) -> list[LogFile]:
    """The logs of a folder: a data set's episodes (LeRobot: data/chunk-*/*.parquet), or what it holds directly."""
    episodes = sorted(folder.glob("data/**/*.parquet"))
    if episodes:
        return [LogFile(path) for path in episodes]
    files = sorted(p for p in folder.iterdir() if p.is_file() and _kind(p) in _SUFFIXES and not p.name.startswith("."))
    bags = sorted(p for p in folder.iterdir() if p.is_dir() and is_bag(p))
    return [f for pair in _pairs(files) for f in _inside(pair)] + [LogFile(p) for p in bags] or [LogFile(folder)]


def _inside(found: LogFile) -> list[LogFile]:
    inside = recordings_in(found.path)
    return [found] if len(inside) == 1 else [LogFile(path) for path in inside]


def _kind(path: Path) -> str:
    suffixes = [s.lower() for s in path.suffixes]
    return suffixes[-2] if len(suffixes) > 1 and suffixes[-1] in _PACKED else suffixes[-1] if suffixes else ""


def content_file(path: Path) -> Path:
    """The file that holds a log: of a path inside a file, that; of a ROS 2 bag's folder, its data."""
    outer, _ = split_inside(path)
    return next((p for p in sorted(outer.iterdir()) if p.suffix in (".db3", ".mcap")), outer) if outer.is_dir() else outer


def _pairs(files: Sequence[Path]) -> list[LogFile]:
    """Files whose names differ only in a word for desired and one for measured (or none) are one run."""
    desired = {(words_of(p.stem) - DESIRED, p.suffix): p for p in files if words_of(p.stem) & DESIRED}
    out = [LogFile(p, desired.get((words_of(p.stem) - MEASURED, p.suffix))) for p in files if p not in desired.values()]
    taken = {f.desired for f in out}
    return sorted((*out, *(LogFile(p) for p in desired.values() if p not in taken)), key=lambda f: f.path)
