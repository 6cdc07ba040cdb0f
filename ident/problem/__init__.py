"""Problems: a model and prepared signals, reduced to information on base parameters."""

from __future__ import annotations

from .base_report import BaseReport, base_report
from .check import ProblemCheck
from .information import Form, Information
from .integrated import EnergyProblem, MomentumProblem
from .problem import Problem

__all__ = ["BaseReport", "EnergyProblem", "Form", "Information", "MomentumProblem", "Problem", "ProblemCheck", "base_report"]
