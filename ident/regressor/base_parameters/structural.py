"""Base parameters of any tree from its structure: no samples, no rank decision on a large matrix.

What the torques show of the inertial parameters is spanned by the coefficients of H_ij(q) and of the gravity torques as functions
of q. Both are energy vectors (see `joint_blocks`) of pairs of motions, gravity being one more motion of the base. An energy
vector y at a body passes into each child as Σ_k f_k(q_child) C_k y with independent functions f_k, f_0 = 1: so what the body
shows reaches the child through C_0 and stays tied to the body, and each C_k y, k > 0, is new and the child's own. With what the
child's own rate shows in pairs with the motions before it, these new vectors span N_child, and the identifiable space is the
direct sum over the bodies of N_i carried on by C_0: its dimension is Σ dim N_i, and every rank decision is about ten columns.
This is the propagation of Wensing, Niemeyer and Slotine ("A geometric characterization of observability in inertial parameter
identification", 2024) in the dual space. Reflected rotor inertias add constants (K⁻¹)_ia (K⁻¹)_ib to H_ab; so rows of constant
coefficients are kept apart by their pair of joints, and only there can a rotor merge with links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.short_repr import ShortRepr
from ..._utils.singular_values import svd
from .base_form import BaseForm, body_names, rotor_names
from .degenerate import near_degenerate
from .expressions import LINK_PREFERENCE, link_parameter_names
from .joint_blocks import JointBlock, joint_blocks, typical_length

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray

#: Directions weaker than this (lengths over the typical length, unit motions) are rounding.
TOLERANCE = 1e-12
#: Weaker directions are passed on with their weight over this, so that their rounding does not grow from body to body.
_FAINT = 1e-3
#: A column becomes the name of a base parameter only with at least this share: keeps coefficients small.
_PIVOT = 1e-2
#: Everything there is to see: by number of columns (an energy vector has 10, a twist 6).
_WHOLE = {size: np.eye(size) for size in range(1, 11)}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class StructuralSet(ShortRepr, BaseForm):
    """Base parameters found from the structure, in reduced form: each row has a 1 at the parameter that names it, which no other
    row contains (Gautier's regrouping).

    `kept` (b,): column of `full` that names each row. `dimensions`: (joint or motor, how many base parameters it adds), in order.
    `strength`: how strongly each direction shows (1: fully), ascending; `gap`: (weakest kept, strongest dropped).
    `exact`: no part of a loop had to be probed at generic positions. `turning` (nb,): dimension of the angular velocities that each
    body attains (0: it never turns, 1: about one direction only)."""

    kept: Array
    dimensions: tuple[tuple[str, int], ...]
    strength: Array
    gap: tuple[float, float]
    exact: bool
    turning: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is known at a body, as rows: the span of its energy vectors (p, 10) and of its twists (v, 6). For rotors also the part of
    the twists that is no joint's constant share, `varying` (w, 6), and those shares, `constant` (n, 6), one per coordinate."""

    energy: Array
    twists: Array
    varying: Array
    constant: Array


@dataclass
class _Ranks:
    """Rank decisions and their margins."""

    tolerance: float
    kept: list[float] = field(default_factory=lambda: [1.0])
    dropped: list[float] = field(default_factory=lambda: [0.0])

    def local(self, rows: Array, rotors: Array, noise: float = 0.0) -> tuple[Array, Array, Array, Array]:
        """Of generating rows (g, 10 r) with their rotor parts (g, m): orthonormal basis and its rotor part, the singular values, and
        the rotor parts of what vanishes on the links. `noise`: rounding of the rows."""
        if not rows.any():
            return rows[:0], rotors[:0], np.zeros(0), rotors
        noise *= np.sqrt(len(rows))
        if not rotors.size and len(rows) > 2 * rows.shape[1]:
            rows = np.asarray(np.linalg.qr(rows, mode="r"))  # the same span in fewer rows
        U, s, Vt = svd(rows, full_matrices=bool(rotors.size))
        r = int((s > max(self.tolerance * max(1.0, s[0]), noise)).sum())
        self.kept += list(np.minimum(s[:r] / max(1.0, s[0]), 1.0))
        self.dropped += list(s[r:])
        if not rotors.size:
            return Vt[:r], np.zeros((r, rotors.shape[1])), s[:r], np.zeros((0, rotors.shape[1]))
        turned = U.T @ rotors
        return Vt[:r], turned[:r] / s[:r, None], s[:r], turned[r:]

    def basis(self, rows: Array, noise: float = 0.0) -> Array:
        """Rows that span the same space: unit vectors, faint ones at their weight; the identity for the full space."""
        if not rows.any():
            return rows[:0]
        noise *= np.sqrt(len(rows))
        if len(rows) > 300:
            rows = np.asarray(np.linalg.qr(rows, mode="r"))
        _, s, Vt = svd(rows, full_matrices=False)
        r = int((s > max(self.tolerance, noise)).sum())
        if r == rows.shape[1] and s[-1] >= _FAINT:
            return _WHOLE[r]
        return np.minimum(s[:r] / _FAINT, 1.0)[:, None] * Vt[:r]


def _motor_rates(robot: Robot, blocks: Sequence[JointBlock], motors: Sequence[int]) -> Array:
    """Rates (m, n) of motors per unit of the blocks' coordinates."""
    unit = np.ones(robot.n)
    for block in blocks:
        unit[list(block.coordinates)] = block.scale
    rates: Array = robot.transmission.K_inverse[motors] * unit
    return rates


def _in_order(full: Array, kept: Array, width: int, motors: Sequence[int], n: int) -> tuple[Array, Array, Array]:
    """Rows in the order of the columns that name them, those columns counted over all motors, and the motors' part over all (b, n)."""
    order = np.argsort([_column_place(int(c)) if c < width else c for c in kept], kind="stable")
    full, kept = full[order], kept[order]
    spread = np.zeros((len(full), n))
    spread[:, motors] = full[:, width:]
    return full, np.array([c if c < width else width + motors[c - width] for c in kept], int), spread


def base_set(robot: Robot, rotor_inertia: bool | Sequence[str] = False, tolerance: float = TOLERANCE) -> StructuralSet:
    """Base parameters of a robot with any tree of revolute and prismatic joints, loop closure or floating base.

    Parameters
    ----------
    robot : Robot
        The robot with its transmission.
    rotor_inertia : bool or sequence of str
        True, or names of joints: the reflected inertias of their motors are included, through K.
    tolerance : float
        Directions that show less than this (lengths over the typical length) count as none.

    Returns
    -------
    StructuralSet

    Raises
    ------
    ConfigurationError
        An unknown joint.

    Examples
    --------
    >>> import ident
    >>> ident.regressor.base_set(ident.load_robot("scara")).count
    8
    """
    asked = robot.joint_names if rotor_inertia is True else tuple(rotor_inertia or ())
    motors = [robot.joint_index(name) for name in asked]
    length = typical_length(robot.tree)
    blocks = joint_blocks(robot, length)
    k = _motor_rates(robot, blocks, motors)
    rotor_size = np.linalg.norm(k, axis=1)

    ranks = _Ranks(tolerance)
    rows, rotors, pivots, dimensions, alone, turning = _propagate(robot, blocks, k / rotor_size[:, None], ranks)
    free, _, _, _ = ranks.local(alone, np.zeros((len(alone), 0)))
    leading = _leading_columns(free, list(range(len(motors))))
    free = np.linalg.inv(free[:, leading]) @ free
    rotors = rotors - rotors[:, leading] @ free

    width = rows.shape[1]
    full = np.block([[rows, rotors], [np.zeros((len(free), width)), free]])
    scale = np.r_[np.tile(np.repeat([1.0, 1 / length, 1 / length**2], [1, 3, 6]), robot.tree.nb), rotor_size**2 / length**2]
    kept = np.r_[np.array(pivots, int), width + np.array(leading, int)]
    full = _tidy(full * scale / scale[kept][:, None])
    full[:, kept] = np.eye(len(full))
    full, kept, spread = _in_order(full, kept, width, motors, robot.n)
    parameters, motor_names = link_parameter_names(body_names(robot)), rotor_names(robot)
    columns = parameters + motor_names
    dimensions += [(f"motor {asked[i]}", 1) for i in sorted(leading)]
    terms = " + ".join(f"{count} ({name})" for name, count in dimensions if count)
    strength = np.sort(ranks.kept)
    return StructuralSet(
        robot=robot,
        method="structural",
        matrix=full[:, :width],
        rotor_matrix=spread,
        names=tuple(columns[c] for c in kept),
        count_formula=f"sum of what each joint adds: {terms or 0} = {len(full)}",
        parameters=parameters,
        rotors=motor_names,
        notes=near_degenerate(robot, strength),
        kept=kept,
        dimensions=tuple(dimensions),
        strength=strength,
        gap=(float(strength[0]), float(max(ranks.dropped))),
        exact=all(block.exact for block in blocks),
        turning=turning,
    )


def _propagate(
    robot: Robot, blocks: list[JointBlock], k: Array, ranks: _Ranks
) -> tuple[Array, Array, list[int], list[tuple[str, int]], Array, tuple[int, ...]]:
    """Rows (b, 10 nb) reduced, with their rotor part (b, m), the column that names each, what each block adds, rows on rotors alone,
    and how many directions each body turns about."""
    tree, n, m = robot.tree, robot.n, len(k)
    names = body_names(robot)
    rows, rotors, alone = np.zeros((0, 10 * tree.nb)), np.zeros((0, m)), [np.zeros((0, m))]
    pivots: list[int] = []
    dimensions: list[tuple[str, int]] = []
    still = np.zeros((n, 6))
    gravity = np.r_[tree.gravity, 0, 0, 0][None]
    pull = gravity / np.linalg.norm(gravity) if gravity.any() else gravity[:0]
    seen = {-1: _Seen(np.zeros((0, 10)), pull, pull, still)}
    if robot.floating_base:
        seen[0] = _Seen(_WHOLE[10], _WHOLE[6], _WHOLE[6], still)
        rows, rotors = np.eye(10, 10 * tree.nb), np.zeros((10, m))
        pivots, dimensions = list(range(10)), [(names[0], 10)]
    done: list[int] = []
    for block in blocks:
        at = seen[block.entrance]
        generated, parts = _generated(block, at, k, done)
        basis, parts, weights, rest = ranks.local(generated, parts, block.noise)
        alone.append(rest)
        columns = (10 * np.array(block.bodies)[:, None] + np.arange(10)).ravel()
        lead = _leading_columns(basis, [10 * i + c for i in range(len(block.bodies)) for c in LINK_PREFERENCE])
        inverse = np.linalg.inv(basis[:, lead])
        basis_reduced, parts = inverse @ basis, inverse @ parts
        if block.entrance >= 0:
            # Earlier rows reach these bodies; what they hold at the new leading columns is taken out at once.
            carried = rows[:, 10 * block.entrance : 10 * block.entrance + 10] @ block.transport[0]
            share = carried[:, lead]
            rows[:, columns] = carried - share @ basis_reduced
            rotors -= share @ parts
        new = np.zeros((len(basis), rows.shape[1]))
        new[:, columns] = basis_reduced
        rows, rotors = np.vstack([rows, new]), np.vstack([rotors, parts])
        pivots += [int(columns[c]) for c in lead]
        dimensions.append((" + ".join(names[b] for b in block.bodies), len(basis)))
        for i, body in enumerate(block.bodies):
            seen[body] = _beyond(block, i, at, weights[:, None] * basis[:, 10 * i : 10 * i + 10], ranks, bool(m))
        done += block.coordinates
    turning = tuple(len(ranks.basis(seen[b].twists[:, 3:])) for b in range(tree.nb))
    return rows, rotors, pivots, dimensions, np.vstack(alone), turning


def _generated(block: JointBlock, at: _Seen, k: Array, done: list[int]) -> tuple[Array, Array]:
    """Rows (g, 10 r) that span what a block adds, and their rotor parts (g, m)."""
    width, m, own = block.transport.shape[2], len(k), list(block.coordinates)
    d = len(own)
    upper = [(a, b) for a in range(d) for b in range(a, d)]
    carried = np.tensordot(at.energy, block.transport[1:], axes=([1], [1])).reshape(-1, width)
    pairs = block.own[:, [a for a, _ in upper], [b for _, b in upper]]
    crossed = np.tensordot(at.twists, block.cross, axes=([1], [1]))  # (v, F, d, 10 r)
    if m == 0:
        rows = np.vstack([carried, crossed.reshape(-1, width), pairs.reshape(-1, width)])
        return rows, np.zeros((len(rows), 0))
    free = np.vstack(
        [
            carried,
            crossed[:, 1:].reshape(-1, width),
            np.tensordot(at.varying, block.cross[0], axes=1).reshape(-1, width),
            pairs[1:].reshape(-1, width),
        ]
    )
    if len(free) > width:  # the same span in fewer rows
        free = np.asarray(np.linalg.qr(free, mode="r"))
    constant = np.tensordot(at.constant[done], block.cross[0], axes=1).reshape(-1, width)
    mine = k[:, own]
    parts = [
        np.zeros((len(free), m)),
        (k[:, done, None] * mine[:, None, :]).reshape(m, -1).T,
        np.array([mine[:, a] * mine[:, b] for a, b in upper]).reshape(-1, m),
    ]
    return np.vstack([free, constant, pairs[0]]), np.vstack(parts)


def _beyond(block: JointBlock, i: int, at: _Seen, added: Array, ranks: _Ranks, rotors: bool) -> _Seen:
    """What is known at body i of a block, for the blocks that hang on it."""
    carry, rate = block.carry[:, i], block.rate[:, i]
    # What is fully seen at the entrance stays fully seen after any motion.
    if at.energy is _WHOLE[10]:
        energy = at.energy
    else:
        carried = at.energy @ block.transport[0][:, 10 * i : 10 * i + 10]
        energy = ranks.basis(np.vstack([carried, added]), block.noise)
    twists = at.twists
    if twists is not _WHOLE[6]:
        twists = ranks.basis(np.vstack([(twists @ carry).reshape(-1, 6), rate.reshape(-1, 6)]), block.noise)
    if not rotors:
        return _Seen(energy, twists, twists, at.constant)
    varying = at.varying
    if varying is not _WHOLE[6]:
        parts = [varying @ carry[0], (at.twists @ carry[1:]).reshape(-1, 6), rate[1:].reshape(-1, 6)]
        varying = ranks.basis(np.vstack(parts), block.noise)
    constant = at.constant @ carry[0]
    constant[list(block.coordinates)] += rate[0]
    return _Seen(energy, twists, varying, constant)


def _leading_columns(basis: Array, order: list[int]) -> list[int]:
    """For orthonormal rows (r, c): r columns, the first in `order` that are independent of those before.

    They always exist: what is left of the columns beside fewer than r of them has norm one at least, so one of c columns exceeds
    1/sqrt(c), which is more than the threshold."""
    left = basis.copy()
    found: list[int] = []
    threshold = min(_PIVOT, 0.5 / np.sqrt(max(basis.shape[1], 1)))
    for c in order:
        if len(found) == len(basis):
            break
        size = float(np.linalg.norm(left[:, c]))
        if size > threshold:
            v = left[:, c] / size
            left -= np.outer(v, v @ left)
            found.append(c)
    return found


def _column_place(column: int) -> int:
    """Place of a link column in the order of preference."""
    return 10 * (column // 10) + LINK_PREFERENCE.index(column % 10)


def _tidy(matrix: Array) -> Array:
    """Zeros and ones that rounding missed are made exact."""
    matrix[np.abs(matrix) < 1e-13 * np.maximum(1.0, np.abs(matrix).max(axis=1, keepdims=True, initial=0.0))] = 0.0
    whole = np.round(matrix)
    tidy: Array = np.where(np.abs(matrix - whole) < 1e-12, whole, matrix)
    return tidy
