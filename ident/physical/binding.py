"""Why a consistent fit differs from the unconstrained one: which constraints bind, what each costs, and whether noise alone explains it."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from .bounds import Bounds, Prior
from .conic import SolverError
from .consistent import link_scales
from .constrained import nominal_scale
from .constrained_problem import MARGIN, ConstrainedProblem
from .pseudo_inertia import pseudo_inertia
from .structure import InertiaStructure
from .target import Target

Array = np.ndarray

#: Eigenvalue of a pseudo-inertia of unit diagonal below which a link counts as lying on the border of real bodies.
_BORDER = 1e-3
#: Probabilities below which noise hardly explains, and does not explain, a distance.
_HARDLY, _NOT = 0.05, 1e-3
#: Simulated estimates from which the distance that noise causes is learnt.
_DRAWS = 8


@dataclass(frozen=True, eq=False)
class Binding:
    """What holds a consistent fit back.

    `distance`: from the unconstrained estimate to the nearest consistent set, in standard deviations (of the metric given). `costs`:
    link or parameter -> what goes of distance^2 when its constraint alone is let go, largest first. `degrees`: the distance^2 to
    be expected from noise alone, for a robot on the border; `chance`: probability of such a distance, or a larger one, by noise alone."""

    distance: float
    costs: dict[str, float]
    degrees: float
    chance: float
    notes: tuple[str, ...] = ()

    @property
    def significant(self) -> bool:
        """Whether noise alone does not explain the distance."""
        return self.chance < _NOT

    def sentences(self) -> tuple[str, ...]:
        """What to tell the user."""
        if self.distance < 1e-3:
            return ()
        head = f"The nearest consistent robot is {self.distance:.3g} standard deviations from the unconstrained estimate"
        costs = ", ".join(f"{name} {cost:.3g}" for name, cost in list(self.costs.items())[:6])
        rest = len(self.costs) - 6
        more = f" and {rest} more" if rest > 0 else ""
        out = []
        chance = f"probability {_small(self.chance)}; about {np.sqrt(self.degrees):.2g} are to be expected"
        if self.chance >= _HARDLY:
            out.append(f"{head}, which noise alone explains ({chance}): the data are compatible with real links.")
        else:
            how = "does not explain" if self.significant else "hardly explains"
            out.append(
                f"{head}, which noise alone {how} ({chance}): the data favour links that cannot exist. Most likely,"
                f" inertia parameters compensate for an effect that the model lacks (friction, a torque that depends on position, tilt,"
                f" delay, a torque scale):"
                " run `ident diagnose`."
            )
        if costs:
            out.append(
                f"Constraints that bind, and what each alone costs of {self.distance**2:.3g} (squared standard deviations): {costs}{more}."
            )
        return (*out, *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "distance": self.distance,
            "costs": dict(self.costs),
            "degrees": self.degrees,
            "chance": self.chance,
            "significant": self.significant,
            "notes": list(self.notes),
        }


def _small(probability: float) -> str:
    return "below 1e-9" if probability < 1e-9 else f"{probability:.2g}"


def binding_constraints(
    structure: InertiaStructure,
    target: Target,
    *,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    least: float = 0.05,
    time_limit: float = 10.0,
) -> Binding:
    """What holds a consistent fit to `target` back: each link or sign on the border is let go in turn.

    Those that cost less than `least` of distance^2 (a share) are not named. With `Target.from_covariance` the units are the estimate's own
    standard deviations. The probability is that of chi^2 with `degrees` degrees of freedom: where the truth is consistent, the
    squared distance to the convex set is no larger in distribution (chi-bar-square; Silvapulle and Sen, Constrained Statistical
    Inference, 2005, ch. 3)."""
    from scipy.stats import chi2

    deadline = time.perf_counter() + time_limit
    bounds = bounds or Bounds()
    scale = link_scales(structure) if prior is None else nominal_scale(structure, prior)
    values, standard, cost, _ = ConstrainedProblem(structure, target, bounds, prior, MARGIN, scale).solve()
    guess = structure.lift @ (target.offset + target.root @ target.target)
    signs = [i for i in (*structure.drive, *structure.nonnegative) if standard[i] <= 1e-6 * abs(guess[i])]
    links = np.flatnonzero(_relative_eigenvalues(structure, standard)[:, 0] < _BORDER)
    found: dict[str, float] = {}
    notes: tuple[str, ...] = ()
    for name in (*(structure.body_names[i] for i in links[::-1]), *(structure.names[i] for i in signs)):
        if time.perf_counter() > deadline:
            notes = ("not every constraint was tried: time ran out.",)
            break
        try:
            without = ConstrainedProblem(structure, target, bounds, prior, MARGIN, scale, name).solve()[2]
        except SolverError:
            continue
        if cost - without >= max(least * cost, 1e-3):
            found[name] = cost - without
    degrees, error = (cost, 0.0) if cost < 1.0 else _degrees(structure, values, target, scale, bounds, prior, deadline)
    return Binding(
        distance=float(np.sqrt(cost)),
        costs=dict(sorted(found.items(), key=lambda item: -item[1])),
        degrees=degrees,
        # The mean is known to within its standard error: in favour of chance.
        chance=float(chi2.sf(cost, max(degrees + error, 1.0))),
        notes=notes,
    )


def _relative_eigenvalues(structure: InertiaStructure, standard: Array) -> Array:
    """Eigenvalues (nb, 4) of the links' pseudo-inertias, scaled to unit diagonal."""
    J = pseudo_inertia(standard[structure.inertial].reshape(-1, 10))
    D = 1.0 / np.sqrt(np.maximum(np.diagonal(J, axis1=1, axis2=2), 1e-300))
    return np.linalg.eigvalsh(D[:, :, None] * J * D[:, None, :])


def _degrees(
    structure: InertiaStructure, values: Array, target: Target, scale: Array, bounds: Bounds, prior: Prior | None, deadline: float
) -> tuple[float, float]:
    """Mean squared distance of estimates of a robot at `values` (b,) on the border, and the standard error of that mean, by simulation.

    It is the statistical dimension of the cone of directions that leave the set, a number between 0 and b."""
    rng = np.random.default_rng(0)
    found: list[float] = []
    while len(found) < _DRAWS and (len(found) < 3 or time.perf_counter() < deadline):
        noise = np.where(target.costed, rng.standard_normal(len(target.target)), 0.0)
        moved = Target(values + target.root @ noise, target.root, np.zeros(len(noise)), target.costed)
        try:
            found.append(ConstrainedProblem(structure, moved, bounds, prior, MARGIN, scale).solve()[2])
        except SolverError:
            found.append(float(noise @ noise))
    mean = float(np.mean(found))
    return mean, float(np.sqrt(2.0 * mean / len(found)))
