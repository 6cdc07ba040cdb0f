"""The estimator contract: a frozen configuration, declared capabilities, one `solve`."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from ..effect import Need
from ..errors import ConfigurationError, unknown_name

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..problem import Problem

#: Passes of the fixed point between parameters and the load they predict; it contracts fast (friction is the smaller part).
_LOAD_PASSES = 12


class Capability(StrEnum):
    """What an estimator can do beyond plain least squares on independent rows."""

    WEIGHTS = "weights"
    BOUNDS = "bounds"
    PRIOR = "prior"
    STREAMING = "streaming"
    ROBUST = "robust"
    NOISY_REGRESSOR = "noisy regressor"
    PHYSICAL = "physical"


@dataclass(frozen=True, kw_only=True)
class Estimator(ABC):
    """A strategy that turns a problem into an estimate."""

    name: ClassVar[str]
    title: ClassVar[str]
    capabilities: ClassVar[frozenset[Capability]] = frozenset()

    def solve(self, problem: Problem) -> Estimate:
        """Estimate the base parameters of a problem.

        Where an effect needs the predicted load, the fit is repeated with the load of the last one until it stands."""
        self.check(problem)
        estimate = self._solve(problem)
        if Need.LOAD not in problem.model.needs:
            return estimate
        for _ in range(_LOAD_PASSES):
            values = estimate.all_values
            problem = problem.with_reference(values)
            estimate = replace(self._solve(problem), reference=values)
            change = np.abs(estimate.values - problem.base.base_values(values)) if len(estimate.values) == problem.base.count else np.inf
            if np.all(change <= 1e-6 * estimate.std + 1e-9 * np.abs(estimate.values)):
                break
        return estimate

    def check(self, problem: Problem) -> None:
        """Refuse, before any work, what this estimator cannot do (UnsupportedError that names one that can)."""

    @abstractmethod
    def _solve(self, problem: Problem) -> Estimate:
        """The estimate for a problem whose reference load is given."""


_REGISTRY: dict[str, type[Estimator]] = {}
_S = TypeVar("_S", bound=Estimator)


def register(estimator: type[_S]) -> type[_S]:
    """Class decorator: make an estimator known by its name."""
    known = _REGISTRY.get(estimator.name)
    if known is not None and known.__qualname__ != estimator.__qualname__:
        raise ConfigurationError(f"two estimators are named {estimator.name!r}.")
    _REGISTRY[estimator.name] = estimator
    return estimator


def estimator_types() -> dict[str, type[Estimator]]:
    """Every registered estimator by name."""
    package = importlib.import_module("ident.estimators")
    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"ident.estimators.{module.name}")
    return dict(sorted(_REGISTRY.items()))


def make_estimator(name: str, **configuration: Any) -> Estimator:
    """An estimator by its name, as study files and the command line give it."""
    types = estimator_types()
    if name not in types:
        raise unknown_name("method", name, types)
    known = {f.name for f in dataclasses.fields(types[name])}
    for key in configuration:
        if key not in known:
            raise unknown_name(f"key of method {name!r}", key, known)
    return types[name](**configuration)
