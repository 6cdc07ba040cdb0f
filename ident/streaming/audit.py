"""Audit of logs on disk: time stamps, ranges and missing torque of the whole log; everything else on an excerpt.

The excerpt is a stretch in which as many joints move as anywhere; a log no longer than it is audited whole, as in memory."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._utils.text import counted
from ..auditing.columns import check_columns, joint_limits
from ..auditing.findings import Audit, AuditFinding, Severity, merged_findings
from ..auditing.motion import check_motion
from ..auditing.time import Stamps, repairs, stamp_findings
from ..logs.spacing import GAP
from ..robots.robot import Robot
from .clock import clock_of, deviation, steps_of
from .stored import StoredLog

Array = np.ndarray
#: Samples of the excerpt.
EXCERPT = 1 << 16
#: Stretches among which the excerpt is chosen.
_CANDIDATES = 12
#: A joint moves in a stretch if it covers this share of its whole range there.
_MOVES = 0.1
#: Findings that only the whole log can tell.
_WHOLE = {"outside_limits", "torque_nan", "constant"}


def audit_stored(logs: Sequence[StoredLog], robot: Robot) -> Audit:
    """Audit logs on disk, run by run; see `ident.auditing.audit.audit`."""
    found: list[AuditFinding] = []
    for log in logs:
        found += repairs(log.name, log.notes)
        in_time = stamp_findings(log.name, stamps_of(log))
        found += in_time
        if any(f.severity == Severity.ERROR for f in in_time):
            continue
        found += _of_content(log, robot)
    return Audit(tuple(merged_findings(found, len(logs))), tuple(log.name for log in logs), robot.name)


def stamps_of(log: StoredLog) -> Stamps:
    """What is known of a run's time stamps, from one pass over them."""
    clock = clock_of(log.t)
    count, longest, place, at = 0, 0.0, 0, 0
    for steps in steps_of(log.t):
        gaps = np.flatnonzero(steps > GAP * clock.step)
        count += len(gaps)
        if len(gaps) and steps[gaps].max() > longest:
            longest, place = float(steps[gaps].max()), at + int(gaps[np.argmax(steps[gaps])])
        at += len(steps)
    even = not count and deviation(log.t, 1 / clock.step) <= clock.tolerance(1 / clock.step)
    return Stamps(len(log), float(log.t[0]), log.duration, clock, count, longest, float(log.t[place]), even)


def _of_content(log: StoredLog, robot: Robot) -> list[AuditFinding]:
    excerpt = _excerpt(log)
    whole = len(excerpt) == len(log)
    piece = log.read(excerpt.start, excerpt.stop)
    columns = check_columns(piece, robot)
    found = columns if whole else [f for f in columns if f.code not in _WHOLE]
    found += check_motion(piece, robot)
    if whole:
        return found
    survey = log.survey(robot.transmission)

    def add(code: str, severity: Severity, text: str, where: str = "", value: float = float("nan")) -> None:
        found.append(AuditFinding(code, severity, text, where, log.name, value))

    constant = [f for f in columns if f.code == "constant"]
    for j, joint in enumerate(robot.joints):
        if survey.high[j] == survey.low[j]:
            found += [f for f in constant if f.where == joint.name]
        elif not survey.jumps[j] and not any(f.code == "unit" and f.where == joint.name for f in columns):
            joint_limits(add, robot, j, joint.name, np.array([survey.low[j], survey.high[j]]))
        if 0 < survey.missing[j] < survey.rows:
            missing = int(survey.missing[j])
            text = f"Torque is missing in {counted(missing, 'sample')}; rows that depend on them are not used."
            add("torque_nan", Severity.WARNING, text, joint.name, missing / survey.rows)
    rate = len(log) / max(log.duration, 1e-300)
    add(
        "excerpt",
        Severity.INFO,
        f"The log is streamed: time stamps, ranges and missing torque were checked throughout, everything else in"
        f" {len(excerpt)} samples from {excerpt.start / rate:.4g} s on.",
        value=len(excerpt),
    )
    return found


def _excerpt(log: StoredLog) -> range:
    """The stretch in which as many joints move as anywhere; the middle one of several."""
    total = len(log)
    if total <= EXCERPT:
        return range(total)
    starts = np.unique(np.linspace(0, total - EXCERPT, _CANDIDATES).astype(int))
    # A few hundred samples tell how far a stretch goes.
    step = max(1, EXCERPT // 400)
    ranges = np.array([np.ptp(_sparse(log, int(a), step), axis=0) for a in starts])
    moving = (ranges > _MOVES * np.maximum(ranges.max(axis=0), 1e-300)).sum(axis=1)
    best = np.flatnonzero(moving == moving.max())
    start = int(starts[best[np.argmin(np.abs(starts[best] - (total - EXCERPT) / 2))]])
    return range(start, start + EXCERPT)


def _sparse(log: StoredLog, start: int, step: int) -> Array:
    return np.asarray(log.positions[start : start + EXCERPT : step])
