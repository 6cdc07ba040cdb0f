"""A repair from the tip to the base, joint by joint: the order of the dissertation (K. Yoshida 1995, chapter 4) with a least change.

H is judged by its trailing blocks H[i:, i:], which need only the positions of the joints after i. A block that is not positive definite
is made so by changing only the parameters that enter with joint i, those further out being settled, by the least change weighted with
each parameter's own standard deviation. Increasing J_iz alone always succeeds, so every step has a solution. The source itself works with
the minors of H and their cones (`modification`), which grow beyond use with the joints; here the least change is found by cutting
planes, for robots of any size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from .conic import InfeasibleError
from .cuts import nearest_by_cuts
from .search import random_positions
from .structure import InertiaStructure

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Step:
    """One step: the `joint` whose block was judged, its smallest scaled eigenvalue after, and what was changed (base name -> change)."""

    joint: str
    eigenvalue: float
    changes: dict[str, float]


def entering_parameters(structure: InertiaStructure, lower: Array, upper: Array) -> list[Array]:
    """For each row i of H the base parameters that are in H[i:, i:] but not in H[i+1:, i+1:]."""
    q = random_positions(structure, lower, upper, 4, np.random.default_rng(3))
    size = np.max([np.abs(structure.parameter_matrices(x)) for x in q], axis=0)
    present = np.array([size[:, i:, i:].max(axis=(1, 2)) > 1e-12 for i in range(structure.nv)] + [np.zeros(structure.b, bool)])
    return [np.flatnonzero(present[i] & ~present[i + 1]) for i in range(structure.nv)]


def _root(std: Array, free: Array) -> Array:
    """Columns (b, u) of the changes of free parameters, as far as their standard deviation (b,) lets them change."""
    free = free[std[free] > 0]
    root = np.zeros((len(std), len(free)))
    root[free, np.arange(len(free))] = std[free]
    return root


def repair_stepwise(
    structure: InertiaStructure,
    values: Array,
    std: Array,
    *,
    weight: Array,
    margin: float,
    lower: Array,
    upper: Array,
    time_limit: float = 60.0,
) -> tuple[Array, list[Step]]:
    """Base values (b,) whose trailing blocks are all >= margin * diag(weight), and the steps. `std` (b,) weighs the changes.

    Raises InfeasibleError where the parameters of a joint, and those further out, cannot do it (their standard deviation is zero)."""
    current = np.array(values, float)
    steps = []
    base = structure.nv - structure.n
    entering = entering_parameters(structure, lower, upper)
    # A block that is only just as far from indefinite as it must be leaves none of that to the rows before it: what couples them could be
    # outweighed by an infinite inertia alone. So what is settled earlier is asked for more, evenly up to twice as much at the tip.
    asked = 1.0 + np.arange(structure.nv) / max(structure.nv - 1, 1)
    # A free-flyer's six rows share one body and are one step.
    for i in [*reversed(range(base, structure.nv)), *([0] if base else [])]:
        free = entering[i] if i >= base else np.unique(np.concatenate(entering[:base]))
        step = partial(
            nearest_by_cuts,
            structure,
            current,
            weight=weight,
            margin=margin * float(asked[i]),
            lower=lower,
            upper=upper,
            start=i,
            time_limit=time_limit,
        )
        try:
            found = step(_root(std, free))
        except InfeasibleError:
            # Where joints are coupled, a row may bring no parameter of its own: what was settled further out is then open again.
            found = step(_root(std, np.unique(np.concatenate(entering[i:]))))
        changed = np.flatnonzero(found.values != current)
        name = structure.joint_names[i - base] if i >= base else "floating base"
        steps.append(Step(name, found.eigenvalue, {structure.base_names[k]: float(found.values[k] - current[k]) for k in changed}))
        current = found.values
    return current, steps
