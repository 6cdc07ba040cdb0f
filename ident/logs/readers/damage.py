"""What libraries raise for a file that is damaged: one list for all readers, and the first line of what they say."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...errors import DataError, IdentError

#: Packed or binary content that ends too early, does not check, or is of another kind than it says.
DAMAGED: tuple[type[Exception], ...] = (EOFError, OSError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, struct.error)
#: Characters of another library's message that are shown.
_SHOWN = 160


def reason(error: BaseException) -> str:
    """The first line of what an error says, or its kind where it says nothing."""
    lines = str(error).strip().splitlines()
    text = "".join(c if c.isprintable() else "?" for c in lines[0]) if lines else type(error).__name__
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "…"


@contextmanager
def damage_told(path: Path, what: str) -> Iterator[None]:
    """Whatever another library makes of a file meanwhile is a DataError: on a damaged file it raises what it likes, at any access.

    `what` is said of the file ("is not a MAT file")."""
    try:
        yield
    except IdentError:
        raise
    except MemoryError:
        raise DataError(
            f"log {path}: needs more memory than there is. Save fewer columns, or several files; a damaged file may also cause this."
        ) from None
    except Exception as error:  # noqa: BLE001 - see above
        raise DataError(f"log {path}: {what} ({reason(error)}).") from None
