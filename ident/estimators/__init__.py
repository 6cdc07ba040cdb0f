"""Estimators: strategies behind one interface and one result."""

from .base import Capability, Estimator, estimator_types, make_estimator, register
from .least_squares import LeastSquares, WeightedLeastSquares

__all__ = ["Capability", "Estimator", "LeastSquares", "WeightedLeastSquares", "estimator_types", "make_estimator", "register"]
