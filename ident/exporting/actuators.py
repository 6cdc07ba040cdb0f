"""An MJCF with actuators: joints with armature, damping and friction loss, and the drives' gains as MuJoCo's position actuators."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._utils.files import write_atomic
from ..errors import ConfigurationError, UnsupportedError
from .export import Exported
from .mjcf import mjcf_text

if TYPE_CHECKING:
    from ..drives import DriveFit

Array = np.ndarray
FORMAT = "mujoco_actuator"


def export_actuators(fit: DriveFit, target: str | Path, *, force: bool = False) -> Exported:
    """Write joints and drives as MJCF: `joint` armature, damping, frictionloss; `position` kp, kv, forcerange.

    A constant offset makes the actuator a `general` one of the same gains with it in its bias. What MuJoCo's actuators do not
    have (delay, load-dependent and Stribeck friction) is listed in the notes with the error it makes.
    Raises ConfigurationError for an existing file, UnsupportedError for laws and links that cannot be written."""
    target = Path(target)
    if target.exists() and not force:
        raise ConfigurationError(f"{target} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True).")
    content, notes = actuator_text(fit)
    write_atomic(target, content, force=force)
    return Exported(str(target), FORMAT, (), notes)


def actuator_text(fit: DriveFit) -> tuple[str, tuple[str, ...]]:
    """MJCF text and notes."""
    from lxml import etree

    robot, constants, drive = fit.model.robot, fit.constants(), fit.drive()
    if fit.law.kind == "pwm":
        raise UnsupportedError(
            "a pwm law is none of MuJoCo's position actuators: its torque follows the supply, and its speed the winding."
        )
    if not fit.law.links_known or robot.nominal is None:
        raise UnsupportedError(
            'the links were identified as base parameters, which are no bodies: give the links\' inertials ([drive] links = "known").'
        )
    joints = {"armature": drive["armature"], "damping": drive["viscous"] + constants["back_emf"], "frictionloss": drive["dry"]}
    text, notes = mjcf_text(robot, robot.nominal, joints)
    root = etree.fromstring(text)
    section = etree.SubElement(root, "actuator")
    for j, name in enumerate(robot.joint_names):
        kp, kd, limit = (float(constants["torque_scale"][j] * constants[key][j]) for key in ("kp", "kd", "effort_limit"))
        if not np.isfinite([kp, kd]).all():
            raise ConfigurationError(
                f"kp or kd of joint {name!r} is known for single logs only ([drive.by_log]); give those to be written in [drive]."
            )
        section.append(_actuator(name, kp, kd, limit, float(drive["offset"][j])))
    notes = (*notes, *_left_out(fit, constants, drive))
    return etree.tostring(root, pretty_print=True, encoding="unicode"), notes


def _actuator(joint: str, kp: float, kd: float, limit: float, offset: float) -> object:
    from lxml import etree

    common = {"name": f"{joint}_position", "joint": joint}
    if offset == 0.0:
        node = etree.Element("position", {**common, "kp": repr(kp), "kv": repr(kd)})
    else:
        bias = f"{-offset!r} {-kp!r} {-kd!r}"
        node = etree.Element("general", {**common, "gainprm": repr(kp), "biastype": "affine", "biasprm": bias})
    if np.isfinite(limit):
        node.set("forcerange", f"{-limit!r} {limit!r}")
    return node


def _left_out(fit: DriveFit, constants: Mapping[str, Array], drive: Mapping[str, Array]) -> list[str]:
    """What the file does not say, with the error that it makes."""
    notes = []
    delay, kp = constants["delay_s"], constants["kp"]
    if np.any(delay > 0):
        worst = int(np.argmax(kp * delay))
        notes.append(
            f"not expressible: the delay from command to torque ({1e3 * delay.min():.2f} to {1e3 * delay.max():.2f} ms). Send commands"
            f" that much later; without, joint {fit.model.robot.joint_names[worst]} is ahead of the robot by {1e3 * delay[worst]:.2f} ms."
        )
    if np.any(drive["load"] > 0):
        notes.append("not expressible: friction that grows with the load (load_dependent_friction); frictionloss is that without load.")
    if np.any(drive["excess"] > 0):
        notes.append("not expressible: Stribeck friction; frictionloss is that of fast motion.")
    if np.any(drive["offset"] != 0):
        notes.append("a constant offset stands in the actuator's bias; forcerange limits the sum of both.")
    if fit.determination is not None:
        notes += [
            f"only together determined: {c.expression}; the file holds one of the pairs that give the same motion."
            for c in fit.determination.combinations
        ]
    return notes
