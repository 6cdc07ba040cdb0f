"""Saturating a model: columns added one after the other, greedily, while they foretell what they were not fitted to.

Hundreds of blocks of columns are looked at in every step. Most act on one joint, but once the model's own columns are taken out of
them they are something on every row. So they are kept as q = z − Q a: z what they are by themselves, on few joints, Q the model's
orthonormal columns, the same for all of them. What each would gain follows from cross-products with z alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .frame import Frame, acting_on

Array = np.ndarray
#: Columns are added while the best ones gain more than this per column (a χ² that chance over the whole catalogue seldom
#: reaches), on all blocks and, halved, on blocks held out.
_LEAST = 30.0
_PER_COLUMN = 2.0
#: At most this share of the rows goes into saturating columns, and so many steps.
_SHARE = 0.12
_STEPS = 40
#: Columns that gain less than this share of what is asked for in one round are not looked at in the next.
_HOPELESS = 0.3
#: Directions of a block that the model leaves less of than this (squared, of unit length) are the model's.
_NEW = 1e-6


@dataclass(frozen=True, eq=False)
class Saturated:
    """`residual` (n, M): whitened, with everything taken up; `chosen`: blocks (M, n, k) that were added; `used` (n,): columns on each
    joint's rows; `others`: blocks that gained anything worth a look at any time."""

    residual: Array
    chosen: list[Array]
    used: Array
    others: list[Array]


def saturated(frame: Frame, blocks: list[Array]) -> Saturated:
    """The frame's model with the blocks (M, n, k) that gain most added one after the other."""
    n, M, b = frame.columns.shape
    rows = frame.problem.signals.valid.sum(axis=0)
    Q, _ = np.linalg.qr(frame.columns.reshape(-1, b))
    pool = Pool.of(frame, blocks, Q.reshape(n, M, b))
    folds = [
        np.concatenate([np.arange(r.start, r.stop) for r, f in zip(frame.block_rows, frame.folds, strict=True) if f == k])
        for k in range(frame.n_folds)
    ]
    r = frame.residual.reshape(-1).copy()
    kept, chosen, used = list[Array](), list[Array](), np.zeros(n)
    most, looked, taken = np.zeros(len(blocks)), np.ones(len(blocks), bool), set[int]()
    for _ in range(_STEPS):
        scale = _spread(r.reshape(n, M), rows)
        gains = np.where(looked, pool.gains(r.reshape(n, M), scale), 0.0)
        np.maximum(most, gains, out=most)
        if not gains.max(initial=0.0) >= _LEAST:
            break
        i = int(np.argmax(gains))
        looked[i] = False
        q = pool.columns(i)
        for other in kept:
            q = q - other @ (other.T @ q)
        q = _basis(q / np.maximum(np.linalg.norm(q, axis=0), 1e-300))
        if not q.shape[1] or _gain(q, r, scale, M) - _PER_COLUMN * q.shape[1] < _LEAST:
            continue
        weight = np.sum(q.reshape(n, M, -1) ** 2, axis=(1, 2))
        if np.any(used + weight > _SHARE * np.maximum(rows, 1)) or _foretold(q, r, folds, scale, M) < 0.5 * _LEAST:
            continue
        used += weight
        r = r - q @ (q.T @ r)
        kept.append(q)
        chosen.append(blocks[i])
        taken.add(i)
    others = [blocks[i] for i in np.flatnonzero(most > _HOPELESS * _LEAST) if i not in taken]
    return Saturated(r.reshape(n, M), chosen, used, others)


@dataclass(frozen=True, eq=False)
class Pool:
    """Orthonormal blocks q = z − Q a beside a model's orthonormal columns `model` (n, M, b). Columns of all blocks stand side by side, K
    in all: `part`: those of each block; `own`: for each joint its rows of z (M, K_j) and which columns they are; `along` (b, K): a;
    `squares`: for each number k of columns the blocks (c,) that have so many, their columns (c, k) and their cross-products on each
    joint's rows, (c, n, k, k)."""

    model: Array
    part: tuple[slice, ...]
    own: tuple[tuple[Array, Array], ...]
    along: Array
    squares: tuple[tuple[Array, Array, Array], ...]

    @classmethod
    def of(cls, frame: Frame, blocks: Sequence[Array], model: Array) -> Pool:
        n, _, b = model.shape
        valid = frame.problem.signals.valid
        joints = [acting_on(block) for block in blocks]
        rows, mixed = list[Array](), list[Array]()
        for j in range(n):
            acting = [block[:, j] for block, own in zip(blocks, joints, strict=True) if j in own]
            z = np.concatenate(acting, axis=1) if acting else np.zeros((len(valid), 0))
            rows.append(frame.white(np.where(valid[:, j, None], z, 0.0), j))
            mixed.append(model[j].T @ rows[j])
        inner = np.matmul(model.transpose(0, 2, 1), model)
        part, along, at = list[slice](), list[Array](), [list[Array]() for _ in range(n)]
        squares: dict[int, list[tuple[int, slice, Array]]] = {}
        seen, start = [0] * n, 0
        for i, (block, own) in enumerate(zip(blocks, joints, strict=True)):
            k = block.shape[2]
            here = {j: slice(seen[j], seen[j] + k) for j in own}
            a, H = np.zeros((b, k)), np.zeros((n, k, k))
            for j, columns in here.items():
                seen[j] += k
                a += mixed[j][:, columns]
                H[j] = rows[j][:, columns].T @ rows[j][:, columns]
            T, H = _orthonormal(H, a, inner, {j: mixed[j][:, columns] for j, columns in here.items()})
            width = T.shape[1]
            part.append(slice(start, start + width))
            along.append(a @ T)
            for j, columns in here.items():
                # In place: the basis has no more columns than the block.
                rows[j][:, columns.start : columns.start + width] = rows[j][:, columns] @ T
                at[j].append(np.where(np.arange(k) < width, start + np.arange(k), -1))
            if width:
                squares.setdefault(width, []).append((i, part[-1], H))
            start += width
        places = [np.concatenate(own) if own else np.zeros(0, int) for own in at]
        return cls(
            model,
            tuple(part),
            tuple((z[:, place >= 0], place[place >= 0]) for z, place in zip(rows, places, strict=True)),
            np.concatenate(along, axis=1) if along else np.zeros((b, 0)),
            tuple(
                (
                    np.array([i for i, _, _ in every]),
                    np.array([np.arange(p.start, p.stop) for _, p, _ in every]),
                    np.stack([H for _, _, H in every]),
                )
                for every in squares.values()
            ),
        )

    def gains(self, r: Array, scale: Array) -> Array:
        """Fall of the loss by each block, less what its columns cost, (blocks,): in units of the variance that the residual r (n, M) has
        where they are, since what is gained on the rows of one joint may be lost on those of another."""
        inner = -np.einsum("jMb,jM->jb", self.model, r, optimize=True) @ self.along
        for j, (z, at) in enumerate(self.own):
            inner[j, at] += r[j] @ z
        fitted, weight = inner.sum(axis=0), 1.0 / scale**2
        linear = 2.0 * fitted * (weight @ inner)
        out = np.zeros(len(self.part))
        for blocks, columns, H in self.squares:
            c = fitted[columns]
            square = np.einsum("ck,cl,cjkl,j->c", c, c, H, weight, optimize=True)
            out[blocks] = linear[columns].sum(axis=1) - square - _PER_COLUMN * columns.shape[1]
        return out

    def columns(self, i: int) -> Array:
        """A block's orthonormal columns (n M, k)."""
        part = self.part[i]
        q = -(self.model @ self.along[:, part])
        for j, (z, at) in enumerate(self.own):
            first, last = np.searchsorted(at, (part.start, part.stop))
            if last > first:
                q[j] += z[:, first:last]
        return q.reshape(q.shape[0] * q.shape[1], q.shape[2])


def _orthonormal(own: Array, a: Array, inner: Array, mixed: dict[int, Array]) -> tuple[Array, Array]:
    """What makes a block's columns z orthonormal once the model's share Q a is out of them, (k, w), and their products on each joint's
    rows then, (n, w, w). `own` (n, k, k): zᵀz of each joint's rows, `inner` (n, b, b): QᵀQ, `mixed`: Qᵀz of the joints that z acts on."""
    size = np.sqrt(np.diagonal(own.sum(axis=0)))
    unit = 1.0 / np.where(size > 0.0, size, 1.0)
    H = own + a.T @ inner @ a
    for j, cross in mixed.items():
        both = a.T @ cross
        H[j] -= both + both.T
    H *= unit[:, None] * unit
    values, vectors = np.linalg.eigh(H.sum(axis=0))
    live = values > _NEW
    turn = vectors[:, live] / np.sqrt(values[live])
    return unit[:, None] * turn, turn.T @ H @ turn


def _spread(r: Array, rows: Array) -> Array:
    """Standard deviation (n,) of each joint's whitened residual (n, M)."""
    return np.sqrt(np.maximum(np.sum(r**2, axis=1) / np.maximum(rows, 1), 1e-300))


def _gain(q: Array, r: Array, scale: Array, M: int) -> float:
    """Fall of the loss by orthonormal columns q, each joint's in units of the variance that the residual has there."""
    fitted = (q @ (q.T @ r)).reshape(-1, M)
    return float(np.sum(np.sum(fitted * (2.0 * r.reshape(-1, M) - fitted), axis=1) / scale**2))


def _foretold(q: Array, r: Array, folds: list[Array], scale: Array, M: int) -> float:
    """Fall of the loss on each fold when the columns' coefficients come from the others."""
    n, k = len(r) // M, q.shape[1]
    z, y = q.reshape(n, M, k) / scale[:, None, None], r.reshape(n, M) / scale[:, None]
    G = np.stack([np.einsum("jmk,jml->kl", z[:, f], z[:, f]) for f in folds])
    c = np.stack([np.einsum("jmk,jm->k", z[:, f], y[:, f]) for f in folds])
    total = 0.0
    for i in range(len(folds)):
        others = np.arange(len(folds)) != i
        beta = np.linalg.lstsq(G[others].sum(axis=0), c[others].sum(axis=0), rcond=1e-10)[0]
        total += 2.0 * float(beta @ c[i]) - float(beta @ G[i] @ beta)
    return total


def _basis(Z: Array) -> Array:
    """Orthonormal basis of columns (rows, k) that were of unit length before what others have was taken out of them."""
    values, vectors = np.linalg.eigh(Z.T @ Z)
    keep = values > _NEW
    return np.asarray((Z @ vectors[:, keep]) / np.sqrt(values[keep]))
