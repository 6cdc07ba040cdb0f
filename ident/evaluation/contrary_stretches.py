"""Stretches of a log that contradict the rest of it: a contact, a brake that closes, a load that is handed over.

The torque column goes on there, and nothing in it says that it is not the drive's alone which moves the arm. What the rest of the log
predicts says so: a stretch is told of if its error is far beyond what the other stretches' spread lets the largest of them have, and if
the others are fitted much better without it, so that it bends the parameters. It stays in the fit: where only its motion is of another
kind, the model lacks an effect there, and leaving it out would hide that."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise, takewhile
from operator import add
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted, moment
from ..effects.kinds import Need
from ..problem.information import Information
from ..problem.linear_solution import full_values, order_of, solve_triangle
from ..problem.problem import Problem
from ..problem.reweighting import reweighted
from ..signals.signals import Signals
from ..statistics.outliers import BY_CHANCE, beyond
from .misreadings import FALL, PASSES

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: A stretch lasts so many seconds and rows at least; so many of a joint's are needed for a usual error.
_SECONDS, _ROWS, _FEW = 0.5, 5, 12
#: Rounds in which stretches are left out at most: those that bend the fit most hide the others.
_ROUNDS = 4
#: So many are named.
_NAMED = 3


def contrary(estimate: Estimate) -> str:
    """A sentence on stretches of the logs that contradict the rest and bend the parameters; "" where there are none."""
    problem = estimate.problem
    if problem is None or type(problem) is not Problem or Need.HISTORY in problem.model.needs:
        return ""
    if type(problem.signals) is not Signals:  # on disk: every pass costs as much as the fit
        return ""
    pieces = _Pieces.of(problem)
    fitted = problem.residual(problem.base.base_values(estimate.all_values))
    plain = _refitted(problem, problem.information)
    bent = fitted, plain
    found = _contradiction(problem, pieces, plain, bent)
    start = _without_a_part(problem)
    more = None if start is None else _contradiction(problem, pieces, start, bent)
    # The fewest stretches that account for it: a fit of a part of the log errs more elsewhere.
    if more is not None and (found is None or more.gain > found.gain + np.log(FALL)):
        found = more
    return "" if found is None else _sentence(problem, pieces, found)


def _contradiction(problem: Problem, pieces: _Pieces, residual: Array, bent: tuple[Array, Array]) -> _Contradiction | None:
    """The pieces that a fit with this `residual` (M, n) shows, as far as the others are fitted the better without them; `bent`: the
    residuals with them."""
    out, found = np.zeros(pieces.count, bool), None
    for _ in range(_ROUNDS):
        more = out | np.any(pieces.far(residual), axis=1)
        if np.array_equal(more, out):
            break
        rest = problem.valid & ~more[pieces.number][:, None]
        if not np.any(problem.tau[rest]):
            break
        kept = replace(problem, signals=replace(problem.signals, valid=rest, source=None))
        after = _refitted(problem, kept.information)
        # A robust fit is not bent: then nothing is to be said, however far the stretch is from it.
        new = _Contradiction(
            more, pieces.times(after), np.minimum(*(_rms(x, rest) for x in bent)), _rms(after, rest), _rms(problem.tau, rest)
        )
        if new.gain <= (found.gain if found else 0.0) + np.log(FALL):
            break
        out, found, residual = more, new, after
    return found


def _without_a_part(problem: Problem) -> Array | None:
    """Residual (M, n) of the fit that errs least on its own rows among those without a quarter of the rows, or two in a row: a long
    stretch bends the fit of all so far that it hides itself; None where there are too few rows."""
    edges = np.linspace(0, len(problem.tau), 5).astype(int)
    parts = [_information(problem, a, b) for a, b in pairwise(edges)]
    _, weights = reweighted(problem.information, order_of(problem.base), iterations=PASSES)
    best: tuple[float, Information] | None = None
    for left_out in ((0,), (1,), (2,), (3,), (0, 1), (1, 2), (2, 3)):
        kept = [part for k, part in enumerate(parts) if k not in left_out]
        whole = reduce(add, kept)
        values = full_values(problem, solve_triangle(*whole.combined(weights)[:2], order_of(problem.base)))
        errors = whole.relative_errors(values)[whole.counts > 0]
        error = float(np.sum(np.log(np.maximum(errors, 1e-12))))
        if np.all(whole.counts[problem.information.counts > 0] > problem.base.count) and (best is None or error < best[0]):
            best = error, whole
    return None if best is None else _refitted(problem, best[1])


@dataclass(frozen=True, eq=False)
class _Pieces:
    """The pieces of time into which runs are cut: the piece (M,) of each row, and whether rows of joints are used (M, n)."""

    number: Array
    used: Array
    count: int

    @classmethod
    def of(cls, problem: Problem) -> _Pieces:
        signals = problem.signals
        length = max(round(_SECONDS * signals.row_rate), _ROWS)
        number, first = np.zeros(len(signals.tau), int), 0
        for rows in signals.row_runs:
            own = np.arange(rows.stop - rows.start) // length
            number[rows] = first + own
            first += int(own[-1]) + 1 if len(own) else 0
        return cls(number, problem.valid, first)

    def times(self, residual: Array) -> Array:
        """Error (K, n) of each piece by the joint's usual one; NaN where a piece has too few rows for one."""
        rows = np.stack([np.bincount(self.number, used, self.count) for used in self.used.T], axis=1)
        squares = np.stack([np.bincount(self.number, x, self.count) for x in np.where(self.used, residual, 0.0).T ** 2], axis=1)
        error = np.where(2 * rows >= _ROWS, np.sqrt(squares / np.maximum(rows, 1)), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            usual = np.array([np.nanmedian(x) if np.isfinite(x).any() else np.nan for x in error.T])
            return np.asarray(error / np.where(usual > 0, usual, np.nan))

    def far(self, residual: Array) -> Array:
        """Pieces (K, n) whose error is far beyond those of the others."""
        times = self.times(residual)
        out = np.zeros(times.shape, bool)
        for j, own in enumerate(times.T):
            known = own[np.isfinite(own)]
            if len(known) >= _FEW:
                out[:, j] = own > beyond(known, BY_CHANCE / times.shape[1])
        return out


@dataclass(frozen=True, eq=False)
class _Contradiction:
    """Pieces (K,) that are left `out`; the error (K, n) of each, by the usual one, in a fit of the rest; rms (n,) of the rest before and
    after, and of its torque."""

    out: Array
    times: Array
    before: Array
    after: Array
    torque: Array

    @property
    def gain(self) -> float:
        """Logarithm of the product by which the joints' errors on the rest fall."""
        return float(np.nansum(np.log(self.before / self.after)))


def _information(problem: Problem, first: int, last: int) -> Information:
    """Information of the rows from `first` to `last`."""
    rows = [slice(max(first, run.start), min(last, run.stop)) for run in problem.row_runs if max(first, run.start) < min(last, run.stop)]
    if not np.any(problem.tau[first:last][problem.valid[first:last]]):  # nothing there, or a channel that dropped out
        return Information.empty(problem.valid.shape[1], problem.base.names)
    return replace(problem, signals=problem.signals.select_rows(rows)).information


def _refitted(problem: Problem, information: Information) -> Array:
    """Residual (M, n) of a problem's rows, with the parameters that fit some of them best."""
    solution, _ = reweighted(information, order_of(problem.base), iterations=PASSES)
    return problem.residual(full_values(problem, solution))


def _rms(residual: Array, used: Array) -> Array:
    count = used.sum(axis=0)
    squares = np.sum(np.where(used, residual, 0.0) ** 2, axis=0)
    return np.sqrt(np.where(count > 0, squares, np.nan) / np.maximum(count, 1))


def _sentence(problem: Problem, pieces: _Pieces, found: _Contradiction) -> str:
    names = problem.model.robot.joint_names
    first, *others = _events(problem, pieces, found)
    # What stands out of a fit this good without bending it, as reversals do, is no part of what is wrong.
    events = [first, *takewhile(lambda event: _bends(problem, pieces, found, event), others)]
    said = [
        f"at {moment(round(event.start, 2), event.origin)}, for {event.stop - event.start:.2g} s"
        f" (log {event.log}; {event.times:.3g} times the usual error of {names[event.joint]})"
        for event in events[:_NAMED]
    ]
    more = f" and in {counted(len(events) - _NAMED, 'more place')}" if len(events) > _NAMED else ""
    worst = int(np.nanargmax(found.before / found.after))
    relative = 100 * found.before[worst] / found.torque[worst], 100 * found.after[worst] / found.torque[worst]
    return (
        f"the torque contradicts the rest of the logs {', '.join(said)}{more}. Without that, the torque error of {names[worst]} falls from"
        f" {relative[0]:.2g} to {relative[1]:.2g} % elsewhere: it biases the parameters. {_advice(pieces, found.out, events[0])} Where only"
        " the motion is of another kind, the model lacks an effect (`ident diagnose`)."
    )


def _bends(problem: Problem, pieces: _Pieces, found: _Contradiction, event: _Event) -> bool:
    """Whether the rest is fitted much worse with an event among it."""
    out = found.out.copy()
    out[event.first : event.last + 1] = False
    kept = replace(problem, signals=replace(problem.signals, valid=problem.valid & ~out[pieces.number][:, None], source=None))
    error = _rms(_refitted(problem, kept.information), problem.valid & ~found.out[pieces.number][:, None])
    return float(np.nansum(np.log(error / found.after))) > np.log(FALL)


def _advice(pieces: _Pieces, out: Array, event: _Event) -> str:
    """What to do about the largest event: what agrees before and after it is right; where it has one other side only, either may be."""
    before, after = (_mostly_kept(pieces, out, side) for side in (slice(0, event.first), slice(event.last + 1, None)))
    if before and after:
        return "Look for a contact, a brake or another load there, and cut it out, or use method irls, which gives it little weight."
    change = moment(round(event.start if before else event.stop, 2), event.origin)
    return (
        f"Something changed at {change} of log {event.log}, such as an offset that jumped, a collision or another load; these data do not"
        " determine which side of it is right. Fit both sides separately, or keep the one that you trust."
    )


def _mostly_kept(pieces: _Pieces, out: Array, side: slice) -> bool:
    """Whether there are pieces on a side of an event, and more of them agree with the rest than contradict it."""
    used = np.bincount(pieces.number, pieces.used.any(axis=1), pieces.count)[side] > 0
    return bool(2 * np.count_nonzero(used & ~out[side]) > np.count_nonzero(used))


@dataclass(frozen=True)
class _Event:
    """Adjoining pieces of a log, the `first` to the `last`, `start` to `stop` s of a recording that begins at `origin`; the joint with the
    largest error."""

    log: str
    first: int
    last: int
    origin: float
    start: float
    stop: float
    joint: int
    times: float


def _events(problem: Problem, pieces: _Pieces, found: _Contradiction) -> list[_Event]:
    """The largest first."""
    signals, period = problem.signals, 1.0 / problem.signals.row_rate
    events: list[_Event] = []
    for run, rows in enumerate(signals.row_runs):
        last = -2
        for piece in np.unique(pieces.number[rows]):
            if not found.out[piece]:
                continue
            time = signals.row_time[rows][pieces.number[rows] == piece]
            joint = int(np.nanargmax(found.times[piece]))
            new = _Event(
                signals.run_names[run],
                int(piece),
                int(piece),
                signals.origins[run],
                float(time[0]),
                float(time[-1] + period),
                joint,
                found.times[piece, joint],
            )
            if piece == last + 1:
                old = events.pop()
                larger = max(old, new, key=lambda event: event.times)
                new = replace(larger, first=old.first, last=new.last, start=old.start, stop=new.stop)
            events.append(new)
            last = int(piece)
    return sorted(events, key=lambda event: -event.times)
