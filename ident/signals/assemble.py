"""From derived runs to signals: rows and the report."""

from __future__ import annotations

import math
from collections.abc import Sequence, Sized
from typing import Protocol, TypeVar

import numpy as np

from .._utils.text import counted
from ..errors import DataError
from ..robots.robot import Robot
from ..robots.urdf import some
from .cutoff import CutoffChoice
from .filters import RowFilter
from .masks import Standstill, TorqueClipping, find_saturation
from .signals import JointReport, PreparationReport, Signals
from .sound import Derived, Pace, Settings, SoundRows, Whole
from .uniform import Recording, Resampling

Array = np.ndarray


def assemble(
    prep: Settings,
    robot: Robot,
    recordings: Sequence[Recording],
    uniform: Resampling,
    derived: Sequence[Derived],
    row_filter: RowFilter | None,
    choice: CutoffChoice,
    cutoff: float,
    inputs: tuple[dict[str, str], ...],
) -> Signals:
    """Concatenate runs, mask rows, report. Raises DataError if nothing is left."""
    kept, short = long_enough(derived, max(len(r) for r in uniform.runs), uniform.rate, cutoff, row_filter)
    warnings = [*dict.fromkeys(note for r in recordings for note in r.notes), *short]
    whole = Whole.of(kept)
    pace = Pace.of(robot, whole, uniform.rate, choice, cutoff, prep.standstill)
    cut = find_saturation(whole.torque, pace.moving)
    rows = SoundRows.of(kept, whole, pace, cut, prep, row_filter)
    absent = np.all([np.isnan(r.torque).all(axis=0) for r in recordings], axis=0)
    masked = prep.standstill is not None
    warnings += preparation_warnings(robot, pace.still, absent, masked, cut, prep.saturated, rows.valid, rows.lost)
    warnings += raised_shares(robot, prep.standstill, rows.allowed)
    warnings += _unheard(prep, choice, cutoff)
    require_motion(prep.standstill, pace.still, [r.name for r in recordings])
    report = PreparationReport(
        config=prep.config(),
        cutoff_hz=cutoff if prep.filters_positions else None,
        cutoff_reason=choice.reason if prep.cutoff_hz is None else f"as asked; from the data {choice.cutoff_hz:.3g} Hz: {choice.reason}",
        row_cutoff_hz=None if row_filter is None else half_gain(row_filter, uniform.rate),
        rate_hz=uniform.rate,
        row_rate_hz=uniform.rate / (row_filter.factor if row_filter else 1),
        samples_read=sum(len(r.t) for r in recordings),
        samples=len(whole.t),
        rows=len(rows.tau),
        resampled=uniform.text,
        joints=_joint_reports(choice, pace, rows),
        warnings=tuple(dict.fromkeys(warnings)),
    )
    names, origins = tuple(d.run.name for d in kept), tuple(d.run.origin for d in kept)
    w = whole
    return Signals(
        robot, w.t, w.q, w.dq, w.ddq, w.torque, rows.tau, rows.valid, w.runs, names, uniform.rate, row_filter, report, inputs, origins,
        near_reversal=rows.near_reversal,
    )  # fmt: skip


def _unheard(prep: Settings, choice: CutoffChoice, cutoff: float) -> list[str]:
    """What to say of joints whose noise was left out of the choice of the cut-off."""
    return [
        f"the position of {name} is so noisy, or jumps so far, that usable accelerations would need a cut-off that leaves"
        f" nothing of the log; the cut-off of {cutoff:.3g} Hz suits the other joints; do not trust what is fitted from {name}'s motion."
        for name in (choice.unheard if prep.cutoff_hz is None else ())
    ]


def _joint_reports(choice: CutoffChoice, pace: Pace, rows: SoundRows) -> tuple[JointReport, ...]:
    return tuple(
        JointReport(
            s.name,
            s.noise,
            s.suggested_hz,
            float(pace.top[j]),
            float(pace.threshold[j]),
            int(rows.valid[:, j].sum()),
            {k: int(v[:, j].sum()) for k, v in rows.lost.items()},
        )
        for j, s in enumerate(choice.joints)
    )


class _Run(Sized, Protocol):
    """A stretch of a log."""

    @property
    def name(self) -> str: ...


class _HasRun(Protocol):
    """A run with derivatives, as long as what is left of `run`."""

    @property
    def run(self) -> _Run: ...

    def __len__(self) -> int: ...


_D = TypeVar("_D", bound=_HasRun)


def long_enough(
    derived: Sequence[_D], longest: int, rate: float, cutoff: float, row_filter: RowFilter | None
) -> tuple[list[_D], list[str]]:
    """Those runs that the rows' filter fits into, and a warning of the others. `longest`: samples of the longest run at `rate` (Hz).

    Raises DataError if none is left."""
    need = len(row_filter.taps) if row_filter else 1
    kept = [d for d in derived if len(d) >= need]
    if not kept:
        # Transients at both ends (measured where something was left between them), and the length of the rows' filter.
        ends = max((len(d.run) - len(d) for d in derived if len(d)), default=math.ceil(6 / cutoff * rate))
        raise DataError(
            f"{of_logs([d.run.name for d in derived])}: the longest run without a gap lasts {longest / rate:.3g} s: too short for a"
            f" cut-off of {cutoff:.3g} Hz, whose filters need about {(ends + need) / rate:.2g} s. Record longer runs, or raise cutoff_hz."
        )
    left_out = len(derived) - len(kept)
    return kept, [f"{left_out} of {len(derived)} stretches are shorter than the filters and are left out."] if left_out else []


def raised_shares(robot: Robot, rule: Standstill | None, allowed: Array) -> list[str]:
    """What to say where the share of standstill that a row may hold, `allowed` (n,), was raised beyond the rule's."""
    raised = [f"{name} {allowed[j]:.0%}" for j, name in enumerate(robot.joint_names) if rule is not None and allowed[j] > rule.share]
    if not raised:
        return []
    text = (
        "velocity reversals are closely spaced for this cut-off; to keep enough rows, some that partly overlap standstill"
        " are used ({', '.join(raised)} of their weight at most). Coulomb friction may be off by a few per cent;"
        " a higher cut-off shortens the rows."
    )
    return [text]


def of_logs(names: Sequence[str]) -> str:
    """The logs that a message is about."""
    names = list(dict.fromkeys(names))
    return f"log{'s' * (len(names) > 1)} {some(names)}"


def require_motion(rule: Standstill | None, still: Array, names: Sequence[str]) -> None:
    """Raises DataError where no joint moves (`still` (n,) bool) in the logs of these names, and that is looked for."""
    if rule is not None and still.all():
        raise DataError(
            f"{of_logs(names)}: no joint moves: every speed stays within the noise of its position. There is no motion to"
            f" identify a model from."
            " For logs of standstill alone, prepare them with standstill = false."
        )


def half_gain(row_filter: RowFilter, rate: float) -> float:
    """Frequency at which the row filter's gain is one half, Hz."""
    low, high = 0.0, rate / 2
    f = np.linspace(low, high, 2 * (len(row_filter.taps) // 8) + 9)
    # Bracketed on a grid that no lobe of the filter escapes, then halved.
    for start in range(0, len(f), 64):
        below = np.flatnonzero(row_filter.gain(f[start : start + 64], rate) < 0.5)
        if len(below):
            high = float(f[start + below[0]])
            low = float(f[max(0, start + below[0] - 1)])
            break
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if row_filter.gain(np.array([middle]), rate)[0] < 0.5 else (middle, high)
    return high


def preparation_warnings(
    robot: Robot, still: Array, absent: Array, masked: bool, cut: TorqueClipping, saturated: str, valid: Array, lost: dict[str, Array]
) -> list[str]:
    """What to say of joints. `still`, `absent` (n,) bool: that never move, whose torque was not logged at all."""
    out = []
    if still.any():
        names = ", ".join(n for n, s in zip(robot.joint_names, still, strict=True) if s)
        what = "its rows are left out" if still.sum() == 1 else "their rows are left out"
        out.append(f"never moved: {names}" + (f"; {what}, and friction and inertia there stay unknown." if masked else "."))
    for j, name in enumerate(robot.joint_names):
        if np.isfinite(cut.limits[j]).any():
            at = " and ".join(f"{x:.4g}" for x in cut.limits[j] if np.isfinite(x))
            use = "left out" if saturated == "mask" else "kept, as asked"
            out.append(
                f"torque of {name} stays at its extreme ({at}) in {counted(int(cut.flag[:, j].sum()), 'sample')}: taken as saturated,"
                f" rows {use}."
            )
        rest = float(lost["standstill"][:, j].mean()) if len(valid) else 0.0
        if not still[j] and rest > 0.5:
            out.append(f"{rest:.0%} of the rows of {name} overlap standstill or reversals; they are left out.")
        if len(valid) and not valid[:, j].any() and not still[j] and not absent[j]:
            sparse = lost["torque missing"][:, j].all()
            out.append(
                f"no row of {name} can be used"
                + (
                    ": its torque is missing in so many samples that every row depends on one. If it is logged at a lower"
                    " rate than the positions, log it at the same rate, or remove the lines without it."
                    if sparse
                    else "."
                )
            )
    return out
