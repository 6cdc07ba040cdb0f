"""Files that a study names: patterns, and paths relative to its folder."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import DataError

if TYPE_CHECKING:
    pass


def from_folder(folder: Path, entry: str) -> str:
    """A path or pattern as a file in `folder` names it."""
    pattern = glob.has_magic(entry) and not (folder / entry).exists()
    return str(Path(glob.escape(str(folder)) if pattern else folder) / entry)


def relative(entry: str, folder: Path | None) -> str:
    """A path as it is written into a file in `folder`; as it is without one."""
    return entry if folder is None else os.path.relpath(os.path.abspath(entry), os.path.abspath(folder))


def expanded(entries: Iterable[str], key: str) -> tuple[Path, ...]:
    """The files that paths and patterns name, each once. Raises DataError for a pattern without a match, with the study's `key`."""
    return tuple(dict.fromkeys(all_files(entries, key)))


def all_files(entries: Iterable[str], key: str) -> list[Path]:
    """The same with files that are named several times."""
    found: list[Path] = []
    for entry in entries:
        if not glob.has_magic(entry) or Path(entry).exists():
            found.append(Path(entry))
            continue
        matches = sorted(Path(p) for p in glob.glob(entry, recursive=True))
        if not matches:
            raise DataError(f"{key}: no file matches {entry!r}.")
        found += matches
    return found
