"""Both judgements of one set of base parameters, for an estimate or a published set, as `ident judge` reports them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import svd
from .._utils.threads import with_one_blas_thread
from ..drawing.document import Figure, Section, Text
from ..drawing.shown import Shown
from ..errors import ConfigurationError
from ..friction import Coulomb, RotorInertia, Viscous
from .conic import solver_available
from .consistent import Consistent, judge_consistent
from .pictures import shortfall_figure, shortfall_frame
from .possible import Possible, judge_possible
from .structure import InertiaStructure

if TYPE_CHECKING:
    import pandas as pd

    from ..estimate.estimate import Estimate
    from ..robots.robot import Robot

Array = np.ndarray

#: The two matrices that can be judged: of the links, and with the rotors R seen through the transmission K.
LINKS_ALONE = "H"
WITH_ROTORS = "H + K^-T R K^-1"
#: What the verdicts mean.
DEFINITIONS = (
    "possible: the inertia matrix is positive definite at every position, so that every motion has a positive kinetic energy.",
    "consistent: real bodies, with a density that is nowhere negative, can have these parameters; then H alone is possible, too.",
)


@dataclass(frozen=True, eq=False, repr=False)
class Judgement(Shown, ShortRepr):
    """`possible` and `consistent` (None without the semidefinite solver) of a set called `subject`, of a robot with these `links`.

    `possible` is of `matrix`: what a drive feels, reflected rotor inertia included, unless the set holds none of its own. `alone`: the
    verdict on H alone, without rotors, as the dissertation judges; None where that is the same matrix.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> judged = ident.judge(ident.fit(train, "puma560", held=0))
    >>> list(judged.to_frame().columns)
    ['possible', 'lacks']
    """

    subject: str
    possible: Possible
    consistent: Consistent | None
    notes: tuple[str, ...] = ()
    links: tuple[str, ...] = ()
    alone: Possible | None = None

    @property
    def matrix(self) -> str:
        """The inertia matrix that `possible` is about."""
        return LINKS_ALONE if self.alone is None else WITH_ROTORS

    def figure(self) -> Figure:
        """What each link's pseudo-inertia lacks to be that of a real body; see `plot`."""
        return shortfall_figure(self.links, self.consistent)

    def to_frame(self) -> pd.DataFrame:
        """One row per moving link: whether a real body can have its parameters, and what its scaled pseudo-inertia lacks."""
        return shortfall_frame(self.links, self.consistent)

    def sections(self) -> tuple[Section, ...]:
        """Both verdicts in words."""
        return (Text(f"Judgement of {self.subject}", tuple(self.text().splitlines()[1:])),)

    def __str__(self) -> str:
        return self.text()

    def text(self) -> str:
        """A few lines for people, with what the verdicts mean."""
        return "\n".join([*self.verdicts(), *DEFINITIONS])

    def verdicts(self) -> list[str]:
        """The lines of the verdicts alone."""
        consistent = "physical consistency was not judged: the solver is not installed (pip install 'ident[sdp]')"
        lines = [self.subject, *self._possible(), consistent if self.consistent is None else self.consistent.text()]
        return [*lines, *self.notes]

    def _possible(self) -> list[str]:
        if self.alone is None:
            return [f"{LINKS_ALONE}, the inertia matrix (no rotor inertia beside it): {self.possible.text()}"]
        alone = self.alone.text().splitlines()[0]
        if self.alone.possible != self.possible.possible:
            alone += "; a drive feels the rotors, too, and the verdicts differ"
        return [f"{WITH_ROTORS}, the inertia that a drive feels: {self.possible.text()}", f"{LINKS_ALONE} alone, without rotors: {alone}"]

    def to_dict(self) -> dict[str, Any]:
        """The body of `ident.judgement/1` (docs/formats.md)."""
        p, c = self.possible, self.consistent
        return {
            "subject": self.subject,
            "matrix": self.matrix,
            "possible": p.possible,
            "alone": None if self.alone is None else self.alone.to_dict(),
            "consistent": None if c is None else c.consistent,
            "min_eigenvalue": p.min_eigenvalue,
            "worst_configuration": dict(p.worst_configuration),
            "method": p.method,
            "certified": p.certified,
            "violated_links": [] if c is None else list(c.violated_links),
            "violated_parameters": [] if c is None else list(c.violated_parameters),
            "lower_bound": p.lower_bound if np.isfinite(p.lower_bound) else None,
            "margin_std": p.margin_std,
            "within_limits": p.within_limits,
            "seconds": p.seconds + (0.0 if c is None else c.seconds),
            "notes": [*self.notes, *p.notes, *(() if c is None else c.notes)],
        }


@dataclass(frozen=True, eq=False, repr=False)
class Subject(ShortRepr):
    """A set of base parameters with what they mean: `structure`, `values` (b,), `covariance` (b, b) or None.

    `unseen` (b, u): changes of base values that the data could not see (none: u = 0); they may be chosen freely."""

    name: str
    structure: InertiaStructure
    values: Array
    covariance: Array | None
    unseen: Array | None = None
    notes: tuple[str, ...] = ()

    @property
    def matrices(self) -> dict[str, InertiaStructure]:
        """The inertia matrices that can be judged, by their formula: with rotors first, and H alone where that is another one."""
        alone = self.structure.without_rotors
        if np.array_equal(alone.reflected, self.structure.reflected):
            return {LINKS_ALONE: self.structure}
        return {WITH_ROTORS: self.structure, LINKS_ALONE: alone}


def subject_of(estimate: Estimate) -> Subject:
    """An estimate's base values over the model's full base (parameters that its data could not tell apart stand at zero, which is said)."""
    base = estimate.model.base
    structure = InertiaStructure.from_model(estimate.model, base)
    if len(estimate.values) == base.count:
        return Subject(estimate.method, structure, estimate.values, estimate.covariance)
    values = base.base_values(estimate.all_values)
    at = np.searchsorted(base.independent, estimate.base.independent)
    covariance = np.zeros((base.count, base.count))
    covariance[np.ix_(at, at)] = estimate.covariance
    missing = ", ".join(base.names[i] for i in range(base.count) if i not in set(at.tolist()))
    # What the data see of the model's base parameters; the rest of the space is free.
    seen = estimate.base.regroup @ structure.lift
    unseen = svd(seen)[2][len(seen) :].T
    return Subject(
        estimate.method, structure, values, covariance, unseen, (f"not determined by the data, and judged with the value zero: {missing}.",)
    )


@with_one_blas_thread
def judge(subject: Subject | Estimate, *, limits: bool = False, time_limit: float = 60.0) -> Judgement:
    """Judge whether an estimate is physically possible (its inertia matrix positive definite everywhere) and consistent (bodies with
    positive mass density have it).

    Parameters
    ----------
    subject : Estimate or Subject
        What is judged.
    limits : bool
        Look within the joint limits only.
    time_limit : float
        Seconds for the search of the worst configuration.

    Returns
    -------
    Judgement
        Both verdicts, the worst configuration, and the distance to the feasibility boundary in standard deviations; and the verdict
        on H alone where the set holds rotor inertia beside it.

    References
    ----------
    K. Yoshida and W. Khalil, "Verification of the positive definiteness of the inertial matrix of manipulators using base inertial
    parameters", Int. J. Robotics Research 19(5), 2000. P. M. Wensing et al., "Linear matrix inequalities for physically consistent
    inertial parameter identification", IEEE Robotics and Automation Letters 3(1), 2018.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> ident.judge(ident.fit(train, "puma560", held=0)).possible.possible
    True
    """
    if not isinstance(subject, Subject):
        subject = subject_of(subject)
    possible = judge_possible(subject.structure, subject.values, covariance=subject.covariance, limits=limits, time_limit=time_limit)
    consistent = None
    if solver_available():
        consistent = judge_consistent(subject.structure, subject.values, unseen=subject.unseen, covariance=subject.covariance)
    links, alone = subject.matrices.get(LINKS_ALONE, subject.structure), None
    if links is not subject.structure and np.array_equal(links.added(subject.values), subject.structure.added(subject.values)):
        alone = replace(possible, margin_std=None)  # rotors that weigh nothing: the same matrix
    elif links is not subject.structure:
        alone = judge_possible(links, subject.values, limits=limits, time_limit=time_limit, beside=possible)
    return Judgement(subject.name, possible, consistent, subject.notes, subject.structure.body_names, alone)


#: First letter and axes of a published name -> symbol of the parameter that stays in that base parameter (theorem 2.3.1).
_PUBLISHED = {
    "Jz": "Izz", "J(x-y)": "Ixx", "Jxy": "Ixy", "Jxz": "Ixz", "Jyz": "Iyz", "Rx": "mx", "Ry": "my", "h": "Ia", "b": "Fv", "c": "Fc",
}  # fmt: skip


def published_subject(robot: Robot, values: Mapping[str, float], name: str = "published set") -> Subject:
    """A set in the dissertation's notation (`J3z`, `J3(x-y)`, `R2x`, `h3`, `b1`, `c1` …, number = joint) for a robot in its frames.

    Raises ConfigurationError where the names are not the base parameters of the robot with rotor inertia, viscous and Coulomb friction."""
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    base = model.base
    structure = InertiaStructure.from_model(model, base)
    out = np.full(base.count, np.nan)
    places = {n: i for i, n in enumerate(base.names)}
    for key, value in values.items():
        number = "".join(c for c in key if c.isdigit())
        symbol = _PUBLISHED.get(key.replace(number, "", 1)) if number else None
        place = None if symbol is None or int(number) > robot.n else places.get(f"{symbol}_{robot.joint_names[int(number) - 1]}")
        if place is None:
            raise ConfigurationError(f"{name}: {key!r} is no base parameter of robot {robot.name!r} in the notation of the dissertation.")
        out[place] = float(value)
    if np.any(np.isnan(out)):
        missing = [n for n, i in places.items() if np.isnan(out[i])]
        raise ConfigurationError(f"{name}: no value for {', '.join(missing[:6])}.")
    return Subject(name, structure, out, None)
