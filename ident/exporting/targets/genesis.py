"""Genesis: a function that sets gains, limits, armature, damping and friction loss of an entity's degrees of freedom."""

from __future__ import annotations

import numpy as np

from ..actuation import Actuation
from ..identified import Identified
from ..omitted import omissions
from ..python_text import header
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target

_PASSIVE = (("armature", "armature"), ("damping", "damping"), ("frictionloss", "dry"))


@register_target
class GenesisTarget(ExportTarget):
    """`apply(entity)` for an entity whose scene was built; then `entity.control_dofs_position(...)` as ever."""

    name = "genesis"
    title = "Genesis degrees of freedom"
    expresses = frozenset(
        {
            Expressed.ARMATURE,
            Expressed.DAMPING,
            Expressed.DRY_FRICTION,
            Expressed.OFFSET,
            Expressed.SPRING,
            Expressed.VELOCITY_COMMAND,
        }
    )

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        law = Actuation.of(found)
        expresses = self.expresses
        if law.law is None or np.any(law.spring != np.diag(np.diag(law.spring))):
            # Without a position drive there is no bias that could hold them.
            expresses = expresses - {Expressed.OFFSET, Expressed.SPRING}
        notes = (*found.notes, *omissions(found, expresses, options))
        held = law.law is not None and any(a.offset or a.stiffness for a in law.actuators)
        if held:
            notes += ("constant torque is part of the actuator's bias, and the force range is shifted by it.",)
        if held and any(a.stiffness and a.limited for a in law.actuators):
            notes += ("springs are part of the actuator's bias, too: the force range limits the sum of spring and drive torque.",)
        rows = [(a.joint, law.law is None, a) for a in law.actuators]
        lines = [header(found, "Genesis degrees of freedom", notes), "import numpy as np", "", f"JOINTS = {[name for name, *_ in rows]!r}"]
        keys = [*_PASSIVE, *(() if law.law is None else (("kp", "kp"), ("kv", "kd")))]
        lines += [f"{name.upper()} = {[float(getattr(a, key)) for *_, a in rows]!r}" for name, key in keys]
        limits = [repr(a.effort_limit) if a.limited else "np.inf" for *_, a in rows]
        lines.append(f"FORCE = [{', '.join(limits)}]")
        if held:
            lines += [f"OFFSET = {[a.offset for *_, a in rows]!r}", f"STIFFNESS = {[a.stiffness for *_, a in rows]!r}"]
        lines += ["", "", "def apply(entity):", '    """Set the identified numbers; call it after scene.build()."""']
        lines += ["    dofs = [entity.get_joint(name).dofs_idx_local[0] for name in JOINTS]"]
        lines += [f"    entity.set_dofs_{name}(np.array({name.upper()}), dofs)" for name, _ in _PASSIVE]
        if law.law is not None:
            lines += ["    entity.set_dofs_kp(np.array(KP), dofs)", "    entity.set_dofs_kv(np.array(KV), dofs)"]
        if held:
            lines += [
                "    # force = kp target - offset - (kp + stiffness) q - kv dq",
                "    entity.set_dofs_act_gain(np.array(KP), dofs)",
                "    entity.set_dofs_act_bias(-np.array(OFFSET), -np.array(KP) - np.array(STIFFNESS), -np.array(KV), dofs)",
            ]
        moved = " - np.array(OFFSET)" if held else ""
        lines += [f"    entity.set_dofs_force_range(-np.array(FORCE){moved}, np.array(FORCE){moved}, dofs)", ""]
        return WrittenFile("\n".join(lines), notes)
