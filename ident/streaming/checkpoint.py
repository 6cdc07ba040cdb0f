"""Where streamed work is kept until it is done, and what must be the same for it to be taken up again."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .._utils.files import remove_folder, staged, write_atomic
from .._utils.structured import read_json
from .._utils.version import __version__
from ..errors import ConfigurationError, DataError

#: Name of the folder of unfinished work inside the folder of results.
NAME = "checkpoint"
_HEAD = 1 << 20
_KEY = "key.json"


def key_of(files: Iterable[Path], settings: dict[str, Any]) -> dict[str, Any]:
    """What a piece of work depends on: every file (path, size, time of change, digest of its beginning), the settings, and the version."""
    return {"ident_version": __version__, "settings": settings, "files": [_file_key(path) for path in files]}


def _file_key(path: Path) -> dict[str, Any]:
    try:
        status = path.stat()
        with path.open("rb") as file:
            head = hashlib.sha256(file.read(_HEAD)).hexdigest()
    except OSError as error:
        return {"path": str(path), "error": str(error.strerror)}
    return {"path": str(path), "size": status.st_size, "changed_ns": status.st_mtime_ns, "head": head}


@dataclass(frozen=True)
class Checkpoint:
    """A folder for the work of one command. `lasting`: it stays if the process dies, so that the work can be taken up again."""

    folder: Path
    lasting: bool

    @classmethod
    def scratch(cls) -> Checkpoint:
        """A folder among the system's temporary ones (TMPDIR)."""
        return cls(Path(tempfile.mkdtemp(prefix="ident-")), False)

    @classmethod
    def beside(cls, results: Path, key: dict[str, Any], *, resume: bool, force: bool = False) -> Checkpoint:
        """The folder of unfinished work in a folder of results: new, or with `resume` the one that is there.

        Raises ConfigurationError where there is one and nobody asked for it (`force` throws it away), or where it is of other work."""
        folder = results / NAME
        record = folder / _KEY
        if not folder.exists() or not any(folder.iterdir()):
            with staged(folder) as scratch:  # with its key, or not at all
                write_atomic(scratch / _KEY, json.dumps(key, indent=1))
            return cls(folder, True)
        if not record.exists():
            raise ConfigurationError(f"{folder} exists, but is no checkpoint of ident; nothing was written. Choose another --out.")
        if not resume:
            if not force:
                raise ConfigurationError(f"{folder} holds unfinished work; continue it (--resume), or discard it (--force).")
            remove_folder(folder)
            return cls.beside(results, key, resume=False)
        found = read_json(record, "checkpoint")
        if not isinstance(found, dict) or not isinstance(found.get("settings"), dict) or not isinstance(found.get("files"), list):
            raise ConfigurationError(f"{record} is damaged; nothing was touched. Discard the unfinished work (--force).")
        changed = _changed(found, json.loads(json.dumps(key)))
        if changed:
            raise ConfigurationError(
                f"{folder} belongs to other work: {changed}; nothing was touched. Start again with another --out, or discard it (--force)."
            )
        return cls(folder, True)

    def part(self, name: str) -> Path:
        """A folder in it."""
        path = self.folder / name
        path.mkdir(parents=True, exist_ok=True)
        return path

    def require_space(self, needed: int) -> None:
        """Raises DataError unless so many bytes are free where the folder lies (what it holds already counts as free)."""
        held = sum(f.stat().st_size for f in self.folder.rglob("*") if f.is_file())
        free = shutil.disk_usage(self.folder).free + held
        if free < needed:
            raise DataError(
                f"{self.folder}: {free / 1e9:.1f} GB are free, but streaming these logs may need {needed / 1e9:.1f} GB of scratch space."
                " Free some, or put it elsewhere (--out on another disk, or TMPDIR)."
            )

    def remove(self) -> None:
        """The work is done."""
        with suppress(OSError):
            remove_folder(self.folder)


def _changed(old: dict[str, Any], new: dict[str, Any]) -> str:
    """The first difference between two keys, in words; "" if there is none."""
    if old.get("ident_version") != new["ident_version"]:
        return f"it was begun by ident {old.get('ident_version')}"
    for before, now in zip(old.get("files", []), new["files"], strict=False):
        if before != now:
            return (
                f"log {before.get('path')} was a different file, or has changed since"
                if before.get("path") == now["path"]
                else "other logs were named"
            )
    if len(old.get("files", [])) != len(new["files"]):
        return "other logs were named"
    settings = {k for k in {*old["settings"], *new["settings"]} if old["settings"].get(k) != new["settings"].get(k)}
    return f"its settings differ ({', '.join(sorted(settings))})" if settings else ""
