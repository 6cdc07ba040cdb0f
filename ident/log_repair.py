"""What recorded time and positions may suffer from, and what is done about it: repaired and said, or refused and said where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .errors import DataError

Array = np.ndarray
#: Missing positions are bridged like a gap in time if no more rows than this follow each other, and few do overall.
_ISOLATED = 10
_SHARE = 0.01


@dataclass(frozen=True)
class Pieces:
    """Rows of a table that are used, as one index array per run (in order), and what was said about the rest."""

    rows: tuple[Array, ...]
    notes: tuple[str, ...]


def usable_rows(t: Array, positions: Mapping[str, Array], where: str, *, missing: str = "refuse") -> Pieces:
    """Rows with a position and a rising time stamp, as runs.

    `positions`: column name → (N,) for every position column. `missing`: "refuse" (an error beyond isolated rows) or "gap" (rows
    without position are left out, however many). Raises DataError naming the rows."""
    notes: list[str] = []
    present = np.isfinite(t)
    if not present.all():
        notes.append(f"{where}: {int((~present).sum())} rows without a time stamp are left out ({ranges(~present)}).")
        if present.mean() < 1 - _SHARE:
            raise DataError(f"{where}: {int((~present).sum())} of {len(t)} rows have no time stamp ({ranges(~present)}).")
    for name, values in positions.items():
        hole = ~np.isfinite(values)
        if not hole.any():
            continue
        longest = int(max(len(r) for r in _blocks(hole)))
        if missing == "refuse" and (longest > _ISOLATED or hole.sum() > max(_ISOLATED, _SHARE * len(t))):
            raise DataError(
                f"{where}: column {name!r} has no number in {int(hole.sum())} of {len(t)} rows ({ranges(hole)})."
                ' A position that is missing cannot be used. Cut the log there, or read it with missing = "gap" (--missing gap)'
                " to leave these rows out as a gap."
            )
        notes.append(f"{where}: column {name!r} has no number in {int(hole.sum())} rows ({ranges(hole)}); they are left out as a gap.")
        present &= ~hole
    index = np.flatnonzero(present)
    if len(index) < 2:
        raise DataError(f"{where}: {len(index)} usable rows; at least a few hundred are needed.")
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
            notes.append(
                f"{where}: {int((~keep).sum())} rows repeat the time stamp before them ({ranges(dropped)}); the first of each is used."
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
    if restart.all() and goes_on.all() and lengths.min() >= 20:
        at = ", ".join(str(int(index[s]) + 1) for s in starts[1:6])
        notes.append(f"{where}: time starts again at data row {at}: taken as {len(starts)} runs.")
        return np.split(index, starts[1:])
    row = int(index[back[0] + 1])
    raise DataError(
        f"{where}: time runs backwards at data row {row + 1} ({t[index[back[0]]]:.6g} s, then {t[row]:.6g} s), in"
        f" {len(back)} place{'s' * (len(back) > 1)}."
        " Sort or cut the log; several runs in one file must each start near the first one's time."
    )


def _blocks(flag: Array) -> list[Array]:
    index = np.flatnonzero(flag)
    return np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)


def ranges(flag: Array, most: int = 4) -> str:
    """Flagged rows in words, counted from 1: "data rows 12, 40-52 …"."""
    blocks = _blocks(flag)
    text = ", ".join(f"{b[0] + 1}" if len(b) == 1 else f"{b[0] + 1}-{b[-1] + 1}" for b in blocks[:most])
    return f"data row{'s' * (int(flag.sum()) > 1)} {text}" + (" …" if len(blocks) > most else "")
