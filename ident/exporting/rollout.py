"""A written MJCF with actuators, rolled out by MuJoCo under the commands of a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError, UnsupportedError
from .identified import Identified
from .target import ExportOptions, make_target

if TYPE_CHECKING:
    from ..drives.commands import DriveLog
    from ..drives.result import DriveFit

Array = np.ndarray
#: Seconds of a step of MuJoCo.
STEP = 5e-4


def mujoco_rollout(fit: DriveFit, log: DriveLog) -> Array:
    """Positions (N, n) at the samples of a log, of the model that `--to mujoco_actuator` writes, under the log's commands.

    Raises
    ------
    UnsupportedError
        What the file cannot be sent: a feed-forward torque, a voltage, torque that is switched off, a supply that is not constant. A drive
        that integrates its error, or has a deadband.
    ConfigurationError
        MuJoCo is not installed, or a constant is known for single logs only.
    """
    require_rollable(log)
    if fit.law.deadbands.any():
        raise UnsupportedError(f"log {log.name}: the drive has a deadband, which the exported file does not have.")
    if fit.law.integrates.any():
        raise UnsupportedError(f"log {log.name}: the drive integrates its error, which the exported file does not do.")
    text = str(make_target("mujoco_actuator", Path()).written(Identified.of(fit), ExportOptions()).content)
    return in_mujoco(text, log, fit.model.robot.joint_names)


def require_rollable(log: DriveLog) -> None:
    """Raises UnsupportedError where a log holds commands that an exported actuator does not take."""
    for there, what in (
        (np.any(log.tau_ff != 0.0), "a feed-forward torque or a voltage was sent"),
        (np.any(log.enabled < 1.0), "the torque was switched off for a part of it"),
        (log.supply is not None, "the torque follows the logged supply voltage"),
    ):
        if there:
            raise UnsupportedError(f"log {log.name}: {what}, which the exported file does not have.")


def in_mujoco(text: str, log: DriveLog, joints: tuple[str, ...], step: float = STEP) -> Array:
    """Positions (N, n) of an MJCF at the samples of a log, whose commands are held from one to the next.

    Dry friction and couplings are soft there: they are made as hard as the step allows."""
    try:
        import mujoco
    except ImportError:
        raise ConfigurationError("MuJoCo is not installed: pip install 'ident[mujoco]'.") from None
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    hard, stiff = (2 * step, 1.0), (0.9999, 0.9999)
    model.dof_solref[:], model.dof_solimp[:, :2] = hard, stiff
    model.jnt_limited[:] = 0
    data: Any = mujoco.MjData(model)
    where = [model.jnt_qposadr[model.joint(name).id] for name in joints]
    moving = [model.jnt_dofadr[model.joint(name).id] for name in joints]
    data.qpos[where], data.qvel[moving] = log.origin, log.start
    sent = _sent(model, log, joints)
    for i in range(model.nu):
        if model.actuator_actadr[i] >= 0:
            data.act[model.actuator_actadr[i]] = sent[0, i]
        if model.actuator_delay[i] > 0:
            count = int(model.actuator_history[i, 0])
            mujoco.mj_initCtrlHistory(model, data, i, None, np.full((count, 1), sent[0, i]))
    out, done = np.empty((len(log.t), len(joints))), 0
    for k, at in enumerate(np.rint(log.t / step).astype(int)):
        if at > done:
            mujoco.mj_step(model, data, at - done)
            done = int(at)
        out[k] = data.qpos[where]
        data.ctrl[:] = sent[k]
    return out


def _sent(model: Any, log: DriveLog, joints: tuple[str, ...]) -> Array:
    """What each actuator of the file is sent (N, nu): position or velocity commands."""
    out = np.zeros((len(log.t), model.nu))
    for j, joint in enumerate(joints):
        for what, commands in (("position", log.q_cmd), ("velocity", log.dq_cmd)):
            for i in range(model.nu):
                if model.actuator(i).name == f"{joint}_{what}":
                    out[:, i] = commands[:, j]
    return out
