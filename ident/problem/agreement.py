"""Do closed form, structure and sampled regressor give the same base parameters? They must span the same space.

They come about independently: formulas of a theorem, propagation along the tree, and rank decisions on random motions
(singular values of the stacked regressor, and the column-by-column reduction that models use)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import svd
from ..effects.reduction import base_reduction
from ..errors import UnsupportedError
from ..friction.drive import RotorInertia
from ..regressor.base_parameters.base_form import BaseForm
from ..regressor.base_parameters.closed_form import mixed, oblique, parallelogram, rotational
from ..regressor.base_parameters.expressions import expression
from ..regressor.base_parameters.structural import StructuralSet, base_set
from ..regressor.rigid import regressor

if TYPE_CHECKING:
    from ..regressor.base_parameters.reduction import BaseReduction
    from ..robots.robot import Robot

Array = np.ndarray

#: Closed forms in the order in which they are tried.
_FORMS: dict[str, Callable[[Robot], BaseForm]] = {
    "rotational": rotational,
    "mixed": mixed,
    "oblique": oblique,
    "parallelogram": parallelogram,
}
#: Directions that agree to this are the same.
_SAME = 1e-9
#: Columns fainter than this share of the largest are not scaled up to it: their rounding would count.
_FAINT = 1e-4
#: Singular values below this share of the largest can be the first of those that count as zero.
_SMALL = 1e-6


@dataclass(frozen=True, eq=False)
class SampledSpace:
    """Row space of the regressor at random states. `basis` (r, k) orthonormal in scaled columns, `scale` (k,): columns were divided
    by it. `gap`: (smallest singular value kept, largest dropped), over the largest."""

    basis: Array
    scale: Array
    gap: tuple[float, float]

    @property
    def count(self) -> int:
        return len(self.basis)


@dataclass(frozen=True)
class Disagreement:
    """A direction that `found_by` has and `missing_in` has not. `outside`: how much of it (1: all)."""

    found_by: str
    missing_in: str
    direction: str
    outside: float

    def __str__(self) -> str:
        return f"{self.found_by} has a direction that {self.missing_in} lacks ({self.outside:.1e} of it outside): {self.direction}"


@dataclass(frozen=True, eq=False)
class Agreement:
    """Base parameters by all ways that apply. `closed`: closed forms of the theorems that cover the robot; `refused`: (theorem's
    function, why not); `sampled`: row space of the sampled regressor; `reduced`: numeric reduction by QR, as models use it (None for
    a floating base, which models do not take); `tolerance`: to how much directions were compared, wider only where geometry is
    nearly degenerate."""

    robot: Robot
    structural: StructuralSet
    closed: tuple[BaseForm, ...]
    refused: tuple[tuple[str, str], ...]
    sampled: SampledSpace
    reduced: BaseReduction | None
    disagreements: tuple[Disagreement, ...]
    tolerance: float

    @property
    def agreed(self) -> bool:
        return not self.disagreements

    @property
    def counts(self) -> dict[str, int]:
        """Number of base parameters by each way."""
        counts = {"structural": self.structural.count, **{f.method: f.count for f in self.closed}, "sampled": self.sampled.count}
        return counts if self.reduced is None else counts | {"qr": self.reduced.count}

    def __bool__(self) -> bool:
        return self.agreed

    def to_dict(self) -> dict[str, object]:
        """JSON form."""
        return {
            "agreed": self.agreed,
            "counts": self.counts,
            "gap": {"structural": list(self.structural.gap), "sampled": list(self.sampled.gap)},
            "closed_forms": {f.method: f.count_formula for f in self.closed},
            "refused": dict(self.refused),
            "disagreements": [vars(d) for d in self.disagreements],
        }

    def __str__(self) -> str:
        counts = ", ".join(f"{name} {count}" for name, count in self.counts.items())
        kept, dropped = self.sampled.gap
        verdict = "the same space" if self.agreed else "NOT the same space"
        margins = f"sampled singular values: smallest kept {kept:.1e}, largest dropped {dropped:.1e}"
        lines = [f"base parameters by {counts}: {verdict} (compared to {self.tolerance:.0e}; {margins})"]
        lines += [f"  {f.method}: {f.count_formula}" for f in self.closed]
        lines += [f"  {d}" for d in self.disagreements]
        return "\n".join([*lines, *(f"note: {n}" for n in self.structural.notes)])


def agreement(robot: Robot, rotor_inertia: bool = False, seed: int = 0) -> Agreement:
    """Compare closed forms that apply, structural and sampled base parameters of a robot: spaces in both directions, not counts alone.

    `rotor_inertia`: structural and sampled sets hold the motors' reflected inertias too (closed forms never do)."""
    structural = base_set(robot, rotor_inertia)
    linked = base_set(robot) if rotor_inertia else structural
    sampled = sampled_space(robot, rotor_inertia, seed)
    closed, refused = closed_forms(robot)
    # Rounding of the sampled directions grows as the smallest singular value falls, and where faint columns stand beside strong ones;
    # well-posed geometry stays at the usual tolerance.
    rounding = max(1e-13, np.finfo(float).eps * float(sampled.scale.max(initial=1.0) / sampled.scale.min(initial=1.0)), 10 * sampled.gap[1])
    tolerance = max(_SAME, rounding / max(sampled.gap[0], 1e-10))
    names = structural.columns if rotor_inertia else structural.parameters
    mine = structural.full if rotor_inertia else structural.matrix
    found = _compare(("structural", _orthonormal(mine / sampled.scale)), ("sampled", sampled.basis), sampled.scale, names, tolerance)
    reduced = None if robot.floating_base else _reduction(robot, rotor_inertia)
    if reduced is not None:
        pair = ("structural", _orthonormal(mine / sampled.scale)), ("qr", _orthonormal(reduced.regroup / sampled.scale))
        found += _compare(*pair, sampled.scale, names, tolerance)
    scale = sampled.scale[: linked.matrix.shape[1]]
    for form in closed:
        pair = (form.method, _orthonormal(form.matrix / scale)), ("structural", _orthonormal(linked.matrix / scale))
        found += _compare(*pair, scale, form.parameters, tolerance)
    return Agreement(robot, structural, closed, refused, sampled, reduced, tuple(found), tolerance)


def closed_forms(robot: Robot) -> tuple[tuple[BaseForm, ...], tuple[tuple[str, str], ...]]:
    """The closed forms that cover a robot, and (function, reason) for the others."""
    forms, refused = [], []
    for name, build in _FORMS.items():
        try:
            forms.append(build(robot))
        except UnsupportedError as error:
            refused.append((name, str(error)))
    return tuple(forms), tuple(refused)


def _reduction(robot: Robot, rotor_inertia: bool) -> BaseReduction:
    model = robot.rigid_body()
    return base_reduction(model + RotorInertia() if rotor_inertia else model)


def sampled_space(robot: Robot, rotor_inertia: bool = False, seed: int = 0) -> SampledSpace:
    """Row space of the joint-side regressor at random states, through the loop; rank by the widest gap in its singular values."""
    rows = _sampled_rows(robot, rotor_inertia, np.random.default_rng(seed))
    size = np.linalg.norm(rows, axis=0)
    dead = size <= 1e-12 * size.max(initial=1e-300)
    scale = np.where(dead, 1.0, np.maximum(size, _FAINT * size.max(initial=0.0)))
    R = np.linalg.qr(np.where(dead, 0.0, rows / scale), mode="r")
    _, s, Vt = svd(np.asarray(R), full_matrices=False)
    s = np.maximum(s / max(s[0], 1e-300), 1e-18)
    candidates = np.flatnonzero(s[1:] < _SMALL)
    rank = int(candidates[np.argmax(s[candidates] / s[candidates + 1])]) + 1 if len(candidates) else len(s)
    # A vector in scaled columns is row * scale; forms are divided by the scale of the regressor's columns in the same way.
    return SampledSpace(Vt[:rank], scale, (float(s[rank - 1]), float(s[rank]) if rank < len(s) else 0.0))


def _sampled_rows(robot: Robot, rotor_inertia: bool, rng: np.random.Generator) -> Array:
    tree, n, free = robot.tree, robot.n, 6 * robot.floating_base
    width = 10 * tree.nb + n * rotor_inertia
    count = 3 * width // (n + free) + 20
    q, dq, ddq = rng.uniform(-np.pi, np.pi, (count, n)), rng.normal(size=(count, n)), 2 * rng.normal(size=(count, n))
    position, velocity, acceleration = robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq)
    if free:
        quaternion = rng.normal(size=(count, 4))
        quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
        position = np.hstack([np.zeros((count, 3)), quaternion, position])
        velocity = np.hstack([rng.normal(size=(count, 6)), velocity])
        acceleration = np.hstack([2 * rng.normal(size=(count, 6)), acceleration])
    Y = regressor(tree, position, velocity, acceleration)
    Y = np.concatenate([Y[:, :free], np.einsum("ta,Ntk->Nak", robot.loop.W, Y[:, free:])], axis=1)
    if rotor_inertia:
        k = robot.transmission.K_inverse
        reflected = np.zeros((count, free + n, n))
        reflected[:, free:] = k.T * (ddq @ k.T)[:, None, :]
        Y = np.concatenate([Y, reflected], axis=2)
    return Y.reshape(-1, width)


def _orthonormal(rows: Array) -> Array:
    """Orthonormal basis of the span of independent rows."""
    if not len(rows):
        return rows
    scaled = rows / np.linalg.norm(rows, axis=1)[:, None]
    basis: Array = np.linalg.qr(scaled.T)[0].T
    return basis


def _compare(one: tuple[str, Array], other: tuple[str, Array], scale: Array, names: Sequence[str], tolerance: float) -> list[Disagreement]:
    """Directions of each space (orthonormal rows, in scaled columns) outside the other."""
    found = []
    for (name, space), (against, reference) in ((one, other), (other, one)):
        if not len(space):
            continue
        outside = space - (space @ reference.T) @ reference
        _, s, Vt = svd(outside, full_matrices=False)
        for size, direction in zip(s, Vt, strict=True):
            if size > tolerance:
                row = direction * scale
                row = row / row[int(np.argmax(np.abs(row)))]
                text = expression(np.where(np.abs(row) > 1e-6, row, 0.0), names)
                found.append(Disagreement(name, against, text, float(size)))
    return found
