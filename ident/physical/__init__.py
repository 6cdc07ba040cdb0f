"""Physically possible and physically consistent: judge base parameters, repair them, turn them into links, find a payload.

Everything works on an `InertiaStructure` (plain arrays) and base values; `judge`, `repair_estimate` and `payload_of` take estimates."""

from .bounds import Bounds, LinkBounds, Metric, Prior
from .conic import InfeasibleError, SolverError, solver_available
from .consistent import Consistent, judge_consistent
from .grid import GridJudgement, GridTest, judge_on_grid
from .judgement import Judgement, Subject, judge, published_subject, subject_of
from .payload import PayloadEstimate, payload_from_fit, payload_from_fits, payload_from_logs
from .possible import Possible, judge_possible
from .repair import Repair, RepairMethod, repair
from .standard import StandardParameters, standard_parameters
from .structure import InertiaStructure

__all__ = [
    "Bounds",
    "Consistent",
    "GridJudgement",
    "GridTest",
    "InertiaStructure",
    "InfeasibleError",
    "Judgement",
    "LinkBounds",
    "Metric",
    "PayloadEstimate",
    "Possible",
    "Prior",
    "Repair",
    "RepairMethod",
    "SolverError",
    "StandardParameters",
    "Subject",
    "judge",
    "judge_consistent",
    "judge_on_grid",
    "judge_possible",
    "payload_from_fit",
    "payload_from_fits",
    "payload_from_logs",
    "published_subject",
    "repair",
    "solver_available",
    "standard_parameters",
    "subject_of",
]
