"""What libraries raise for a file that is damaged: one list for all readers, and the first line of what they say."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib

#: Packed or binary content that ends too early, does not check, or is of another kind than it says.
DAMAGED: tuple[type[Exception], ...] = (EOFError, OSError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, struct.error)
#: Characters of another library's message that are shown.
_SHOWN = 160


def reason(error: BaseException) -> str:
    """The first line of what an error says, or its kind where it says nothing."""
    lines = str(error).strip().splitlines()
    text = "".join(c if c.isprintable() else "?" for c in lines[0]) if lines else type(error).__name__
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "…"
