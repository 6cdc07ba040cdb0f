"""Fields of a JSON result read back: each is of the kind and shape that it must have, or is named in the refusal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ConfigurationError

Array = np.ndarray
_SHOWN = 60
_DAMAGED = "is damaged, or another version of ident wrote it"


@dataclass(frozen=True, eq=False)
class Field:
    """A value of a result and where it stands: `where`, the file; `name`, as in `state.base.regroup`.

    Whatever is asked of it and is not so raises ConfigurationError with the file, the field and what it should be."""

    value: Any
    where: str
    name: str = ""

    def fault(self, expected: str) -> ConfigurationError:
        """The refusal: what the field must be, and is not."""
        shown = repr(self.value)
        shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "…"
        return ConfigurationError(f"{self.where}: {_DAMAGED}: its field {self.name!r} must be {expected}, not {shown}.")

    def __getitem__(self, key: str) -> Field:
        table = self.table()
        if key not in table:
            name = f"{self.name}.{key}" if self.name else key
            raise ConfigurationError(f"{self.where}: {_DAMAGED}: its field {name!r} is missing.")
        return self._below(key, table[key])

    def __contains__(self, key: str) -> bool:
        return key in self.table()

    def _below(self, key: object, value: Any) -> Field:
        return Field(value, self.where, f"{self.name}.{key}" if self.name else str(key))

    def table(self) -> dict[str, Any]:
        """A table of fields."""
        if not isinstance(self.value, dict):
            raise self.fault("a table")
        return self.value

    def items(self, count: int | None = None) -> Iterator[Field]:
        """The entries of a list, `count` of them where that is known."""
        if not isinstance(self.value, list) or (count is not None and len(self.value) != count):
            raise self.fault("a list" if count is None else f"a list of {count}")
        return (self._below(i, value) for i, value in enumerate(self.value))

    def text(self) -> str:
        """A text."""
        if not isinstance(self.value, str):
            raise self.fault("a text")
        return self.value

    def texts(self) -> tuple[str, ...]:
        """A list of texts."""
        return tuple(item.text() for item in self.items())

    def one_of(self, choices: Iterable[str]) -> str:
        """One of some texts."""
        known = list(choices)
        if not isinstance(self.value, str) or self.value not in known:
            raise self.fault("one of " + ", ".join(known))
        return self.value

    def whole(self, least: int = 0, most: int = 1 << 62) -> int:
        """A whole number between two."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or not least <= self.value <= most:
            raise self.fault(f"a whole number from {least}" if most == 1 << 62 else f"a whole number from {least} to {most}")
        return self.value

    def number(self, *, absent: bool = False) -> float:
        """A finite number; NaN for null where it may be `absent`."""
        if self.value is None and absent:
            return math.nan
        if isinstance(self.value, bool) or not isinstance(self.value, int | float) or not abs(self.value) <= _LARGEST:
            raise self.fault("a finite number" + (" or null" if absent else ""))
        return float(self.value)

    def numbers(self, *shape: int, absent: bool = False) -> Array:
        """An array of finite numbers of a shape (-1: any length); null is NaN where numbers may be `absent`."""
        text = " x ".join("any number" if s < 0 else str(s) for s in shape)
        try:
            found = np.array(self.value, float)
        except (TypeError, ValueError, OverflowError):
            raise self.fault(f"numbers ({text})") from None
        if 0 in found.shape and 0 in shape:
            return np.zeros(shape)
        if found.ndim != len(shape) or any(s not in (-1, f) for s, f in zip(shape, found.shape, strict=True)):
            raise self.fault(f"numbers ({text})")
        if not _plain(self.value) or not np.all(np.abs(found[~np.isnan(found)]) <= _LARGEST) or (not absent and np.isnan(found).any()):
            raise self.fault(f"finite numbers ({text})")
        return found

    def indices(self, below: int, count: int | None = None) -> Array:
        """Different whole numbers from 0, below a bound."""
        found = [item.whole(0, below - 1) for item in self.items(count)]
        if len(set(found)) < len(found):
            raise self.fault("different whole numbers")
        return np.array(found, int)


#: No number of a result is larger: products of it would overflow.
_LARGEST = 1e100


def _plain(value: Any) -> bool:
    """Whether nested lists hold nothing but numbers and null: NumPy would make numbers of texts and truth values too."""
    if isinstance(value, list):
        return all(map(_plain, value))
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))
