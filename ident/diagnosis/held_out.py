"""What data that no choice saw say of a diagnosis: they confirm it, or they make it unexplained. They change no finding."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .prediction_variance import prediction_variance, share_variance
from .result import Undetermined, Unexplained
from .thresholds import HALF, LOUD, MATERIAL, STRETCH, WORSE

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .inference.confidence_set import AcceptedEffect

#: Rows of a joint below which its error on data held out says nothing.
_ROWS = 50
#: Blocks of time of each run over which standard errors are taken.
_BLOCKS = 20


def presence(without: Estimate, whole: Estimate, data: Signals) -> tuple[float, float]:
    """Share of what an effect predicts on data that is there, with its standard error over blocks of time.

    The two models' predictions differ by d. If the effect is what acts, the residual without it holds d once: its regression on d, rows
    weighted by the noise and by how far the fit's own uncertainty lets the prediction be off, is 1. If the effect stood for something else,
    which is not there, it is 0. The standard error holds both. NaN where the two do not differ."""
    rw, ra = without.residual(data), whole.residual(data)
    there = np.isfinite(rw + ra)
    d, r = (np.where(there, x, 0.0) for x in (rw - ra, rw))
    noise = np.maximum(np.asarray(whole.fit_error.rms), 1e-300) ** 2
    with np.errstate(invalid="ignore"):
        weight = np.where(there, 1.0 / (noise + prediction_variance(whole, data)), 0.0)
    weight = np.where(np.isfinite(weight), weight, 0.0)
    edges = [np.linspace(run.start, run.stop, _BLOCKS + 1).astype(int) for run in data.row_runs]
    parts = [slice(a, b) for e in edges for a, b in itertools.pairwise(e) if b > a]
    along, own = (np.array([np.sum(weight[part] * x[part] * d[part]) for part in parts]) for x in (r, d))
    if not own.sum() > 0 or len(parts) < 3:
        return float("nan"), float("nan")
    share = float(along.sum() / own.sum())
    left = (along.sum() - along) / np.maximum(own.sum() - own, 1e-300)
    by_blocks = (len(parts) - 1) * np.mean((left - left.mean()) ** 2)
    # One error of a parameter is in all blocks, which do not tell it from what is there.
    return share, float(np.sqrt(by_blocks + share_variance(whole, data, weight * d) / own.sum() ** 2))


def contradicted(named: Sequence[AcceptedEffect], shares: Sequence[tuple[float, float]]) -> tuple[Unexplained, ...]:
    """Accepted effects that are not there as predicted on data held out: the whole is ruled out, and less than half is seen."""
    return tuple(_missing(x.effect.name, x.joints, share) for x, share in zip(named, shares, strict=True) if _ruled_out(share))


def confirmed(share: tuple[float, float]) -> bool:
    """All that an effect predicts is there on data held out, and told to be, to within what is not material. What stands for something else
    is seldom so: beside something left, 15 of 22 right first names were and 1 of 21 wrong ones (logs of the benchmark)."""
    return abs(share[0] - 1.0) <= MATERIAL and share[1] <= MATERIAL


def unconfirmed(share: tuple[float, float]) -> bool:
    """Data held out do not tell what an effect predicts there from nothing, or have less of it by more than chance and what is immaterial.

    Beside nothing left, 2 of 197 right names of one half and more on logs of the benchmark were so, and 6 of 16 wrong ones. More than is
    predicted speaks against the size and not against the name."""
    present, std = share
    return bool(np.isfinite(std) and (present <= WORSE * std or partly(share)))


def partly(share: tuple[float, float]) -> bool:
    """Data held out have less of what an effect predicts than chance and what is immaterial explain, and more than nothing."""
    present, std = share
    return bool(WORSE * std < present < 1.0 - MATERIAL - WORSE * std)


def heaps(named: Sequence[AcceptedEffect]) -> list[list[int]]:
    """Which accepted effects share one joint, two or more."""
    of_joint: dict[tuple[str, ...], list[int]] = {}
    for i, x in enumerate(named):
        if len(x.joints) == 1:
            of_joint.setdefault(x.joints, []).append(i)
    return [own for own in of_joint.values() if len(own) > 1]


def contradicted_heap(named: Sequence[AcceptedEffect], share: tuple[float, float]) -> tuple[Unexplained, ...]:
    """The same of all that is accepted on one joint, by the share of what it predicts together: each may borrow from the others."""
    names = ", ".join(x.effect.name for x in named)
    return (_missing(f"{names} together", named[0].joints, share),) if _ruled_out(share) else ()


def _ruled_out(share: tuple[float, float]) -> bool:
    return share[0] < HALF and share[0] + WORSE * share[1] < 1.0


def _missing(name: str, joints: tuple[str, ...], share: tuple[float, float]) -> Unexplained:
    where = ", ".join(joints) or "the whole robot"
    predict = "predict" if name.endswith("together") else "predicts"
    said = (
        f"{where}: only {share[0]:.2f} ± {share[1]:.1g} of what {name} {predict} is present in the held-out data:"
        " it stands for something else in the fitted data"
    )
    return Unexplained(joints[0] if joints else "", "data held out", said, 0.0)


def louder(after: Estimate, fitted: Signals, held: Signals) -> tuple[Unexplained, ...]:
    """Joints whose error on data held out is far above what the same model leaves on the data fitted, and what the uncertainty of its
    parameters makes of it there."""
    return tuple(
        Unexplained(
            joint,
            "data held out",
            f"{joint}: its error on held-out data is {beside:.1f} times the error on fitted data; the model does not hold there"
            " (something acted in only one part of the log, or the motion left the range of the fitted data)",
            0.0,
        )
        for joint, _, beside in _times_the_fitted(after, fitted, held)
        if beside > LOUD
    )


def undetermined(after: Estimate, fitted: Signals, held: Signals) -> tuple[Undetermined, ...]:
    """Joints whose error on data held out is as far above, but no farther than the uncertainty of the parameters lets it be: the data
    fitted do not determine the torque of that motion, and its error speaks neither for the model nor against it."""
    found = _times_the_fitted(after, fitted, held)
    return tuple(Undetermined(joint, plain) for joint, plain, beside in found if plain > LOUD >= beside)


def _times_the_fitted(after: Estimate, fitted: Signals, held: Signals) -> Iterator[tuple[str, float, float]]:
    """Each joint with enough rows: its error on data held out over that on the data fitted, as it is, and in units of what noise and the
    uncertainty of the parameters make of it together.

    Sizes are those that a tenth of the rows exceeds: no single stretch decides (rows beside a reversal, where a joint sticks, are loud)."""
    own, other = (np.abs(after.residual(s)) for s in (fitted, held))
    with np.errstate(invalid="ignore", divide="ignore"):
        allowed = np.sqrt(1.0 + prediction_variance(after, held) / np.asarray(after.fit_error.rms) ** 2)
    for j, joint in enumerate(after.model.robot.joint_names):
        usual, read = own[:, j][np.isfinite(own[:, j])], np.isfinite(other[:, j])
        if len(usual) < _ROWS or np.count_nonzero(read) < _ROWS:
            continue
        size = max(float(np.quantile(usual, 1.0 - STRETCH)), 1e-300)
        here = other[read, j]
        plain, beside = (float(np.quantile(x, 1.0 - STRETCH)) / size for x in (here, here / allowed[read, j]))
        yield joint, plain, beside
