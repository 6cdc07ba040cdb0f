"""Lines of a text that are no rows of its table: comments between them, the header again, a last row that was never finished."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import IO

from .header import MISSING, Header, is_number

_MARKS = ("#", "//", "% ")


def without_strangers(stream: IO[bytes], header: Header, path: Path) -> tuple[bytes, tuple[str, ...]] | None:
    """The lines behind the header that are rows, and what is said of the others; None where there are no others."""
    lines = stream.readlines()
    kept, comments, again, cut = list[bytes](), 0, 0, 0
    for k, line in enumerate(lines):
        text = line.decode(header.encoding, "replace").strip()
        last = k == len(lines) - 1 and not line.endswith((b"\n", b"\r"))
        if text.startswith(_MARKS):
            comments += 1
        elif text and not text[0].isdigit() and _fields(text, header) in (header.names, header.units):
            again += 1
        elif last and text and not _whole(_fields(text, header), header):
            cut = header.line + k + 1
        else:
            kept.append(line)
    notes = [f"log {path}: {comments} comments between the rows are left out."] if comments else []
    notes += [f"log {path}: the header stands {again} times more between the rows."] if again else []
    notes += [f"log {path}: line {cut}, the last, ends in the middle of a row, and is left out."] if cut else []
    return (b"".join(kept), tuple(notes)) if notes else None


def _fields(text: str, header: Header) -> tuple[str, ...]:
    if header.delimiter == " ":
        return tuple(text.split())
    return tuple(x.strip() for x in next(csv.reader([text], delimiter=header.delimiter), []))


def _whole(fields: tuple[str, ...], header: Header) -> bool:
    """Whether a row has all its fields, and the last of them is a number (or what stands for none)."""
    return len(fields) == len(header.names) and (
        fields[-1].lower() in MISSING or is_number(fields[-1].replace(header.decimal, ".")) or not any(c.isdigit() for c in fields[-1])
    )
