"""What all readers of tables share: the names of the columns, and what a value is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DataError

Array = np.ndarray
MISSING = {
    "", "nan", "na", "n/a", "null", "none", "-nan", "+nan", "#n/a", "<na>", "-", "--", "nan(ind)", "-nan(ind)", "nan(snan)", "-nan(snan)",
    "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan", "1.#inf", "-1.#inf", "1.#snan", "-1.#snan",
    "---", "----", "n.a.", "n. a.", "nil", "missing", "?",  # what people write
    "#nv", "#value!", "#wert!", "#div/0!", "#num!", "#zahl!", "#null!", "#ref!", "#bezug!", "#name?",  # what spreadsheets write
}  # fmt: skip
#: What stands between the name of a column that occurs again and its number; longest line (characters) of a table.
AGAIN = "\x00again "


class UnreadableRows(DataError):
    """Rows are at fault (a text for a number, a field too many, a damaged end), whatever the columns are called."""


@dataclass(frozen=True)
class Header:
    """Column names of a table; for text, on which line they end (from 1), what separates fields (" ": runs of spaces) and the digits of a
    number, the units that are told of columns, and the encoding.

    `unnamed`: the file names no column; `#0`, `#1` … stand for them; `moments`: columns of dates with times, or times of day;
    `constants`: names and numbers that are told before the table."""

    names: tuple[str, ...]
    line: int = 0
    delimiter: str = ","
    decimal: str = "."
    units: tuple[str, ...] = ()
    encoding: str = "utf-8-sig"
    unnamed: bool = False
    moments: tuple[str, ...] = ()
    constants: tuple[tuple[str, float], ...] = ()


def check_file(path: Path) -> None:
    """Raises DataError if `path` is no readable, non-empty file."""
    if not path.exists():
        raise DataError(f"log {path}: no such file.")
    if path.is_dir():
        raise DataError(f"log {path}: is a folder; give its files, for example {path}/*.csv.")
    try:
        if path.stat().st_size == 0:
            raise DataError(f"log {path}: the file is empty.")
        with path.open("rb"):
            pass
    except OSError as error:
        raise DataError(f"log {path}: cannot be read ({error.strerror}).") from None


def once(names: Sequence[str]) -> tuple[str, ...]:
    """Column names, each once: what stands again is numbered, so that what is not used stops nothing."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}{AGAIN}{seen[name]}")
    return tuple(out)


def is_number(text: str) -> bool:
    """Whether the readers take a text for a number: `1_0` and digits of other scripts are numbers to Python alone."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text.isascii()


def numeric(values: Array, path: Path, name: str, first: int = 1) -> Array:
    """A column as float64, but for time stamps and durations, which know their own unit. `first`: data row (from 1) of its first value, for
    messages. Raises DataError."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    if values.dtype.kind in "mM":
        return values
    for row, value in enumerate(values.tolist(), first):
        if value is not None and not isinstance(value, (int, float)) and not (isinstance(value, str) and is_number(value)):
            raise UnreadableRows(f"log {path}: column {name!r}, data row {row}: {value!r} is not a number. Correct or remove the row.")
    return np.array([np.nan if v is None else float(v) for v in values.tolist()])


def seconds(values: Array) -> Array:
    """Time stamps (since 1970) and durations in seconds, NaN where there is none; numbers as they are."""
    kind = values.dtype.kind
    if kind not in "mM":
        return values
    # All dtypes of numpy's time count from the same moment; in seconds and what is beyond them no digit is lost that a float could hold.
    whole = values.astype(f"{kind}8[s]")
    rest = (values - whole).astype("m8[ns]").astype(np.int64)
    return np.where(np.isnat(values), np.nan, whole.astype(np.int64) + 1e-9 * rest)
