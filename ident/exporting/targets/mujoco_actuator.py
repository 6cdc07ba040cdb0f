"""MJCF with actuators: the drives' gains, limits and delay as MuJoCo's own actuators."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..actuation import Actuation, JointActuator
from ..identified import Identified
from ..mjcf import mjcf_text
from ..omitted import omissions
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target
from .mjcf_file import JOINTS, spring_attributes

#: The shortest step of a simulation whose buffer of commands holds the delay, s.
_SHORTEST_STEP = 1e-4


@register_target
class MujocoActuatorTarget(ExportTarget):
    """`position` (with a velocity command also `velocity`) actuators, `general` ones where a constant torque or a filter of commands is in
    them, `motor` for fits of measured torque."""

    name = "mujoco_actuator"
    title = "MJCF with actuators"
    expresses = JOINTS | {Expressed.OFFSET, Expressed.SPRING, Expressed.DELAY, Expressed.VELOCITY_COMMAND, Expressed.COMMAND_FILTER}

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        from lxml import etree

        law = Actuation.of(found)
        springs = spring_attributes(law)
        text, notes = mjcf_text(found.robot, found.inertial, found.drive(), {**found.beside(), **springs})
        root = etree.fromstring(text, etree.XMLParser(remove_blank_text=True))
        section, constant, summed = etree.SubElement(root, "actuator"), False, False
        for j, actuator in enumerate(law.actuators):
            offset = 0.0 if springs and springs["stiffness"][j] > 0 else actuator.offset
            nodes = _nodes(actuator, offset, law.velocity_command)
            section.extend(nodes)
            constant = constant or offset != 0.0
            if len(nodes) > 1 and actuator.limited:
                # The limit is of the sum of what acts on the joint.
                joint = next(node for node in root.iter("joint") if node.get("name") == actuator.joint)
                joint.set("actuatorfrcrange", _range(actuator.effort_limit))
                summed = True
        more = []
        if constant:
            more.append(
                "a constant offset is part of the actuator's bias; forcerange is shifted by it, so that the drive keeps its own limit."
            )
        if summed:
            more.append("position and velocity actuators share a joint; actuatorfrcrange limits their sum.")
        if any(a.delay_s > 0 for a in law.actuators):
            most = max(a.delay_s for a in law.actuators)
            more.append(
                f"delay (up to {1e3 * most:.2f} ms) is rounded up to whole steps, and acts on zero commands first: fill the"
                " buffer with mj_initCtrlHistory. MuJoCo before 3.5 does not know it: take nsample and delay out for those."
            )
        if any(a.command_lag_s for a in law.actuators):
            more.append("the filter of commands begins at zero: set the activations (mjData.act) to the first commands.")
        expresses = self.expresses if springs or not np.any(law.spring) else self.expresses - {Expressed.SPRING}
        content = etree.tostring(root, pretty_print=True, encoding="unicode")
        return WrittenFile(content, (*found.notes, *notes, *more, *omissions(found, expresses, options)))


def _nodes(actuator: JointActuator, offset: float, rates: bool) -> list[Any]:
    """The elements of one joint's actuator."""
    if actuator.kp is None or actuator.kd is None:
        return [_node("motor", actuator, "torque", offset, {}, limited=True)]
    kp, kd = actuator.kp, actuator.kd
    if not rates:
        return [_node("position", actuator, "position", offset, {"kp": repr(kp), "kv": repr(kd)}, limited=True)]
    velocity = _node("velocity", actuator, "velocity", offset if kp == 0.0 else 0.0, {"kv": repr(kd)}, limited=kp == 0.0)
    if kp == 0.0:
        return [velocity]
    return [_node("position", actuator, "position", offset, {"kp": repr(kp)}, limited=False), velocity]


def _node(tag: str, actuator: JointActuator, what: str, offset: float, gains: dict[str, str], *, limited: bool) -> Any:
    from lxml import etree

    common = {"name": f"{actuator.joint}_{what}", "joint": actuator.joint}
    if offset == 0.0 and not actuator.command_lag_s:
        node = etree.Element(tag, {**common, **gains})
    else:
        kp, kv = float(gains.get("kp", 0.0)), float(gains.get("kv", 0.0))
        gain = {"motor": 1.0, "position": kp, "velocity": kv}[tag]
        bias = f"{-offset!r} {-kp!r} {-kv!r}"
        node = etree.Element("general", {**common, "gainprm": repr(gain), "biastype": "affine", "biasprm": bias})
        if actuator.command_lag_s and tag != "motor":
            node.attrib.update({"dyntype": "filterexact", "dynprm": repr(actuator.command_lag_s)})
    if limited and actuator.limited:
        # The drive's limit is of its own torque; the constant one lies outside of it.
        node.set("forcerange", f"{-actuator.effort_limit - offset!r} {actuator.effort_limit - offset!r}")
    if actuator.delay_s > 0:
        node.set("nsample", str(int(np.ceil(actuator.delay_s / _SHORTEST_STEP))))
        node.set("delay", repr(actuator.delay_s))
    return node


def _range(limit: float) -> str:
    return f"{-limit!r} {limit!r}"
