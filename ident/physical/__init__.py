"""Physically possible and physically consistent: judge base parameters, repair them, turn them into links, find a payload.

Everything works on an `InertiaStructure` (plain arrays) and base values; `judge`, `repair_estimate` and `payload_of` take estimates.

>>> import ident
>>> train, test = ident.demo_logs()
>>> estimate = ident.fit(train, ident.load_robot("puma560"), held=test)
>>> bool(ident.physical.judge(estimate).possible)
True
"""

from .binding import Binding, binding_constraints
from .bounds import Bounds, LinkBounds, Metric, Prior, nominal_prior, reference_prior
from .cone_judgement import ConeJudgement, MinorVerdict, judge_by_cone
from .conic import InfeasibleError, SolverError, solver_available
from .consistent import Consistent, judge_consistent
from .constrained import Settling
from .estimates import payload_of, repair_estimate, with_repair
from .grid import GridJudgement, GridTest, judge_on_grid
from .judgement import DEFINITIONS, Judgement, Subject, judge, published_subject, subject_of
from .minors import MinorOrder, TooManyRaysError
from .modification import Modification, modify_by_cone
from .payload import PayloadEstimate, payload_from_fit, payload_from_fits, payload_from_logs
from .possible import Possible, judge_possible
from .repairs import Repair, RepairMethod, consistent_fit, repair, torque_errors
from .standard import StandardParameters, standard_parameters
from .structure import InertiaStructure
from .target import Target

__all__ = [
    "DEFINITIONS",
    "Binding",
    "Bounds",
    "ConeJudgement",
    "Consistent",
    "GridJudgement",
    "GridTest",
    "InertiaStructure",
    "InfeasibleError",
    "Judgement",
    "LinkBounds",
    "Metric",
    "MinorOrder",
    "MinorVerdict",
    "Modification",
    "PayloadEstimate",
    "Possible",
    "Prior",
    "Repair",
    "RepairMethod",
    "Settling",
    "SolverError",
    "StandardParameters",
    "Subject",
    "Target",
    "TooManyRaysError",
    "binding_constraints",
    "consistent_fit",
    "judge",
    "judge_by_cone",
    "judge_consistent",
    "judge_on_grid",
    "judge_possible",
    "modify_by_cone",
    "nominal_prior",
    "payload_from_fit",
    "payload_from_fits",
    "payload_from_logs",
    "payload_of",
    "published_subject",
    "reference_prior",
    "repair",
    "repair_estimate",
    "solver_available",
    "standard_parameters",
    "subject_of",
    "torque_errors",
    "with_repair",
]
