"""The estimator contract: a frozen configuration, declared capabilities, one `solve`."""

from __future__ import annotations

import dataclasses
import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from .._utils.registered import Registry
from .._utils.threads import with_one_blas_thread
from ..effects.kinds import Need
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from .own_prediction import standing
from .reversals import without_inconsistent_reversals

if TYPE_CHECKING:
    from pathlib import Path

    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..problem.problem import Problem
    from ..robots.robot import Robot


Array = np.ndarray
_LOG = logging.getLogger(__name__)


class Capability(StrEnum):
    """What an estimator can do beyond plain least squares on independent rows.

    STREAMING: works from information blocks, with a fixed number of passes over the samples. RECURSIVE: takes samples as they
    come (`start`). NOISY_REGRESSOR: stays consistent where the motion itself is noisy. DRIFT: parameters may change slowly."""

    WEIGHTS = "weights"
    BOUNDS = "bounds"
    PRIOR = "prior"
    STREAMING = "streaming"
    RECURSIVE = "recursive"
    ROBUST = "robust"
    NOISY_REGRESSOR = "noisy regressor"
    DRIFT = "drift"
    PHYSICAL = "physical"


class OnlineState(Protocol):
    """Where a recursion stands: every update gives the next state."""

    def update(self, columns: Array, tau: Array, valid: Array | None = None) -> Self:
        """Take m instants: `columns` (m, n, b), `tau` (m, n), `valid` (m, n) bool (None: all)."""
        ...

    @property
    def values(self) -> Array:
        """Base parameters (b,) by the samples so far."""
        ...

    @property
    def std(self) -> Array:
        """Their standard deviations (b,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Estimator(ABC):
    """A strategy that turns a problem into an estimate."""

    name: ClassVar[str]
    title: ClassVar[str]
    capabilities: ClassVar[frozenset[Capability]] = frozenset()
    #: Keys of the configuration that name files; in a study file they start at its folder.
    files: ClassVar[frozenset[str]] = frozenset()
    #: Whether a log must be whole: then no part of it can be held out.
    whole_logs: ClassVar[bool] = False
    #: Whether it prepares rows of its own from the logs, and masks them.
    own_rows: ClassVar[bool] = False

    def __post_init__(self) -> None:
        # Lists come from study files; a configuration is hashable and cannot change under its owner.
        for f in dataclasses.fields(self):
            object.__setattr__(self, f.name, _frozen(getattr(self, f.name)))

    @with_one_blas_thread
    def solve(self, problem: Problem) -> Estimate:
        """Estimate the base parameters of a problem, without rows near reversals that do not fit (`estimators.reversals`).

        Where an effect needs the model's own prediction (load), the fit is repeated with that of the last one until it stands."""
        self.check(problem)
        asked = problem
        problem, left_out = (problem, ()) if self.own_rows else without_inconsistent_reversals(problem)
        found = replace(self._solve(problem), reversals_left_out=left_out, problem=asked)
        if problem.model.needs & {Need.LOAD, Need.REFERENCE}:
            by_rows = None if Capability.NOISY_REGRESSOR in self.capabilities else self._solve
            found = replace(standing(problem, found, self._solve, by_rows), reversals_left_out=left_out, problem=asked)
        _LOG.info("%s: %d parameters from %d rows, status %s", self.name, len(found.values), found.samples, found.status.code.value)
        return found

    def start(self, model: Model) -> OnlineState:
        """Begin a recursion that takes samples as they come. Raises UnsupportedError unless the estimator is RECURSIVE."""
        raise UnsupportedError(
            f"method {self.name!r} fits whole logs and cannot take samples one by one; methods that can: {_able(Capability.RECURSIVE)}."
        )

    def own_logs(self) -> tuple[Path, ...]:
        """Logs that the configuration itself names, where a study names none. Raises DataError for one that is not there."""
        return ()

    def check_robot(self, robot: Robot) -> None:  # noqa: B027 - most estimators take any robot
        """Refuse a robot that the configuration is not for (ConfigurationError), before logs are read."""

    def check(self, problem: Problem) -> None:  # noqa: B027 - most estimators refuse nothing
        """Refuse, before any work, what this estimator cannot do (UnsupportedError that names one that can)."""

    @abstractmethod
    def _solve(self, problem: Problem) -> Estimate:
        """The estimate for a problem whose reference load is given."""

    def to_dict(self) -> dict[str, Any]:
        """As study files give it: `method` and every key that is not at its default."""
        out: dict[str, Any] = {"method": self.name}
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            if value != f.default:
                out[f.name] = _thawed(value)
        return out


def per_joint(value: Sequence[float] | float, n: int, what: str, *, positive: bool) -> Array:
    """A configured noise as numbers (n,): one for all joints, or one a joint. Raises ConfigurationError."""
    given = np.asarray(value, float)
    fits = given.shape in ((), (n,)) and bool(np.all(np.isfinite(given) & ((given > 0) if positive else (given >= 0))))
    if not fits:
        allowed = "all positive" if positive else "none negative"
        raise ConfigurationError(f"{what} must hold one number for all joints, or {n}, one per joint, {allowed}, not {given.tolist()}.")
    return np.broadcast_to(given, n).copy()


def require_forgetting(factor: float, method: str) -> None:
    """Raises ConfigurationError for a weight of a sample against the next that is none."""
    if not 0.0 < factor <= 1.0:
        raise ConfigurationError(f"method {method!r}: forgetting must lie in (0, 1] (1: nothing is forgotten), not {factor}.")


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return tuple((k, _frozen(v)) for k, v in value.items())
    return tuple(_frozen(v) for v in value) if isinstance(value, list | tuple) else value


def _thawed(value: Any) -> Any:
    return [_thawed(v) for v in value] if isinstance(value, tuple) else value


_REGISTRY: Registry[Estimator] = Registry("estimator", "ident.estimators")
_S = TypeVar("_S", bound=Estimator)


def register(estimator: type[_S]) -> type[_S]:
    """Class decorator: make an estimator known by its name.

    Parameters
    ----------
    estimator : type
        A class of estimators with a `name` of its own.

    Returns
    -------
    type
        The class itself.

    Raises
    ------
    ConfigurationError
        Another class has that name.

    Examples
    --------
    >>> from ident.estimators import LeastSquares, register
    >>> register(LeastSquares) is LeastSquares  # known already: nothing changes
    True
    """
    _REGISTRY.add(estimator)
    return estimator


def estimator_types() -> dict[str, type[Estimator]]:
    """Every registered estimator by name, the built-in ones and those of plugins.

    Returns
    -------
    dict of str to type
        In the order of the names.

    Examples
    --------
    >>> import ident
    >>> ident.estimators.estimator_types()["wls"] is ident.estimators.WeightedLeastSquares
    True
    """
    return _REGISTRY.types()


def _able(capability: Capability) -> str:
    """Names of the methods that have a capability."""
    return ", ".join(name for name, kind in estimator_types().items() if capability in kind.capabilities) or "none"


def make_estimator(name: str, /, **configuration: Any) -> Estimator:
    """An estimator by its name, as study files and the command line give it.

    Parameters
    ----------
    name : str
        For example "wls", "irls", "iv", "physical"; `ident fit --help` lists them.
    **configuration
        Settings of the method.

    Returns
    -------
    Estimator

    Raises
    ------
    ConfigurationError
        An unknown method or key, with the nearest known ones.
    UnsupportedError
        A key that belongs to other methods, which it names.

    Examples
    --------
    >>> import ident
    >>> ident.make_estimator("rls", forgetting=0.999).forgetting
    0.999
    """
    types = estimator_types()
    if name not in types:
        raise unknown_name("method", name, types)
    known = {f.name for f in dataclasses.fields(types[name])}
    for key in configuration:
        if key in known:
            continue
        others = [other for other, kind in types.items() if key in {f.name for f in dataclasses.fields(kind)}]
        if others:
            raise UnsupportedError(f"method {name!r} has no {key!r}; methods that have it: {', '.join(others)}.")
        raise unknown_name(f"key of method {name!r}", key, known)
    return types[name](**configuration)
