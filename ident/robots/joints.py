"""Joints of a tree: those that move, those that are held, and linear closures of loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, unknown_name
from .urdf import UrdfText

if TYPE_CHECKING:
    pass

Array = np.ndarray
#: rad or m: beyond it, a number is no position of a joint, and sums of it overflow.
_FARTHEST = 1e6


@dataclass(frozen=True)
class Joint:
    """A joint of the tree. `kind` is "revolute", "continuous" or "prismatic"; limits are in rad or m, infinite where unknown.
    `damping`, `friction`: what the URDF's <dynamics> says of its viscous and dry friction (N m s/rad, N m; N s/m, N), zero if nothing.
    No fit uses them: they are nominal values, as the URDF's inertials are."""

    name: str
    kind: str
    lower: float
    upper: float
    velocity: float
    effort: float
    damping: float = 0.0
    friction: float = 0.0

    @property
    def prismatic(self) -> bool:
        return self.kind == "prismatic"


@dataclass(frozen=True, eq=False)
class Loop:
    """A linear loop closure: q_tree = W q + offset, hence τ = Wᵀ τ_tree (parallelograms, mimic joints).

    `W` (n_tree, n), `offset` (n_tree,)."""

    W: Array
    offset: Array

    @cached_property
    def is_trivial(self) -> bool:
        """It closes nothing: tree joints are the joints."""
        return self.W.shape[0] == self.W.shape[1] and np.array_equal(self.W, np.eye(len(self.W))) and not self.offset.any()


def held_joints(
    urdf: UrdfText, moving: Sequence[str], locked: Mapping[str, float], keep: Sequence[str] | None, loop: Mapping[str, Mapping[str, float]]
) -> dict[str, float]:
    """Joint → position of every joint that does not move: locked ones, those not kept, and the followers of such."""
    held = {}
    for joint, position in locked.items():
        if joint not in moving:
            raise unknown_name("joint in `locked`", joint, moving)
        if joint in loop:
            raise ConfigurationError(f"joint {joint!r} is both locked and dependent ([loop]); it can only be one of them.")
        held[joint] = float(position)
        if not abs(held[joint]) <= _FARTHEST:
            raise ConfigurationError(f"joint {joint!r} is locked at {position}, which is not a plausible position of a joint.")
    masters = {m.joint: m for m in urdf.mimics if m.joint not in held and m.joint not in loop}
    if keep is not None:
        for joint in keep:
            if joint not in moving:
                raise unknown_name("joint in `joints`", joint, moving)
            if joint in masters and masters[joint].master not in keep:
                raise ConfigurationError(f"joint {joint!r} mimics {masters[joint].master!r}; keep that joint, and this one follows it.")
        held = {j: 0.0 for j in moving if j not in keep and j not in loop and j not in masters} | held
    for joint, mimic in masters.items():
        if mimic.master in held or mimic.master not in moving:  # a fixed joint is at zero
            held[joint] = mimic.multiplier * held.get(mimic.master, 0.0) + mimic.offset
    return held


def closure_of(urdf: UrdfText, tree_joints: tuple[Joint, ...], loop: Mapping[str, Mapping[str, float]]) -> tuple[Loop, tuple[Joint, ...]]:
    """The closure by mimic joints and by the rules of [loop], and the joints that are independent under it."""
    names = [j.name for j in tree_joints]
    if "offset" in names and (loop or urdf.mimics):
        raise ConfigurationError("a joint is named 'offset', which is the constant of a rule ([loop], <mimic>): rename the joint.")
    rules: dict[str, dict[str, float]] = {m.joint: {m.master: m.multiplier, "offset": m.offset} for m in urdf.mimics if m.joint in names}
    for joint, rule in loop.items():
        if joint not in names:
            raise unknown_name("joint in [loop]", joint, names)
        rules[joint] = {k: float(v) for k, v in rule.items()}
    free = [j for j in names if j not in rules]
    if not free:
        raise ConfigurationError("[loop] leaves no independent joint.")
    W = np.zeros((len(names), len(free)))
    offset = np.zeros(len(names))
    for row, joint in enumerate(names):
        if joint in free:
            W[row, free.index(joint)] = 1.0
            continue
        for master, factor in rules[joint].items():
            if master == "offset":
                offset[row] = factor
            elif master in free:
                W[row, free.index(master)] = factor
            else:
                raise ConfigurationError(
                    f"[loop] joint {joint!r} depends on {master!r}, which is not an independent joint ({', '.join(free)})."
                )
    return Loop(W, offset), tuple(j for j in tree_joints if j.name in free)
