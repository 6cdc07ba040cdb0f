"""Time stamps in two columns (seconds, and a fraction of one), and stamps that count since 1970 in a unit that their size tells."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

Array = np.ndarray
_WHOLE = re.compile(r"^(?P<before>.*?)(?P<word>secs?|seconds)$", re.IGNORECASE)
#: Words for a fraction of a second, and seconds in one of it.
_FRACTIONS = {
    "nsec": 1e-9, "nsecs": 1e-9, "nanosec": 1e-9, "nanosecs": 1e-9, "nanos": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9, "usec": 1e-6,
    "usecs": 1e-6, "micros": 1e-6, "microsec": 1e-6, "microseconds": 1e-6,
}  # fmt: skip
#: A number of more than these seconds is none since 1970; so many units are a second.
_SIZES = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))


def fraction_of(name: str, names: Sequence[str]) -> tuple[str, float] | None:
    """The column that by its name holds the fraction of the seconds in another (`sec`, `nanosec`), and seconds in one unit of it."""
    found = _WHOLE.match(name)
    if found is None:
        return None
    known = {n.lower(): n for n in names}
    for word, factor in _FRACTIONS.items():
        if (own := known.get(found["before"].lower() + word)) is not None:
            return own, factor
    return None


def fraction_beside(name: str, names: Sequence[str], read: Callable[[Sequence[str]], Mapping[str, Array]]) -> tuple[str, float] | None:
    """`fraction_of` where the numbers agree: seconds are whole, and the fraction stays below one."""
    found = fraction_of(name, names)
    if found is None:
        return None
    table = read([name, found[0]])
    whole, part = (np.asarray(table[n], float) for n in (name, found[0]))
    known = np.isfinite(whole) & np.isfinite(part)
    fits = known.any() and np.all(whole[known] == np.round(whole[known])) and part[known].min() >= 0 and part[known].max() * found[1] < 1.0
    return found if fits else None


def since_1970(size: float) -> float:
    """Seconds in one unit of a time of this size; 1 where it may be seconds."""
    return next((factor for bound, factor in _SIZES if abs(size) > bound), 1.0)
