"""Which column of a recording is the time, and in what unit: told, or by velocities that must agree with positions, or by its size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import DataError
from .channel_group import ChannelGroup, known_scale, unit_suffix
from .readers.header import seconds
from .readers.moments import MOMENT
from .readers.text_rows import RowFault
from .stamps import fraction_beside, fraction_of, since_1970
from .time_names import scalar_time_names
from .told_units import unread_unit
from .units import as_suffix, bracketed, is_unit, split_unit, unit_of

Array = np.ndarray
Reader = Callable[[Sequence[str]], Mapping[str, Array]]
#: The recorder's clock beside that of the sender.
RECEIVED = "received"
#: A ratio this near to a unit's is that unit's.
_NEAR = 0.25


@dataclass(frozen=True)
class RecordedTime:
    """The column of time ("" where there is none), seconds in one unit of it, and what is wrong with those that seem to be one."""

    column: str = ""
    factor: float = 1.0
    doubt: str = ""


def time_of(
    names: Sequence[str],
    read: Reader,
    table: Mapping[str, Array],
    q: ChannelGroup,
    dq: ChannelGroup | None,
    scales: tuple[float, float],
    units: Mapping[str, str],
) -> RecordedTime:
    """The sender's stamp before the recorder's, and one that rises. `scales`: of positions and velocities; `units`: of columns."""
    rising: dict[str, Array] = {}
    doubts, paired = list[str](), set[str]()
    for name in sorted(
        scalar_time_names(names, units), key=lambda name: units.get(name) == MOMENT
    ):  # a time of day where there is no other
        try:
            values = np.asarray(seconds(np.asarray(read([name])[name])), float)
            if part := fraction_beside(name, names, read):
                values = values + part[1] * np.asarray(read([part[0]])[part[0]], float)
                paired.add(name)
            elif fraction_of(name, names) and np.mean(np.diff(values) > 0) < 0.5:
                continue
        except RowFault:  # of the whole row, not of its time alone
            raise
        except DataError as error:
            doubts.append(str(error).split(": ", 1)[-1])
            continue
        step = np.diff(values[np.isfinite(values)])
        if len(step) and np.mean(step >= 0) > 0.9 and np.any(step > 0):
            rising[name] = values
        elif np.any(step):
            doubts.append(f"column {name!r} does not increase from row to row. Correct it.")
    if not rising:
        return RecordedTime(doubt=doubts[0] if doubts else "")
    if units.get(next(iter(rising))) == MOMENT:
        return RecordedTime(next(iter(rising)))
    if len(rising) > 1:
        rising.pop(RECEIVED, None)  # where the sender has a clock of its own
    for name in rising:
        if name in paired:
            return RecordedTime(name)
        if unit := unit_suffix(units.get(name, "")) or unit_suffix(bracketed(name)[1]) or _suffix(name):
            return RecordedTime(name, known_scale(unit))
    for name, values in rising.items():
        ratio = rate_ratio(values, table, q, dq, scales)
        for factor in (1.0, 1e-3, 1e-6, 1e-9):
            if ratio is not None and abs(np.log(ratio / factor)) < _NEAR:
                return RecordedTime(name, factor)
    name, values = next(iter(rising.items()))
    if unread := unread_unit(units.get(name, "") or bracketed(name)[1]):
        return RecordedTime(doubt=f"column {name!r} is in {unread!r}, which is not a known unit of time. Correct it.")
    return RecordedTime(name, _seconds(name, values))


def _suffix(name: str) -> str:
    """The unit of time on which a name ends (`timestamp_ns`), or which it is (`millis`)."""
    whole = as_suffix(name)
    if len(whole) > 1 and is_unit(whole) and unit_of(whole).dimension == "time" and name.lower() not in ("min", "h"):
        return unit_of(whole).name
    stem, unit = split_unit(name)
    return unit if unit and stem and unit_of(unit).dimension == "time" else ""


def _seconds(name: str, t: Array) -> float:
    """Seconds in one unit of a time that nothing else tells: by its size since 1970, or whole milliseconds."""
    step = float(np.median(np.diff(t)[np.diff(t) > 0]))
    factor = since_1970(float(np.nanmedian(np.abs(t))))
    if factor != 1.0:
        return factor
    whole = bool(np.all(t == np.round(t)))
    return 1e-3 if name.lower() == "ms" or (whole and 1.0 <= step <= 200.0) else 1.0


def rate_ratio(t: Array, table: Mapping[str, Array], q: ChannelGroup, dq: ChannelGroup | None, scales: tuple[float, float]) -> float | None:
    """How many times faster the logged velocities (SI) are than the positions (SI) in units of this time; None where nothing tells."""
    if dq is None:
        return None
    ratios = []
    for a, b in zip(q.columns, dq.columns, strict=True):
        rate = np.gradient(np.asarray(table[a], float) * scales[0], np.maximum.accumulate(t) + 1e-12 * np.arange(len(t)))
        logged = np.asarray(table[b], float) * scales[1]
        big = np.abs(logged) > 0.3 * np.nanmax(np.abs(logged), initial=0.0)
        if big.sum() > 10 and np.any(np.abs(rate[big]) > 0):
            ratios.append(float(np.nanmedian(np.abs(rate[big]) / np.abs(logged[big]))))
    middle = float(np.median(ratios)) if ratios else 0.0
    return middle if middle > 0.0 else None
