"""Instruments: the regressor along a motion that the model made and no sensor disturbed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Nature, Need
from ..effects.motion import Coordinates
from ..errors import ConfigurationError, DataError
from ..model import Model
from ..problem.problem import Problem
from ..regressor.kernel_choice import kernel
from ..robots.transmission import Side
from ..signals.rows import Rows
from .experiment import Experiment
from .possible import MARGIN

if TYPE_CHECKING:
    from .possible import NearestPossible

Array = np.ndarray
_CHUNK = 2048
#: Share of a row's weight on samples without instruments from which the row is not used.
_MISSING = 1e-9


class Instruments(StrEnum):
    """Where instruments come from.

    FORWARD_DYNAMICS: measured positions and speeds, accelerations from the model's forward dynamics at the measured torque
    (Yoshida 1995); valid where the torque was commanded, or its noise does not matter. SIMULATION: the whole motion
    simulated along the same experiment. REFERENCE: the desired motion itself."""

    FORWARD_DYNAMICS = "forward_dynamics"
    SIMULATION = "simulation"
    REFERENCE = "reference"


def instrument_problem(
    problem: Problem, possible: NearestPossible, source: Instruments, experiment: Experiment | None
) -> tuple[Problem, Array]:
    """The problem along the instruments' motion, and which rows (M, n) have instruments and may be used."""
    values = problem.base.expand(possible.values)
    motion = _MAKERS[source](problem, values, possible, experiment)
    known = np.isfinite(motion.q).all(axis=1) & np.isfinite(motion.dq).all(axis=1) & np.isfinite(motion.ddq).all(axis=1)
    s = problem.signals
    q, dq, ddq = (np.where(known[:, None], new, old) for new, old in ((motion.q, s.q), (motion.dq, s.dq), (motion.ddq, s.ddq)))
    usable = problem.valid & (np.abs(problem.at_rows((~known).astype(float))) <= _MISSING)[:, None]
    if not usable.any():
        raise DataError("no row of the log has instruments: torque is missing, or the simulated motion diverged, everywhere.")
    return along(problem, replace(s, q=q, dq=dq, ddq=ddq)), usable


def along(problem: Problem, signals: object) -> Problem:
    """The same problem on signals of another motion; the reduction is kept."""
    other = replace(problem, signals=signals, progress=None)  # type: ignore[arg-type]
    other.__dict__["base"] = problem.base
    return other


def paired(problem: Problem, instruments: Problem, usable: Array) -> Iterator[tuple[Rows, Array]]:
    """Blocks of rows with their instruments (m, n, b); rows that are not `usable` (M, n) are not valid, their instruments zero."""
    for rows, other in zip(problem.rows(), instruments.rows(), strict=True):
        valid = rows.valid & usable[rows.place]
        yield replace(rows, valid=valid), np.where(valid[:, :, None], other.columns, 0.0)


def _forward_dynamics(problem: Problem, values: Array, possible: NearestPossible, experiment: Experiment | None) -> Coordinates:
    s = problem.signals
    torque = s.torque - _along_measured(problem, values)
    present = np.isfinite(torque).all(axis=1)
    ddq = np.full(s.q.shape, np.nan)
    model, own = _instant_part(problem.model, values)
    robot = model.robot
    to_joint = robot.transmission.torque_map(robot.transmission.measured, Side.JOINT)
    at = np.flatnonzero(present)
    for first in range(0, len(at), _CHUNK):
        part = at[first : first + _CHUNK]
        inertia, bias = model.inertia_and_bias(s.q[part], s.dq[part], own)
        ddq[part] = _response(inertia, torque[part] - bias, to_joint, possible.scale)
    return Coordinates(s.q, s.dq, ddq)


def _response(inertia: Array, force: Array, to_joint: Array, scale: Array) -> Array:
    """Accelerations (N, n) under `force` (N, n) of inertia matrices (N, n, n), both on a side that `to_joint` (n, n) carries to the joints.

    Between the postures of the repair an eigenvalue, in units of `scale` (n,), may still be small: it is held."""
    least = MARGIN / 2
    out, sound = kernel().drive.respond(inertia, force, to_joint, scale, least)
    if not sound.all():
        joint = np.matmul(to_joint, inertia[~sound])
        values, vectors = np.linalg.eigh((joint + joint.swapaxes(1, 2)) / (2 * np.outer(scale, scale)))
        along = np.einsum("sij,si->sj", vectors, force[~sound] @ to_joint.T / scale) / np.maximum(values, least)
        out[~sound] = np.einsum("sij,sj->si", vectors, along) / scale
    return out


def _instant_part(model: Model, values: Array) -> tuple[Model, Array]:
    """The effects that depend on the instant alone, and their values."""
    keep = [i for i, e in enumerate(model.effects) if not _follows(e)]
    return Model(model.robot, tuple(model.effects[i] for i in keep)), np.concatenate([values[model.slices[i]] for i in keep])


def _follows(effect: object) -> bool:
    needs: frozenset[Need] = effect.needs  # type: ignore[attr-defined]
    return bool(needs & {Need.HISTORY, Need.NEIGHBOURS, Need.REFERENCE, Need.TORQUE}) or effect.nature == Nature.SENSOR  # type: ignore[attr-defined]


def _along_measured(problem: Problem, values: Array) -> Array:
    """Torque (N, n), measured side, of the effects that only act along the measured motion."""
    model, robot, s = problem.model, problem.model.robot, problem.signals
    chosen = [i for i, e in enumerate(model.effects) if _follows(e) and values[model.slices[i]].any()]
    out = np.zeros(s.q.shape)
    for run in s.runs if chosen else ():
        motion = problem.motion(run)
        for i in chosen:
            own = model.effects[i].torque(motion, robot, values[model.slices[i]])
            out[run] += robot.transmission.torque(own, model.effects[i].side, robot.transmission.measured)
    return out


def _simulation(problem: Problem, values: Array, possible: NearestPossible, experiment: Experiment | None) -> Coordinates:
    return repeated(problem, values, experiment or Experiment())[0]


def repeated(problem: Problem, values: Array, experiment: Experiment) -> tuple[Coordinates, Array]:
    """Motion and torque (N, n), measured side, of the experiment repeated on the model with all values (k,).

    Effects that follow more than the instant act as they did along the measured motion."""
    model, own = _instant_part(problem.model, values)
    follow = _along_measured(problem, values)
    motion, torque = experiment.repeat(model, own, replace(problem.signals, torque=problem.signals.torque - follow))
    return motion, torque + follow


def _reference(problem: Problem, values: Array, possible: NearestPossible, experiment: Experiment | None) -> Coordinates:
    if experiment is None or not experiment.desired:
        raise ConfigurationError("instruments 'reference' need the desired motion: experiment = Experiment(controller=…, desired=…).")
    return experiment.desired_motion(problem.signals)


_MAKERS: dict[Instruments, Callable[[Problem, Array, NearestPossible, Experiment | None], Coordinates]] = {
    Instruments.FORWARD_DYNAMICS: _forward_dynamics,
    Instruments.SIMULATION: _simulation,
    Instruments.REFERENCE: _reference,
}
