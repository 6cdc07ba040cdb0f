"""Exciting trajectories: motion within limits that reveals a model's parameters best (Swevers et al., 1997)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError, UnsupportedError
from ..robots.library.nominal import nominal_values
from .clearance import Clearance
from .families import BSplineFamily, Family, FourierFamily
from .information import MotionInformation
from .limits import Limits
from .margins import margins_of
from .noise import sample_noise
from .objective import Both, ConditionNumber, DOptimality, Measure, condition_number
from .result import Excitation
from .search import TrajectoryCandidate, TrajectorySearch
from .surroundings import Safety, Surroundings

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..model import Model

Array = np.ndarray
_LOG = logging.getLogger(__name__)

__all__ = [
    "BSplineFamily",
    "Both",
    "ConditionNumber",
    "DOptimality",
    "Excitation",
    "Family",
    "FourierFamily",
    "Limits",
    "Measure",
    "condition_number",
    "excite",
    "random_excitation",
    "sample_noise",
    "tell_apart",
]

_FAMILY: Family = FourierFamily(10.0)
_MEASURE: Measure = Both()


def excite(
    model: Model,
    *,
    limits: Limits | None = None,
    values: Array | None = None,
    noise: Sequence[float] | float | None = None,
    family: Family = _FAMILY,
    measure: Measure = _MEASURE,
    surroundings: Surroundings | None = None,
    rate: float = 200.0,
    starts: int = 3,
    iterations: int = 60,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Excitation:
    """The trajectory of a family (by default a Fourier series of 10 s) that makes a measure of the base parameters smallest within limits.

    `limits`: by default nine tenths of what the robot's description allows. `values` (k,): parameter values, for torque limits
    and for effects that need the model's prediction; by default the nominal ones, if there are any. `noise`: std of the torque,
    one value or (n,), measured side; by default one hundredth of the rms torque of random motion. `starts`: independent
    searches, of which the best is taken; `iterations` of each per level of the limits' barrier. `surroundings`: what the motion keeps
    clear of, the robot itself among it, at every moment; None: collisions are not looked at, and the result says so. Raises
    ConfigurationError for limits or surroundings within which the robot cannot move, with what is in the way.

    Examples
    --------
    >>> import ident
    >>> robot = ident.load_robot("scara")
    >>> found = ident.excite(robot.rigid_body(), starts=1, iterations=2)
    >>> sorted(found.shares) != []
    True
    """
    search, noise_std = _prepared(model, limits, values, noise, family, measure, surroundings)
    rng = np.random.default_rng(seed)
    found: list[TrajectoryCandidate] = []
    for start in range(max(1, starts)):
        candidate = search.run(rng, iterations)
        found += [] if candidate is None else [candidate]
        _LOG.info("search %d of %d: %s", start + 1, starts, "nothing safe" if candidate is None else f"value {candidate.value:.6g}")
        if progress is not None:
            progress((start + 1) / max(1, starts))
    if not found:
        raise ConfigurationError(
            f"excitation: no motion of {max(1, starts)} searches keeps clear at every moment and still moves; allow more room (ground,"
            " workspace, clearance), more time, or more searches."
        )
    best = min(found, key=lambda c: c.value)
    return _result(search, best, noise_std, rate, tuple(c.value for c in found))


def random_excitation(
    model: Model,
    *,
    limits: Limits | None = None,
    values: Array | None = None,
    noise: Sequence[float] | float | None = None,
    family: Family = _FAMILY,
    measure: Measure = _MEASURE,
    rate: float = 200.0,
    seed: int = 0,
) -> Excitation:
    """A random trajectory of the family, scaled until it touches a limit: what `excite` must beat."""
    search, noise_std = _prepared(model, limits, values, noise, family, measure)
    candidate = search.random(np.random.default_rng(seed), 1.0 - 1e-10)
    return _result(search, candidate, noise_std, rate, (candidate.value,))


def tell_apart(model: Model, first: Effect, second: Effect) -> tuple[Model, DOptimality]:
    """The model with two rival effects, and the measure that makes their parameters as distinct as can be. Effects of a kind that the
    model has already are those of the model.

    Raises UnsupportedError where no motion can tell one of them from the rest of the model, ConfigurationError for two of one kind."""
    if first.name == second.name:
        raise ConfigurationError(f"excitation: {first.name!r} is to be distinguished from itself; name two effects.")
    both = model
    for effect in (first, second):
        if all(own.name != effect.name for own in model.effects):
            both = both + effect
    chosen = []
    for effect in (first, second):
        rivals = [own for own in both.effects if own.name == effect.name]
        own = [p.name for rival in rivals for p in rival.parameters(model.robot) if p.name in both.base.names]
        if not own:
            raise UnsupportedError(f"no motion tells {effect.name!r} from the rest of the model: its parameters only regroup with others.")
        chosen += own
    return both, DOptimality(tuple(chosen))


def _prepared(
    model: Model,
    limits: Limits | None,
    values: Array | None,
    noise: Sequence[float] | float | None,
    family: Family,
    measure: Measure,
    surroundings: Surroundings | None = None,
) -> tuple[TrajectorySearch, Array]:
    robot = model.robot
    limits = limits or Limits.of(robot)
    if limits.n != robot.n:
        raise ConfigurationError(f"excitation: limits of {limits.n} joints are given for a robot of {robot.n}.")
    if values is None and robot.nominal is not None:
        values = nominal_values(model)
    if values is not None and np.shape(values) != (len(model.parameters),):
        raise ConfigurationError(f"excitation: the model has {len(model.parameters)} parameters, but values are {np.shape(values)}.")
    values = None if values is None else np.asarray(values, float)
    if noise is None:
        std = _usual_noise(model, values, limits)
    else:
        std = np.broadcast_to(np.asarray(noise, float), (robot.n,)).copy()
        if not np.all(std > 0):
            raise ConfigurationError("excitation: the noise must be positive on every joint.")
    clearance = None if surroundings is None else Clearance(robot, surroundings, limits)
    return TrajectorySearch(MotionInformation(model, values, std), limits, family, measure, clearance), std


def _usual_noise(model: Model, values: Array | None, limits: Limits) -> Array:
    """One hundredth of the rms torque of random motion within the limits; 1 without parameter values."""
    robot = model.robot
    if values is None:
        return np.ones(robot.n)
    rng = np.random.default_rng(0)
    q = rng.uniform(limits.lower, limits.upper, (200, robot.n))
    dq = 0.5 * limits.velocity * rng.normal(size=q.shape)
    ddq = 0.5 * limits.acceleration * rng.normal(size=q.shape)
    info = MotionInformation(model, values, np.ones(robot.n))

    torque = info.columns(info.motion(np.arange(200) * 0.01, Coordinates(q, dq, ddq))) @ values
    rms = np.sqrt(np.mean(torque**2, axis=0))
    return 0.01 * np.maximum(rms, 1e-3 * rms.max(initial=1e-12))


def _result(search: TrajectorySearch, best: TrajectoryCandidate, noise: Array, rate: float, values: tuple[float, ...]) -> Excitation:
    info, limits = search.information, search.limits
    trajectory = search.family.build(best.offset, best.coefficients)
    t = np.arange(round(trajectory.duration * rate) + 1) / rate
    joint = trajectory.sample(t)
    columns = info.columns(info.motion(t, joint))
    torque = info.joint_torque(columns) if search.limited_torque else None
    kinds = ("position", "velocity", "acceleration", "torque")
    used = np.abs(limits.shares(joint, torque)).max(axis=(1, 2))
    shares = {kind: float(share) for kind, share in zip(kinds, used, strict=False)}
    margins = margins_of(info.model.robot, joint, torque)
    return Excitation(
        info.model, trajectory, limits, rate, noise, info.matrix(columns), best.value, values, shares, margins, _safety(search, best)
    )


def _safety(search: TrajectorySearch, best: TrajectoryCandidate) -> Safety | None:
    """How clear the motion keeps, if that was asked for."""
    clearance, certificate = search.clearance, search.certificate(best)
    if clearance is None or certificate is None:
        return None
    return Safety(
        clearance.surroundings.clearance, certificate.nearest[:12], certificate.whole, clearance.touching, clearance.unchecked,
        clearance.bodies.invented, clearance.bodies.radius, clearance.notes,
    )  # fmt: skip
