"""What this motion could not have shown, however surely nothing was found: the least size at which each effect would be seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.places import motors_of
from ..robots.transmission import Side
from .advice import motion_for
from .result import Hidden

if TYPE_CHECKING:
    from .inference.decide import Decision

#: An effect is told if what it could be without being seen makes up this share of its joint's torque; from ten times on no robot has it.
_SHARE, _ANY = 0.3, 10.0


def undetectable(decision: Decision) -> tuple[Hidden, ...]:
    """Effects of one parameter that may be large without being seen beside the decision's model, the largest first; none that it names."""
    scores, fit = decision.scores, decision.fit
    robot, critical = fit.robot, decision.critical
    found: list[Hidden] = []
    named = {(x.effect.name, x.joints) for x in decision.named}
    torque = np.concatenate([run.torque for run in fit.runs])
    spread = torque.std(axis=0)
    for g, square in zip(scores.catalogue.groups, scores.squares, strict=True):
        effect = g.effect
        if effect is None or effect.shape() or len(g.columns) != 1 or g.kind in named:
            continue
        left = float(square[0, 0])
        if not left > 0:
            continue
        least = critical / np.sqrt(left)
        values = np.concatenate([effect.columns(m, robot) for m in fit.motions(instrument=True)])[:, :, 0]
        if effect.side != Side.MOTOR:
            values = values @ robot.transmission.torque_map(effect.side, Side.MOTOR).T
        size = values.std(axis=0)
        size = np.where(size > 1e-3 * np.abs(values).max(axis=0, initial=0.0), size, np.abs(values).mean(axis=0))
        shares = np.where(spread > 0, least * size / np.maximum(spread, 1e-300), 0.0)
        m = int(np.argmax(shares))
        if not _SHARE <= shares[m] <= _ANY * 1e6:
            continue
        p = effect.parameters(robot)[0]
        joint = robot.joint_names[m]
        made = float(least * size[m])
        advice = motion_for(effect, g.joints[0] if g.joints else joint)
        found.append(
            Hidden(effect.name, g.joints, motors_of(effect), p.name.replace("+", ""), p.unit, float(least), joint, made,
                   robot.force_unit(m, Side.MOTOR), float(shares[m]), advice)
        )  # fmt: skip
    return tuple(sorted(found, key=lambda h: -h.share))
