"""Payload: the ten parameters of a load on a link, from two logs (without and with), or one log on top of a saved fit.

Base values change by A phi when a link carries the load phi, A = regroup[:, that link's columns]. Both logs are fitted together,
[R0 0; R1 R1 A] (p, phi) = (z0, z1), so the parameters of the arm weigh in with what each log knows of them (the difference of two
separate fits would not). A saved fit enters as its covariance. The load is a real body by construction: its pseudo-inertia is
positive definite in the program itself."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import matrix_rank, pinv, svd
from ..errors import ConfigurationError, DataError, unknown_name
from ..robots.parameters import LINK_SYMBOLS, LINK_UNITS
from .conic import ConicProgram, solver_available
from .consistent import link_scales
from .pseudo_inertia import UNITS, centre_of_mass, from_pseudo_inertia, pseudo_inertia
from .structure import InertiaStructure
from .target import covariance_root

Array = np.ndarray
#: What noise and the inexactness of its colour leave, in units of its degrees of freedom.
_MORE = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class PayloadEstimate(ShortRepr):
    """A payload on `link`, in that link's joint frame.

    `values` (10,) in Pinocchio's order, a real body; `unconstrained` (10,) and `std` (10,): what the logs alone say (nan where they
    say nothing). `mass` kg with `mass_std`, `centre_of_mass` (3,) m, `inertia` (3, 3) kg m^2 about it.
    `identifiable`: number of directions of the ten that the robot's motion can show at all; `significant`: whether there is a payload
    beyond chance (`chi2`, what it explains, with that many degrees of freedom, at 0.1 %); `notes`: what speaks against it."""

    link: str
    values: Array
    unconstrained: Array
    std: Array
    mass: float
    mass_std: float
    centre_of_mass: Array
    inertia: Array
    identifiable: int
    chi2: float
    significant: bool
    method: str
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def unknown(self) -> tuple[str, ...]:
        """Of the ten, those that no torque in these logs shows on their own."""
        return tuple(s for s, std in zip(LINK_SYMBOLS, self.std, strict=True) if np.isnan(std))

    @property
    def unclear(self) -> tuple[str, ...]:
        """Of the ten, those that cannot be distinguished from zero: what the logs say is below two standard deviations."""
        pairs = zip(LINK_SYMBOLS, self.unconstrained, self.std, strict=True)
        return tuple(s for s, value, std in pairs if not np.isnan(std) and abs(value) < 2.0 * std)

    def text(self) -> str:
        """A few lines for people."""
        head = "payload" if self.significant else "no payload beyond chance"
        c = ", ".join(f"{1e3 * x:.1f}" for x in self.centre_of_mass)
        lines = [f"{head} on {self.link}: {self.mass:.4g} +- {self.mass_std:.2g} kg, centre of mass ({c}) mm in the joint frame"]
        principal = np.sqrt(np.maximum(np.linalg.eigvalsh(self.inertia), 0.0) / max(self.mass, 1e-300))
        lines.append("radii of gyration " + ", ".join(f"{1e3 * r:.1f}" for r in principal) + " mm")
        if self.identifiable < 10:
            lines.append(
                f"the motion shows {self.identifiable} of its 10 directions; the rest are chosen so that the body is real and compact"
            )
        lines.append(f"{'parameter':<10}{'value':>13}{'std':>11}  {'unit':<7}{'the logs alone':>15}")
        for symbol, unit, value, std, free in zip(LINK_SYMBOLS, LINK_UNITS, self.values, self.std, self.unconstrained, strict=True):
            alone = f"{'cannot be told':>15}" if np.isnan(std) else f"{free:>15.5g}"
            remark = "  not significantly different from zero" if symbol in self.unclear else ""
            lines.append(f"{symbol:<10}{value:>13.5g}{'' if np.isnan(std) else format(std, '.2g'):>11}  {unit:<7}{alone}{remark}")
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "link": self.link,
            "parameters": [
                {
                    "name": f"{symbol}_payload",
                    "value": float(v),
                    "std": None if np.isnan(s) else float(s),
                    "unit": unit,
                    "unconstrained": None if np.isnan(u) else float(u),
                }
                for symbol, unit, v, s, u in zip(LINK_SYMBOLS, LINK_UNITS, self.values, self.std, self.unconstrained, strict=True)
            ],
            "unknown": list(self.unknown),
            "unclear": list(self.unclear),
            "mass": self.mass,
            "mass_std": None if np.isnan(self.mass_std) else self.mass_std,
            "centre_of_mass": self.centre_of_mass.tolist(),
            "inertia": self.inertia.tolist(),
            "identifiable": self.identifiable,
            "chi2": self.chi2,
            "significant": self.significant,
            "method": self.method,
            "seconds": self.seconds,
            "notes": list(self.notes),
        }


def payload_columns(structure: InertiaStructure, link: str) -> Array:
    """How base values change with the ten parameters of a load on `link`, (b, 10)."""
    if link not in structure.body_names:
        raise unknown_name("moving link", link, structure.body_names)
    body = structure.body_names.index(link)
    return structure.regroup[:, structure.inertial[10 * body : 10 * body + 10]]


def payload_from_logs(
    structure: InertiaStructure, without: tuple[Array, Array], with_load: tuple[Array, Array], *, link: str | None = None
) -> PayloadEstimate:
    """From a log pair: `without` and `with_load` are whitened information blocks (R (m, b), z (m,)) of the same base parameters.

    Without a `link` the load is on the end of the tree; of several ends, on the one whose load explains the difference between the logs."""
    _check(structure, without, with_load)
    ends = [structure.body_names[body] for body in structure.tree.ends]
    if link is not None or len(ends) == 1:
        return _estimate(structure, without, with_load, link or ends[0])
    return _on_one_of(structure, without, with_load, ends)


def _on_one_of(
    structure: InertiaStructure, without: tuple[Array, Array], with_load: tuple[Array, Array], ends: list[str]
) -> PayloadEstimate:
    """The load on that of several ends of the tree which explains most; refused where another one explains as much."""
    found, unseen = [], []
    for end in ends:
        try:
            found.append(_estimate(structure, without, with_load, end))
        except DataError:  # nothing moved it
            unseen.append(end)
    if not found:
        raise DataError(f"a load on {' or '.join(ends)} is not visible in these logs: move the joints before it.")
    best = max(found, key=lambda one: one.chi2)
    others = [one for one in found if one is not best]
    # Two ends are as far apart as a body and what is none: by what noise makes of so many directions.
    alike = [one for one in others if best.chi2 - one.chi2 <= _limit(max(best.identifiable, one.identifiable))]
    if best.significant and alike:
        named = " or on ".join(one.link for one in (best, *alike))
        raise DataError(
            f"these logs do not determine which link carries the load: a load on {named} explains the difference between them"
            " equally well. Name the link with --link (link= in Python): one of these, or one before them."
        )
    notes = []
    if others and not best.significant:
        notes.append(f"nor is there a load on {', '.join(one.link for one in others)}.")
    elif others and best.notes:
        notes.append(f"a load on {', '.join(one.link for one in others)} explains less. Name another link with --link (link= in Python).")
    if unseen:
        notes.append(f"a load on {', '.join(unseen)} would not be visible in these logs: nothing moves before it.")
    return replace(best, notes=(*best.notes, *notes))


def _check(structure: InertiaStructure, without: tuple[Array, Array], with_load: tuple[Array, Array]) -> None:
    for (R, z), which in ((without, "without"), (with_load, "with")):
        R, z = np.atleast_2d(np.asarray(R, float)), np.asarray(z, float)
        if R.shape[1] != structure.b or z.shape != (len(R),):
            raise ConfigurationError(
                f"the information block {which} the load has shape {R.shape}, but there are {structure.b} base parameters."
            )
        if not (np.all(np.isfinite(R)) and np.all(np.isfinite(z))):
            raise DataError(f"the information block {which} the load holds values that are not finite.")


def payload_from_fit(
    structure: InertiaStructure, values: Array, covariance: Array, with_load: tuple[Array, Array], *, link: str | None = None
) -> PayloadEstimate:
    """From one log with the load, on top of a saved fit without it: `values` (b,) and `covariance` (b, b) of that fit."""
    values = structure.check_values(values)
    root = covariance_root(covariance)
    size = np.sqrt(np.maximum(np.diagonal(np.asarray(covariance, float)), 0.0))
    D = 1.0 / np.where(size > 0, size, 1.0)
    R = pinv(D[:, None] * root, rcond=1e-13) * D
    # A base parameter without variance is known; a millionth of itself stands for that.
    known = np.flatnonzero(size <= 0)
    R = np.concatenate([R, np.eye(structure.b)[known] / np.maximum(1e-6 * np.abs(values[known]), 1e-9)[:, None]])
    return payload_from_logs(structure, (R, R @ values), with_load, link=link)


def payload_from_fits(
    structure: InertiaStructure, before: tuple[Array, Array], after: tuple[Array, Array], *, link: str | None = None
) -> PayloadEstimate:
    """From two saved fits, (values (b,), covariance (b, b)) without and with the load."""
    values, covariance = after
    values = structure.check_values(values)
    D = 1.0 / np.maximum(np.sqrt(np.maximum(np.diagonal(np.asarray(covariance, float)), 0.0)), 1e-300)
    R = pinv(D[:, None] * covariance_root(covariance), rcond=1e-13) * D
    return payload_from_fit(structure, before[0], before[1], (R, R @ values), link=link)


def _estimate(structure: InertiaStructure, without: tuple[Array, Array], with_load: tuple[Array, Array], name: str) -> PayloadEstimate:
    start = time.perf_counter()
    A = payload_columns(structure, name)
    (R0, z0), (R1, z1) = ((np.atleast_2d(np.asarray(R, float)), np.asarray(z, float)) for R, z in (without, with_load))
    # A log adds nothing where it is blind; drop the arm's parameters by orthogonal triangularisation.
    stacked = np.concatenate([np.concatenate([R0, np.zeros((len(R0), 10)), z0[:, None]], 1), np.concatenate([R1, R1 @ A, z1[:, None]], 1)])
    size = np.linalg.norm(stacked[:, : structure.b], axis=0)
    stacked[:, : structure.b] /= np.where(size > 0, size, 1.0)
    Q = _column_basis(stacked[:, : structure.b])
    rest = stacked[:, structure.b :] - Q @ (Q.T @ stacked[:, structure.b :])
    rest -= Q @ (Q.T @ rest)
    R, z = rest[:, :10], rest[:, 10]
    scale = _scale(structure)
    unconstrained, covariance, seen = _plain(R, z, scale, int(matrix_rank(A, tol=1e-9 * float(np.linalg.norm(A)))))
    if seen == 0:
        raise DataError(
            f"a load on {name!r} is not visible in these logs: none of its parameters acts on a measured torque. Move the joints before it."
        )
    visible = _visible(R, scale)
    std = np.where(visible, np.sqrt(np.maximum(np.diagonal(covariance), 0.0)), np.nan)
    fit, method = (_consistent(R, z, scale), "linear matrix inequality (Clarabel)") if solver_available() else (
        _log_cholesky(R, z, scale), "log-Cholesky factors, nonlinear least squares (fallback)"
    )  # fmt: skip
    mass, com, inertia = centre_of_mass(fit)
    left, with_body = (float(np.sum((z - R @ values) ** 2)) for values in (np.nan_to_num(unconstrained), fit))
    gain = float(z @ z) - with_body
    # Both logs say something of the same arm: so many directions they say twice, and the load has some of them.
    twice = sum(int(matrix_rank(M / np.where(size > 0, size, 1.0), tol=1e-9)) for M in (R0, R1)) - Q.shape[1]
    return PayloadEstimate(
        link=name,
        values=fit,
        unconstrained=np.where(visible, unconstrained, np.nan),
        std=std,
        mass=mass,
        mass_std=float(std[0]),
        centre_of_mass=com,
        inertia=inertia,
        identifiable=seen,
        chi2=gain,
        significant=gain > _chi2_limit(seen),
        method=method,
        seconds=time.perf_counter() - start,
        notes=_notes(name, left, max(twice - seen, 0), with_body - left, seen),
    )


def _notes(link: str, left: float, free: int, cost: float, seen: int) -> tuple[str, ...]:
    """What speaks against a load on that link: `left`, what its parameters leave (`free` degrees of freedom), and the `cost` of its being a
    body (twice a log-likelihood)."""
    out = []
    if free and left > _limit(free):
        out.append(
            f"a load on {link} does not explain the difference between the logs (chi2 {left:.4g} with {free} degrees of"
            " freedom): something else has changed, such as friction, or the load is on another link. `ident monitor` looks for it."
        )
    if cost > _limit(seen):
        out.append(
            f"no physical body on {link} fits the logs (chi2 {cost:.4g}): something else has changed, or the load is on another link."
        )
    return tuple(out)


def _column_basis(M: Array) -> Array:
    """Orthonormal basis of the columns of M."""
    from scipy.linalg import qr

    Q, T, _ = qr(M, mode="economic", pivoting=True)
    diagonal = np.abs(np.diagonal(T))
    rank = int(np.sum(diagonal > 1e-11 * max(float(diagonal.max(initial=0.0)), 1e-300)))
    return Q[:, :rank]


def _scale(structure: InertiaStructure) -> Array:
    """Size (10,) of a payload's parameters: a kilogram at a tenth of the arm's links."""
    length = float(1.0 / link_scales(structure)[0, 0])
    return np.array([1.0] + [length] * 3 + [length**2] * 6)


def _plain(R: Array, z: Array, scale: Array, structural: int) -> tuple[Array, Array, int]:
    """Least squares without constraints: (values (10,), covariance (10, 10), directions seen)."""
    U, S, Vt = svd(R * scale, full_matrices=False)
    keep = (S > 1e-8 * max(float(S.max(initial=0.0)), 1e-300)) & (np.arange(len(S)) < structural) & (S > 0)
    inverse = (scale[:, None] * Vt[keep].T) / S[keep]
    return inverse @ (U[:, keep].T @ z), inverse @ inverse.T, int(keep.sum())


def _visible(R: Array, scale: Array) -> Array:
    """Which of the ten (10,) bool are determined on their own."""
    _, S, Vt = svd(R * scale, full_matrices=True)
    full = np.zeros(10)
    full[: len(S)] = S
    unseen = Vt[full <= 1e-8 * max(float(full.max(initial=0.0)), 1e-300)]
    return np.asarray(np.abs(unseen).max(axis=0, initial=0.0) < 1e-6, bool)


def _consistent(R: Array, z: Array, scale: Array) -> Array:
    """Least squares with a positive definite pseudo-inertia; what is not seen is settled on a light, compact body."""
    program = ConicProgram()
    x = program.variables(10)
    U, S, Vt = svd(R * scale, full_matrices=False)
    program.squares(x, S[:, None] * Vt, U.T @ z)
    length = scale[1]
    D = np.array([1.0 / length] * 3 + [1.0])
    units = D[:, None] * UNITS * D * scale[:, None, None]
    program.semidefinite(-1e-7 * np.eye(4), [(x, units)])
    program.linear(x, 1e-4 * np.trace(units, axis1=1, axis2=2))
    found = program.solve("the payload")
    values = scale * found.x[x]
    # Lift by what rounding took, so that the body is one.
    J = D[:, None] * pseudo_inertia(values) * D
    lack = 1e-8 - float(np.linalg.eigvalsh(J)[0])
    return values if lack <= 0 else from_pseudo_inertia((J + lack * np.eye(4)) / np.outer(D, D))


def _log_cholesky(R: Array, z: Array, scale: Array) -> Array:
    from scipy.optimize import least_squares

    D = np.array([1.0 / scale[1]] * 3 + [1.0])
    rows, columns = np.tril_indices(4)
    diagonal = rows == columns

    def body(x: Array) -> Array:
        L = np.zeros((4, 4))
        L[rows, columns] = np.where(diagonal, np.exp(np.clip(x, -60, 60)), x)
        return from_pseudo_inertia((L @ L.T) / np.outer(D, D))

    def residual(x: Array) -> Array:
        return np.concatenate([R @ body(x) - z, 1e-3 * x])

    best = None
    for mass in (0.1, 1.0, 10.0):
        x0 = np.where(diagonal, 0.5 * np.log(mass), 0.0)
        found = least_squares(residual, x0, x_scale="jac", max_nfev=300)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return body(best.x)


def _limit(degrees: int) -> float:
    """What noise and the inexactness of its colour leave of so many degrees of freedom."""
    return max(_chi2_limit(degrees), _MORE * degrees)


def _chi2_limit(degrees: int) -> float:
    from scipy.stats import chi2

    return float(chi2.ppf(0.999, degrees))
