"""Pieces of delimited text → SI arrays, by the fastest reader that takes them.

The compiled one takes plain numbers only; Arrow (where it is installed) and pandas are more lenient, and say what is wrong. All three
round decimals correctly, so that which of them reads a piece changes no bit."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from .._native.choice import compiled
from ..errors import DataError
from ..logs.column_plan import ColumnPlan
from ..logs.readers.header import Header
from ..logs.readers.packed import open_binary
from ..logs.readers.strangers import Strangers, without_strangers
from ..logs.readers.text import arrow_columns, body_of, lenient_columns
from ..logs.readers.text_rows import columns_by_rows, unpaired_quotes

Array = np.ndarray
_COUNTED = 1 << 20
#: Bytes up to which a file is looked at as a whole for what is wrong with a piece of it.
_WHOLE = 1 << 28


@dataclass(frozen=True, eq=False)
class TextParser:
    """Whole lines of a file as arrays by quantity (`ColumnPlan.arrays`)."""

    path: Path
    header: Header
    plan: ColumnPlan

    def __call__(self, text: memoryview) -> tuple[dict[str, Array], Strangers] | None:
        """`text`: whole lines; and which of them are none of the table. None where only `by_rows` can tell."""
        found = self._plain(text)
        if found is not None:
            return found, Strangers()
        columns = self._lenient(text)
        if columns is not None:
            return self.plan.arrays(columns), Strangers()
        rows, left = without_strangers(io.BytesIO(text), self.header)
        columns = lenient_columns(self.path, self.header, self.plan.sources, rows) if left else None
        return None if columns is None else (self.plan.arrays(columns), left)

    def by_rows(self, text: memoryview, offset: int, rows: int) -> tuple[dict[str, Array], Strangers]:
        """The same row by row, `offset` bytes and `rows` data rows behind the header. Raises DataError for the first row that cannot be
        read, in the words of the whole file's reader."""
        plain, left = without_strangers(io.BytesIO(text), self.header)
        hidden = b'"' in plain and self._sound_whole  # quotes that another piece opens may hide what is wrong with this one
        try:
            columns = columns_by_rows(self.path, self.header, self.plan.sources, plain, 0)
        except DataError:
            if hidden:
                raise DataError(
                    f"log {self.path}: text in quotes runs past the end of its line, which cannot be streamed; read the"
                    f" log into memory (--no-stream)."
                ) from None
            lines = self.header.line + self._lines_before(offset)
            columns = columns_by_rows(self.path, self.header, self.plan.sources, plain, lines, rows + 1)
        return self.plan.arrays(columns), left

    @cached_property
    def _sound_whole(self) -> bool:
        """Whether the whole file was read row by row, which raises DataError where it cannot be; False for a very large one."""
        if self.path.stat().st_size > _WHOLE:
            return False
        with body_of(self.path, self.header) as stream:
            plain, _ = without_strangers(stream, self.header)
        columns_by_rows(self.path, self.header, self.plan.sources, plain, self.header.line)
        return True

    @cached_property
    def _targets(self) -> tuple[dict[str, int], bytes] | None:
        """Width of each quantity's array, and the array and column to which each field of a line goes; None where one goes to several."""
        columns = self.plan.read
        if len({c.source for c in columns}) < len(columns) or len(self.header.delimiter) != 1 or len(self.plan.quantity("t")) > 1:
            return None
        widths = {q: 1 if q == "t" else self.plan.n for q in dict.fromkeys(c.quantity for c in columns)}
        place = np.full((len(self.header.names), 2), -1, np.int32)
        for c in columns:
            place[self.header.names.index(c.source)] = list(widths).index(c.quantity), c.joint
        return widths, place.tobytes()

    @cached_property
    def _absent(self) -> tuple[tuple[str, int], ...]:
        """Columns of the arrays that no field fills."""
        given = {(c.quantity, c.joint) for c in self.plan.read}
        matrices = {c.quantity for c in self.plan.read if c.quantity != "t"}
        return tuple((q, j) for q in sorted(matrices) for j in range(self.plan.n) if (q, j) not in given)

    def _plain(self, text: memoryview) -> dict[str, Array] | None:
        """The compiled reader's arrays; None where it is not there or does not take the text."""
        reader, targets = compiled("_text"), self._targets
        if reader is None or targets is None:
            return None
        widths, place = targets
        lines = reader.lines(text)
        arrays = {q: np.empty((lines, w)) for q, w in widths.items()}
        rows = reader.parse(text, ord(self.header.delimiter), place, tuple(arrays.values()), tuple(widths.values()), lines)
        if rows < 0:
            return None
        for quantity, j in self._absent:
            arrays[quantity][:, j] = np.nan
        for c in self.plan.read:
            values = arrays[c.quantity][:rows, c.joint]
            if c.scale != 1.0:
                values *= c.scale
            if c.offset:
                values += c.offset
        return {q: a[:rows, 0] if q == "t" else a[:rows] for q, a in arrays.items()}

    def _lenient(self, text: memoryview) -> dict[str, Array] | None:
        """Raw columns by Arrow or pandas; None where neither takes the text."""
        names = self.plan.sources
        if len(text) < 4096 and not bytes(text).strip():
            return {name: np.zeros(0) for name in names}
        if find_spec("pyarrow") is not None and not unpaired_quotes(text):
            import pyarrow as pa

            source, pool = pa.BufferReader(pa.py_buffer(text)), pa.system_memory_pool()
            try:
                return arrow_columns(source, self.header, names, 0, block=len(text) + 1, threads=False, pool=pool)
            except (pa.ArrowException, ValueError):
                pass  # the slower reader says why, or is more lenient
        return lenient_columns(self.path, self.header, names, bytes(text))

    def _lines_before(self, offset: int) -> int:
        """Lines in the `offset` bytes behind the header."""
        lines = 0
        with open_binary(self.path) as stream:
            for _ in range(self.header.line):
                stream.readline()
            left = offset
            while left and (block := stream.read(min(left, _COUNTED))):
                lines += block.count(b"\n")
                left -= len(block)
        return lines
