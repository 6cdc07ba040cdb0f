"""`fit_drives`: model and drive law from logs of commands and positions, by simulation in closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.threads import with_one_blas_thread
from .determined import determination
from .limits import without_unreached
from .plant import DrivePlant
from .profile import delay_profiles
from .residual import above_noise, require_motion
from .result import DriveFit
from .search import Fitted, fitted
from .sizes import doubtful_sizes, without_sizes
from .space import drive_logs
from .starts import starts
from .stretches import steadied, unexplained
from .uncertainty import Precision

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..model import Model
    from .law import DriveLaw

Array = np.ndarray


@with_one_blas_thread
def fit_drives(
    logs: LogSet, model: Model, law: DriveLaw, *, held: LogSet | None = None, progress: Callable[[float], None] | None = None
) -> DriveFit:
    """Identify what is unknown of joints under a drive law, by the positions that the logged commands lead to in simulation.

    Parameters
    ----------
    logs : LogSet
        Logs with positions and commands; torque is not used.
    model : Model
        Rigid body and effects: rotor_inertia, viscous, coulomb, offset, stribeck, load_dependent_friction.
    law : DriveLaw
        Known constants and those to be identified.
    held : LogSet, optional
        Logs to report the error of simulated position on.
    progress : callable, optional
        Is told the share of the work that is done.

    Returns
    -------
    DriveFit

    Raises
    ------
    DataError
        Logs without the commands that the law needs, with commands that are not positions of the joints, or in which no joint moves.
    UnsupportedError
        Effects that are not simulated under a drive law.

    Examples
    --------
    A PD drive with kp = 100 N m/rad, kd = 5 N m s/rad and a joint with a viscous friction of 2 N m s/rad:

    >>> import ident
    >>> import numpy as np
    >>> robot = ident.load_robot("scara", joints=["joint1"], transmission=np.ones(1))
    >>> inertia = ident.regressor.mass_matrix(robot.tree, robot.nominal, np.zeros((1, 1))).item()
    >>> t = np.arange(0.0, 4.0, 0.0005)
    >>> q, dq, command = np.zeros(len(t)), 0.0, 0.5 * (1.0 - np.cos(4.0 * t)) + 0.2 * (t > 2.0)
    >>> for k in range(len(t) - 1):
    ...     dq += 0.0005 * (100.0 * (command[k] - q[k]) - (5.0 + 2.0) * dq) / inertia
    ...     q[k + 1] = q[k] + 0.0005 * dq
    >>> log = ident.Log("run", t=t[::10], q=q[::10, None], extra={"q_cmd1": command[::10]})
    >>> law = ident.drives.DriveLaw.of(robot, kp=100.0, kd=5.0, delay_s=0.0)
    >>> fit = ident.drives.fit_drives(ident.LogSet((log,)), robot.rigid_body() + ident.friction.Viscous(), law)
    >>> print(f"{fit.value('Fv_joint1'):.1f}")
    2.0
    """
    robot = model.robot
    plant = DrivePlant(model, law, drive_logs(logs, robot, law))
    require_motion(plant)
    at, sizes = starts(plant)
    found = without_unreached(plant, steadied(plant, fitted(plant, at, sizes, progress=progress), sizes), sizes)
    fit = finished(plant, found, sizes, logs.inputs)
    return fit if held is None else fit.with_heldout(held, logs)


def finished(plant: DrivePlant, found: Fitted, sizes: Array, inputs: tuple[dict[str, str], ...] = ()) -> DriveFit:
    """`result_of` with the delay's interval by profile likelihood, which takes about as long as the search, with a warning of each
    stretch that is not explained, and of an error above the noise of the readings."""
    precision = Precision.of(found, np.maximum(np.abs(found.values), sizes))
    told = tuple(one.text(plant.robot.joint_names[one.joint]) for one in unexplained(plant, found))
    fit = result_of(plant, found, sizes, inputs)
    warnings = (*fit.warnings, *scale_of_gains(plant), *notes_of(plant), *told, *above_noise(plant, found))
    late = max(log.lateness for log in plant.logs)
    ends = {name: (low, high + late) for name, (low, high) in delay_profiles(plant, found, sizes, precision).items()}
    return replace(fit, delay_ends=ends, warnings=warnings)


def notes_of(plant: DrivePlant) -> tuple[str, ...]:
    """What was made of the logs' commands and positions."""
    return tuple(note for log in plant.logs for note in log.notes)


def scale_of_gains(plant: DrivePlant) -> tuple[str, ...]:
    """That the scale of everything is that of the URDF's links, where no gain of a joint is known."""
    if not plant.law.links_known or plant.law.loaded or not any(u.place in plant.law.scales for u in plant.unknowns):
        return ()
    text = (
        "gains are identified against the inertial parameters of the URDF's links: where these are wrong by a factor, gains, rotor inertia"
        " and friction are, too; a known gain, or a log with an added mass, gives the scale."
    )
    return (text,)


def result_of(plant: DrivePlant, found: Fitted, sizes: Array, inputs: tuple[dict[str, str], ...] = ()) -> DriveFit:
    """What a search found, with covariance and what is determined. `sizes` (p,): usual sizes of the unknowns."""
    precision = Precision.of(found, np.maximum(np.abs(found.values), sizes))
    period = max(log.period for log in plant.logs)
    decided = determination(plant.unknowns, found.values, precision, period)
    covariance = precision.covariance(np.arange(len(found.values))) * np.outer(precision.scale, precision.scale)
    # Commands whose instants are not known: the delay is longer by anything up to a row.
    late = [i for i, u in enumerate(plant.unknowns) if u.place == "delay_s"]
    covariance[late, late] += max(log.lateness for log in plant.logs) ** 2 / 3.0
    doubts = doubtful_sizes(plant.unknowns, found.values, covariance)
    return DriveFit(
        plant.model,
        plant.law,
        plant.unknowns,
        found.values,
        covariance,
        without_sizes(decided, doubts),
        found.rms,
        period,
        len(found.residual),
        found.settled,
        inputs,
        warnings=tuple(doubts.values()),
    )
