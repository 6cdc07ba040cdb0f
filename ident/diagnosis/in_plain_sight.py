"""What no search over effects sees, but anyone who looks: positions that jump, held-out data that are of another kind."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .findings import Unexplained

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..signals import Signals

#: Errors on held-out data that are so many times those on fitted data are no scatter, from so many rows on.
_APART = 2.0
_FEW = 100


def jumps(signals: Signals) -> tuple[Unexplained, ...]:
    """Joints whose recorded position jumps (an encoder that slips, a wrong sample): what is around a jump is lost to any fit."""
    from ..audit_checks import check_columns

    found = {}
    for log in () if signals.source is None else signals.source:
        for finding in check_columns(log, signals.robot):
            if finding.code == "spike" and finding.where not in found:
                said = f"{finding.where}: {finding.text} (log {log.name}) If it stays away after that, the encoder or a coupling slipped."
                found[finding.where] = Unexplained(finding.where, "a jump of its position", said, 0.0)
    return tuple(found.values())


def apart(after: Estimate, fitted: Signals, held: Signals) -> tuple[Unexplained, ...]:
    """Joints on which the fit fails on held-out data as it does not on its own: something is there that was not before."""
    inside, outside = after.torque_error(fitted).rms, after.torque_error(held).rms
    enough = (fitted.valid.sum(axis=0) >= _FEW) & (held.valid.sum(axis=0) >= _FEW)
    found = []
    for j in enough.nonzero()[0].tolist():
        joint, ratio = after.model.robot.joint_names[j], outside[j] / max(inside[j], 1e-300)
        if ratio > _APART:
            said = (
                f"{joint}: the error on held-out data is {ratio:.3g} times that on fitted data: something is in that part of the logs that"
                " the fitted part does not hold (a change, a slip, motion outside the range); nothing here can say what"
            )
            found.append(Unexplained(joint, "the part of the logs held out", said, float(held.valid[:, j].sum() * (ratio**2 - 1.0))))
    return tuple(found)
