"""Scores of all candidates at once, by Gram algebra: correlation of the residual with columns of the instrument, on one z scale."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._utils.singular_values import pinv
from ..thresholds import ABSORBED, LEVEL, MATERIAL, STRETCH
from .constancy import Constancy, dry_levels

if TYPE_CHECKING:
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved
    from ..design.catalogue import Catalogue, Group

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
    """Scores of a catalogue of P columns beside a frame's model. K groups that the model does not absorb (`kept`), with c whitened
    directions in all.

    `blocks` (c, B): score of each block of time; `starts` (K,), `degrees` (K,): directions of each group; `directions` (c, P): sparse;
    `squares`: for each group of the catalogue the Gram matrix of its columns, without what the model absorbs; `raw_blocks` (P, B): scores
    of the columns, of which `blocks` lack what the log does not resolve;
    `absorbed` (P, p): the columns by the model's, along the instrument; `along` (P, p): products of the columns with the instrument's;
    `stretch`: share of the log that may not decide alone; `material`: z of what is not material;
    `constancy`: what friction that varies a little along the travel adds to the directions' scores."""

    fit: Fit = field(repr=False)
    frame: Solved = field(repr=False)
    catalogue: Catalogue = field(repr=False)
    kept: list[int]
    blocks: Array = field(repr=False)
    starts: Array = field(repr=False)
    degrees: Array = field(repr=False)
    directions: Any = field(repr=False)
    squares: list[Array] = field(repr=False)
    raw_blocks: Array = field(repr=False)
    absorbed: Array = field(repr=False)
    along: Array = field(repr=False)
    stretch: float = STRETCH
    material: float = 0.0
    constancy: Constancy | None = field(default=None, repr=False)

    @classmethod
    def of(cls, fit: Fit, frame: Solved, catalogue: Catalogue, stretch: float = STRETCH) -> Scores:
        """Score a catalogue beside a frame's model: orthonormal directions inside each group; what the model absorbs is dropped."""
        import scipy.sparse as sparse

        cuts, p, count = blocks(fit, frame), len(frame.theta), catalogue.count
        CX, CZ, S = np.zeros((count, p)), np.zeros((count, p)), np.zeros((count, len(cuts)))
        for m, ids, C in catalogue.whitened(fit, frame.gains):
            CX[ids] += C @ frame.X[:, m]
            CZ[ids] += C @ frame.Z[:, m]
            S[ids] += np.add.reduceat(C * frame.residual[:, m], cuts, axis=1)
        A, CZ = (CX / frame.scale) @ frame.solution.T, CZ / frame.scale
        S -= A @ (np.add.reduceat(frame.row_scores, cuts, axis=0) + frame.prior / len(cuts)).T
        squares: list[Array] = [np.zeros(0)] * len(catalogue.groups)
        entries = np.zeros((count, max(catalogue.of_width, default=0)))
        at, seen = np.full(entries.shape, -1), np.zeros(count, bool)
        for (width, (which, ix)), raw in zip(catalogue.of_width.items(), catalogue.raw_squares(fit, frame.gains), strict=True):
            T = CZ[ix] @ A[ix].swapaxes(1, 2)
            own = raw - T - T.swapaxes(1, 2) + A[ix] @ frame.gram @ A[ix].swapaxes(1, 2)
            power = np.diagonal(raw, axis1=1, axis2=2)
            size = np.sqrt(np.maximum(power, 1e-300))
            unit = own / (size[:, :, None] * size[:, None, :])
            w, U = np.linalg.eigh((unit + unit.swapaxes(1, 2)) / 2.0)
            good = (w > ABSORBED) & (power.max(axis=1) > 0)[:, None]
            entries[ix, :width] = (U / np.sqrt(np.where(good, w, 1.0))[:, None]).swapaxes(1, 2) / size[:, None]
            at[ix, :width], seen[ix] = ix[:, None], good
            for k, square in zip(which.tolist(), own, strict=True):
                squares[k] = square
        resolved = S - _unresolved(fit, catalogue, squares, S.sum(axis=1))[:, None] / len(cuts)
        degrees = np.array([seen[g.columns].sum() for g in catalogue.groups], int)
        inside = at[seen] >= 0
        ends = np.cumsum([0, *inside.sum(axis=1)])
        Q = sparse.csr_matrix((entries[seen][inside], at[seen][inside], ends), shape=(len(inside), count))
        kept = np.flatnonzero(degrees)
        degrees = degrees[kept]
        starts = np.cumsum([0, *degrees])[:-1]
        material = material_z(fit, frame)
        found = cls(fit, frame, catalogue, kept.tolist(), Q @ resolved, starts, degrees, Q, squares, S, A, CZ, stretch, material)
        return replace(found, constancy=found._constancy())

    def _constancy(self) -> Constancy | None:
        """What friction that varies a little along the travel adds to the directions' scores."""
        import scipy.sparse as sparse

        levels = np.repeat(dry_levels(self.fit), [len(x) for x in self.catalogue.waves]) if self.catalogue.waves else np.zeros(0)
        places = np.concatenate([np.zeros(0, int), *self.catalogue.waves])[levels > 0]
        if not len(places) or not len(self.kept):
            return None
        waves = sparse.csr_matrix((np.ones(len(places)), places, np.arange(len(places) + 1)), shape=(len(places), self.catalogue.count))
        return Constancy.of(self._products(self.directions, waves), levels[levels > 0], self.starts, self.degrees)

    @property
    def of_noise_alone(self) -> Scores:
        """The same scores in units of what noise alone makes of them."""
        return replace(self, constancy=None)

    def _tempered(self, scores: Array) -> Array:
        """Scores (c, …) of the directions over what noise and friction that is never quite constant make of them."""
        return scores if self.constancy is None else self.constancy.tempered(scores)

    def gram(self, left: Array, right: Array) -> Array:
        """Covariance of some directions (c,) with others (d,)."""
        return self._products(self.directions[left], self.directions[right])

    def _products(self, Q: Any, P: Any) -> Array:
        """Covariance of combinations (c, P) of the columns with others (d, P), both sparse."""
        rows, columns = np.unique(Q.indices), np.unique(P.indices)
        square = np.array_equal(rows, columns)
        G = np.zeros((len(rows), len(columns)))
        for _, ids, C in self.catalogue.whitened(self.fit, self.frame.gains):
            here, there = np.isin(rows, ids), np.isin(columns, ids)
            if there.any():
                own = C if here.sum() == len(ids) else C[np.isin(ids, rows)]
                # A covariance of its own must be positive: rounded to single precision the products of columns are not.
                own, other = (own.astype(float),) * 2 if square else (own, C[np.isin(ids, columns)])
                G[np.ix_(here, there)] += own @ other.T
        A, B = self.absorbed[rows], self.absorbed[columns]
        G += (A @ self.frame.gram - self.along[rows]) @ B.T - A @ self.along[columns].T
        return np.asarray(Q[:, rows] @ (P[:, columns] @ G.T).T)

    def of_blocks(self, which: Array) -> Array:
        """z (K,) of some blocks (B,) alone."""
        scores = self.raw_blocks[:, which].sum(axis=1)
        scores = self._tempered(self.directions @ (scores - _unresolved(self.fit, self.catalogue, self.squares, scores)))
        return z_of(np.add.reduceat(scores**2, self.starts), self.degrees) if len(self.kept) else np.zeros(0)

    @cached_property
    def raw_scores(self) -> Array:
        """Scores (P,) of the columns."""
        return np.asarray(self.raw_blocks.sum(axis=1))

    @cached_property
    def named(self) -> Array:
        """Which of the K groups are effects of the catalogue."""
        return np.array([self.group(k).named for k in range(len(self.kept))], bool)

    @cached_property
    def total(self) -> Array:
        return np.asarray(self.blocks.sum(axis=1))

    def group(self, k: int) -> Group:
        """The k-th of the groups that are not absorbed."""
        return self.catalogue.groups[self.kept[k]]

    def slice_of(self, k: int) -> Array:
        """Directions of the k-th group."""
        return np.arange(self.starts[k], self.starts[k] + self.degrees[k])

    @cached_property
    def plain(self) -> Array:
        """z (K,) of the whole log."""
        return z_of(np.add.reduceat(self._tempered(self.total) ** 2, self.starts), self.degrees)

    @cached_property
    def z(self) -> Array:
        """z (K,), the least over all windows of a tenth of the log (`stretch`) that are left out: no single one decides. Where one may, a
        score counts for no more than its own rows bear out."""
        if self.stretch > 0.0:
            return z_of(least_squares_left(self._tempered(self.blocks), self.starts, self.stretch), self.degrees)
        return np.asarray(np.minimum(self.plain, self.self_normalised))

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
        for k, parts in zip(heard, np.split(self._row_scores(np.concatenate(columns)), ends), strict=True):
            parts = parts / np.sqrt(np.maximum(np.sum(parts**2, axis=1), 1e-300))[:, None]
            s = parts.sum(axis=1)
            found[k] = z_of(np.array([s @ pinv(parts @ parts.T, rcond=_FLAT) @ s]), self.degrees[[k]])[0]
        return found

    def _row_scores(self, columns: Array) -> Array:
        """What each row adds to the raw scores of some columns (k, R), the prior apart."""
        found = -self.absorbed[columns] @ self.frame.row_scores.T
        for m, ids, C in self.catalogue.whitened(self.fit, self.frame.gains):
            _, at, own = np.intersect1d(ids, columns, return_indices=True)
            found[own] += C[at] * self.frame.residual[:, m]
        return np.asarray(found)

    @cached_property
    def parts(self) -> list[Array]:
        """Places of groups that act on several motors, and of those that act on one, motor by motor."""
        acts = np.zeros((len(self.catalogue.places), self.catalogue.count), bool)
        for m, ids in enumerate(self.catalogue.places):
            acts[m, ids] = True
        of_group = [acts[:, self.group(k).columns].any(axis=1) for k in range(len(self.kept))]
        alone = np.array([int(np.argmax(x)) if x.sum() == 1 else -1 for x in of_group], int)
        found = [np.flatnonzero(alone == m) for m in range(-1, len(self.catalogue.places))]
        return [x for x in found if len(x)]

    def values(self, k: int) -> tuple[Array, Array]:
        """What the parameters of the k-th group would be, and their standard deviations, in the units of its columns; of parameters that
        the model absorbs, or that never act, the deviation is infinite."""
        ix, gram = self.group(k).columns, self.squares[self.kept[k]]
        inverse, free = _inverse(gram)
        return inverse @ self.raw_scores[ix], np.where(free, np.inf, np.sqrt(np.maximum(np.diag(inverse), 0.0)))

    def alike(self, k: int, other: int) -> float:
        """Part of the directions of two groups that they have in common."""
        shared = self.gram(self.slice_of(k), self.slice_of(other))
        return float(np.sum(shared**2) / max(self.degrees[k], self.degrees[other]))

    def beside(self, directions: Array) -> tuple[Array, Array]:
        """z (K,) of all groups after those directions have joined the model; and the share of each group's least direction that is left."""
        g = self.gram(np.arange(len(self.total)), directions)
        inner = pinv(g[directions], rcond=1e-8)
        left = self.total - g @ (inner @ self.total[directions])
        h = g @ inner
        energy = 1.0 - np.einsum("ij,ij->i", h, g)
        squares, waves = np.zeros(len(self.degrees)), None if self.constancy is None else self.constancy.answers
        for d in np.unique(self.degrees):
            k = np.flatnonzero(self.degrees == d)
            ii = self.starts[k][:, None] + np.arange(d)
            r = left[ii]
            if d == 1:
                e = energy[ii[:, 0]]
                more = 0.0 if waves is None else np.sum(waves[ii[:, 0]] ** 2, axis=1)
                squares[k] = np.where(e > 1e-3, r[:, 0] ** 2 / (np.maximum(e, 1e-3) + more), 0.0)
            else:
                own = np.eye(d) - h[ii] @ g[ii].swapaxes(1, 2)
                w, U = np.linalg.eigh((own + np.swapaxes(own, 1, 2)) / 2.0)
                along = np.einsum("kab,ka->kb", U, r)
                more = 0.0 if waves is None else np.sum((U.swapaxes(1, 2) @ waves[ii]) ** 2, axis=2)
                squares[k] = np.where(w > 1e-3, along**2 / (np.maximum(w, 1e-3) + more), 0.0).sum(axis=1)
        return z_of(squares, self.degrees), np.minimum.reduceat(energy, self.starts)


def _inverse(gram: Array) -> tuple[Array, Array]:
    """Inverse (k, k) of the Gram matrix of a group's columns, and which of its parameters (k,) it leaves free."""
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size = np.where(size > 0, size, 1.0)
    w, U = np.linalg.eigh(gram / np.outer(size, size))
    good = w > max(float(w[-1]), 1e-300) * _FLAT
    inverse = (U[:, good] / w[good]) @ U[:, good].T / np.outer(size, size)
    return inverse, (U[:, ~good] ** 2).sum(axis=1) > _SHARED


def _unresolved(fit: Fit, catalogue: Catalogue, squares: list[Array], scores: Array) -> Array:
    """What of the columns' scores (P,) values explain that the log does not tell from none."""
    found, interval = np.zeros(len(scores)), max(run.interval for run in fit.runs)
    for group, gram in zip(catalogue.groups, squares, strict=True):
        least = 0.0 if group.effect is None else group.effect.unresolved(interval)
        if least > 0.0:
            values = _inverse(gram)[0] @ scores[group.columns]
            found[group.columns] = gram @ np.clip(values, -least, least)
    return found


def material_z(fit: Fit, frame: Solved) -> float:
    """z of the largest effect that is not material, over the rows in use."""
    share = fit.share
    used = float(share[share > 0].mean()) if (share > 0).any() else 1.0
    return MATERIAL * float(np.sqrt(frame.rows * used))


def blocks(fit: Fit, frame: Solved) -> Array:
    """Where blocks of rows start; none reaches over the end of a run."""
    found: list[int] = []
    for run, a, b in zip(fit.runs, frame.edges[:-1], frame.edges[1:], strict=True):
        length = max(1, round(BLOCK * run.band.row_rate))
        starts = np.arange(a, b, length)
        found += starts[:-1].tolist() if len(starts) > 1 and b - starts[-1] < length // 2 else starts.tolist()
    return np.array(found, int)
