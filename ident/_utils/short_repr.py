"""What objects show of themselves at a prompt: class, small values, and the sizes of large ones."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

#: Length beyond which a value is told by its kind and size alone.
_LONG = 40


class ShortRepr:
    """A dataclass (with `repr=False`) whose `repr` fits in a few lines, however much it holds.

    Examples
    --------
    >>> import ident
    >>> ident.load_robot("scara").transmission
    Transmission(K=array (4, 4), zero=array (4,), measured='motor')
    """

    __slots__ = ()

    def __repr__(self) -> str:
        shown = [f"{f.name}={_short(getattr(self, f.name))}" for f in fields(self) if f.repr and not _nothing(getattr(self, f.name))]  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(shown)})"


def _nothing(value: Any) -> bool:
    return value is None or (isinstance(value, tuple | list | dict | str) and not value)


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"array {value.shape}" if value.size > 3 else np.array2string(value, precision=4, separator=", ")
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str | bool | int):
        text = repr(str(value) if isinstance(value, str) else value)
        return text if len(text) <= _LONG else f"{text[: _LONG - 1]}…"
    if isinstance(value, tuple | list | dict | set | frozenset):
        text = _items(value)
        return text if len(text) <= 2 * _LONG else f"{len(value)} entries"
    if is_dataclass(value):
        return f"<{type(value).__name__}>"
    text = repr(value)
    return text if len(text) <= _LONG else f"<{type(value).__name__}>"


def _items(value: Any) -> str:
    if len(value) > 12:
        return " " * (2 * _LONG + 1)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k!r}: {_short(v)}" for k, v in value.items()) + "}"
    return "(" + ", ".join(_short(v) for v in value) + ")"
