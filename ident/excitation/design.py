"""Exciting trajectories: motion within limits that reveals a model's parameters best (Swevers et al., 1997)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.threads import with_one_blas_thread
from ..effects.motion import Coordinates
from ..errors import ConfigurationError, UnsupportedError
from ..robots.library.nominal import nominal_values
from ..simulation.trajectory import Chained, Trajectory
from .approach import NoWay, approach, require_clear
from .candidate import TrajectoryCandidate
from .certificate import certify, nearest
from .clearance import Clearance
from .families import Family, FourierFamily
from .information import MotionInformation
from .limits import Limits
from .margins import margins_of
from .objective import Both, DOptimality, Measure
from .result import Excitation
from .search import TrajectorySearch
from .surroundings import Safety, Surroundings

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray
_LOG = logging.getLogger(__name__)

_FAMILY: Family = FourierFamily(10.0)
_MEASURE: Measure = Both()


@with_one_blas_thread
def excite(
    model: Model,
    *,
    limits: Limits | None = None,
    values: Array | None = None,
    noise: Sequence[float] | float | None = None,
    family: Family = _FAMILY,
    measure: Measure = _MEASURE,
    surroundings: Surroundings | None = None,
    posture: Sequence[float] | None = None,
    present: Sequence[float] | None = None,
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
    clear of, the robot itself among it, at every moment; None: collisions are not looked at, and the result says so. `posture` (n,): where
    the motion starts and ends, None: wherever is best; `present` (n,): where the robot stands, from which a slow and clear approach
    is put before the motion. Raises ConfigurationError for limits, surroundings or postures with which the robot cannot move, with
    what is in the way.

    Examples
    --------
    >>> import ident
    >>> robot = ident.load_robot("scara")
    >>> found = ident.excite(robot.rigid_body(), starts=1, iterations=2)
    >>> sorted(found.shares) != []
    True
    """
    search, noise_std = _prepared(model, limits, values, noise, family, measure, surroundings, posture)
    here = None if present is None else _present(present, model.robot, search.clearance)
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
    best, way = _reached(search, sorted(found, key=lambda c: c.value), here, seed)
    return _result(search, best, noise_std, rate, tuple(c.value for c in found), way)


def _reached(
    search: TrajectorySearch, found: list[TrajectoryCandidate], present: Array | None, seed: int
) -> tuple[TrajectoryCandidate, Trajectory | None]:
    """The best candidate to whose start there is a way from the present posture, and the way."""
    if present is None:
        return found[0], None
    refused: list[NoWay] = []
    for candidate in found:
        start = search.family.build(candidate.offset, candidate.coefficients).sample(np.zeros(1)).q[0]
        try:
            return candidate, approach(present, start, search.limits, search.clearance, search.information, seed)
        except NoWay as error:
            refused.append(error)
    raise refused[0]


def _present(posture: Sequence[float], robot: Robot, clearance: Clearance | None) -> Array:
    """Where the robot stands, (n,), within the range of its own joints, and clear. Raises ConfigurationError where it is not."""
    q = _posture("the present posture", posture, robot)
    for joint, at in zip(robot.joints, q.tolist(), strict=True):
        if not joint.lower - 1e-6 <= at <= joint.upper + 1e-6:
            raise ConfigurationError(
                f"excitation: in the present posture joint {joint.name} is at {at:g}, outside its range from {joint.lower:g} to"
                f" {joint.upper:g}; give joint-side positions in rad (m), in the order {', '.join(robot.joint_names)}."
            )
    if clearance is not None:
        require_clear(q, "the present posture", clearance, 0.0, "Move the robot free by hand, or give a smaller --clearance.")
    return q


def _posture(what: str, posture: Sequence[float], robot: Robot) -> Array:
    q = np.asarray(posture, float)
    if q.shape != (robot.n,) or not np.isfinite(q).all():
        raise ConfigurationError(f"excitation: {what} must be {robot.n} numbers, one for each joint ({', '.join(robot.joint_names)}).")
    return q


def _start(posture: Sequence[float], limits: Limits, robot: Robot, clearance: Clearance | None) -> Array:
    """Where a motion is to start, (n,): with room within the limits, and clear. Raises ConfigurationError where it is not."""
    q = _posture("the start posture", posture, robot)
    for j, name in enumerate(robot.joint_names):
        if not limits.lower[j] < q[j] < limits.upper[j]:
            raise ConfigurationError(
                f"excitation: the start posture has joint {name} at {q[j]:g}, outside the limits from {limits.lower[j]:g} to"
                f" {limits.upper[j]:g}; give another posture, or a larger --position-share."
            )
    if clearance is not None:
        require_clear(q, "the start posture", clearance, 1.0, "Give another posture, or a smaller --clearance.")
    return q


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
    posture: Sequence[float] | None = None,
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
    start = None if posture is None else _start(posture, limits, robot, clearance)
    return TrajectorySearch(MotionInformation(model, values, std), limits, family, measure, clearance, start), std


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


def _result(
    search: TrajectorySearch,
    best: TrajectoryCandidate,
    noise: Array,
    rate: float,
    values: tuple[float, ...],
    way: Trajectory | None = None,
) -> Excitation:
    info, limits = search.information, search.limits
    trajectory = search.family.build(best.offset, best.coefficients)
    t = np.arange(round(trajectory.duration * rate) + 1) / rate
    joint = trajectory.sample(t)
    matrix = info.matrix(info.columns(info.motion(t, joint)))
    whole = trajectory if way is None else Chained((way, trajectory))
    often = np.linspace(0.0, whole.duration, int(np.ceil(whole.duration * max(rate, 1000.0))) + 1)
    moved = whole.sample(often)
    torque = None if info.values is None else info.torque(often, moved)
    jerk = search.family.jerk(t) @ best.coefficients
    used = np.abs(limits.shares(joint, jerk if search.limited_jerk else None)).max(axis=(1, 2))
    shares = {kind: float(share) for kind, share in zip(limits.kinds, used, strict=True)}
    if torque is not None and search.limited_torque:
        shares["torque"] = float(np.abs(torque / limits.torque).max())
    return Excitation(
        info.model, trajectory, limits, rate, noise, matrix, best.value, values, shares,
        margins_of(info.model.robot, moved, np.abs(jerk).max(axis=0), torque), _safety(search, whole, way is not None), way,
        _predicted(info), None if search.clearance is None else search.clearance.surroundings,
    )  # fmt: skip


def _predicted(info: MotionInformation) -> tuple[str, ...]:
    """The effects whose values predict the torque."""
    if info.values is None:
        return ()
    return tuple(e.name for e, part in zip(info.model.effects, info.model.slices, strict=True) if np.any(info.values[part]))


def _safety(search: TrajectorySearch, whole: Trajectory, approached: bool) -> Safety | None:
    """How clear the motion keeps, if that was asked for."""
    clearance = search.clearance
    if clearance is None:
        return None
    proof = certify(clearance, whole, search.limits)
    return Safety(
        clearance.surroundings.clearance, nearest(clearance, whole)[:12], proof.whole, clearance.touching, clearance.unchecked,
        clearance.bodies.invented, clearance.bodies.radius, clearance.notes, approached,
    )  # fmt: skip
