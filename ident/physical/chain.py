"""The kinetic energy as a chain of one-joint inequalities: what certifies H(q) > 0 on the whole continuum of positions.

Seen from body p, all that hangs behind joint i has the energy E_i(V_p, dq_i ..; q_i ..), quadratic in the body's velocity. If constant
matrices P_i bound it from below, E_i >= V_p' P_i V_p at every position, then for every joint

    (X(q_i) V_p + S dq_i)' (M_i + sum of P over the children of i) (X(q_i) V_p + S dq_i) + rotor terms - lambda D_i dq_i^2 >= V_p' P_i V_p

and summed up the chain dq' H(q) dq >= lambda dq' D dq. In one angle this is a matrix trigonometric polynomial of degree two, whose
nonnegativity is exactly one linear matrix inequality in its Gram matrix (Fejér-Riesz; within limits with a multiplier,
Markov-Lukács). All inequalities are jointly linear in lambda, the P_i and the base parameters. The bound is sufficient, not
necessary, since P_i may not follow the joints before; rates that share a rotor are carried along as part of the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._utils.singular_values import svd
from .conic import symmetric_basis
from .energy import Velocities, skew
from .structure import InertiaStructure

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class RecursionStage:
    """One joint's inequality, u = (state of the parent body, own rates) in an orthonormal order (constant part first).

    `parent`: body, -1 for the base; `E` (d, g): the child's state per Gram column; `T` (s, f + r): u in the new order; `f`, `r`: sizes of
    the part that does not turn and the part that does; `m`: functions of the joint, 1, cos, sin (3), 1, x (2) or 1; `cos_half`:
    cos of half the range, or None for the whole turn; `rates` (s, nt): own scaled rates in u; `rotor` (a, s, s): forms of u per `pairs`
    of coupled tree rates (a, 2); `state` (6 + c, d): body velocity and carried rates per state; `weakness`: bound on |u|^2 / |dq|^2."""

    body: int
    parent: int
    E: Array
    T: Array
    f: int
    r: int
    m: int
    cos_half: float | None
    width: int
    rotor: Array
    pairs: Array
    own: Array
    rates: tuple[int, ...]
    state: Array
    weakness: float

    @property
    def size(self) -> int:
        """Size of the Gram matrix."""
        return self.f + self.r * self.m


def spatial_units() -> Array:
    """Quadratic form of (linear, angular) velocity per unit inertial parameter: (10, 6, 6)."""
    out = np.zeros((10, 6, 6))
    out[0, :3, :3] = np.eye(3)
    for i in range(3):
        K = skew(np.eye(3)[i])
        out[1 + i, :3, 3:], out[1 + i, 3:, :3] = -K, K
    for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
        out[row, 3 + x, 3 + y] = out[row, 3 + y, 3 + x] = 1.0
    return out


@dataclass(frozen=True)
class Cross:
    """A rotor that couples two tree rates of different branches: its term 2 c a b is at least -(alpha a^2 + delta b^2)

    where alpha delta >= c^2."""

    rates: tuple[int, int]
    scale: float


def build_stages(structure: InertiaStructure, weight: Array, lower: Array, upper: Array) -> tuple[list[RecursionStage], list[Cross]]:
    """Stages for all joints, and couplings between branches. `weight` (nv,): D, the sizes against which lambda is measured."""
    tree, first = structure.tree, int(structure.tree.floating)
    W = structure.projection
    independent = _independent_rows(structure)
    coupling = np.any(structure.reflected != 0, axis=0)
    lower_t, upper_t = _tree_ranges(structure, lower, upper)
    scale = np.ones(tree.nv)
    for j, row in enumerate(independent):
        scale[row] = 1.0 / np.sqrt(weight[j])
    for row in set(range(tree.nv)) - set(independent):
        # A dependent rate counts as the independent ones it follows.
        scale[row] = 1.0 / np.sqrt(max(float(weight[np.abs(W[row]) > 0].min(initial=np.inf)), 1e-300)) if np.any(W[row]) else 1.0
    pairs_at: dict[int, list[tuple[int, int]]] = {i: [] for i in range(tree.nv)}
    for a in range(len(independent)):
        for b in range(a, len(independent)):
            if coupling[a, b]:
                i, j = sorted((independent[a], independent[b]))
                pairs_at[j].append((i, j))
    ancestors = _ancestors(tree.parent)
    carried, apart = _carried(pairs_at, ancestors, first)
    cross = [Cross(pair, float(scale[pair[0]] * scale[pair[1]])) for pair in apart]
    rng = np.random.default_rng(0)
    q_tree, rates = _sample(structure, lower_t, upper_t, rng)
    velocity = Velocities(tree, q_tree, rates * scale)
    inverse, state = [], []
    for i in range(tree.nb):
        Y = np.concatenate([velocity.l[i], velocity.w[i], rates[:, carried[i]].T])
        U, S, _ = svd(Y / np.sqrt(Y.shape[1]), full_matrices=False)
        keep = S > 1e-7 * S[0] if len(S) and S[0] > 0 else np.zeros(len(S), bool)
        # Whitened, but not so that a rarely used direction is blown up.
        size = np.maximum(S[keep], 1e-3 * S[0]) if keep.any() else S[keep]
        state.append(U[:, keep] * size)
        inverse.append((U[:, keep] / size).T)
    arms = _arms(structure, lower_t, upper_t, scale, ancestors)
    common = (scale, carried, state, inverse, pairs_at, lower_t, upper_t, arms)
    return [_stage(structure, i, *common) for i in range(tree.nb)], cross


def _stage(
    structure: InertiaStructure, i: int, scale: Array, carried: list[list[int]], state: list[Array], inverse: list[Array],
    pairs_at: dict[int, list[tuple[int, int]]], lower: Array, upper: Array, arms: Array,
) -> RecursionStage:  # fmt: skip
    tree = structure.tree
    up = int(tree.parent[i])
    floating = tree.floating and i == 0
    rates = list(range(6)) if floating else [i + 5 * tree.floating]
    held = carried[up] if up >= 0 else []
    Bp = state[up] if up >= 0 else np.zeros((6, 0))
    d, s = Bp.shape[1], Bp.shape[1] + len(rates)
    # Functions of the joint: [1, cos, sin] or [1, x]; entries are maps from u to (velocity, carried rates) of this body.
    parts, cos_half = _joint_maps(tree, i, lower, upper)
    maps = []
    for k, X in enumerate(parts):
        full = np.zeros((6 + len(carried[i]), s))
        full[:6, :d] = X @ Bp[:6]
        if k == 0:
            push = np.eye(6) if floating else np.zeros((6, 1))
            if not floating:
                push[slice(0, 3) if tree.prismatic[i] else slice(3, 6), 0] = tree.axis[i]
            full[:6, d:] = push * scale[rates]
            for place, rate in enumerate(carried[i]):
                if rate in held:
                    full[6 + place, :d] = Bp[6 + held.index(rate)]
                else:
                    full[6 + place, d + rates.index(rate)] = 1.0
        maps.append(inverse[i] @ full)
    turning = np.concatenate(maps[1:], axis=0) if len(maps) > 1 else np.zeros((0, s))
    turning[np.abs(turning) < 1e-12] = 0.0
    _, S, Vt = svd(turning[:, :d], full_matrices=True) if turning.size and d else (None, np.zeros(0), np.eye(d))
    r = int(np.sum(S > 1e-9)) if len(S) else 0
    still = np.zeros((s, d - r + len(rates)))
    still[:d, : d - r], still[d:, d - r :] = Vt[r:].T, np.eye(len(rates))
    moving = np.zeros((s, r))
    moving[:d] = Vt[:r].T
    T = np.concatenate([still, moving], axis=1)
    E = np.concatenate([maps[0] @ T] + [m @ moving for m in maps[1:]], axis=1) if r else maps[0] @ T
    forms, pairs = [], []
    for rate in rates:
        for a, b in pairs_at[rate]:
            form = np.zeros((s, s))
            row = np.zeros(s)
            if a in rates:
                row[d + rates.index(a)] = 1.0
            else:
                row[:d] = Bp[6 + held.index(a)]
            form[d + rates.index(b)] += row * scale[a] * scale[b]
            forms.append(form + form.T if a != b else form * 1.0)
            pairs.append((a, b))
    own = np.zeros((s, s))
    own[np.arange(d, s), np.arange(d, s)] = 1.0
    weakness = 1.0 + (float(np.linalg.norm(inverse[up], 2) ** 2) * (arms[up] + len(held)) if up >= 0 else 0.0)
    return RecursionStage(
        i, up, E, T, T.shape[1] - r, r, len(maps) if r else 1, cos_half if r else None, d,
        np.array(forms).reshape(-1, s, s), np.array(pairs, int).reshape(-1, 2), own, tuple(rates), state[i], weakness,
    )  # fmt: skip


def _joint_maps(tree: object, i: int, lower: Array, upper: Array) -> tuple[list[Array], float | None]:
    """Velocity of body i per velocity of its parent, as coefficients of [1, cos, sin] or [1, x] about the middle of the range."""
    R0, p, u = tree.rotation[i], tree.translation[i], tree.axis[i]  # type: ignore[attr-defined]
    if tree.floating and i == 0:  # type: ignore[attr-defined]
        return [np.zeros((6, 6))], None
    j = i - int(tree.floating)  # type: ignore[attr-defined]
    middle, half = 0.5 * (lower[j] + upper[j]), 0.5 * (upper[j] - lower[j])

    def transform(R: Array, shift: Array) -> Array:
        out = np.zeros((6, 6))
        out[:3, :3] = out[3:, 3:] = R
        out[:3, 3:] = -R @ skew(shift)
        return out

    if tree.prismatic[i]:  # type: ignore[attr-defined]
        slide = np.zeros((6, 6))
        slide[:3, 3:] = -R0.T @ skew(R0 @ u) * half
        return [transform(R0.T, p + R0 @ u * middle), slide], 0.0
    along, across, turn = np.outer(u, u), np.eye(3) - np.outer(u, u), -skew(u)
    c, s = np.cos(middle), np.sin(middle)
    parts = [along, c * across + s * turn, c * turn - s * across]
    whole = half >= np.pi - 1e-9
    return [transform(A @ R0.T, p) for A in parts], None if whole else float(np.cos(half))


def gram_freedom(stage: RecursionStage) -> Array:
    """Gram matrices of the zero polynomial: (a, size, size)."""
    f, r, m = stage.f, stage.r, stage.m
    size, found = stage.size, []

    def at(k: int) -> slice:
        return slice(f + k * r, f + (k + 1) * r)

    if not r:
        return np.zeros((0, size, size))
    if m == 3:
        for N in symmetric_basis(r):
            G = np.zeros((size, size))
            G[at(0), at(0)], G[at(1), at(1)], G[at(2), at(2)] = -N, N, N
            found.append(G)
    for a in range(m):
        for b in range(a + 1, m):
            for i in range(r):
                for j in range(i + 1, r):
                    G = np.zeros((size, size))
                    K = np.zeros((r, r))
                    K[i, j], K[j, i] = 1.0, -1.0
                    G[at(a), at(b)], G[at(b), at(a)] = K, K.T
                    found.append(G)
    return np.array(found).reshape(-1, size, size)


def gram_multiplier(stage: RecursionStage) -> tuple[int, Array] | None:
    """(size g of the multiplier's matrix, Gram matrices to be taken off per entry of its symmetric basis), or None without limits."""
    f, r, m = stage.f, stage.r, stage.m
    if stage.cos_half is None or not r:
        return None
    g = 2 * r if m == 3 else r
    basis = symmetric_basis(g)
    out = np.zeros((len(basis), stage.size, stage.size))

    def at(k: int) -> slice:
        return slice(f + k * r, f + (k + 1) * r)

    if m == 2:  # 1 - x^2 on -1 <= x <= 1
        out[:, at(0), at(0)], out[:, at(1), at(1)] = basis, -basis
        return g, out
    a = stage.cos_half
    G11, G22, G12 = basis[:, :r, :r], basis[:, r:, r:], basis[:, :r, r:]
    B0, B1, B2 = 0.5 * (G11 + G22), 0.5 * (G11 - G22), 0.5 * (G12 + np.swapaxes(G12, 1, 2))
    out[:, at(0), at(0)] = -a * B0
    out[:, at(1), at(1)] = B1
    for (i, j), block in (((0, 1), 0.5 * (B0 - a * B1)), ((0, 2), -0.5 * a * B2), ((1, 2), 0.5 * B2)):
        out[:, at(i), at(j)] = out[:, at(j), at(i)] = block
    return g, out


def _independent_rows(structure: InertiaStructure) -> list[int]:
    """Tree rate of each independent velocity: a row of the projection that is its unit vector."""
    W = structure.projection
    rows = []
    for j in range(structure.nv):
        unit = np.zeros(structure.nv)
        unit[j] = 1.0
        rows.append(int(np.flatnonzero((W == unit).all(axis=1))[0]))
    return rows


def _tree_ranges(structure: InertiaStructure, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Ranges of the tree's joints, dependent ones by interval arithmetic."""
    floating = 6 * structure.tree.floating
    W = structure.projection[floating:, floating:]
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    centre, spread = W @ middle + structure.offset, np.abs(W) @ half
    return centre - spread, centre + spread


def _ancestors(parent: Array) -> list[list[int]]:
    found: list[list[int]] = []
    for up in parent:
        found.append([] if up < 0 else [*found[up], int(up)])
    return found


def _carried(
    pairs_at: dict[int, list[tuple[int, int]]], ancestors: list[list[int]], floating: int
) -> tuple[list[list[int]], list[tuple[int, int]]]:
    """For each body the rates of earlier joints (itself included) that a rotor further out still needs; and pairs across branches,

    which are taken out of `pairs_at`."""
    carried: list[set[int]] = [set() for _ in ancestors]
    apart = []
    for pairs in pairs_at.values():
        for a, b in list(pairs):
            if a == b:
                continue
            i, j = max(a - 5 * floating, 0), b - 5 * floating
            if i not in ancestors[j]:
                pairs.remove((a, b))
                apart.append((a, b))
                continue
            for body in ancestors[j]:
                if body == i or i in ancestors[body]:
                    carried[body].add(a)
    return [sorted(c) for c in carried], apart


def _sample(structure: InertiaStructure, lower: Array, upper: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    tree = structure.tree
    count = 40 * tree.nv + 200
    q = rng.uniform(lower, upper, (count, len(lower)))
    if tree.floating:
        pose = np.zeros((count, 7))
        pose[:, 6] = 1.0
        q = np.concatenate([pose, q], axis=1)
    rates = rng.normal(size=(count, tree.nv))
    return q, rates / np.linalg.norm(rates, axis=1, keepdims=True)


def _arms(structure: InertiaStructure, lower: Array, upper: Array, scale: Array, ancestors: list[list[int]]) -> Array:
    """Bound on |V_i|^2 over unit scaled rates for every body: each joint turns it with a lever no longer than the links between."""
    tree, first = structure.tree, int(structure.tree.floating)
    length = np.linalg.norm(tree.translation, axis=1)
    for i in range(first, tree.nb):
        if tree.prismatic[i]:
            length[i] += max(abs(lower[i - first]), abs(upper[i - first]))
    out = np.zeros(tree.nb)
    for i in range(tree.nb):
        lever = 0.0
        for k in reversed([*ancestors[i], i]):
            if tree.floating and k == 0:
                out[i] += float(np.max(scale[:6]) ** 2) * (6.0 + 3.0 * lever**2)
            else:
                out[i] += float(scale[k + 5 * first] ** 2) * (1.0 if tree.prismatic[k] else 1.0 + lever**2)
            lever += float(length[k])
    return out
