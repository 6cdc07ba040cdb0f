"""`fit_drives`: model and drive law from logs of commands and positions, by simulation in closed loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .determined import determination
from .plant import DrivePlant
from .profile import delay_profiles
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
        Logs without the commands that the law needs, or with commands that are not positions of the joints.
    UnsupportedError
        Effects that are not simulated under a drive law.

    Examples
    --------
    >>> import ident
    >>> import numpy as np
    >>> from ident.drives import DriveLaw, fit_drives
    >>> fit_drives  # doctest: +ELLIPSIS
    <function fit_drives at ...>
    """
    robot = model.robot
    plant = DrivePlant(model, law, drive_logs(logs, robot, law))
    at, sizes = starts(plant)
    found = steadied(plant, fitted(plant, at, sizes, progress=progress), sizes)
    fit = finished(plant, found, sizes, logs.inputs)
    return fit if held is None else fit.with_heldout(held)


def finished(plant: DrivePlant, found: Fitted, sizes: Array, inputs: tuple[dict[str, str], ...] = ()) -> DriveFit:
    """`result_of` with the delay's interval by profile likelihood, which takes about as long as the search, and with a warning of each
    stretch that is not explained."""
    precision = Precision.of(found, np.maximum(np.abs(found.values), sizes))
    told = tuple(one.text(plant.robot.joint_names[one.joint]) for one in unexplained(plant, found))
    fit = result_of(plant, found, sizes, inputs)
    return replace(fit, delay_ends=delay_profiles(plant, found, sizes, precision), warnings=(*fit.warnings, *told))


def result_of(plant: DrivePlant, found: Fitted, sizes: Array, inputs: tuple[dict[str, str], ...] = ()) -> DriveFit:
    """What a search found, with covariance and what is determined. `sizes` (p,): usual sizes of the unknowns."""
    precision = Precision.of(found, np.maximum(np.abs(found.values), sizes))
    period = max(log.period for log in plant.logs)
    decided = determination(plant.unknowns, found.values, precision, period)
    covariance = precision.covariance(np.arange(len(found.values))) * np.outer(precision.scale, precision.scale)
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
