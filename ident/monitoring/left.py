"""What no change accounts for: structure in the new logs that the fit's own do not have, and a residual larger than theirs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.quality import jumps
from ..diagnosis.thresholds import LOUDER
from .result import Drift

if TYPE_CHECKING:
    from ..diagnosis.inference.decide import Decision
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray


def unknown(estimate: Estimate, signals: Signals) -> tuple[Drift, ...]:
    """Joints with torque in the new logs of which the fit has no row: neither their parameters nor their noise are known."""
    names = estimate.model.robot.joint_names
    text = (
        "the fit was made without a usable row of it (no motion, or no torque), so that a change there cannot be"
        " detected; fit again with more motion"
    )
    blind = (estimate.fit_error.rows == 0) & signals.valid.any(axis=0)
    return tuple(Drift(names[j], "not known from the fit", f"{names[j]}: {text}") for j in blind.nonzero()[0].tolist())


def left_of(decision: Decision, before: Collection[tuple[str, tuple[str, ...]]], signals: Signals) -> tuple[Drift, ...]:
    """What the decision leaves, once a joint, but for what the fit's own logs leave, too; and positions that jump."""
    found: dict[tuple[str, ...], Drift] = {}
    for x in sorted(decision.left, key=lambda x: (x.named, -x.z)):
        if (x.name, x.joints) not in before and x.joints not in found:
            where = ", ".join(x.joints) or "the whole robot"
            said = f"{where}: the residual depends on {x.name} (z {x.z:.1f}, chance and tolerance explain up to {decision.critical:.1f})"
            found[x.joints] = Drift(x.joints[0] if x.joints else "", x.name, said)
    return (*found.values(), *(Drift(u.joint, u.signature, u.evidence) for u in jumps(signals)))


def louder(names: Sequence[str], usual: Array, here: Array, left: Mapping[str, Drift]) -> tuple[Drift, ...]:
    """Joints whose residual stays larger than on the fit's own logs with all changes in the model: rms (n,) there and here."""
    found = []
    for joint, there, now in zip(names, usual, here, strict=True):
        if there > 0 and now > LOUDER * there:
            follows = f"and follows {left[joint].signature}" if joint in left else "like noise"
            said = f"{joint}: the residual is {now / there:.2g} times as large as on the fit's own logs (rms), {follows}"
            found.append(Drift(joint, left[joint].signature if joint in left else "like noise", said))
    return tuple(found)
