"""Log files read piece by piece: CSV (plain or compressed) and Parquet, columns as in `ident.logs.readers.tables`."""

from __future__ import annotations

import io
import itertools
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from ..errors import DataError, UnsupportedError
from ..logs.column_plan import ColumnPlan
from ..logs.planning import COUNTED
from ..logs.readers.damage import DAMAGED, reason
from ..logs.readers.header import Header, numeric
from ..logs.readers.packed import LONGEST_LINE, open_binary
from ..logs.readers.parquet import arrow_values, parquet_file, stored_names
from ..logs.readers.stored import Chunked, format_of
from ..logs.readers.strangers import Strangers
from .text import TextParser

Array = np.ndarray
#: Bytes of text that are parsed as one piece: many against the handing over, few against the cache and memory.
TEXT_PIECE = 1 << 21
#: Rows of Parquet that are read as one piece.
_PARQUET_PIECE = 1 << 16
_CARRIAGE = "log {path}: lines end with a carriage return alone, which cannot be streamed; read the log into memory (--no-stream)."
#: Bytes in which the end of a piece's last line is looked for at a time.
_TAIL = 1 << 12


@dataclass(frozen=True)
class PieceOfFile:
    """Where reading stands: `offset` bytes of the (uncompressed) text after the header, or 0; data `rows` before it."""

    offset: int = 0
    rows: int = 0


@dataclass(frozen=True, eq=False)
class Piece:
    """SI arrays by quantity of some rows (`ColumnPlan.arrays`), the place after them, the share of the file that is done, and lines that
    were left out."""

    arrays: dict[str, Array]
    after: PieceOfFile
    share: float
    left: Strangers = field(default_factory=Strangers)


def chunked_file(path: Path) -> Chunked | None:
    """A file that is neither text nor plain Parquet, in chunks; None for those. Raises UnsupportedError for a format that is read whole."""
    found = format_of(path)
    if found is None:
        return None
    if found.chunks is None:
        raise UnsupportedError(f"log {path}: {found.name} cannot be streamed; leave out --stream, or save it as Parquet or CSV.")
    return found.chunks(path)


def is_streamable(path: Path) -> bool:
    """Whether a file is of a kind that can be read piece by piece."""
    return path.suffix.lower() != ".mat"


def shows_bytes(path: Path) -> bool:
    """Whether what is parsed of a file are its own bytes: text that is not compressed."""
    if path.suffix.lower() in (".parquet", ".pq") or format_of(path) is not None:
        return False
    with open_binary(path) as stream:
        return isinstance(stream, io.BufferedReader) and isinstance(stream.raw, io.FileIO)


def pieces(
    path: Path,
    header: Header | Chunked,
    plan: ColumnPlan,
    start: PieceOfFile,
    jobs: int = 1,
    show: Callable[[int, memoryview], None] | None = None,
) -> Iterator[Piece]:
    """The columns of a plan from `start` on, in order. `jobs`: threads that parse; `show` is called with each piece of text and its
    place in the file, where `shows_bytes`. Raises DataError (file, column, row)."""
    if isinstance(header, Chunked):
        return _chunk_pieces(header, plan, start)
    if path.suffix.lower() in (".parquet", ".pq"):
        return _parquet_pieces(path, plan, start)
    if not is_streamable(path):
        raise UnsupportedError(
            f"log {path}: MAT files cannot be streamed. Save it as CSV or Parquet, or read it into memory (--no-stream)."
        )
    return _text_pieces(path, header, plan, start, jobs, show if shows_bytes(path) else None)


def _chunk_pieces(file: Chunked, plan: ColumnPlan, start: PieceOfFile) -> Iterator[Piece]:
    stored = [name for name in plan.sources if name != COUNTED]
    row = start.rows
    for columns in file.read(stored, row):
        rows = len(columns[stored[0]])
        counted = {} if plan.rate_hz is None else {COUNTED: np.arange(row, row + rows) / plan.rate_hz}
        row += rows
        yield Piece(plan.arrays(columns | counted), PieceOfFile(0, row), min(1.0, row / max(1, file.rows)))


def _parquet_pieces(path: Path, plan: ColumnPlan, start: PieceOfFile) -> Iterator[Piece]:
    import pyarrow as pa

    file = parquet_file(path)
    stored = {name: own for name, own in stored_names(file) if name in plan.sources}
    total = max(1, file.metadata.num_rows)
    group, before = 0, 0
    while group < file.num_row_groups and before + file.metadata.row_group(group).num_rows <= start.rows:
        before += file.metadata.row_group(group).num_rows
        group += 1
    row = before
    try:
        # One group at a time: a reader of several keeps in memory what it has read of all of them.
        asked = {"columns": list(stored.values()), "use_threads": False}
        batches = (file.iter_batches(_PARQUET_PIECE, row_groups=[g], **asked) for g in range(group, file.num_row_groups))
        for batch in itertools.chain.from_iterable(batches):
            skip = min(max(0, start.rows - row), batch.num_rows)
            table = pa.Table.from_batches([batch.slice(skip)])
            row += batch.num_rows
            if not table.num_rows:
                continue
            first = row - table.num_rows + 1
            columns = {name: numeric(arrow_values(table.column(own)), path, name, first) for name, own in stored.items()}
            yield Piece(plan.arrays(columns), PieceOfFile(0, row), row / total)
    except (pa.ArrowException, *DAMAGED) as error:
        raise DataError(f"log {path}: the file is damaged after data row {row} ({reason(error)}).") from None


def _text_pieces(
    path: Path, header: Header, plan: ColumnPlan, start: PieceOfFile, jobs: int, show: Callable[[int, memoryview], None] | None
) -> Iterator[Piece]:
    parse = TextParser(path, header, plan)
    size = max(1, path.stat().st_size)
    place = start
    with open_binary(path) as stream, ThreadPoolExecutor(max(1, jobs)) as pool:
        waiting: deque[tuple[Future[tuple[dict[str, Array], Strangers] | None], memoryview, float]] = deque()
        source = _whole_lines(stream, path, header, start.offset, size, show)
        more = True
        while more or waiting:
            # A piece ahead of each thread, no more: memory stays the same however long the file is.
            while more and len(waiting) <= max(1, jobs):
                found = next(source, None)
                if found is None:
                    more = False
                else:
                    waiting.append((pool.submit(parse, found[0]), *found))
            if not waiting:
                break
            future, text, share = waiting.popleft()
            arrays, left = future.result() or parse.by_rows(text, place.offset, place.rows)
            rows = len(arrays["t"])
            place = PieceOfFile(place.offset + len(text), place.rows + rows)
            if rows or left:
                yield Piece(arrays, place, share, left)


def _whole_lines(
    stream: IO[bytes], path: Path, header: Header, offset: int, size: int, show: Callable[[int, memoryview], None] | None
) -> Iterator[tuple[memoryview, float]]:
    """Blocks of whole lines after the header, from `offset` bytes behind it on, and the share of the file read."""
    raw = getattr(stream, "fileobj", None) or getattr(stream, "_fp", None) or stream
    position: Callable[[], int] = raw.tell
    try:
        for _ in range(header.line):
            if b"\r" in stream.readline().rstrip(b"\r\n"):
                raise UnsupportedError(_CARRIAGE.format(path=path))
        if offset:
            stream.seek(offset, io.SEEK_CUR)
        at = stream.tell() if show is not None else 0
        rest = memoryview(b"")
        while True:
            # One buffer a piece, so that nothing is copied: what begins a line that ends in the next piece moves there.
            text = np.empty(len(rest) + TEXT_PIECE, np.uint8).data
            text[: len(rest)] = rest
            end = len(rest)
            while end < len(text) and (count := stream.readinto(text[end:])):  # type: ignore[attr-defined]
                end += count
            whole = end < len(text)
            cut = end if whole else _last_line_end(text)
            if not cut and not whole and b"\r" in bytes(text):
                raise UnsupportedError(_CARRIAGE.format(path=path))
            if not cut and end > LONGEST_LINE:
                raise DataError(f"log {path}: has a line of more than {LONGEST_LINE} characters: it is not a table of rows.")
            if show is not None and cut:
                show(at, text[:cut])
                at += cut
            if cut:
                yield text[:cut], min(1.0, position() / size)
            if whole:
                return
            rest = text[cut:end]
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


def _last_line_end(text: memoryview) -> int:
    """Bytes up to and with the last line feed; 0 if there is none."""
    for start in range(len(text) // _TAIL * _TAIL, -1, -_TAIL):
        found = bytes(text[start : start + _TAIL]).rfind(b"\n")
        if found >= 0:
            return start + found + 1
    return 0
