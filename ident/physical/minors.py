"""Principal minors of the inertia matrix as the dissertation's chapter 4 takes them: det_i(q; p) = f_i(q)' x_i(p).

H is linear in the base parameters p, so its i-th minor is a polynomial of degree i in p whose coefficients are functions of the
positions. As many of these functions as are linearly independent are the terms of the minor; f_i(q) are their values at a position, a
row of F_i, and x_i(p) what the base parameters make of them. That the minor is positive at the positions is F_i x_i(p) > 0: x_i(p) lies
inside a polyhedral cone. The terms are counted numerically (25 for the first and 311 for the second leading minor of the
PUMA 560's H), and made orthonormal, so that lengths of x_i are root mean squares of the minor over all positions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import svd
from ..errors import UnsupportedError
from .structure import InertiaStructure
from .trigonometric import TrigonometricPolynomial, coefficients_on_grid, grid

Array = np.ndarray

#: Numbers in F_i at most: rows times terms.
MOST_NUMBERS = 2_000_000
#: Sampled sets beyond the rank that show that no further term is to be found.
_SPARE = 8
#: Singular value, of the largest, below which there is no term.
_RANK = 1e-9


class MinorOrder(StrEnum):
    """LEADING: of the first i rows, as in the dissertation. TRAILING: of the last i rows, which need only the positions of the joints
    after the first of them."""

    LEADING = "leading"
    TRAILING = "trailing"


class TooManyRaysError(UnsupportedError):
    """A cone with more rays than can be worked with."""


@dataclass(frozen=True, eq=False, repr=False)
class Minor(ShortRepr):
    """A minor of `size` rows of H, a function of the angles of `joints` (a,), indices among the structure's n.

    `matrices` (M, b, size, size): those rows per unit base parameter at `points` positions of every joint, M = points**a, enough to
    determine the minor; `basis` (t, M): its t orthonormal terms there; `frequencies` (f, a), `spectrum` (t, f): the same as trigonometric
    polynomials; `n`: joints of the robot; `names`: joints whose rows it has."""

    size: int
    names: tuple[str, ...]
    joints: Array
    points: int
    matrices: Array
    basis: Array
    frequencies: Array
    spectrum: Array
    n: int

    @property
    def terms(self) -> int:
        """Number t of independent terms: the dimension of the cone."""
        return len(self.basis)

    def on_grid(self, values: Array) -> Array:
        """The minor (M,) of base values (b,) at the positions that determine it."""
        return np.asarray(np.linalg.det(np.tensordot(self.matrices, values, ([1], [0]))))

    def coordinates(self, values: Array) -> Array:
        """x_i (t,) of base values (b,)."""
        return np.asarray(self.basis @ self.on_grid(values) / self.basis.shape[1])

    def linear(self, values: Array) -> tuple[Array, Array]:
        """x_i (t,) and its slope dx_i / dp (t, b) at base values (b,)."""
        H = np.tensordot(self.matrices, values, ([1], [0]))
        C = cofactors(H)
        M, b = self.matrices.shape[:2]
        change = (self.matrices.reshape(M, b, -1) @ C.reshape(M, -1, 1))[:, :, 0]
        return np.asarray(self.basis @ (H[:, 0] * C[:, 0]).sum(axis=1) / M), np.asarray(self.basis @ change / M)

    def rows(self, angles: Array) -> Array:
        """Rows f_i (N, t) of F_i at angles (N, a) of its joints."""
        turned = np.exp(1j * (angles @ self.frequencies.T))
        return np.asarray((turned @ self.spectrum.T).real)

    def polynomial(self, x: Array) -> TrigonometricPolynomial:
        """The function of the angles that x (t,) stands for."""
        return TrigonometricPolynomial(self.frequencies, x @ self.spectrum)

    def position(self, angles: Array) -> Array:
        """Positions (n,) of all joints for angles (a,), those that do not matter at zero."""
        q = np.zeros(self.n)
        q[self.joints] = angles
        return q


def minor_of(structure: InertiaStructure, rows: range, most: int = MOST_NUMBERS) -> Minor:
    """The minor of consecutive `rows` of H.

    Raises TooManyRaysError where F_i has more than `most` numbers; UnsupportedError for robots whose inertia matrix is no
    trigonometric polynomial of degree two in each joint."""
    check_structure(structure)
    size, block = len(rows), slice(rows.start, rows.stop)
    names = structure.joint_names[block]
    joints = _dependence(structure, block)
    points = 4 * size + 1
    positions = points ** len(joints)
    if positions * min(8 * _SPARE, positions) > most:
        raise TooManyRaysError(_too_many(names, len(joints), points, None))
    angles = grid(points, len(joints))
    q = np.zeros((positions, structure.n))
    q[:, joints] = angles
    matrices = np.stack([structure.inertia_matrix(unit, q)[:, block, block] for unit in np.eye(structure.b)], axis=1)
    basis = _terms(matrices, names, len(joints), points, most)
    frequencies, spectrum = coefficients_on_grid(basis, points, len(joints))
    return Minor(size, names, joints, points, matrices, basis, frequencies, spectrum, structure.n)


def check_structure(structure: InertiaStructure) -> None:
    """Raise UnsupportedError where minors are no trigonometric polynomials of degree two per row."""
    slides = [structure.joint_names[i] for i in np.flatnonzero(structure.prismatic & structure.relevant)]
    why = (
        "a floating base" if structure.nv != structure.n else "loop closures" if structure.has_loop else
        f"prismatic joints whose position matters ({', '.join(slides)})" if slides else ""
    )  # fmt: skip
    if why:
        raise UnsupportedError(
            f"the cones of chapter 4 are those of revolute chains; this robot has {why}. Judge it without the cone (`ident judge`), and"
            " repair it by 'possible'."
        )


def minor_rows(structure: InertiaStructure, order: MinorOrder) -> list[range]:
    """Rows of H of each minor, smallest first."""
    n = structure.nv
    return [range(i + 1) if order == MinorOrder.LEADING else range(n - 1 - i, n) for i in range(n)]


def cofactors(H: Array) -> Array:
    """Cofactor matrices (M, n, n) of (M, n, n): the slope of the determinant by its entries."""
    n = H.shape[1]
    if n == 1:
        return np.ones_like(H)
    out = np.empty_like(H)
    if n == 3:
        for i in range(3):
            out[:, i] = np.cross(H[:, (i + 1) % 3], H[:, (i + 2) % 3])
        return out
    for i in range(n):
        for j in range(n):
            rest = np.delete(np.delete(H, i, axis=1), j, axis=2)
            out[:, i, j] = (-1) ** (i + j) * (np.linalg.det(rest) if n > 2 else rest[:, 0, 0])
    return out


def _dependence(structure: InertiaStructure, block: slice) -> Array:
    """Joints on whose position a block of H depends for some base parameters."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-np.pi, np.pi, (4, structure.n))
    sets = rng.standard_normal((3, structure.b))
    found = []
    for j in np.flatnonzero(structure.relevant):
        other = q.copy()
        other[:, j] = rng.uniform(-np.pi, np.pi, 4)
        for values in sets:
            here, there = (structure.inertia_matrix(values, x)[:, block, block] for x in (q, other))
            if np.abs(here - there).max() > 1e-10 * max(float(np.abs(here).max()), 1e-300):
                found.append(int(j))
                break
    return np.array(found, int)


def _terms(matrices: Array, names: tuple[str, ...], joints: int, points: int, most: int) -> Array:
    """Orthonormal basis (t, M) of the minors of all base parameters, from random sets."""
    positions = len(matrices)
    rng = np.random.default_rng(7)
    # Parameters of unlike size count alike.
    size = np.abs(matrices).max(axis=(0, 2, 3))
    scale = np.where(size > 1e-12 * size.max(initial=0.0), 1.0 / np.where(size > 0, size, 1.0), 0.0)
    samples = np.zeros((0, positions))
    count = 4 * _SPARE
    while True:
        sets = rng.standard_normal((count - len(samples), matrices.shape[1])) * scale
        new = np.linalg.det(np.einsum("Kb,Mbij->KMij", sets, matrices, optimize=True))
        norm = np.linalg.norm(new, axis=1, keepdims=True)
        samples = np.concatenate([samples, new / np.where(norm > 0, norm, 1.0)])
        _, S, Vt = svd(samples, full_matrices=False)
        rank = int(np.count_nonzero(S > _RANK * max(float(S[0]), 1e-300)))
        if rank <= count - _SPARE or rank == positions:
            return np.asarray(Vt[:rank] * np.sqrt(positions))
        if positions * 2 * count > most:
            raise TooManyRaysError(_too_many(names, joints, points, rank))
        count *= 2


def _too_many(names: tuple[str, ...], joints: int, points: int, terms: int | None) -> str:
    held = "" if terms is None else f" with {terms} terms or more each"
    return (
        f"the minor of {names[0]}{f' to {names[-1]}' if len(names) > 1 else ''} depends on {joints} angles: its cone is bounded by"
        f" {points**joints:,} rays (rows of F at {points} positions of each joint){held}, which is beyond what is computed"
    )
