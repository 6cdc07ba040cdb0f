"""The signals that a diagnosis looks at: as wide a band as the noise of the positions allows, rows near reversals left out."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...robots.reversals import Reversals
from ...signals.cutoff import HIGHEST
from ...signals.filters import RowFilter
from ...signals.preparation import make_preparation
from ...signals.signals import Signals
from .motion_noise import less_noise
from .motion_spectrum import told_up_to

if TYPE_CHECKING:
    from ...logs.log import LogSet

Array = np.ndarray
#: The rows' low-pass lies where the noise of the positions is one thousandth of the power of the accelerations; that of the
#: positions themselves lies higher by the share that a preparation puts between the two.
_ROWS_BELOW = 0.4
#: A band that is not wider than this is as good as another. Accelerations count as told where noise makes up this share of their power.
_WIDER = 1.05
_TOLD = 0.2
#: Effects are evaluated at this multiple of the positions' cut-off at least: faster samples hold no more of the motion.
_SAMPLED = 8.0
#: Rows of all joints together that a search looks at, and the stretches of a longer log that they are taken from.
_MOST_ROWS = 24000
_STRETCHES = 10
#: A row is not looked at if more than this share of its filter's weight lies on samples near a reversal.
_SHARE = 0.05
#: Near a reversal: slower than this share of the usual top speed (or than the speed's own noise lets tell).
_SLOW = 0.02


def analysis_signals(signals: Signals, held: Signals | None) -> tuple[Signals, Signals | None]:
    """Fit and held-out signals for a diagnosis: in a wide band, the noise in the motion taken out as far as can be."""
    signals, held = in_wide_band(signals, held)
    return less_noise(signals), None if held is None else less_noise(held)


def in_wide_band(signals: Signals, held: Signals | None) -> tuple[Signals, Signals | None]:
    """Both prepared anew, with a wider band, where the cut-off was not given and the logs are at hand; else as they are. Effects
    that act fast are not seen in the narrow band that suits parameters."""
    if signals.source is None or signals.report.config.get("cutoff_hz") is not None or signals.report.cutoff_hz is None:
        return signals, held
    if held is not None and held.source is None:
        return signals, held

    def prepared(source: LogSet, cutoff: float) -> Signals:
        return make_preparation(**{**signals.report.config, "cutoff_hz": cutoff, "row_cutoff_hz": None})(source, signals.robot)

    cutoff = wide_cutoff(signals)
    if cutoff <= _WIDER * signals.report.cutoff_hz:
        return signals, held
    wide = prepared(signals.source, cutoff)
    # Motion that comes in bursts allows a band in which there is mostly noise the rest of the time.
    calmer = max(told_up_to(wide, _TOLD) / _ROWS_BELOW, signals.report.cutoff_hz)
    if cutoff > _WIDER * calmer:
        if calmer <= _WIDER * signals.report.cutoff_hz:
            return signals, held
        wide, cutoff = prepared(signals.source, calmer), calmer
    return wide, None if held is None or held.source is None else prepared(held.source, cutoff)


def thinned(signals: Signals) -> Signals:
    """The same rows from every d-th sample, where the motion is sampled much faster than its cut-off asks for.

    The row filter keeps every d-th tap; `tau` stays what the full rate gave."""
    cutoff, filter_ = signals.report.cutoff_hz, signals.row_filter
    if cutoff is None or filter_ is None:
        return signals
    most = signals.rate / (_SAMPLED * cutoff)
    d = max((k for k in range(1, filter_.factor + 1) if filter_.factor % k == 0 and k <= most), default=1)
    if d == 1:
        return signals
    first = filter_.half % d
    taps = filter_.taps[first::d]
    fewer = RowFilter(taps / taps.sum(), filter_.factor // d)
    at, edges = [], [0]
    for run, rows in zip(signals.runs, signals.row_runs, strict=True):
        count = rows.stop - rows.start
        needed = (count - 1) * fewer.factor + len(fewer.taps) if count else 0
        at.append(run.start + first + d * np.arange(needed))
        edges.append(edges[-1] + needed)
    place = np.concatenate(at) if at else np.zeros(0, int)
    return replace(
        signals,
        **{key: getattr(signals, key)[place] for key in ("t", "q", "dq", "ddq", "torque")},
        runs=tuple(slice(a, b) for a, b in itertools.pairwise(edges)),
        rate=signals.rate / d,
        row_filter=fewer,
        # Fewer samples with as much noise in a band would each have less of it.
        report=replace(
            signals.report,
            rate_hz=signals.rate / d,
            joints=tuple(replace(j, noise=j.noise / np.sqrt(d)) for j in signals.report.joints),
        ),
    )


def stretches(signals: Signals) -> Signals:
    """The same signals, or of many rows stretches that are spread evenly over them: a search over the catalogue holds thousands of
    columns of every row in memory."""
    n, rows = signals.robot.n, len(signals.tau)
    if rows * n <= _MOST_ROWS:
        return signals
    length = max(1, _MOST_ROWS // n // _STRETCHES)
    ends = np.linspace(length, rows, _STRETCHES).astype(int)
    chosen: list[slice] = []
    for run in signals.row_runs:
        for stop in ends.tolist():
            part = slice(max(run.start, stop - length, chosen[-1].stop if chosen else 0), min(run.stop, stop))
            if part.stop - part.start >= min(length // 4, run.stop - run.start):
                chosen.append(part)
    return signals.select_rows(chosen)


def wide_cutoff(signals: Signals) -> float:
    """Cut-off (Hz) of the positions for a diagnosis."""
    report = signals.report
    allowed = [j.suggested_hz for j in report.joints if j.suggested_hz > 0]
    top = HIGHEST * report.rate_hz
    if not allowed:
        return float(report.cutoff_hz or top)
    return float(min(top, max(float(np.median(allowed)) / _ROWS_BELOW, report.cutoff_hz or 0.0)))


def without_reversals(signals: Signals, but: Collection[str] = (), memory: Array | None = None) -> Signals:
    """The same signals without the rows near a reversal of any motor whose friction is in them, or of a joint that others' motors move
    too; those of some joints, `but`, stay. `memory` (n,): seconds after it (before it, if negative) for which it is still in the rows of a
    joint.

    There the sign of the speed is wrong by its own error in time, and a contact may hold: what is left there looks like a fault."""
    report, reversals = signals.report, Reversals.of(signals.robot.transmission)
    speed = reversals.speeds(signals.dq)
    top = np.quantile(speed, 0.95, axis=0) if len(speed) else np.zeros(speed.shape[1])
    limits = np.maximum(reversals.limits(np.array([j.threshold for j in report.joints])), _SLOW * top)
    slow = reversals.reached(speed, limits, top)
    reach = int(np.ceil(0.5 * signals.rate / report.cutoff_hz)) if report.cutoff_hz else 1
    before, after = (np.zeros(signals.robot.n, int) for _ in range(2))
    if memory is not None:
        before, after = (np.ceil(np.maximum(x, 0.0) * signals.rate).astype(int) for x in (-memory, memory))
    near = np.zeros(signals.dq.shape)
    for run in signals.runs:
        for j in range(signals.robot.n):
            near[run, j] = _dilated(slow[run, j], reach + before[j], reach + after[j])
    valid = signals.valid.copy()
    for run, rows in zip(signals.runs, signals.row_runs, strict=True):
        if signals.row_filter is None:
            valid[rows] &= near[run] == 0.0
        else:
            valid[rows] &= signals.row_filter.magnitude.apply(near[run]) < _SHARE
    # A joint that hardly moves would lose every row: then its own rows stay.
    kept = valid.sum(axis=0) >= 0.25 * signals.valid.sum(axis=0)
    kept &= [name not in but for name in signals.robot.joint_names]
    return replace(signals, valid=np.where(kept, valid, signals.valid))


def without_turning(signals: Signals, joints: Collection[str]) -> Signals:
    """The same signals without the rows of some joints into which a reversal of theirs reaches, or, where gears couple joints, one of any
    joint or motor whose friction is in them."""
    rows, reaches = signals.without_turning(joints), Reversals.of(signals.robot.transmission).reaches
    at = [j for j in map(signals.robot.joint_index, joints) if np.count_nonzero(reaches[j]) > 1]
    valid = rows.valid.copy()
    valid[:, at] &= without_reversals(signals).valid[:, at]
    return replace(rows, valid=valid)


def _dilated(flag: Array, before: int, after: int) -> Array:
    """Flags (N,) bool, and so many samples before and after each, as 0 and 1."""
    edges = np.zeros(len(flag) + 1, int)
    at = np.flatnonzero(flag)
    np.add.at(edges, np.maximum(at - before, 0), 1)
    np.add.at(edges, np.minimum(at + after + 1, len(flag)), -1)
    return np.asarray(np.cumsum(edges[:-1]) > 0, float)
