"""Isaac Lab: actuator configurations for `ArticulationCfg(actuators=...)`."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ..actuation import Actuation, JointActuator
from ..identified import Identified
from ..omitted import omissions
from ..python_text import header, table
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target

_UNITS = (
    "friction and dynamic_friction are efforts (N m), viscous_friction N m s/rad, as of Isaac Sim 5.0 (Isaac Lab 2.2); in Isaac Sim 4.5"
    " friction is a coefficient without unit: do not use this file there."
)


@register_target
class IsaacLabTarget(ExportTarget):
    """`ImplicitActuatorCfg`; `DelayedPDActuatorCfg` for joints whose drive has a delay. Friction as PhysX 5 has it: efforts in N m."""

    name = "isaaclab"
    title = "Isaac Lab actuators"
    expresses = frozenset(
        {
            Expressed.ARMATURE,
            Expressed.DAMPING,
            Expressed.DRY_FRICTION,
            Expressed.BREAKAWAY,
            Expressed.DELAY,
            Expressed.VELOCITY_COMMAND,
        }
    )

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        law = Actuation.of(found)
        delays = sorted({a.delay_s for a in law.actuators})
        notes = (*found.notes, *_notes(law, delays), *omissions(found, self.expresses, options))
        kinds = [name for name, used in (("DelayedPDActuatorCfg", delays[-1] > 0), ("ImplicitActuatorCfg", delays[0] == 0)) if used]
        lines = [header(found, "Isaac Lab actuators", notes), f"from isaaclab.actuators import {', '.join(kinds)}", ""]
        if delays[-1] > 0:
            lines += ["PHYSICS_DT = 0.005  # s, the physics step of your scene (SimulationCfg.dt)", ""]
        lines.append("ACTUATORS = {")
        for i, delay in enumerate(delays):
            group = [a for a in law.actuators if a.delay_s == delay]
            lines += _group("drives" if len(delays) == 1 else f"drives_{i + 1}", group, delay)
        return WrittenFile("\n".join([*lines, "}", ""]), notes)


def _group(name: str, group: Sequence[JointActuator], delay: float) -> list[str]:
    # Names are regular expressions there, matched as a whole.
    def of(key: str) -> str:
        return table({re.escape(a.joint): float(getattr(a, key)) for a in group}, "        ")

    lines = [f'    "{name}": {"DelayedPDActuatorCfg" if delay > 0 else "ImplicitActuatorCfg"}(']
    lines.append(f"        joint_names_expr={[re.escape(a.joint) for a in group]!r},")
    commanded = group[0].kp is None
    if commanded:
        lines += ["        stiffness=None,  # no gains in this fit: those of the USD stay", "        damping=None,"]
    else:
        lines += [f"        stiffness={of('kp')},", f"        damping={of('kd')},"]
    limited = [a for a in group if a.limited]
    if limited:
        limits = table({re.escape(a.joint): a.effort_limit for a in limited}, "        ")
        # Explicit models clip their own effort; implicit ones are clipped by the solver.
        lines.append(f"        {'effort_limit' if delay > 0 else 'effort_limit_sim'}={limits},")
    lines.append(f"        armature={of('armature')},")
    still = table({re.escape(a.joint): a.dry + a.breakaway for a in group}, "        ")
    lines += [f"        friction={still},", f"        dynamic_friction={of('dry')},", f"        viscous_friction={of('damping')},"]
    if delay > 0:
        lines += [f"        min_delay=round({delay!r} / PHYSICS_DT),", f"        max_delay=round({delay!r} / PHYSICS_DT),"]
    return [*lines, "    ),"]


def _notes(law: Actuation, delays: Sequence[float]) -> list[str]:
    notes = [_UNITS]
    if delays[-1] > 0:
        notes.append(
            "the delay is a whole number of physics steps, counted at PHYSICS_DT: set it to that of your scene."
            " The gains of delayed joints act outside the solver: use a step that is short compared with kd / (armature + inertia)."
        )
    if any(np.isfinite(a.velocity) for a in law.actuators):
        notes.append("speed limits are those of the asset: none was identified.")
    return notes
