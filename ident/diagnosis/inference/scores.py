"""Scores of all candidates at once, by Gram algebra: correlation of the residual with columns of the instrument, on one z scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.singular_values import pinv
from ..thresholds import ABSORBED, LEVEL, MATERIAL, STRETCH

if TYPE_CHECKING:
    from ..design.catalogue import Catalogue, Group
    from ..scoring.fit import Fit, Solved

Array = np.ndarray
#: Seconds of a block, within which scores may depend on each other.
BLOCK = 1.0
#: Share of the largest eigenvalue below which a direction of a group's parameters is free, and part that a parameter has in it then.
_FLAT, _SHARED = 1e-8, 1e-3


def z_of(squares: Array, degrees: Array) -> Array:
    """Sums of squares (K, …) of `degrees` (K,) standard normal scores, as the normal deviate of the same probability (two-sided)."""
    from scipy.special import gammaln
    from scipy.stats import chi2, norm

    d = np.broadcast_to(degrees.reshape(-1, *[1] * (squares.ndim - 1)), squares.shape)
    log_p = np.asarray(chi2.logsf(np.minimum(squares, 1000.0), d))
    big = squares > 600.0
    if big.any():
        half = squares[big] / 2.0
        log_p[big] = -half + (d[big] / 2.0 - 1.0) * np.log(half) - gammaln(d[big] / 2.0)
    z = np.empty_like(squares)
    z[~big] = norm.isf(np.exp(log_p[~big]) / 2.0)
    z[big] = np.sqrt(np.maximum(-2.0 * log_p[big] - np.log(2.0 * np.pi * -2.0 * log_p[big]), 0.0))
    return z


def least_squares_left(blocks: Array, starts: Array, stretch: float = STRETCH) -> Array:
    """The least sums of squares (K, …) of scores by blocks (c, B, …) when any window of a share of the blocks is left out."""
    B = blocks.shape[1]
    total = blocks.sum(axis=1)
    if stretch <= 0.0:
        return np.asarray(np.add.reduceat(total**2, starts))
    width = max(round(stretch * B), 1)
    sums = np.concatenate([np.zeros_like(blocks[:, :1]), np.cumsum(blocks, axis=1)], axis=1)
    least = np.add.reduceat(total**2, starts)
    for b in range(B - width + 1):
        least = np.minimum(least, np.add.reduceat((total - (sums[:, b + width] - sums[:, b])) ** 2, starts))
    return np.asarray(least)


@dataclass(eq=False)
class Scores:
    """Scores of a frame. K groups that the model does not absorb (`kept`), with c whitened directions in all.

    `blocks` (c, B): score of each block of time; `gram` (c, c): their covariance; `starts` (K,), `degrees` (K,): directions of each group;
    `parts`: groups that act on one motor, motor by motor, then those that act on several; `row_scores(columns)` (R, k): what each row adds
    to the raw scores of some columns; `stretch`: share of the log that may not decide alone; `material`: z of what is not material."""

    groups: list[Group]
    kept: list[int]
    blocks: Array = field(repr=False)
    gram: Array = field(repr=False)
    starts: Array = field(repr=False)
    degrees: Array = field(repr=False)
    raw_scores: Array = field(repr=False)
    raw_gram: Array = field(repr=False)
    parts: list[Array] = field(repr=False)
    row_scores: Callable[[Array], Array] = field(repr=False)
    stretch: float = STRETCH
    material: float = 0.0

    @classmethod
    def of(cls, fit: Fit, frame: Solved, catalogue: Catalogue, stretch: float = STRETCH) -> Scores:
        """Score a catalogue beside a frame's model."""
        R, n, p = frame.Z.shape
        scaled = frame.Z / frame.scale
        inverse = frame.inverse.reshape(p, R, n)
        cuts = blocks(fit, frame)
        count = catalogue.count
        G, A, CZ, S = np.zeros((count, count)), np.zeros((p, count)), np.zeros((count, p)), np.zeros((count, len(cuts)))
        for m in range(n):
            ids = catalogue.places[m]
            if not len(ids) or not any(gain[m].any() for gain in frame.gains):
                continue
            C = fit.filtered(catalogue.rows[m], frame.gains, m)
            G[np.ix_(ids, ids)] += C.T @ C
            A[:, ids] += inverse[:, :, m] @ C
            CZ[ids] += C.T @ scaled[:, m]
            S[ids] += np.add.reduceat(C * frame.residual[:, [m]], cuts, axis=0).T
        model = np.add.reduceat(np.einsum("rnp,rn->rp", scaled, frame.residual), cuts, axis=0) + frame.prior / len(cuts)
        raw = np.diag(G).copy()
        T = CZ @ A
        G = G - T - T.T + A.T @ (frame.gram @ A)
        S = S - (model @ A).T
        found = cls._orthonormal(catalogue, raw, G, S, partial(_row_scores, fit, frame, catalogue), stretch)
        return replace(found, material=material_z(fit, frame))

    @classmethod
    def _orthonormal(
        cls, catalogue: Catalogue, raw: Array, G: Array, S: Array, row_scores: Callable[[Array], Array], stretch: float
    ) -> Scores:
        """Orthonormal directions inside each group; what the model absorbs is dropped."""
        import scipy.sparse as sparse

        groups = catalogue.groups
        kept, starts, degrees, entries, rows, columns = [], [], [], [], [], []
        total = 0
        for k, g in enumerate(groups):
            ix = g.columns
            size = np.sqrt(np.maximum(raw[ix], 1e-300))
            if not raw[ix].max(initial=0.0) > 0:
                continue
            own = G[np.ix_(ix, ix)] / np.outer(size, size)
            w, U = np.linalg.eigh((own + own.T) / 2.0)
            good = w > ABSORBED
            if not good.any():
                continue
            B = (U[:, good] / np.sqrt(w[good])).T / size
            kept.append(k)
            starts.append(total)
            degrees.append(len(B))
            for r, row in enumerate(B):
                entries += row.tolist()
                rows += [total + r] * len(ix)
                columns += ix.tolist()
            total += len(B)
        Q = sparse.csr_matrix((entries, (rows, columns)), shape=(total, len(raw)))
        gram = np.asarray(Q @ (Q @ G).T)
        parts = _by_motor(catalogue, kept)
        return cls(groups, kept, Q @ S, gram, np.array(starts, int), np.array(degrees, int), S.sum(axis=1), G, parts, row_scores, stretch)

    @cached_property
    def named(self) -> Array:
        """Which of the K groups are effects of the catalogue."""
        return np.array([self.groups[k].named for k in self.kept], bool)

    @cached_property
    def total(self) -> Array:
        return np.asarray(self.blocks.sum(axis=1))

    def group(self, k: int) -> Group:
        """The k-th of the groups that are not absorbed."""
        return self.groups[self.kept[k]]

    def slice_of(self, k: int) -> Array:
        """Directions of the k-th group."""
        return np.arange(self.starts[k], self.starts[k] + self.degrees[k])

    @cached_property
    def plain(self) -> Array:
        """z (K,) of the whole log."""
        return z_of(np.add.reduceat(self.total**2, self.starts), self.degrees)

    @cached_property
    def z(self) -> Array:
        """z (K,), the least over all windows of a tenth of the log (`stretch`) that are left out: no single one decides. Where one may, a
        score counts for no more than its own rows bear out: they speak against chance, not for a size."""
        if self.stretch > 0.0:
            return z_of(least_squares_left(self.blocks, self.starts, self.stretch), self.degrees)
        return np.asarray(np.minimum(self.plain, self.self_normalised + self.material))

    @cached_property
    def self_normalised(self) -> Array:
        """z (K,) of scores over the size of their own rows' parts, of those that one test alone would see; infinite for others.

        Noise that is loud for a moment makes no such score large, however loud: what follows a column over many rows does. Its tails are no
        heavier than the normal ones for any noise that is symmetric from row to row.

        B. Efron, "Student's t-test under symmetry conditions", Journal of the American Statistical Association 64, 1969."""
        from scipy.stats import norm

        found = np.full(len(self.kept), np.inf)
        heard = np.flatnonzero(self.plain > norm.isf(LEVEL / 2.0)).tolist()
        if not heard:
            return found
        columns = [self.group(k).columns for k in heard]
        ends = np.cumsum([len(x) for x in columns])[:-1]
        for k, parts in zip(heard, np.split(self.row_scores(np.concatenate(columns)), ends, axis=1), strict=True):
            size = np.sqrt(np.maximum(np.sum(parts**2, axis=0), 1e-300))
            parts = parts / size
            s = parts.sum(axis=0)
            found[k] = z_of(np.array([s @ pinv(parts.T @ parts, rcond=_FLAT) @ s]), self.degrees[[k]])[0]
        return found

    def values(self, k: int) -> tuple[Array, Array]:
        """What the parameters of the k-th group would be, and their standard deviations, in the units of its columns; of parameters that
        the model absorbs, or that never act, the deviation is infinite."""
        ix = self.group(k).columns
        gram = self.raw_gram[np.ix_(ix, ix)]
        size = np.sqrt(np.maximum(np.diag(gram), 0.0))
        size = np.where(size > 0, size, 1.0)
        w, U = np.linalg.eigh(gram / np.outer(size, size))
        good = w > max(float(w[-1]), 1e-300) * _FLAT
        inverse = (U[:, good] / w[good]) @ U[:, good].T / np.outer(size, size)
        free = (U[:, ~good] ** 2).sum(axis=1) > _SHARED
        return inverse @ self.raw_scores[ix], np.where(free, np.inf, np.sqrt(np.maximum(np.diag(inverse), 0.0)))

    def alike(self, k: int, other: int) -> float:
        """Part of the directions of two groups that they have in common."""
        shared = self.gram[np.ix_(self.slice_of(k), self.slice_of(other))]
        return float(np.sum(shared**2) / max(self.degrees[k], self.degrees[other]))

    def beside(self, directions: Array) -> tuple[Array, Array]:
        """z (K,) of all groups after those directions have joined the model; and the share of each group's least direction that is left."""
        g = self.gram[:, directions]
        inner = pinv(self.gram[np.ix_(directions, directions)], rcond=1e-8)
        left = self.total - g @ (inner @ self.total[directions])
        h = g @ inner
        energy = 1.0 - np.einsum("ij,ij->i", h, g)
        squares = np.zeros(len(self.degrees))
        for d in np.unique(self.degrees):
            k = np.flatnonzero(self.degrees == d)
            ii = self.starts[k][:, None] + np.arange(d)
            r = left[ii]
            if d == 1:
                e = energy[ii[:, 0]]
                squares[k] = np.where(e > 1e-3, r[:, 0] ** 2 / np.maximum(e, 1e-3), 0.0)
            else:
                own = np.stack([self.gram[np.ix_(i, i)] for i in ii]) - np.einsum("kab,kcb->kac", h[ii], g[ii])
                w, U = np.linalg.eigh((own + np.swapaxes(own, 1, 2)) / 2.0)
                along = np.einsum("kab,ka->kb", U, r)
                squares[k] = np.where(w > 1e-3, along**2 / np.maximum(w, 1e-3), 0.0).sum(axis=1)
        return z_of(squares, self.degrees), np.minimum.reduceat(energy, self.starts)


def material_z(fit: Fit, frame: Solved) -> float:
    """z of the largest effect that is not material, over the rows in use."""
    share = fit.share
    used = float(share[share > 0].mean()) if (share > 0).any() else 1.0
    return MATERIAL * float(np.sqrt(frame.rows * used))


def _row_scores(fit: Fit, frame: Solved, catalogue: Catalogue, columns: Array) -> Array:
    """What each row (R, k) adds to the scores of some columns of a catalogue, beside a frame's model (its prior apart)."""
    R, n, p = frame.Z.shape
    inverse = frame.inverse.reshape(p, R, n)
    absorbed, found = np.zeros((p, len(columns))), np.zeros((R, len(columns)))
    for m in range(n):
        here, at, own = np.intersect1d(catalogue.places[m], columns, return_indices=True)
        if len(here) and frame.gains[0][m].any():
            x = fit.filtered([rows[:, at] for rows in catalogue.rows[m]], frame.gains, m)
            found[:, own] += x * frame.residual[:, [m]]
            absorbed[:, own] += inverse[:, :, m] @ x
    model = np.einsum("rnp,rn->rp", frame.Z / frame.scale, frame.residual)
    return np.asarray(found - model @ absorbed)


def _by_motor(catalogue: Catalogue, kept: list[int]) -> list[Array]:
    """Places (among the kept groups) of those that act on one motor, motor by motor, and of those that act on several."""
    acts = np.zeros((len(catalogue.places), catalogue.count), bool)
    for m, ids in enumerate(catalogue.places):
        acts[m, ids] = True
    of_group = [acts[:, catalogue.groups[k].columns].any(axis=1) for k in kept]
    alone = np.array([int(np.argmax(x)) if x.sum() == 1 else -1 for x in of_group], int)
    found = [np.flatnonzero(alone == m) for m in range(-1, len(catalogue.places))]
    return [x for x in found if len(x)]


def blocks(fit: Fit, frame: Solved) -> Array:
    """Where blocks of rows start; none reaches over the end of a run."""
    found: list[int] = []
    for run, a, b in zip(fit.runs, frame.edges[:-1], frame.edges[1:], strict=True):
        length = max(1, round(BLOCK * run.band.row_rate))
        starts = np.arange(a, b, length)
        found += starts[:-1].tolist() if len(starts) > 1 and b - starts[-1] < length // 2 else starts.tolist()
    return np.array(found, int)
