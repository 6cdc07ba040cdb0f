"""ident: identify a robot's dynamics, and find what its model is missing.

    robot = ident.load_robot("puma560")
    train, test = ident.demo_logs()
    print(ident.audit(train, robot))
    estimate = ident.fit(train, robot, held=test)
    print(estimate)

Robots (describe the robot and its drive): `load_robot`, `robot_names`, `Robot`, `Transmission`, `Side`.
Logs (read, check and prepare recordings): `read_logs`, `demo_logs`, `audit`, `Log`, `LogSet`, `Signals`,
    `ZeroPhase`, `SavitzkyGolay`, `CentralDifference`.
Models (the terms that make up the torque): `Model`, `Effect`, `Motion`, `effect_names`, `make_effect`, `base`.
Identification (parameters with covariance): `fit`, `Problem`, `MomentumProblem`, `EnergyProblem`, `Information`,
    `make_estimator`, `Estimate`, `Status`, `StatusCode`.
Evaluation (on held-out data; against feedback): `validate`, `Validation`, `compare`, `Comparison`, `essential`, `Essential`,
    `feedback_bias`, `FeedbackBias`.
Diagnosis (what the model is missing, and what has changed): `diagnose`, `Diagnosis`, `next_motion`, `monitor`.
Physics (physical consistency, payloads): `judge`, `repair`, `payload`.
Experiments (motions to run, and simulated runs): `excite`, `plan`, `simulate`.
Results (reports and exports): `report`, `export`.
Studies (everything in one TOML file): `Study`, `read_study`.
Errors (each says what is wrong and how to fix it): `IdentError`, `ConfigurationError`, `DataError`, `UnsupportedError`.

Packages: `drives` (logs without torque), `effects`, `estimators`, `friction`, `logs`, `physical`, `regressor`, `robots`.
Steps are logged to the logger `ident`: `logging.basicConfig(level="INFO")` shows them.
Public names are loaded on first use, so that `import ident` is fast."""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

from ._utils.version import __version__

# A library's log says nothing until its user asks.
logging.getLogger(__name__).addHandler(logging.NullHandler())

#: Public name → where it is: package, and its name there where that is another.
_WHERE: dict[str, tuple[str, str]] = {
    "load_robot": ("robots", "load_robot"),
    "robot_names": ("robots", "robot_names"),
    "Robot": ("robots", "Robot"),
    "Transmission": ("robots", "Transmission"),
    "Side": ("robots", "Side"),
    "read_logs": ("logs", "read_logs"),
    "demo_logs": ("logs", "demo_logs"),
    "audit": ("auditing", "audit"),
    "Log": ("logs", "Log"),
    "LogSet": ("logs", "LogSet"),
    "Signals": ("signals", "Signals"),
    "ZeroPhase": ("signals", "ZeroPhase"),
    "SavitzkyGolay": ("signals", "SavitzkyGolay"),
    "CentralDifference": ("signals", "CentralDifference"),
    "Model": ("model", "Model"),
    "Effect": ("effects", "Effect"),
    "Motion": ("effects", "Motion"),
    "effect_names": ("effects", "effect_names"),
    "make_effect": ("effects", "make_effect"),
    "base": ("problem", "base_report"),
    "fit": ("study", "fit"),
    "Problem": ("problem", "Problem"),
    "MomentumProblem": ("problem", "MomentumProblem"),
    "EnergyProblem": ("problem", "EnergyProblem"),
    "Information": ("problem", "Information"),
    "make_estimator": ("estimators", "make_estimator"),
    "Estimate": ("estimate", "Estimate"),
    "Status": ("estimate", "Status"),
    "StatusCode": ("estimate", "StatusCode"),
    "validate": ("evaluation", "validate"),
    "Validation": ("evaluation", "Validation"),
    "compare": ("evaluation", "compare"),
    "Comparison": ("evaluation", "Comparison"),
    "essential": ("evaluation", "essential"),
    "Essential": ("evaluation", "Essential"),
    "feedback_bias": ("evaluation", "feedback_bias"),
    "FeedbackBias": ("evaluation", "FeedbackBias"),
    "diagnose": ("diagnosis", "diagnose"),
    "Diagnosis": ("diagnosis", "Diagnosis"),
    "next_motion": ("diagnosis", "next_motion"),
    "monitor": ("monitoring", "monitor"),
    "judge": ("physical", "judge"),
    "repair": ("physical", "repair_estimate"),
    "payload": ("physical", "payload_of"),
    "excite": ("excitation", "excite"),
    "plan": ("planning", "make_plan"),
    "simulate": ("simulation", "simulate"),
    "report": ("reporting", "report"),
    "export": ("exporting", "export"),
    "Study": ("study", "Study"),
    "read_study": ("study", "read_study"),
    "IdentError": ("errors", "IdentError"),
    "ConfigurationError": ("errors", "ConfigurationError"),
    "DataError": ("errors", "DataError"),
    "UnsupportedError": ("errors", "UnsupportedError"),
}
_PACKAGES = ("drives", "effects", "estimators", "friction", "logs", "physical", "regressor", "robots")

__all__ = [
    "CentralDifference",
    "Comparison",
    "ConfigurationError",
    "DataError",
    "Diagnosis",
    "Effect",
    "EnergyProblem",
    "Essential",
    "Estimate",
    "FeedbackBias",
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
    "audit",
    "base",
    "compare",
    "demo_logs",
    "diagnose",
    "drives",
    "effect_names",
    "effects",
    "essential",
    "estimators",
    "excite",
    "export",
    "feedback_bias",
    "fit",
    "friction",
    "judge",
    "load_robot",
    "logs",
    "make_effect",
    "make_estimator",
    "monitor",
    "next_motion",
    "payload",
    "physical",
    "plan",
    "read_logs",
    "read_study",
    "regressor",
    "repair",
    "report",
    "robot_names",
    "robots",
    "simulate",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        package, own = _WHERE[name]
        value = getattr(importlib.import_module(f".{package}", __name__), own)
    elif name in _PACKAGES:
        value = importlib.import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module 'ident' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


if TYPE_CHECKING:
    from . import drives, effects, estimators, friction, logs, physical, regressor, robots
    from .auditing import audit
    from .diagnosis import Diagnosis, diagnose, next_motion
    from .effects import Effect, Motion, effect_names, make_effect
    from .errors import ConfigurationError, DataError, IdentError, UnsupportedError
    from .estimate import Estimate, Status, StatusCode
    from .estimators import make_estimator
    from .evaluation import Comparison, Essential, FeedbackBias, Validation, compare, essential, feedback_bias, validate
    from .excitation import excite
    from .exporting import export
    from .logs import Log, LogSet, demo_logs, read_logs
    from .model import Model
    from .monitoring import monitor
    from .physical import judge
    from .physical import payload_of as payload
    from .physical import repair_estimate as repair
    from .planning import make_plan as plan
    from .problem import EnergyProblem, Information, MomentumProblem, Problem
    from .problem import base_report as base
    from .reporting import report
    from .robots import Robot, Side, Transmission, load_robot, robot_names
    from .signals import CentralDifference, SavitzkyGolay, Signals, ZeroPhase
    from .simulation import simulate
    from .study import Study, fit, read_study
