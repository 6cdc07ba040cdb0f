"""ident: identify a robot's dynamics, and find what its model lacks.

Public names load when they are used: `import ident` itself is light."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_WHERE = {
    "Robot": "robot",
    "Transmission": "transmission",
    "Side": "transmission",
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
    "Motion": "motion",
    "Effect": "effect",
    "make_effect": "effect",
    "effect_names": "effect",
    "Problem": "problem",
    "Information": "information",
    "Estimate": "estimate",
    "Status": "status",
    "StatusCode": "status",
    "make_estimator": "estimators",
    "validate": "validation",
    "Validation": "validation",
    "compare": "comparison",
    "monitor": "monitoring",
    "report": "reporting",
    "diagnose": "diagnosis",
    "Diagnosis": "diagnosis",
    "Comparison": "comparison",
    "Study": "study",
    "read_study": "study",
    "IdentError": "errors",
    "ConfigurationError": "errors",
    "DataError": "errors",
    "UnsupportedError": "errors",
    "MomentumProblem": "integrated",
    "EnergyProblem": "integrated",
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
    from .comparison import Comparison, compare
    from .diagnosis import Diagnosis, diagnose
    from .effect import Effect, effect_names, make_effect
    from .errors import ConfigurationError, DataError, IdentError, UnsupportedError
    from .estimate import Estimate
    from .estimators import make_estimator
    from .information import Information
    from .integrated import EnergyProblem, MomentumProblem
    from .logs import Log, LogSet, read_logs
    from .model import Model
    from .monitoring import monitor
    from .motion import Motion
    from .problem import Problem
    from .reporting import report
    from .robot import Robot
    from .robots import load_robot, robot_names
    from .signals import CentralDifference, SavitzkyGolay, Signals, ZeroPhase
    from .status import Status, StatusCode
    from .study import Study, read_study
    from .transmission import Side, Transmission
    from .validation import Validation, validate
