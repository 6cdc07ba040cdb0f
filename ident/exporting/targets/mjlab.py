"""mjlab: actuator configurations for `EntityArticulationInfoCfg(actuators=...)`."""

from __future__ import annotations

import re

from ..actuation import Actuation, JointActuator
from ..identified import Identified
from ..omitted import omissions
from ..python_text import header
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target


@register_target
class MjlabTarget(ExportTarget):
    """`BuiltinPositionActuatorCfg` per joint; `BuiltinPdActuatorCfg` with a velocity command, `BuiltinMotorActuatorCfg` without gains."""

    name = "mjlab"
    title = "mjlab actuators"
    expresses = frozenset({Expressed.ARMATURE, Expressed.DAMPING, Expressed.DRY_FRICTION, Expressed.DELAY, Expressed.VELOCITY_COMMAND})

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        law = Actuation.of(found)
        kind = "Motor" if law.law is None else "Pd" if law.velocity_command else "Position"
        delayed = any(a.delay_s > 0 for a in law.actuators)
        notes = (*found.notes, *_notes(kind, delayed), *omissions(found, self.expresses, options))
        lines = [header(found, "mjlab actuators", notes), f"from mjlab.actuator import Builtin{kind}ActuatorCfg", ""]
        if delayed:
            lines += ["PHYSICS_DT = 0.005  # s, the physics step of your scene (MujocoCfg.timestep)", ""]
        lines.append("ACTUATORS = (")
        for actuator in law.actuators:
            lines += _entry(actuator, kind)
        return WrittenFile("\n".join([*lines, ")", ""]), notes)


def _entry(actuator: JointActuator, kind: str) -> list[str]:
    values = {"target_names_expr": f"({re.escape(actuator.joint)!r},)"}
    if kind != "Motor":
        values |= {"stiffness": repr(actuator.kp), "damping": repr(actuator.kd)}
    if actuator.limited:
        values["effort_limit"] = repr(actuator.effort_limit)
    elif kind == "Motor":
        values["effort_limit"] = 'float("inf")'
    values |= {
        "armature": repr(actuator.armature),
        "frictionloss": repr(actuator.dry),
        "viscous_damping": repr(actuator.damping),
    }
    if actuator.delay_s > 0:
        values |= dict.fromkeys(("delay_min_lag", "delay_max_lag"), f"round({actuator.delay_s!r} / PHYSICS_DT)")
    return [f"    Builtin{kind}ActuatorCfg(", *(f"        {key}={value}," for key, value in values.items()), "    ),"]


def _notes(kind: str, delayed: bool) -> list[str]:
    notes = ["armature, frictionloss and viscous_damping replace those of the joint in the MJCF (mjlab 1.6)."]
    if delayed:
        notes.append("the delay is a whole number of physics steps, counted at PHYSICS_DT: set it to that of your scene.")
    if kind == "Motor":
        notes.append("this fit has no gains: efforts are commanded; a limit that the URDF does not give is infinite.")
    return notes
