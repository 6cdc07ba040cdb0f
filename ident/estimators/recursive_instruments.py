"""Recursive instrumental variables: the plain instrumental estimate, up to date after every sample."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.reduction import base_reduction
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..problem.linear_solution import LinearSolution
from ..robots.transmission import Side
from .base import Capability, Estimator, register, require_forgetting
from .earlier import load_earlier
from .experiment import Experiment, require_experiment
from .instrumental import InstrumentalVariable
from .instruments import Instruments
from .plain_instruments import ExtendedInformation, PlainPasses

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..problem.problem import Problem
    from ..regressor.base_parameters.reduction import BaseReduction

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class RecursiveInstrumentalVariable(Estimator):
    """Plain instrumental variables (Yoshida 1995) by a formula that is up to date after every sample; at the end of a log it equals
    method `iv` with `weighting = "none"` and as many iterations as there are `passes`.

    The model that makes the instruments is fixed during a pass: at first that of ordinary least squares on the log, then that of the pass
    before. `instruments`, `loop`, `experiment`: as for `iv`. `forgetting`: weight of a sample against the next in the last pass (1: none
    is forgotten). `follow`: base parameters whose course over the last pass is kept in the trace (None: all), at `trace_points` points.

    In a live loop: `state = estimator.start(model)` with `prior`, an earlier estimate (or the path of a saved one) whose model makes the
    instruments; then `state = state.observe(q, dq, ddq, tau)`.

    Examples
    --------
    >>> import ident
    >>> method = ident.estimators.RecursiveInstrumentalVariable(passes=3)
    >>> sorted(capability.value for capability in method.capabilities)
    ['noisy regressor', 'recursive']
    """

    name: ClassVar[str] = "riv"
    title: ClassVar[str] = "recursive instrumental variables"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.NOISY_REGRESSOR, Capability.RECURSIVE})
    files: ClassVar[frozenset[str]] = frozenset({"prior"})

    instruments: str = Instruments.FORWARD_DYNAMICS.value
    loop: str = "unknown"
    experiment: Experiment | None = None
    passes: int = 2
    forgetting: float = 1.0
    prior: Estimate | str | None = None
    follow: tuple[str, ...] | None = None
    trace_points: int = 100

    def __post_init__(self) -> None:
        super().__post_init__()
        require_experiment(self.experiment, self.name)
        require_forgetting(self.forgetting, self.name)
        if self.passes < 1 or self.trace_points < 0:
            raise ConfigurationError("method 'riv': passes must be at least 1, and trace_points must not be negative.")
        self._batch  # noqa: B018 - its own checks of instruments and loop

    @property
    def _batch(self) -> InstrumentalVariable:
        return InstrumentalVariable(
            instruments=self.instruments, loop=self.loop, experiment=self.experiment, weighting="none", iterations=self.passes
        )

    def check(self, problem: Problem) -> None:
        self._batch.check(problem)
        for name in self.follow or ():
            if name not in problem.base.names:
                raise unknown_name("base parameter in `follow`", name, problem.base.names)

    def start(self, model: Model, base: BaseReduction | None = None) -> InstrumentState:
        """A recursion over the base parameters of a model, before the first sample."""
        base = base_reduction(model) if base is None else base
        source = None if self.prior is None else base.base_values(load_earlier(self.prior).all_values)
        return InstrumentState(model, base, ExtendedInformation.empty(base.count), 0, self, source)

    def _solve(self, problem: Problem) -> Estimate:
        source, total = Instruments(self.instruments), len(problem.valid)
        found = PlainPasses.begin(problem)
        for _ in range(self.passes - 1):
            found = found.next(problem, source, self.experiment)
        names = self.follow or problem.base.names
        course = _Passage(found.columns, [problem.base.names.index(n) for n in names], total, self.trace_points)
        found = found.next(problem, source, self.experiment, course, self.forgetting)
        trace = {
            "names": list(names), "samples": course.samples, "values": course.values, "std": course.std, "forgetting": self.forgetting,
            "steps": list(found.steps), "repaired": list(found.repaired),
        }  # fmt: skip
        result = found.result(problem, commanded=self._batch.from_commanded_torque)
        supposed = (self.experiment.assumed,) if self.experiment is not None and self.experiment.assumed else ()
        return result.estimate(self.name, trace, found.steps[-1] < 1.0, supposed)


@dataclass(frozen=True, eq=False)
class InstrumentState:
    """Where a recursion stands. Immutable: every update gives the next state.

    `information`: the factor of [Ω Ψ τ] so far; `seen`: instants taken so far; `source` (b,): base parameters of the model that makes the
    instruments, None without one."""

    model: Model
    base: BaseReduction
    information: ExtendedInformation
    seen: int
    config: RecursiveInstrumentalVariable
    source: Array | None = field(default=None)

    def update(self, columns: Array, tau: Array, valid: Array | None = None, instruments: Array | None = None) -> InstrumentState:
        """Take m instants: `columns` and `instruments` (m, n, b) over base parameters, `tau` (m, n), `valid` (m, n) bool (None: all).

        Without instruments the columns stand for themselves, which is least squares."""
        use = np.isfinite(tau) if valid is None else valid & np.isfinite(tau)
        Z = columns if instruments is None else instruments
        m, factor = len(tau), self.config.forgetting
        information, clean = self.information, np.where(use, tau, 0.0)
        if factor < 1.0:
            root = np.sqrt(factor ** np.arange(m - 1, -1, -1.0))[:, None]
            information, clean = information.scaled(factor**m), clean * root
            Z, columns = Z * root[:, :, None], columns * root[:, :, None]
        return replace(self, information=information.with_rows(Z, columns, clean, use), seen=self.seen + m)

    def observe(self, q: Array, dq: Array, ddq: Array, tau: Array, t: Array | None = None) -> InstrumentState:
        """Take measured instants, each array (n,) or (m, n): joint-side motion, measured-side torque (NaN: missing).

        Instruments: accelerations of the `prior`'s model at the measured state and torque. Raises ConfigurationError without a prior."""
        if self.source is None:
            raise ConfigurationError("method 'riv' needs a model to make instruments from: give prior = an earlier estimate.")
        if self.model.needs & {Need.HISTORY, Need.NEIGHBOURS, Need.REFERENCE}:
            raise UnsupportedError(
                "an effect of this model depends on other instants; make columns and instruments yourself, and `update`."
            )
        q, dq, ddq, tau = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq, tau))
        clock = None if t is None else np.atleast_1d(t)
        robot, values = self.model.robot, self.base.expand(self.source)
        inertia, bias = self.model.inertia_and_bias(q, dq, values)
        to_joint = robot.transmission.torque_map(robot.transmission.measured, Side.JOINT)
        known = np.isfinite(tau).all(axis=1)
        force = (np.where(known[:, None], tau, 0.0) - bias) @ to_joint.T
        modelled = np.linalg.solve(np.matmul(to_joint, inertia), force[:, :, None])[:, :, 0]
        columns, instruments = (self.model.columns(Motion.of(robot, q, dq, a, clock))[:, :, self.base.independent] for a in (ddq, modelled))
        return self.update(columns, tau, np.isfinite(tau) & known[:, None], instruments)

    @cached_property
    def _solution(self) -> LinearSolution | None:
        if not self.information.determined:
            return None
        found = self.information.solution()
        return found if len(found.values) == self.base.count else None

    @property
    def values(self) -> Array:
        """Base parameters (b,); NaN before the samples determine them."""
        return np.full(self.base.count, np.nan) if self._solution is None else self._solution.values

    @property
    def std(self) -> Array:
        """Their standard deviations (b,), for white noise."""
        return _white_std(self.information, self._solution, self.base.count)


def _white_std(information: ExtendedInformation, solution: LinearSolution | None, b: int) -> Array:
    from scipy.linalg import solve_triangular

    if solution is None:
        return np.full(b, np.nan)
    inverse = solve_triangular(solution.root, np.eye(b))
    return np.asarray(np.linalg.norm(inverse, axis=1) * np.sqrt(information.variance(solution.values)))


class _Passage:
    """Values and standard deviations of some parameters against the number of samples."""

    def __init__(self, columns: Array, which: list[int], total: int, points: int) -> None:
        place = {int(c): i for i, c in enumerate(columns)}
        self.which = [place.get(i, -1) for i in which]
        self.piece = max(1, -(-total // points)) if points else total
        self.keep, self.total, self.count = points > 0, total, len(columns)
        self.samples: list[int] = []
        self.values: list[list[float]] = []
        self.std: list[list[float]] = []

    def __call__(self, information: ExtendedInformation, seen: int) -> None:
        """Note where the recursion stands."""
        if not self.keep or (seen % self.piece and seen != self.total):
            return
        found = information.solution() if information.determined else None
        if found is not None and len(found.values) != self.count:
            found = None
        values = np.full(self.count, np.nan) if found is None else found.values
        std = _white_std(information, found, self.count)
        self.samples.append(seen)
        self.values.append([float(values[i]) if i >= 0 else float("nan") for i in self.which])
        self.std.append([float(std[i]) if i >= 0 else float("nan") for i in self.which])
