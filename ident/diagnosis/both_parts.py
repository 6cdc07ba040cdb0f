"""Fitted and held-out data looked at as one, where the error is larger on those held out: something sits in them alone, or mostly.

A fault that began late, a motor that meets its limit in one stretch: a fit of the other part hardly knows of it. Both together may tell
what it is. What a search without every other block of the data held out names as well, these blocks may confirm; if not, nothing is
left that could, and that is said."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DataError
from ..signals.signals import Signals

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..evaluation.comparison import Comparison
    from ..signals.signals import JointReport
    from .findings import Unexplained

_TOGETHER = (
    "the error on the data held out is larger than on those fitted, so both were searched together: findings, fit and errors are those of"
    " all rows"
)
#: What is said of a diagnosis of both parts that nothing confirms.
SAID = f"{_TOGETHER}, and no data are left that could confirm them. Log more of the motion of the part held out."

#: Blocks of each run held out, every other of which is searched.
_BLOCKS = 8

#: Relative difference of sampling rates, each the median of a part's own steps, that is one of rounding.
_AS_FAST = 1e-6


def together(fit: Signals, held: Signals) -> Signals | None:
    """Runs of both parts as one; None where they were not prepared alike, or do not lie in memory."""
    alike = type(fit) is Signals and type(held) is Signals and np.isclose(fit.rate, held.rate, rtol=_AS_FAST) and _same_rows(fit, held)
    if not alike:
        return None
    after = len(fit.t)
    samples: dict[str, Any] = {
        key: np.concatenate([getattr(fit, key), getattr(held, key)]) for key in ("t", "q", "dq", "ddq", "torque", "tau", "valid")
    }
    turning = None if fit.turning is None or held.turning is None else np.concatenate([fit.turning, held.turning])
    return replace(
        fit,
        **samples,
        runs=(*fit.runs, *(slice(r.start + after, r.stop + after) for r in held.runs)),
        run_names=(*fit.run_names, *held.run_names),
        origins=(*fit.origins, *held.origins),
        inputs=(*fit.inputs, *(x for x in held.inputs if x not in fit.inputs)),
        report=replace(
            fit.report,
            samples_read=fit.report.samples_read + held.report.samples_read,
            samples=fit.report.samples + held.report.samples,
            rows=fit.report.rows + held.report.rows,
            joints=tuple(_of_both(*pair) for pair in zip(fit.report.joints, held.report.joints, strict=True)),
            warnings=tuple(dict.fromkeys((*fit.report.warnings, *held.report.warnings))),
        ),
        source=None,
        turning=turning,
    )


def halved(fit: Signals, held: Signals) -> tuple[Signals, Signals] | None:
    """The fitted part with every other block of the one held out, and the blocks between; None where that cannot be."""
    try:
        searched, between = held.split("blocks", held=0.5, blocks=_BLOCKS)
    except DataError:  # too short
        return None
    both = together(fit, searched)
    return None if both is None else (both, between)


def confirmed_by_half(between: Comparison) -> str:
    """What is said of a diagnosis of both parts, where a search without some blocks found the same; `between`: the comparison on these."""
    before, after = (100.0 * e.relative_all for e in (between.error_before, between.error_after))
    return (
        f"{_TOGETHER}. Without every other block of the data held out the same was found, and in these blocks, which that fit and search"
        f" did not see, the torque error falls from {before:.3g} to {after:.3g} % (the squared error, weighted by noise, by"
        f" {100 * between.gain:.1f} ± {100 * between.gain_std:.1f} %)."
    )


def unconfirmed(beyond: Sequence[Unexplained], names: Sequence[str]) -> str:
    """What is said of a diagnosis that stands, though the error on held-out data is larger on some joints, and a search of both parts names
    something else."""
    joints = ", ".join(dict.fromkeys(u.joint for u in beyond))
    return (
        f"the error on held-out data is larger than on fitted data on {joints}. A search of both together finds {', '.join(names)}, but"
        " blocks of the part held out, left out of it, do not confirm that; log more of the motion of that part."
    )


def _same_rows(fit: Signals, held: Signals) -> bool:
    one, other = fit.row_filter, held.row_filter
    if one is None or other is None:
        return one is other
    return (
        one.factor == other.factor
        and len(one.taps) == len(other.taps)
        and np.allclose(one.taps, other.taps, rtol=0.0, atol=_AS_FAST * np.abs(one.taps).max())
    )


def _of_both(one: JointReport, other: JointReport) -> JointReport:
    lost = {reason: one.lost.get(reason, 0) + other.lost.get(reason, 0) for reason in (*one.lost, *other.lost)}
    top = max(one.top_speed, other.top_speed)
    return replace(one, rows=one.rows + other.rows, lost=lost, top_speed=top, repeats=one.repeats + other.repeats)
