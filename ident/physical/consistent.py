"""Consistent: are there links with positive mass and positive definite pseudo-inertia that give these base parameters?

The question is a linear matrix inequality over the directions that no torque sees (Sousa and Cortesão, IJRR 2014; Wensing, Kim and
Slotine, RA-L 2018). A positive answer comes with such links, and these are checked; a negative one names the links at fault."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from .conic import ConicProgram, require_solver
from .pseudo_inertia import UNITS, pseudo_inertia, smallest_eigenvalues
from .structure import InertiaStructure

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Consistent:
    """Verdict. `consistent`: real links exist.

    `violated_links`: those that cannot be real, tip last; `violated_parameters`: rotor inertias and friction of the wrong sign.
    `margin`: largest t with every (scaled) pseudo-inertia >= t, positive inside. `shortfall`: link -> what its scaled pseudo-inertia
    lacks. `standard` (k,): consistent parameters that give the base values, or None."""

    consistent: bool
    violated_links: tuple[str, ...]
    violated_parameters: tuple[str, ...]
    margin: float
    shortfall: dict[str, float]
    standard: Array | None
    seconds: float
    method: str = "linear matrix inequalities on pseudo-inertias (Clarabel)"
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """A few lines for people."""
        if self.consistent:
            lines = ["physically consistent: links with positive mass and positive definite pseudo-inertia give these base parameters"]
            return "\n".join([*lines, *self.notes])
        lines = ["not physically consistent"]
        if self.violated_links:
            lines.append(
                "no real body gives the parameters of: "
                + ", ".join(f"{n} (lacks {self.shortfall[n]:.2g} of its size)" for n in self.violated_links)
            )
        if self.violated_parameters:
            lines.append("wrong sign: " + ", ".join(self.violated_parameters))
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "consistent": self.consistent,
            "violated_links": list(self.violated_links),
            "violated_parameters": list(self.violated_parameters),
            "margin": self.margin,
            "shortfall": dict(self.shortfall),
            "standard": None if self.standard is None else self.standard.tolist(),
            "method": self.method,
            "seconds": self.seconds,
            "notes": list(self.notes),
        }


def link_scales(structure: InertiaStructure, parameters: Array | None = None) -> Array:
    """Scale (nb, 4) that makes each link's pseudo-inertia a matrix of ordinary numbers: diag(1/length x3, 1) / sqrt(mass).

    From `parameters` (k,) where given (their diagonal), else a kilogram and the mean distance between joints."""
    nb = structure.tree.nb
    if parameters is None:
        distance = np.linalg.norm(structure.tree.translation, axis=1)
        length = 0.3 * float(distance[distance > 1e-6].mean()) if np.any(distance > 1e-6) else 0.1
        return np.tile([1.0 / length] * 3 + [1.0], (nb, 1))
    J = pseudo_inertia(parameters[structure.inertial].reshape(-1, 10))
    diagonal = np.diagonal(J, axis1=1, axis2=2)
    mass = np.maximum(np.abs(diagonal[:, 3]), 1e-9)
    # A body's second moments per mass are the squares of lengths; none is taken below a millimetre.
    length = np.sqrt(np.maximum(np.abs(diagonal[:, :3]) / mass[:, None], 1e-6))
    return np.concatenate([1.0 / length, np.ones((nb, 1))], axis=1) / np.sqrt(mass)[:, None]


def scaled_units(scale: Array) -> Array:
    """Pseudo-inertia per unit parameter under scale (4,): (10, 4, 4)."""
    return scale[:, None] * UNITS * scale[None, :]


def judge_consistent(
    structure: InertiaStructure, values: Array, *, unseen: Array | None = None, covariance: Array | None = None
) -> Consistent:
    """Judge base values (b,). `unseen` (b, u): changes of them that the data could not see, and that may be chosen.

    `covariance` (b, b): friction below zero by less than two of its standard deviations is no wrong sign; a note says so.
    Raises ConfigurationError without the solver, SolverError where it fails."""
    start = time.perf_counter()
    require_solver("the judgement of physical consistency")
    values = structure.check_values(values)
    constant, free = structure.lift @ values, structure.null_space
    if unseen is not None and unseen.shape[1]:
        free = np.concatenate([free, structure.lift @ unseen], axis=1)
    zero = consistent_with_zero(structure, values, free, covariance)
    wrong = tuple(name for name in wrong_signs(structure, constant, free) if name not in zero)
    scale = link_scales(structure)
    drive = _drive_scale(structure, constant)
    margin, standard = -np.inf, constant
    for _ in range(4):
        margin, standard = _deepest(structure, constant, free, scale, drive)
        if abs(margin) > 1e-5 or _holds(structure, standard):
            break
        # Too near to the border to tell at this scale: measure each link by what was found.
        scale, drive = link_scales(structure, standard), _drive_scale(structure, standard)
    holds = _holds(structure, standard) and not wrong
    shortfall: dict[str, float] = {}
    if not _holds(structure, standard):
        shortfall = _shortfall(structure, constant, free, scale, drive)
    notes = zero_notes(zero)
    if not holds and not wrong and abs(margin) < 1e-7:
        notes += ("the set lies on the feasibility boundary: only bodies without extent in some direction have it.",)
    return Consistent(
        consistent=holds,
        violated_links=tuple(shortfall),
        violated_parameters=wrong,
        margin=margin,
        shortfall=shortfall,
        standard=standard if holds else None,
        seconds=time.perf_counter() - start,
        notes=notes,
    )


def wrong_signs(structure: InertiaStructure, constant: Array, free: Array) -> tuple[str, ...]:
    """Rotor inertias (not positive) and friction (negative) that are base parameters of their own and have the wrong sign."""
    fixed = ~np.any(np.abs(free) > 1e-12, axis=1)
    found = [i for i in structure.drive if fixed[i] and constant[i] <= 0.0]
    found += [i for i in structure.nonnegative if fixed[i] and constant[i] < 0.0]
    return tuple(structure.names[i] for i in found)


#: Standard deviations below zero up to which a friction coefficient is consistent with zero.
SIGN_STD = 2.0


def consistent_with_zero(
    structure: InertiaStructure, values: Array, free: Array, covariance: Array | None
) -> dict[str, tuple[float, float]]:
    """Friction of its own base parameter below zero by less than two standard deviations: name -> (value, standard deviation)."""
    if covariance is None:
        return {}
    found = {}
    for i in structure.nonnegative:
        row = structure.lift[i]
        value, std = float(row @ values), float(np.sqrt(max(row @ covariance @ row, 0.0)))
        if -SIGN_STD * std < value < 0.0 and not np.any(np.abs(free[i]) > 1e-12):
            found[structure.names[i]] = (value, std)
    return found


def zero_notes(zero: dict[str, tuple[float, float]]) -> tuple[str, ...]:
    """A sentence on friction that is consistent with zero."""
    if not zero:
        return ()
    listed = ", ".join(f"{name} {value:.3g} ± {std:.2g}" for name, (value, std) in zero.items())
    return (f"below zero by less than {SIGN_STD:g} standard deviations, so consistent with zero: {listed}.",)


def _drive_scale(structure: InertiaStructure, parameters: Array) -> Array:
    """Size (r,) of each drive inertia: its own, or one that reflects a hundredth of a kg m^2 where it is grouped away."""
    own = np.abs(parameters[structure.drive])
    reflected = np.abs(structure.reflected).max(axis=(1, 2), initial=1e-300) if len(own) else np.zeros(0)
    return np.where(own > 1e-12, own, 0.01 / reflected)


def _holds(structure: InertiaStructure, parameters: Array) -> bool:
    """Whether the links and the free drive inertias are those of real bodies: checked, not believed."""
    rotors = parameters[structure.drive]
    return bool(np.all(smallest_eigenvalues(parameters[structure.inertial]) > 1e-13) and np.all(rotors >= 0.0))


def _deepest(structure: InertiaStructure, constant: Array, free: Array, scale: Array, drive: Array) -> tuple[float, Array]:
    """Largest common margin t of all scaled pseudo-inertias and rotor inertias, and the parameters that have it."""
    program = ConicProgram()
    z, t = program.variables(free.shape[1]), program.variables(1)
    size = _free_scale(structure, free, scale, drive)
    direction = free * size
    for body in range(structure.tree.nb):
        at = structure.inertial[10 * body : 10 * body + 10]
        units = scaled_units(scale[body])
        program.semidefinite(np.tensordot(constant[at], units, 1), [(z, np.tensordot(direction[at].T, units, 1)), (t, -np.eye(4)[None])])
    # Rotor inertias that are fixed by the base values are judged by their sign alone.
    bound = [i for i in range(len(structure.drive)) if np.any(np.abs(free[structure.drive[i]]) > 1e-12)]
    if bound:
        at = structure.drive[bound]
        small = -0.01 * np.ones((1, len(bound)))
        program.nonnegative(constant[at] / drive[bound], [(z, (direction[at] / drive[bound, None]).T), (t, small)])
    # What no torque sees could grow for ever (a heavier first link): beyond one, nothing is gained.
    program.nonnegative(np.ones(1), [(t, -np.ones((1, 1)))])
    program.linear(t, -np.ones(1))
    found = program.solve("the judgement of physical consistency", tolerance=1e-10)
    standard = constant + direction @ found.x[z]
    low = structure.drive[standard[structure.drive] < 0.0]
    standard[low] = np.where(standard[low] > -1e-9 * np.abs(constant[structure.drive]).max(initial=1e-9), 0.0, standard[low])
    # Clipping a rotor inertia must not change the base parameters.
    wanted = structure.regroup @ (constant + direction @ found.x[z])
    standard = standard + structure.lift @ (wanted - structure.regroup @ standard)
    return float(found.x[t][0]), standard


def _free_scale(structure: InertiaStructure, free: Array, scale: Array, drive: Array) -> Array:
    """Size (f,) of each unseen direction that changes the scaled matrices by about one."""
    effect = np.zeros(free.shape[1])
    for body in range(structure.tree.nb):
        at = structure.inertial[10 * body : 10 * body + 10]
        effect = np.maximum(effect, np.abs(np.tensordot(free[at].T, scaled_units(scale[body]), 1)).max(axis=(1, 2), initial=0.0))
    if len(structure.drive):
        effect = np.maximum(effect, np.abs(free[structure.drive] / drive[:, None]).max(axis=0, initial=0.0))
    return 1.0 / np.maximum(effect, 1e-12)


def _shortfall(structure: InertiaStructure, constant: Array, free: Array, scale: Array, drive: Array) -> dict[str, float]:
    """Least total amount by which scaled pseudo-inertias must be raised, link by link; links that need none are left out.

    The sum of amounts (not of squares) leaves most links untouched: those named are the ones at fault."""
    program = ConicProgram()
    nb = structure.tree.nb
    z, s = program.variables(free.shape[1]), program.variables(nb)
    direction = free * _free_scale(structure, free, scale, drive)
    for body in range(nb):
        at = structure.inertial[10 * body : 10 * body + 10]
        units = scaled_units(scale[body])
        program.semidefinite(
            np.tensordot(constant[at], units, 1), [(z, np.tensordot(direction[at].T, units, 1)), (s[body : body + 1], np.eye(4)[None])]
        )
    bound = [i for i in range(len(structure.drive)) if np.any(np.abs(free[structure.drive[i]]) > 1e-12)]
    if bound:
        at = structure.drive[bound]
        program.nonnegative(constant[at] / drive[bound], [(z, (direction[at] / drive[bound, None]).T)])
    program.nonnegative(np.zeros(nb), [(s, np.eye(nb))])
    program.linear(s, np.ones(nb))
    found = program.solve("the search for the links at fault", tolerance=1e-10)
    standard = constant + direction @ found.x[z]
    out: dict[str, float] = {}
    amounts = np.maximum(found.x[s], 0.0)
    for body in map(int, np.flatnonzero(amounts > max(1e-6 * float(amounts.max(initial=0.0)), 1e-9))):
        J = np.tensordot(standard[structure.inertial[10 * body : 10 * body + 10]], scaled_units(scale[body]), 1)
        out[structure.body_names[body]] = float(amounts[body] / max(float(np.abs(J).max()), 1e-300))
    return out
