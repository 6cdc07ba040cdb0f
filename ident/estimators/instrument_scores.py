"""Covariance of the sums Zᵀ e of weighted rows, for instruments of several lags, and of Φᵀ e, under the colour that the errors still have.

As `statistics.noise.noise_gram` has it, joint by joint: a column that a joint does not have costs nothing, and instruments of several
lags are one line of rows, seen with a delay."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..regressor.kernel_choice import kernel
from ..statistics.noise import HELD_NUMBERS, NoiseModel, fit_noise, innovations
from .moments import Lagged, WhiteRows

if TYPE_CHECKING:
    from .instrument_rows import InstrumentRows

Array = np.ndarray
#: Correlations of joints below this are round-off.
_UNCORRELATED = 1e-14


def score_covariance(rows: InstrumentRows, error: Array, lags: tuple[int, ...]) -> Array:
    """((k+1) b, (k+1) b) for k lags of instruments and, last, the columns; `error` (M, n): of the weighted rows, NaN if not used.

    The errors' own squares stand for their variance (`noise_gram`), but in runs too long to be held, and where their past is masked."""
    runs = rows.problem.row_runs
    noise = fit_noise(error, runs)
    scores = _Scores(noise, len(rows.columns), len(lags) + 1)
    for run, blocks in groupby(rows, key=lambda block: block.run):
        if (runs[run].stop - runs[run].start) * len(noise.ar) * scores.size > HELD_NUMBERS:
            scores.add_stationary(blocks, lags)
        else:
            scores.add_run(blocks, lags, innovations(error[runs[run]], noise.ar))
    return scores.gram


class _Scores:
    """Sums over runs; `size`: scores, `groups` times b."""

    def __init__(self, noise: NoiseModel, b: int, groups: int) -> None:
        self.noise, self.b, self.groups, self.size = noise, b, groups, groups * b
        self.gram = np.zeros((self.size, self.size))
        self._polynomials = [a[: int(np.flatnonzero(a)[-1]) + 1] for a in noise.ar]
        self._layout: _Layout | None = None

    def add_stationary(self, blocks: Iterable[WhiteRows], lags: tuple[int, ...]) -> None:
        """Blocks of one run, by the variance of the innovations."""
        before: list[Array] = []
        for laid in self._laid(blocks, lags):
            before = before or [np.zeros((len(a) - 1, x.shape[1])) for a, x in zip(self._polynomials, laid, strict=True)]
            shaped = []
            for j, (a, x) in enumerate(zip(self._polynomials, laid, strict=True)):
                whole = kernel().series.recursion(a, x, before[j])
                before[j] = whole[len(whole) - len(a) + 1 :].copy()
                shaped.append(whole[len(a) - 1 :])
            self._add_mixed(shaped)

    def add_run(self, blocks: Iterable[WhiteRows], lags: tuple[int, ...], innovation: Array) -> None:
        """A whole run with its innovations (m, n), which stand for their own variance where they are known.

        e = B u with B lower triangular, hence Zᵀ e = (Bᵀ Z)ᵀ u: the rows are filtered backwards in time."""
        known = np.all(np.isfinite(innovation), axis=1)
        laid = list(self._laid(blocks, lags))
        if self._layout is None or not laid:
            return
        score, rest = np.zeros((int(known.sum()), self.size)), []
        for j, a in enumerate(self._polynomials):
            backwards = np.concatenate([block[j][::-1] for block in reversed(laid)])
            for block in laid:
                block[j] = backwards[:0]  # a run of these is large: nothing is held twice
            shaped = kernel().series.recursion(a, backwards, np.zeros((len(a) - 1, backwards.shape[1])))[len(a) - 1 :][::-1]
            score[:, self._places(self._layout.columns[j])] += shaped[known] * innovation[known, j, None]
            rest.append(shaped[~known])
        self.gram += score.T @ score
        self._add_mixed(rest)

    def _laid(self, blocks: Iterable[WhiteRows], lags: tuple[int, ...]) -> Iterator[list[Array]]:
        """For each block, of each joint instruments of every lag and the columns, in the joint's layout: (m, groups w)."""
        earlier = [Lagged(lag) for lag in lags]
        for rows in blocks:
            if self._layout is None:
                self._layout = _Layout.of(rows.columns, self.b, self.noise.innovation)
            found = [lagged(rows) for lagged in earlier]
            yield [self._layout.laid(j, [*(f[j] for f in found), rows.others(j)[:, :-2]]) for j in range(len(rows.lines))]

    def _places(self, columns: Array) -> Array:
        return np.concatenate([columns + self.b * group for group in range(self.groups)])

    def _add_mixed(self, shaped: list[Array]) -> None:
        """Σ C_ij S_iᵀ S_j over joints i and j, with C the covariance of the innovations, as Σ M_jᵀ M_j of mixed rows M_j = Σ L_ij S_i."""
        assert self._layout is not None
        m = len(shaped[0])
        for columns, parts in self._layout.mixtures:
            mixed = np.zeros((m, self.groups, len(columns)))
            for weight, i in parts:
                own = shaped[i].reshape(m, self.groups, shaped[i].shape[1] // self.groups)
                mixed[:, :, len(columns) - own.shape[2] :] += weight * own
            flat, whole = mixed.reshape(m, self.groups * len(columns)), self._places(columns)
            self.gram[np.ix_(whole, whole)] += flat.T @ flat


@dataclass(frozen=True, eq=False)
class _Layout:
    """How the scores of each joint are laid out: over `columns[j]`, of which those of a joint with fewer are the last ones of a joint with
    more, so that joints are mixed without a search; `stretches[j]`: which of the joint's own columns go where in one piece.

    `mixtures`: for each mixed row its columns, and weight and number of the joints in it: L Lᵀ = C, the covariance of the innovations,
    with L lower triangular and the joints with the most columns first. So the mixed rows of the others have few columns too."""

    columns: tuple[Array, ...]
    stretches: tuple[tuple[tuple[slice, slice], ...], ...]
    mixtures: tuple[tuple[Array, tuple[tuple[float, int], ...]], ...]

    @classmethod
    def of(cls, columns: tuple[Array, ...], b: int, C: Array) -> _Layout:
        """From the columns of each joint, of b."""
        order = np.argsort([-len(c) for c in columns], kind="stable")
        last = np.full(b, -1)
        for rank, j in enumerate(order):
            last[columns[j]] = rank
        ranked = np.argsort(last, kind="stable")
        ranked = ranked[last[ranked] >= 0]
        laid = [ranked[0:0]] * len(columns)
        for rank, j in enumerate(order):
            laid[j] = ranked[int(np.searchsorted(last[ranked], rank)) :]
        stretches = []
        for mine, whole in zip(columns, laid, strict=True):
            place = np.empty(b, int)
            place[whole] = np.arange(len(whole))
            at = place[mine]
            edges = [0, *(np.flatnonzero(np.diff(at) != 1) + 1).tolist(), len(at)] if len(at) else []
            stretches.append(tuple((slice(f, e), slice(int(at[f]), int(at[f]) + e - f)) for f, e in pairwise(edges)))
        values, vectors = np.linalg.eigh(C[np.ix_(order, order)])
        upper = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T, mode="r")
        size = np.sqrt(np.maximum(np.diag(C), 0.0))[order]
        mixtures = []
        for k, row in enumerate(upper):
            parts = tuple((float(row[e]), int(order[e])) for e in range(k, len(order)) if abs(row[e]) > _UNCORRELATED * size[e])
            if parts:
                mixtures.append((laid[parts[0][1]], parts))
        return cls(tuple(laid), tuple(stretches), tuple(mixtures))

    def laid(self, j: int, groups: list[Array]) -> Array:
        """Groups of joint j's own columns (m, l), each in the joint's layout, one after the other."""
        out = np.zeros((len(groups[0]), len(groups), len(self.columns[j])))
        for g, values in enumerate(groups):
            for mine, place in self.stretches[j]:
                out[:, g, place] = values[:, mine]
        return out.reshape(len(out), len(groups) * len(self.columns[j]))
