"""Lines of a text that are no rows of its table: comments between them, the header again, a last row that was never finished."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO

from .header import MISSING, Header, is_number

#: What begins a comment.
MARKS = ("#", "//", "% ")


@dataclass(frozen=True)
class Strangers:
    """How many lines were left out: comments, headers that stand again, and a last row that ends in its middle."""

    comments: int = 0
    headers: int = 0
    cut: int = 0

    def __add__(self, other: Strangers) -> Strangers:
        return Strangers(self.comments + other.comments, self.headers + other.headers, self.cut + other.cut)

    def __bool__(self) -> bool:
        return bool(self.comments or self.headers or self.cut)

    def notes(self, where: str) -> list[str]:
        """What to say of them."""
        notes = [f"{where}: comments between the rows ({self.comments}) are left out."] if self.comments else []
        notes += (
            [f"{where}: the header is repeated between the rows ({self.headers}×); the repetitions are left out."] if self.headers else []
        )
        return notes + ([f"{where}: the last line is an incomplete row, and is left out."] if self.cut else [])


def without_strangers(stream: IO[bytes], header: Header) -> tuple[bytes, Strangers]:
    """A text behind its header in which lines that are no rows are blank, and which such there were."""
    lines = stream.readlines()
    kept, comments, again, cut = list[bytes](), 0, 0, 0
    for k, line in enumerate(lines):
        kept.append(b"\n")
        text = line.decode(header.encoding, "replace").strip()
        last = k == len(lines) - 1 and not line.endswith((b"\n", b"\r"))
        if text.startswith(MARKS):
            comments += 1
        elif text and not text[0].isdigit() and is_stranger(_fields(text, header), header):
            again += 1
        elif last and text and not _readable(_fields(text, header), header):
            cut = 1
        else:
            kept[-1] = line
    return b"".join(kept), Strangers(comments, again, cut)


def is_stranger(fields: Sequence[str], header: Header) -> bool:
    """Whether a row is a comment, or the header (or its row of units) again."""
    told = tuple(x.strip() for x in fields)
    return bool(told) and (told[0].startswith(MARKS) or told in (header.names, header.units))


def _fields(text: str, header: Header) -> tuple[str, ...]:
    if header.delimiter == " ":
        return tuple(text.split())
    return tuple(x.strip() for x in next(csv.reader([text], delimiter=header.delimiter), []))


def _readable(fields: tuple[str, ...], header: Header) -> bool:
    """Whether the last field of a row is a number, what stands for none, or no number at all."""
    last = fields[-1] if fields else ""
    return last.lower() in MISSING or is_number(last.replace(header.decimal, ".")) or not any(c.isdigit() for c in last)
