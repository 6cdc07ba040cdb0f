"""Writing files so that nothing is half written, and nothing is lost without being asked."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import ConfigurationError


def write_atomic(path: Path, data: str | bytes, *, force: bool = False) -> Path:
    """Write a file completely or not at all. Raises ConfigurationError if it exists and `force` is false."""
    path = Path(path)
    try:
        if path.exists() and not force:
            raise ConfigurationError(
                f"{path} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True)."
            )
        if not path.parent.is_dir():
            raise ConfigurationError(f"{path.parent} is not a folder; nothing was written.")
        return _written(path, data.encode() if isinstance(data, str) else data)
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None


def _not_written(path: Path, error: Exception) -> ConfigurationError:
    """One line on what the system says: a full disk, a folder that is read-only, a name that is too long or holds a NUL."""
    reason = getattr(error, "strerror", None) or str(error)
    return ConfigurationError(f"{str(path)[:200]!r} cannot be written ({reason}); nothing was written.")


def _written(path: Path, data: bytes) -> Path:
    if path.is_dir():
        raise IsADirectoryError(21, "is a folder")
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:100]}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


@contextmanager
def staged(folder: Path, *, force: bool = False) -> Iterator[Path]:
    """A scratch folder beside `folder`; what is written there is moved into `folder` when all went well, and nothing otherwise.

    Raises ConfigurationError if a file would be overwritten and `force` is false, or if the folder cannot be made."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name[:100]}."))
    except (OSError, ValueError) as error:
        raise _not_written(folder, error) from None
    try:
        yield scratch
        made = sorted(p.relative_to(scratch) for p in scratch.rglob("*") if p.is_file())
        there = [p for p in made if (folder / p).exists()]
        if there and not force:
            raise ConfigurationError(
                f"{folder / there[0]} exists; nothing was written. Choose another folder, or allow overwriting (--force)."
            )
        try:
            for path in made:
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (scratch / path).replace(folder / path)
        except OSError as error:
            raise _not_written(folder, error) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def sha256(path: Path) -> str:
    """SHA-256 of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
