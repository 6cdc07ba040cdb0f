"""Consistent fit without a semidefinite solver: every link as a Cholesky factor with logarithmic diagonal.

J = L L' with L lower triangular and a positive diagonal reaches exactly the real bodies, without constraints (after Rucker and Wensing,
IEEE RA-L 2022), so ordinary nonlinear least squares will do. It is not convex in these coordinates: the result is a local optimum."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._utils.singular_values import pinv
from ..errors import UnsupportedError
from .bounds import Bounds, Metric, Prior
from .conic import SolverError
from .consistent import _drive_scale, _holds, link_scales, wrong_signs
from .constrained import ConsistentFit
from .pseudo_inertia import UNITS, from_pseudo_inertia, pseudo_inertia
from .structure import InertiaStructure
from .target import Target

Array = np.ndarray

_ROWS, _COLUMNS = np.tril_indices(4)
_DIAGONAL = _ROWS == _COLUMNS
#: Parameters per unit entry of a pseudo-inertia: the inverse of the map from parameters to J.
_TO_PARAMETERS = pinv(UNITS.reshape(10, 16).T)


def fit_log_cholesky(
    structure: InertiaStructure, target: Target, *, bounds: Bounds | None = None, prior: Prior | None = None, start: Array | None = None
) -> ConsistentFit:
    """Consistent base values by nonlinear least squares over log-Cholesky factors, from `start` (k,) or the prior's nominal links.

    Bounds are not supported (UnsupportedError names what supports them). Raises SolverError where the fit ends without a consistent set."""
    from scipy.optimize import least_squares

    if bounds is not None and bounds != Bounds():
        raise UnsupportedError(
            "the log-Cholesky fit takes no bounds on mass or centre of mass;"
            " the fit by linear matrix inequalities does: pip install 'ident[sdp]'."
        )
    if prior is not None and prior.metric != Metric.QUADRATIC:
        raise UnsupportedError(
            f"the nearest bodies by the {prior.metric} metric need the solver: pip install 'ident[sdp]'. Without it, only those by the"
            f" {Metric.QUADRATIC} metric are found."
        )
    fit = _Factors(structure, target, prior)

    def descend(x0: Array, evaluations: int) -> Any:
        return least_squares(
            fit.residual, x0, jac=fit.jacobian, x_scale="jac", method="trf", bounds=(fit.lower, np.inf), max_nfev=evaluations,
            ftol=1e-12, xtol=1e-12, gtol=1e-12,
        )  # fmt: skip

    # A few steps from every start, the rest from the best.
    best = min((descend(x0, 25) for x0 in fit.starts(start, prior)), key=lambda found: found.cost)
    best = descend(best.x, 400)
    standard = fit.parameters(best.x)
    values = structure.regroup @ standard
    if not _holds(structure, standard) or wrong_signs(structure, structure.lift @ values, structure.null_space):
        raise SolverError(
            "the log-Cholesky fit ended at links that vanish;"
            " give a nominal model as prior, or install the solver: pip install 'ident[sdp]'."
        )
    data = fit.data_residual(standard)
    notes: tuple[str, ...] = (
        "fallback without a semidefinite solver: a local optimum of a problem that is not convex in these coordinates.",
    )
    if not best.success:
        notes += (f"the least-squares search stopped early ({best.message}).",)
    return ConsistentFit(values, standard, float(data @ data), "log-Cholesky factors, nonlinear least squares (fallback)", notes)


class _Factors:
    """All parameters as a function of x: ten numbers a link, log rotor inertias, friction >= 0, everything else free."""

    def __init__(self, structure: InertiaStructure, target: Target, prior: Prior | None) -> None:
        self.structure, self.target = structure, target
        self.nb = structure.tree.nb
        self.scale = link_scales(structure)
        taken = {*structure.inertial.tolist(), *structure.drive.tolist()}
        self.rest = np.array([i for i in range(structure.k) if i not in taken], int)
        self.drive = _drive_scale(structure, structure.lift @ (target.offset + target.root @ target.target))
        self.lower = np.full(10 * self.nb + len(structure.drive) + len(self.rest), -np.inf)
        # No factor's diagonal below a thousandth of a typical link's: a body that vanishes is none.
        self.lower[: 10 * self.nb][np.tile(_DIAGONAL, self.nb)] = np.log(1e-3)
        signed = np.isin(self.rest, structure.nonnegative)
        self.lower[10 * self.nb + len(structure.drive) :][signed] = 0.0
        # Base values -> whitened residuals: the inverse of the target's root on what costs something.
        size = np.linalg.norm(target.root, axis=1)
        D = 1.0 / np.where(size > 0, size, 1.0)
        inverse = pinv(D[:, None] * target.root, rcond=1e-13) * D
        self.whiten = inverse[target.costed]
        fixed = np.eye(structure.b) - target.root @ inverse
        # Base values that may not change weigh as if known to a millionth.
        self.whiten = np.concatenate([self.whiten, 1e6 * fixed[size <= 0] / np.maximum(np.abs(target.offset[size <= 0]), 1e-3)[:, None]])
        self.wanted = np.concatenate([target.target[target.costed], np.zeros(len(self.whiten) - int(target.costed.sum()))])
        self.roots = [None] * self.nb if prior is None else prior.roots(structure)
        self.spread = 1.0 if prior is None else prior.spread

    def starts(self, start: Array | None, prior: Prior | None) -> list[Array]:
        """Starting points: the given or nominal links, else ordinary bodies of three sizes."""
        guess = self.structure.lift @ (self.target.offset + self.target.root @ self.target.target)
        rest = np.maximum(guess[self.rest], np.where(np.isfinite(self.lower[10 * self.nb + len(self.drive) :]), 1e-9, -np.inf))
        links: list[Array] = []
        if start is not None:
            links.append(np.asarray(start, float)[self.structure.inertial])
        elif prior is not None and all(root is not None for root in prior.roots(self.structure)):
            links.append(prior.nominal)
        else:
            for mass in (0.3, 3.0, 30.0):
                J = np.einsum("bi,ij,bj->bij", 1.0 / self.scale, mass * np.eye(4), 1.0 / self.scale)
                links.append(from_pseudo_inertia(J).reshape(-1))
        rotors = np.log(np.maximum(guess[self.structure.drive], 0.1 * self.drive))
        return [np.maximum(np.concatenate([self._factors(link), rotors, rest]), self.lower + 1e-6) for link in links]

    def _factors(self, links: Array) -> Array:
        J = pseudo_inertia(links.reshape(-1, 10))
        L = np.linalg.cholesky(J * self.scale[:, :, None] * self.scale[:, None, :])
        out = L[:, _ROWS, _COLUMNS]
        out[:, _DIAGONAL] = np.log(out[:, _DIAGONAL])
        return out.reshape(-1)

    def _lower(self, x: Array) -> Array:
        entries = x[: 10 * self.nb].reshape(-1, 10).copy()
        entries[:, _DIAGONAL] = np.exp(np.clip(entries[:, _DIAGONAL], -60.0, 60.0))
        L = np.zeros((self.nb, 4, 4))
        L[:, _ROWS, _COLUMNS] = entries
        return L / self.scale[:, :, None]

    def parameters(self, x: Array) -> Array:
        """All parameters (k,)."""
        L = self._lower(x)
        out = np.zeros(self.structure.k)
        out[self.structure.inertial] = from_pseudo_inertia(L @ np.swapaxes(L, 1, 2)).reshape(-1)
        r = len(self.structure.drive)
        out[self.structure.drive] = np.exp(np.clip(x[10 * self.nb : 10 * self.nb + r], -60.0, 60.0))
        out[self.rest] = x[10 * self.nb + r :]
        return out

    def data_residual(self, parameters: Array) -> Array:
        return (self.whiten @ (self.structure.regroup @ parameters - self.target.offset) - self.wanted)[: int(self.target.costed.sum())]

    def residual(self, x: Array) -> Array:
        """Whitened residuals of data, prior, and a trace of regularisation that settles what no torque sees."""
        parameters = self.parameters(x)
        data = self.whiten @ (self.structure.regroup @ parameters - self.target.offset) - self.wanted
        parts = [data]
        L = self._lower(x)
        for body, root in enumerate(self.roots):
            if root is not None:
                A = np.linalg.solve(root, L[body])
                parts.append(np.sqrt(0.5) / self.spread * (A @ A.T - np.eye(4)).reshape(-1))
        parts.append(1e-4 * x[: 10 * self.nb])
        return np.concatenate(parts)

    def jacobian(self, x: Array) -> Array:
        """Slope of `residual`, analytic."""
        p, r = len(x), len(self.structure.drive)
        L = self._lower(x)
        slope = np.zeros((self.structure.k, p))
        prior_rows = []
        for body in range(self.nb):
            dL = np.zeros((10, 4, 4))
            dL[np.arange(10), _ROWS, _COLUMNS] = np.where(_DIAGONAL, L[body][_ROWS, _COLUMNS], 1.0 / self.scale[body][_ROWS])
            dJ = np.einsum("pij,kj->pik", dL, L[body])
            dJ = dJ + np.swapaxes(dJ, 1, 2)
            at = self.structure.inertial[10 * body : 10 * body + 10]
            slope[at, 10 * body : 10 * body + 10] = _TO_PARAMETERS @ dJ.reshape(10, 16).T
            if (root := self.roots[body]) is not None:
                inverse = np.linalg.inv(root)
                rows = np.zeros((16, p))
                rows[:, 10 * body : 10 * body + 10] = np.einsum("ai,pij,bj->abp", inverse, dJ, inverse).reshape(16, 10)
                prior_rows.append(np.sqrt(0.5) / self.spread * rows)
        at = np.arange(10 * self.nb, 10 * self.nb + r)
        slope[self.structure.drive, at] = np.exp(np.clip(x[at], -60.0, 60.0))
        slope[self.rest, np.arange(10 * self.nb + r, p)] = 1.0
        settle = np.zeros((10 * self.nb, p))
        settle[:, : 10 * self.nb] = 1e-4 * np.eye(10 * self.nb)
        return np.concatenate([self.whiten @ self.structure.regroup @ slope, *prior_rows, settle])
