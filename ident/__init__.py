"""ident: identify a robot's dynamics, and find what its model lacks.

Public names load when they are used: `import ident` itself is light."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._utils.version import __version__

_WHERE = {
    "Robot": "robots",
    "Transmission": "robots",
    "Side": "robots",
    "load_robot": "robots",
    "robot_names": "robots",
    "Log": "logs",
    "LogSet": "logs",
    "read_logs": "logs",
    "Signals": "signals",
    "ZeroPhase": "signals",
    "SavitzkyGolay": "signals",
    "CentralDifference": "signals",
    "Model": "model",
    "Motion": "effects",
    "Effect": "effects",
    "make_effect": "effects",
    "effect_names": "effects",
    "Problem": "problem",
    "Information": "problem",
    "Estimate": "estimate",
    "Status": "estimate",
    "StatusCode": "estimate",
    "make_estimator": "estimators",
    "validate": "evaluation",
    "Validation": "evaluation",
    "compare": "evaluation",
    "monitor": "monitoring",
    "report": "reporting",
    "diagnose": "diagnosis",
    "Diagnosis": "diagnosis",
    "Comparison": "evaluation",
    "Study": "study",
    "read_study": "study",
    "IdentError": "errors",
    "ConfigurationError": "errors",
    "DataError": "errors",
    "UnsupportedError": "errors",
    "MomentumProblem": "problem",
    "EnergyProblem": "problem",
}
_PACKAGES = ("effects", "estimators", "friction", "physical", "regressor", "robots")

__all__ = [
    "CentralDifference",
    "Comparison",
    "ConfigurationError",
    "DataError",
    "Diagnosis",
    "Effect",
    "EnergyProblem",
    "Estimate",
    "IdentError",
    "Information",
    "Log",
    "LogSet",
    "Model",
    "MomentumProblem",
    "Motion",
    "Problem",
    "Robot",
    "SavitzkyGolay",
    "Side",
    "Signals",
    "Status",
    "StatusCode",
    "Study",
    "Transmission",
    "UnsupportedError",
    "Validation",
    "ZeroPhase",
    "__version__",
    "compare",
    "diagnose",
    "effect_names",
    "effects",
    "estimators",
    "friction",
    "load_robot",
    "make_effect",
    "make_estimator",
    "monitor",
    "physical",
    "read_logs",
    "read_study",
    "regressor",
    "report",
    "robot_names",
    "robots",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        value = getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
    elif name in _PACKAGES:
        value = importlib.import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module 'ident' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


if TYPE_CHECKING:
    from . import effects, estimators, friction, physical, regressor, robots
    from .diagnosis import Diagnosis, diagnose
    from .effects.base import Effect, effect_names, make_effect
    from .effects.motion import Motion
    from .errors import ConfigurationError, DataError, IdentError, UnsupportedError
    from .estimate.estimate import Estimate
    from .estimate.status import Status, StatusCode
    from .estimators import make_estimator
    from .evaluation.comparison import Comparison, compare
    from .evaluation.validation import Validation, validate
    from .logs.log import Log, LogSet, read_logs
    from .model import Model
    from .monitoring import monitor
    from .problem.information import Information
    from .problem.integrated import EnergyProblem, MomentumProblem
    from .problem.problem import Problem
    from .reporting import report
    from .robots.library.load import load_robot, robot_names
    from .robots.robot import Robot
    from .robots.transmission import Side, Transmission
    from .signals.preparation import CentralDifference, SavitzkyGolay, ZeroPhase
    from .signals.signals import Signals
    from .study.study import Study, read_study
