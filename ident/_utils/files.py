"""Writing files so that nothing is half written, nothing mixed, and nothing is lost without being asked.

What is being written lies beside its target, hidden, under a name that tells who writes it. A process that is killed leaves it there;
the next one that writes to the same target removes it."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import ConfigurationError

#: What stands in the name of a file or folder that is being written, before the host and the process.
_MARK = ".ident-"
#: Bytes of the target's name in that of what is being written.
_NAME = 100
#: Arguments of Linux' renameat2: paths as they are, and to exchange them.
_HERE, _EXCHANGE = -100, 2

_LOG = logging.getLogger(__name__)


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
        written = _written(path, data.encode() if isinstance(data, str) else data, force=force)
        _LOG.info("wrote %s", path)
        return written
    except ConfigurationError:
        raise
    except (OSError, ValueError) as error:
        raise _not_written(path, error) from None


def _not_written(path: Path, error: Exception) -> ConfigurationError:
    """One line on what the system says: a full disk, a folder that is read-only, a name that is too long or holds a NUL."""
    reason = getattr(error, "strerror", None) or str(error)
    return ConfigurationError(f"{str(path)[:200]!r} cannot be written ({reason}); nothing was written.")


def _written(path: Path, data: bytes, *, force: bool) -> Path:
    if path.is_dir():
        raise IsADirectoryError(21, "is a folder")
    remove_leftovers(path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=_prefix(path))
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o666 & ~_umask())
        if force:
            Path(temporary).replace(path)
        else:
            _place_new(Path(temporary), path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    _settle(path.parent)
    return path


def _place_new(temporary: Path, path: Path) -> None:
    """Give a file its name, unless another process took it meanwhile."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise ConfigurationError(f"{path} exists (another process wrote it meanwhile); nothing was written.") from None
    except OSError:  # a file system without links
        temporary.replace(path)
        return
    temporary.unlink()


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


@contextmanager
def staged(folder: Path, *, force: bool = False) -> Iterator[Path]:
    """A scratch folder beside `folder`; what is written there appears in `folder` all at once when all went well, and nothing otherwise.

    What `folder` held beside the new files stays. Raises ConfigurationError if a file would be overwritten and `force` is false, or if
    the folder cannot be made."""
    try:
        folder = folder.resolve()
        scratch = _scratch(folder)
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
        if made:
            try:
                _appear(scratch, folder, made)
            except OSError as error:
                raise _not_written(folder, error) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _scratch(folder: Path) -> Path:
    """A hidden folder beside another; in it, where one can write there alone (a mount, a parent that is read-only)."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    mounted = folder.is_dir() and folder.stat().st_dev != folder.parent.stat().st_dev
    remove_leftovers(folder)
    if not mounted:
        try:
            return Path(tempfile.mkdtemp(dir=folder.parent, prefix=_prefix(folder)))
        except OSError:
            if not folder.is_dir():
                raise
    remove_leftovers(folder / folder.name)
    return Path(tempfile.mkdtemp(dir=folder, prefix=_prefix(folder)))


def _appear(scratch: Path, folder: Path, made: list[Path]) -> None:
    """Put a finished folder in the place of another, of which everything else is kept: one step of the file system.

    File by file where this process stands in that folder (it would be left in one that is gone), or the system has no such step."""
    if folder.is_dir():
        shutil.copymode(folder, scratch)
    else:
        scratch.chmod(0o777 & ~_umask())
    for path in (scratch, *(p for p in scratch.rglob("*") if p.is_dir())):
        _settle(path)
    movable = scratch.parent == folder.parent and folder not in (Path.cwd(), *Path.cwd().parents)
    if movable and (not folder.exists() or not any(folder.iterdir())):
        scratch.rename(folder)  # fails where another process put something there meanwhile
    elif not (movable and _keep_others(folder, scratch) and _exchanged(scratch, folder)):
        for path in made:
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (scratch / path).replace(folder / path)
    _settle(folder.parent)


def _keep_others(folder: Path, scratch: Path) -> bool:
    """Put what lies in `folder` and is not made anew into `scratch` too: the same files, not copies. False where that cannot be done."""
    for path in sorted(folder.rglob("*")):
        beside = scratch / path.relative_to(folder)
        if beside.exists() or beside.is_symlink():
            continue
        if path.is_symlink():
            beside.symlink_to(path.readlink())
        elif path.is_dir():
            beside.mkdir()
            shutil.copystat(path, beside)
        else:
            try:
                os.link(path, beside)
            except OSError:
                return False
    return True


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; False where the system cannot."""
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    return bool(call(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0)


def remove_folder(folder: Path) -> None:
    """Remove a folder, which is gone at once: a process that is killed meanwhile leaves what the next one takes for left behind."""
    aside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=_prefix(folder)))
    folder.rename(aside)  # an empty folder may be replaced
    shutil.rmtree(aside, ignore_errors=True)


def _settle(folder: Path) -> None:
    """Ask the disk to remember the names in a folder."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _prefix(path: Path) -> str:
    return f"{_start(path)}{os.getpid()}-"


def _start(path: Path) -> str:
    """How names of what this host writes to a target begin; a name may be as long as the file system allows, in bytes."""
    host = hashlib.sha256(socket.gethostname().encode()).hexdigest()[:8]
    return f".{os.fsencode(path.name)[:_NAME].decode(errors='ignore')}{_MARK}{host}-"


def remove_leftovers(path: Path) -> None:
    """Remove what processes of this host that are no more left beside a target while they wrote it."""
    start = _start(path)
    try:
        found = [p for p in path.parent.iterdir() if p.name.startswith(start)]
    except OSError:
        return
    for left in found:
        writer = left.name[len(start) :].split("-")[0]
        if not writer.isdecimal() or _lives(int(writer)):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            with suppress(OSError):
                left.unlink()


def remove_all_leftovers(folder: Path) -> None:
    """The same for whatever lies in a folder: what was written there, whichever command was cut off."""
    for left in list(folder.iterdir()) if folder.is_dir() else []:
        target, mark, _ = left.name.rpartition(_MARK)
        if mark and target.startswith("."):
            remove_leftovers(folder / target[1:])


def _lives(process: int) -> bool:
    if os.name == "nt":  # there, the signal 0 would end the process
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def sha256(path: Path) -> str:
    """SHA-256 of a file, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()
