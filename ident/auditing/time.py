"""Audit of a run's time stamps, and what reading it had to repair."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .._utils.text import counted, moment
from ..logs.log import Log
from ..logs.spacing import GAP
from ..signals.resample import Clock, is_even, slow_clock
from .findings import AuditFinding, Severity

Array = np.ndarray
#: Share of samples missing, one or two at a time, from which on it is a warning: 1 % moves estimates by a tenth of their deviation.
_FEW = 0.01


@dataclass(frozen=True)
class Stamps:
    """What is known of rising time stamps: `samples`, the first at `start` (s), `duration` (s), `clock`; `gaps`: steps beyond `GAP` usual
    ones, the `longest` (s) of them beginning `at` (s); `even`: they lie on a uniform grid."""

    samples: int
    start: float
    duration: float
    clock: Clock
    gaps: int
    longest: float
    at: float
    even: bool

    @classmethod
    def of(cls, t: Array) -> Stamps:
        """From stamps (N,) in memory."""
        steps, clock = np.diff(t), Clock.of(t)
        gaps = np.flatnonzero(steps > GAP * clock.step)
        longest = int(gaps[np.argmax(steps[gaps])]) if len(gaps) else 0
        even = not len(gaps) and is_even(t, 1 / clock.step, clock)
        return cls(len(t), float(t[0]), float(t[-1] - t[0]), clock, len(gaps), float(steps[longest]), float(t[longest]), even)


def check_time(log: Log) -> list[AuditFinding]:
    """Sample rate, jitter, missing samples, gaps, stamps that repeat or run backwards."""
    if len(log) < 3:
        return [*repairs(log.name, log.notes), _short(log.name, len(log))]
    steps = np.diff(log.t)
    back, equal = int((steps < 0).sum()), int((steps == 0).sum())
    out = repairs(log.name, log.notes)

    def add(code: str, text: str, value: float) -> list[AuditFinding]:
        return [*out, AuditFinding(code, Severity.ERROR, text, "", log.name, value)]

    if back or not np.all(np.isfinite(log.t)):
        at = int(np.flatnonzero((steps < 0) | ~np.isfinite(steps))[0]) + 2
        text = f"Time runs backwards or is missing in {counted(max(back, 1), 'place')}, first at row {at}. Sort or cut the log."
        return add("time_backwards", text, back)
    if equal:
        text = f"{counted(equal, 'row', 'repeat')} the previous time stamp. Read the log with read_logs, which drops them."
        return add("time_repeated", text, equal)
    return [*out, *stamp_findings(log.name, Stamps.of(log.t))]


def repairs(name: str, notes: Iterable[str]) -> list[AuditFinding]:
    """What reading a run had to repair."""
    return [AuditFinding("repaired", Severity.WARNING, f"When reading: {note}", "", name) for note in notes]


def _short(name: str, samples: int) -> AuditFinding:
    return AuditFinding(
        "too_short", Severity.ERROR, f"{counted(samples, 'sample')}; nothing can be estimated from them.", "", name, samples
    )


def stamp_findings(name: str, stamps: Stamps) -> list[AuditFinding]:
    """What a run's rising time stamps tell."""
    out: list[AuditFinding] = []

    def add(code: str, severity: Severity, text: str, value: float = float("nan")) -> None:
        out.append(AuditFinding(code, severity, text, "", name, value))

    if stamps.samples < 3:
        return [_short(name, stamps.samples)]
    clock = stamps.clock
    rate = 1 / clock.step
    add("sample_rate", Severity.INFO, f"{counted(stamps.samples, 'sample')} in {stamps.duration:.4g} s, {rate:.5g} Hz.", rate)
    if why := slow_clock(clock.step):
        add("time_unit", Severity.ERROR, f"{why[0].upper()}{why[1:]}", clock.step)
    if stamps.duration * rate < 200:
        add(
            "too_short",
            Severity.WARNING,
            f"Only {counted(stamps.samples, 'sample')}: filters discard a good part of them, and few parameters can be separated.",
        )
    if stamps.gaps:
        add(
            "gaps",
            Severity.WARNING,
            f"{stamps.gaps} gap{'s' * (stamps.gaps > 1)} in time, the longest {stamps.longest * 1e3:.4g} ms"
            f" at {moment(stamps.at, stamps.start)}."
            " Short ones are bridged where the motion is slow enough; longer ones split the run, and the filters'"
            " transients on either side are lost. If there are many, log with a real-time buffer.",
            stamps.longest,
        )
    if clock.missing:
        share = clock.missing / (stamps.samples + clock.missing)
        add(
            "missing_samples",
            Severity.WARNING if share > _FEW else Severity.INFO,
            f"{clock.missing} sample{'s are' if clock.missing > 1 else ' is'} missing ({share:.2%}), one or two at a time: the steps about"
            f" them are whole multiples of the period of {clock.step * 1e3:.4g} ms. Positions and torques there are"
            f" interpolated by splines,"
            + (
                " not measured: above a few per cent, parameters shift and their intervals widen. Find out why the recorder drops samples."
                if share > _FEW
                else " which hardly affects an estimate while they are so few."
            ),
            share,
        )
    uneven = clock.jitter / clock.step
    # Rounding of the stamps alone makes steps differ by no more than half of their resolution (rms).
    rounded = stamps.even or (clock.missing > 0 and clock.jitter <= 0.51 * clock.resolution)
    if not rounded and uneven > 0.005:
        add(
            "jitter",
            Severity.WARNING if uneven > 0.05 else Severity.INFO,
            f"Steps vary by {uneven:.1%} (rms). The stamps are trusted and the run is resampled; treating the samples as"
            f" equally spaced would distort velocities and accelerations by as much. If the recorder, not the drive, stamped the"
            f" samples, this variation is itself noise.",
            uneven,
        )
    return out
