"""What motion would reveal a parameter: advice in words, from the kind of parameter and the joint it sits on."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..regressor.base_parameters.reduction import BaseReduction
    from ..robots.robot import Robot

_KIND = {
    "m": "inertia", "mx": "moment", "my": "moment", "mz": "moment",
    "Ixx": "inertia", "Ixy": "product", "Iyy": "inertia", "Ixz": "product", "Iyz": "product", "Izz": "inertia",
}  # fmt: skip
_TEXT = {
    "inertia": "accelerate {joint} harder and reverse it often, with the joints beyond it in several postures",
    "product": "accelerate {joint} together with {before}, in several postures",
    "moment": "move {joint} slowly through its whole range (gravity) and accelerate {before}",
    "rotor_inertia": "accelerate {joint} hard in postures where the load inertia differs",
    "viscous": "run {joint} at several speeds up to its highest, both ways",
    "coulomb": "run {joint} slowly and steadily, both ways",
    "offset": "run {joint} both ways through the same positions",
}


def advice(robot: Robot, base: BaseReduction, names: tuple[str, ...]) -> tuple[str, ...]:
    """Sentences that say which motion reveals the named base parameters, one per kind and joint, at most six."""
    by_name = {p.name: p for p in base.parameters}
    order = [j.name for j in robot.tree_joints]
    said: dict[str, None] = {}
    for name in names:
        p = by_name[name]
        kind = _KIND.get(name.split("_", 1)[0], "inertia") if p.effect == "rigid_body" else p.effect
        text = _TEXT.get(kind)
        if text is None or not p.joint:
            continue
        place = order.index(p.joint) if p.joint in order else 0
        said[text.format(joint=p.joint, before=order[place - 1] if place else "the others")] = None
    chosen = list(said)[:6]
    return tuple(f"To reveal: {sentence}." for sentence in chosen)
