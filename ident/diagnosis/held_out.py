"""What data that no choice saw say of a diagnosis: they confirm it, or they make it unexplained. They change no finding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .result import Unexplained
from .thresholds import LOUD, MATERIAL, STRETCH, WORSE

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..evaluation.comparison import Comparison
    from ..signals.signals import Signals
    from .inference.confidence_set import AcceptedEffect

#: Rows of a joint below which its error on data held out says nothing.
_ROWS = 50


def contradicted(named: tuple[AcceptedEffect, ...], without: tuple[Comparison, ...]) -> tuple[Unexplained, ...]:
    """Findings that make the error on data held out larger, beyond chance. `without`: for each, the model without it against the whole."""
    found = []
    for x, c in zip(named, without, strict=True):
        if c.gain < -MATERIAL and c.gain < -WORSE * c.gain_std:
            where = ", ".join(x.joints) or "the whole robot"
            said = (
                f"{where}: with {x.effect.name} the squared error on data held out grows by {-100 * c.gain:.0f} ± {100 * c.gain_std:.0f} %:"
                " it stands for something else that the data fitted hold"
            )
            found.append(Unexplained(x.joints[0] if x.joints else "", "data held out", said, 0.0))
    return tuple(found)


def louder(after: Estimate, fitted: Signals, held: Signals) -> tuple[Unexplained, ...]:
    """Joints whose error on data held out is far above what the same model leaves on the data fitted.

    Sizes are those that a tenth of the rows exceeds: no single stretch decides (rows beside a reversal, where a joint sticks, are loud)."""
    found = []
    own, other = (np.abs(after.residual(s)) for s in (fitted, held))
    for j, joint in enumerate(after.model.robot.joint_names):
        usual, here = (x[:, j][np.isfinite(x[:, j])] for x in (own, other))
        if len(usual) < _ROWS or len(here) < _ROWS:
            continue
        ratio = float(np.quantile(here, 1.0 - STRETCH) / max(np.quantile(usual, 1.0 - STRETCH), 1e-300))
        if ratio > LOUD:
            said = (
                f"{joint}: its error on data held out is {ratio:.1f} times the error on the data fitted; the model does not hold there"
                " (something acted in one part of the log alone, or the motion reached where it had not been)"
            )
            found.append(Unexplained(joint, "data held out", said, 0.0))
    return tuple(found)
