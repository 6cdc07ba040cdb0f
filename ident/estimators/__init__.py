"""Estimators: strategies behind one interface and one result.

>>> import ident
>>> ident.estimators.make_estimator("wls") == ident.estimators.WeightedLeastSquares()
True
"""

from ..problem.linear_solution import LinearSolution, solve_triangle
from .band_instruments import BandInstruments
from .base import Capability, Estimator, estimator_types, make_estimator, register
from .bounded import BoundedLeastSquares
from .drifting import DriftingParameters
from .experiment import Desired, Experiment, assumed_experiment, desired_from_logs
from .finish import finish
from .generalised import GeneralisedLeastSquares
from .instrumental import InstrumentalVariable
from .instruments import Instruments
from .least_squares import LeastSquares, WeightedLeastSquares, weighted_solution
from .output_error import OutputError
from .physical import PhysicalLeastSquares
from .prior import PriorLeastSquares
from .recursive import RecursiveLeastSquares, RecursiveState
from .recursive_instruments import InstrumentState, RecursiveInstrumentalVariable
from .robust import RobustLeastSquares
from .sequential import StepByStep
from .total import TotalLeastSquares

__all__ = [
    "BandInstruments",
    "BoundedLeastSquares",
    "Capability",
    "Desired",
    "DriftingParameters",
    "Estimator",
    "Experiment",
    "GeneralisedLeastSquares",
    "InstrumentState",
    "InstrumentalVariable",
    "Instruments",
    "LeastSquares",
    "LinearSolution",
    "OutputError",
    "PhysicalLeastSquares",
    "PriorLeastSquares",
    "RecursiveInstrumentalVariable",
    "RecursiveLeastSquares",
    "RecursiveState",
    "RobustLeastSquares",
    "StepByStep",
    "TotalLeastSquares",
    "WeightedLeastSquares",
    "assumed_experiment",
    "desired_from_logs",
    "estimator_types",
    "finish",
    "make_estimator",
    "register",
    "solve_triangle",
    "weighted_solution",
]
