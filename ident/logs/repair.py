"""What recorded time and positions may suffer from, and what is done about it: repaired and said, or refused and said where."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .._utils.text import counted
from ..errors import DataError

Array = np.ndarray
#: Missing positions are bridged like a gap in time if no more rows than this follow each other, and few do overall.
_ISOLATED = 10
#: Beyond this, a number of a log is none: squares and sums of it would overflow, and no quantity of a robot is so large.
_LARGEST = 1e30
#: Share of rows up to which repeats are a recorder's; more of them are the stream itself, held.
REPEATS = 0.3
#: A log of fewer rows does not tell a repeat.
FEWEST = 100
#: Sizes of steps that are told apart: the first bits of a number that is not negative.
_SIZES = 1 << 15
#: Positions that stay within this (rad, m) may have velocities that are all zero.
_AT_REST = 1e-3
_SHARE = 0.01
#: Where more rows than this share repeat the stamp before them, and this share of those not its positions, stamps are rounded too coarsely.
_ROUNDED = 0.2
_MOVED = 0.1


@dataclass(frozen=True)
class Pieces:
    """Rows of a table that are used, as one index array per run (in order), and what was said about the rest."""

    rows: tuple[Array, ...]
    notes: tuple[str, ...]


@dataclass
class Holes:
    """Flagged rows of a table, gathered piece by piece: `blocks` [first, stop) from 0, in order."""

    blocks: list[list[int]] = field(default_factory=list)

    def add(self, flag: Array, first: int = 0) -> None:
        """Rows `first` … of which some are flagged."""
        if not flag.any():
            return
        for block in _blocks(flag):
            start, stop = first + int(block[0]), first + int(block[-1]) + 1
            if self.blocks and self.blocks[-1][1] == start:
                self.blocks[-1][1] = stop
            else:
                self.blocks.append([start, stop])

    def __bool__(self) -> bool:
        return bool(self.blocks)

    @property
    def count(self) -> int:
        return sum(stop - start for start, stop in self.blocks)

    @property
    def longest(self) -> int:
        return max((stop - start for start, stop in self.blocks), default=0)

    def flag(self, rows: int) -> Array:
        """The flags (rows,) themselves."""
        out = np.zeros(rows, bool)
        for start, stop in self.blocks:
            out[start:stop] = True
        return out

    def __str__(self) -> str:
        return _ranges(self.blocks)


def repeated_rows(arrays: Mapping[str, Array]) -> Array:
    """Rows (N,) that repeat the row before them in every channel but the time, while the joints move: the recorder took a sample again.

    `arrays`: "t" and other channels (N, n). Without a torque, or where every other row repeats, nothing tells a repeat from rest."""
    channels = [a for k, a in arrays.items() if k != "t" and a.ndim == 2]
    none = np.zeros(len(arrays["t"]), bool)
    if not any(k.startswith("tau") for k in arrays) or len(none) < FEWEST:
        return none
    same = same_rows(channels)
    if not same.any() or same.mean() > REPEATS:
        return none
    q = next(a for k, a in arrays.items() if k in ("q", "q_motor"))
    return same & moving_rows(q, usual_steps(step_sizes(q)))


def same_rows(channels: Sequence[Array]) -> Array:
    """Rows (N,) that are, in every channel (N, n), what the row before them is."""
    same = np.zeros(len(channels[0]), bool)
    same[1:] = np.all([np.all((a[1:] == a[:-1]) | (np.isnan(a[1:]) & np.isnan(a[:-1])), axis=1) for a in channels], axis=0)
    return same


def step_sizes(positions: Array) -> Array:
    """How often each size of a step occurs, of positions (N, n): (n, sizes), in sixteenths of a power of two; counts of pieces add up."""
    step = np.abs(np.diff(positions, axis=0))
    sizes = (np.ascontiguousarray(step).view(np.int64) >> 48).reshape(step.shape)
    return np.stack([np.bincount(own[moved > 0], minlength=_SIZES) for own, moved in zip(sizes.T, step.T, strict=True)])


def usual_steps(counts: Array) -> Array:
    """The middle size (n,) of the steps that were counted; infinite where there is none."""
    whole = np.cumsum(counts, axis=1)
    middle = np.argmax(whole >= 0.5 * whole[:, -1:], axis=1)
    return np.where(whole[:, -1] > 0, (middle.astype(np.int64) << 48).view(np.float64), np.inf)


def moving_rows(positions: Array, usual: Array) -> Array:
    """Rows (N,) before and after which a joint makes a step of its `usual` size (n,)."""
    step = np.abs(np.diff(positions, axis=0))
    before, after = np.zeros_like(positions), np.zeros_like(positions)
    before[2:] = step[:-1]
    after[:-1] = step
    with np.errstate(invalid="ignore"):
        return np.asarray(np.any((before > 0.2 * usual) & (after > 0.2 * usual), axis=1))


def repeats_told(count: int, where: str) -> str:
    """What to say of rows that repeat the row before them."""
    return (
        f"{where}: {counted(count, 'row', 'repeat')} the row before in every column but the time while the joints move (the"
        f" recorder repeated the sample of a slower stream), left out as gaps of one sample."
    )


def usable_numbers(values: Array) -> Array:
    """Which numbers can be ones of a recording: finite, and of a size of which squares and sums stay so."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < _LARGEST)


def blank_unusable(arrays: Mapping[str, Array]) -> None:
    """Torques, speeds and accelerations that can be none of a recording become NaN, in place."""
    for name, values in arrays.items():
        if name not in ("t", "q", "q_motor") and not (known := usable_numbers(values)).all():
            values[~known] = np.nan


def usable_rows(t: Array, positions: Mapping[str, Array], where: str, *, missing: str = "refuse", repeated: Array | None = None) -> Pieces:
    """Rows with a position and a rising time stamp, as runs.

    `positions`: column name → (N,) for every position column. `missing`: "refuse" (an error beyond isolated rows) or "gap" (rows
    without position are left out, however many). Raises DataError naming the rows."""
    unstamped = Holes()
    unstamped.add(~usable_numbers(t))
    holes = {name: Holes() for name in positions}
    present = usable_numbers(t)
    for name, values in positions.items():
        hole = ~usable_numbers(values)
        holes[name].add(hole)
        present &= ~hole
    notes = missing_rows(unstamped, holes, len(t), where, missing=missing)
    if repeated is not None and repeated.any():
        present &= ~repeated
        notes.append(repeats_told(int(repeated.sum()), where))

    def moved(rows: Array) -> Array:
        return np.any([values[rows] != values[rows - 1] for values in positions.values()], axis=0)

    return rising_runs(t, np.flatnonzero(present), where, notes, moved)


def missing_rows(unstamped: Holes, holes: Mapping[str, Holes], rows: int, where: str, *, missing: str) -> list[str]:
    """Notes on rows left out for want of a time stamp or a position. Raises DataError where there are too many."""
    notes: list[str] = []
    if unstamped:
        notes.append(f"{where}: left out: {counted(unstamped.count, 'row')} without a time stamp ({unstamped}).")
        if unstamped.count > _SHARE * rows:
            raise DataError(f"{where}: {unstamped.count} of {counted(rows, 'row', 'have')} no time stamp ({unstamped}).")
    for name, hole in holes.items():
        if not hole:
            continue
        if missing == "refuse" and (hole.longest > _ISOLATED or hole.count > max(_ISOLATED, _SHARE * rows)):
            raise DataError(
                f"{where}: column {name!r} has no number in {hole.count} of {counted(rows, 'row')} ({hole})."
                ' Missing positions cannot be used. Cut the log there, or read it with missing = "gap" (--missing gap)'
                " to leave these rows out as a gap."
            )
        notes.append(f"{where}: column {name!r} has no number in {counted(hole.count, 'row')} ({hole}), left out as a gap.")
    return notes


def rising_runs(t: Array, index: Array, where: str, notes: list[str], moved: Callable[[Array], Array]) -> Pieces:
    """The rows `index` of stamps `t` (N,) as runs of rising time. `moved`: which of some rows hold another position than the row before
    them. Raises DataError naming the rows."""
    if len(index) < 2:
        raise DataError(f"{where}: {counted(len(index), 'usable row')}; at least a few hundred are needed.")
    step = np.diff(t[index])
    back = np.flatnonzero(step < 0)
    pieces = [index] if not len(back) else _runs(t, index, back, where, notes)
    out = []
    for piece in pieces:
        # A stamp must be later than all before it; equal stamps are the same sample twice.
        keep = np.r_[True, np.diff(t[piece]) > 0]
        if not keep.all():
            dropped = np.zeros(len(t), bool)
            dropped[piece[~keep]] = True
            again = np.flatnonzero(dropped)
            if keep.sum() > 1 and len(again) > _ROUNDED * len(piece) and np.mean(moved(again)) > _MOVED:
                raise DataError(
                    f"{where}: {len(again)} of {counted(len(piece), 'row', 'repeat')} the time stamp before ({ranges(dropped)}), but not"
                    " its positions: the time stamps are rounded more coarsely than the sample period, so no velocity can be"
                    " computed from them."
                    " Write them with more digits; or, if the samples are evenly spaced, give the time as row number / rate."
                )
            notes.append(
                f"{where}: {counted(int((~keep).sum()), 'row', 'repeat')} the time stamp before ({ranges(dropped)}); the"
                " first of each is used."
            )
        out.append(piece[keep])
    if all(len(p) < 2 for p in out):
        raise DataError(f"{where}: the time stamp is the same in every row ({t[index[0]]:g} s).")
    return Pieces(tuple(p for p in out if len(p) >= 2), tuple(notes))


def _runs(t: Array, index: Array, back: Array, where: str, notes: list[str]) -> list[Array]:
    """Split where time starts again, if that is what its steps back are; else refuse."""
    starts = np.r_[0, back + 1]
    lengths = np.diff(np.r_[starts, len(index)])
    first = t[index[0]]
    # Runs written one after the other all start near the first one's start, and each is long.
    typical = float(np.median(np.abs(np.diff(t[index]))))
    span = float(np.max(t[index]) - np.min(t[index]))
    restart = np.abs(t[index[starts]] - first) <= max(0.02 * span, 10 * typical)
    # Each goes on at once from where it starts: a stray stamp does not.
    goes_on = t[index[np.minimum(starts + 1, len(index) - 1)]] - t[index[starts]] <= 5 * typical
    # And it takes back nearly all of the run before: two rows that changed places do not.
    before = t[index[back]]
    restart[1:] &= before - t[index[back + 1]] >= 0.5 * (before - t[index[starts[:-1]]])
    if restart.all() and goes_on.all() and lengths.min() >= 20:
        at = ", ".join(str(int(index[s]) + 1) for s in starts[1:6])
        notes.append(f"{where}: time restarts at data row {at}: taken as {len(starts)} runs.")
        return np.split(index, starts[1:])
    row = int(index[back[0] + 1])
    raise DataError(
        f"{where}: time runs backwards at data row {row + 1} ({t[index[back[0]]]:.12g} s, then {t[row]:.12g} s), in"
        f" {len(back)} place{'s' * (len(back) > 1)}."
        " Sort or cut the log; several runs in one file must each start near the first one's time."
    )


def _blocks(flag: Array) -> list[Array]:
    index = np.flatnonzero(flag)
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)


def ranges(flag: Array) -> str:
    """Flagged rows in words, counted from 1: "data rows 12, 40-52 …"."""
    return _ranges([[int(b[0]), int(b[-1]) + 1] for b in _blocks(flag)])


def _ranges(blocks: list[list[int]], most: int = 4) -> str:
    text = ", ".join(f"{a + 1}" if b - a == 1 else f"{a + 1}-{b}" for a, b in blocks[:most])
    rows = sum(b - a for a, b in blocks)
    return f"data row{'s' * (rows > 1)} {text}" + (" …" if len(blocks) > most else "")


def drop_empty(arrays: dict[str, Array], where: str) -> list[str]:
    """Take out channels that are there and hold nothing but zeros, which no measurement does; what to say of them.

    `arrays`: (N, n) by quantity, or the least and largest value of each, (2, n)."""
    notes = []
    q = arrays.get("q", arrays.get("q_motor"))
    assert q is not None
    span = np.nanmax(q, axis=0, initial=-np.inf) - np.nanmin(q, axis=0, initial=np.inf)
    for name in [k for k in arrays if k not in ("t", "q", "q_motor")]:
        values = arrays[name]
        known = np.isfinite(values)
        if not known.any() or np.any(values[known] != 0.0):
            continue
        if name.startswith("tau") or np.any(span > _AT_REST):
            del arrays[name]
            what = {"tau_joint": "torque", "tau_motor": "motor torque", "tau_current": "current"}.get(name, "velocity or acceleration")
            notes.append(f"{where}: the {what} is zero in every row: nothing was recorded there, and it is not used.")
    return notes
