"""Writing files so that nothing is half written, and nothing is lost without being asked."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

from .errors import ConfigurationError


def write_atomic(path: Path, data: str | bytes, *, force: bool = False) -> Path:
    """Write a file completely or not at all. Raises ConfigurationError if it exists and `force` is false."""
    path = Path(path)
    if path.exists() and not force:
        raise ConfigurationError(f"{path} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True).")
    if not path.parent.is_dir():
        raise ConfigurationError(f"{path.parent} is not a folder; nothing was written.")
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
        umask = os.umask(0)
        os.umask(umask)
        Path(temporary).chmod(0o666 & ~umask)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def sha256(path: Path) -> str:
    """SHA-256 of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
