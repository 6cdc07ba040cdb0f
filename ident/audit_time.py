"""Audit of a run's time stamps, and what reading it had to repair."""

from __future__ import annotations

import numpy as np

from .audit import Finding, Severity
from .logs import Log
from .resample import Clock, is_even

Array = np.ndarray


def check_time(log: Log) -> list[Finding]:
    """Sample rate, jitter, gaps, stamps that repeat or run backwards."""
    out: list[Finding] = []

    def add(code: str, severity: Severity, text: str, value: float = float("nan")) -> None:
        out.append(Finding(code, severity, text, "", log.name, value))

    for note in log.notes:
        add("repaired", Severity.WARNING, f"When reading: {note}")
    if len(log) < 3:
        add("too_short", Severity.ERROR, f"{len(log)} samples; nothing can be estimated from them.", len(log))
        return out
    steps = np.diff(log.t)
    back, equal = int((steps < 0).sum()), int((steps == 0).sum())
    if back or not np.all(np.isfinite(log.t)):
        at = int(np.flatnonzero((steps < 0) | ~np.isfinite(steps))[0]) + 2
        add(
            "time_backwards",
            Severity.ERROR,
            f"Time runs backwards or is missing in {max(back, 1)} places, first at row {at}. Sort or cut the log.",
            back,
        )
        return out
    if equal:
        add(
            "time_repeated",
            Severity.ERROR,
            f"{equal} rows repeat the time stamp before them. Read the log with read_logs, which drops them.",
            equal,
        )
        return out
    clock = Clock.of(log.t)
    rate = 1 / clock.step
    add("sample_rate", Severity.INFO, f"{len(log)} samples in {log.duration:.4g} s, {rate:.5g} Hz.", rate)
    if log.duration * rate < 200:
        add(
            "too_short",
            Severity.WARNING,
            f"Only {len(log)} samples: filters lose a good part of them, and few parameters can be told from the rest.",
        )
    gaps = np.flatnonzero(steps > 3.5 * clock.step)
    if len(gaps):
        longest = gaps[np.argmax(steps[gaps])]
        add(
            "gaps",
            Severity.WARNING,
            f"{len(gaps)} gap{'s' * (len(gaps) > 1)} in time, the longest {steps[longest] * 1e3:.4g} ms at {log.t[longest]:.6g} s."
            " Short ones are bridged where the motion is slow enough; longer ones cut the run, and the filters lose"
            " their transient on either side."
            " Log with a real-time buffer if they are many.",
            float(steps[longest]),
        )
    uneven = clock.jitter / clock.step
    if not len(gaps) and is_even(log.t, rate, clock.resolution):
        return out
    if uneven > 0.005:
        add(
            "jitter",
            Severity.WARNING if uneven > 0.05 else Severity.INFO,
            f"Steps vary by {uneven:.1%} (rms). The stamps are believed and the run is resampled; counting samples as equally spaced would"
            " distort velocities and accelerations by as much. If the stamps were taken late by the recorder and not"
            " by the drive, this is noise.",
            uneven,
        )
    return out
