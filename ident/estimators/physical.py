"""Weighted least squares over physically consistent robots only: real links, and rotor inertia and friction of the right sign."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..estimate.status import StatusCode
from ..physical.binding import binding_constraints
from ..physical.bounds import Bounds, Metric, nominal_prior, reference_prior
from ..physical.conic import SolverError, solver_available
from ..physical.consistent import judge_consistent
from ..physical.constrained import ConsistentFit, Settling
from ..physical.judgement import subject_of
from ..physical.repairs import consistent_fit
from ..physical.structure import InertiaStructure
from ..physical.target import Target
from ..problem.linear_solution import LinearSolution, order_of, solve_triangle
from ..problem.reweighting import residual_weights
from .base import Capability, Estimator, register
from .finish import finish
from .least_squares import weighted_solution

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..physical.binding import Binding
    from ..physical.bounds import Prior
    from ..problem.problem import Problem

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class PhysicalLeastSquares(Estimator):
    """Weighted least squares subject to linear matrix inequalities (Sousa & Cortesão 2014; Wensing, Kim & Slotine 2018), solved

    from the information block. `total_mass`: (least, most) of all moving links in kg, None for open. `spread`: relative standard deviation
    about the URDF's own links; None for no prior, and then what the data hardly see is settled on the URDF's links (the lightest,
    where it has none) within one standard deviation of the best fit. `metric` of the prior: "quadratic", "entropic" or "geometric".
    `solver`: "auto", "lmi" (needs the extra `sdp`) or "log_cholesky". The covariance is that without the constraints.

    Examples
    --------
    >>> import ident
    >>> method = ident.estimators.PhysicalLeastSquares(spread=0.3)
    >>> sorted(capability.value for capability in method.capabilities)
    ['bounds', 'physical', 'prior', 'streaming', 'weights']
    """

    name: ClassVar[str] = "physical"
    title: ClassVar[str] = "weighted least squares over physically consistent robots"
    capabilities: ClassVar[frozenset[Capability]] = frozenset(
        {Capability.STREAMING, Capability.WEIGHTS, Capability.BOUNDS, Capability.PRIOR, Capability.PHYSICAL}
    )

    total_mass: tuple[float | None, float | None] = (None, None)
    spread: float | None = None
    metric: str = "quadratic"
    solver: str = "auto"

    def check(self, problem: Problem) -> None:
        if self.solver not in ("auto", "lmi", "log_cholesky"):
            raise unknown_name("solver", self.solver, ("auto", "lmi", "log_cholesky"))
        if self.metric not in list(Metric):
            raise unknown_name("metric", self.metric, [m.value for m in Metric])
        if self.spread is not None and not self.spread > 0:
            raise ConfigurationError(f"spread must be positive (0.3: links within about 30 % of the URDF's), not {self.spread}.")
        if self.spread is not None and problem.model.robot.nominal is None:
            raise ConfigurationError(f"robot {problem.model.robot.name!r} has no nominal inertials to stay close to; leave out `spread`.")
        if not any(isinstance(e, RigidBody) for e in problem.model.effects):
            raise UnsupportedError(
                "method 'physical' needs links, but the model holds no rigid body; use 'bounded' for bounds on single parameters."
            )

    def _solve(self, problem: Problem) -> Estimate:
        structure = InertiaStructure.from_model(problem.model, problem.base)
        bounds, prior = self._knowledge(problem)
        near, notes = reference_prior(problem.model.robot, structure) if prior is None else (None, ())
        free, weights = weighted_solution(problem)
        if bounds is None and prior is None and _already(structure, free):
            return finish(problem, free, weights, self.name)
        unconstrained = finish(problem, free, weights, self.name)
        order = order_of(problem.base)

        def constrained(weights: Array) -> ConsistentFit:
            R, z, _ = problem.information.combined(weights)
            target = Target.from_information(R, z)
            return consistent_fit(structure, target, bounds=bounds, prior=prior, method=self.solver, settling=Settling(near))

        fit = constrained(weights)
        for _ in range(2):
            new = residual_weights(problem.information, replace(free, values=free.regroup @ fit.values), weights)
            change = np.max(np.abs(new - weights) / np.where(new > 0, new, 1.0))
            if change < 1e-2:
                break
            weights = new
            free = solve_triangle(*problem.information.combined(weights)[:2], order)
            fit = constrained(weights)
        solution = replace(free, values=free.regroup @ fit.values)
        estimate = finish(problem, solution, weights, self.name, warnings=(*fit.notes, *notes))
        moved = np.abs(solution.values - free.values) / np.where(estimate.std > 0, estimate.std, np.inf)
        trace = {"cost": fit.cost, "method": fit.method, "unconstrained": dict(zip(estimate.names, free.values.tolist(), strict=True))}
        binding = _binding(unconstrained, bounds)
        if binding is not None:
            trace["binding"] = binding.to_dict()
        estimate = replace(estimate, trace=trace)
        if not np.any(moved > 0.1):
            return estimate
        most = np.argsort(-moved)[:6]
        details = (
            "No real robot gives the unconstrained solution; farthest from it:",
            *(
                f"{estimate.names[i]} {solution.values[i]:.4g} instead of {free.values[i]:.4g} ({moved[i]:.1f} std)."
                for i in most
                if moved[i] > 0.1
            ),
            *(binding.sentences() if binding is not None else ()),
        )
        code = StatusCode.AT_BOUND if estimate.status.code in (StatusCode.OK, StatusCode.POOR_FIT) else estimate.status.code
        return replace(estimate, status=replace(estimate.status, code=code, details=(*estimate.status.details, *details)))

    def _knowledge(self, problem: Problem) -> tuple[Bounds | None, Prior | None]:
        bounds = None if self.total_mass == (None, None) else Bounds(total_mass=self.total_mass)
        if self.spread is None:
            return bounds, None
        return bounds, nominal_prior(problem.model.robot, Metric(self.metric), self.spread)[0]


def _binding(unconstrained: Estimate, bounds: Bounds | None) -> Binding | None:
    """Which links and signs hold the fit back, in standard deviations of the unconstrained estimate; None without the solver."""
    if not solver_available():
        return None
    subject = subject_of(unconstrained)
    assert subject.covariance is not None
    try:
        return binding_constraints(
            subject.structure, Target.from_covariance(subject.values, subject.covariance, subject.unseen), bounds=bounds
        )
    except SolverError:
        return None


def _already(structure: InertiaStructure, free: LinearSolution) -> bool:
    """Whether the unconstrained solution is consistent as it stands."""
    if not solver_available() or len(free.columns) < structure.b:
        return False
    return judge_consistent(structure, free.values).consistent
