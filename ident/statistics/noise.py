"""The noise of the residual: its colour per joint, and the covariance of an estimate under it.

Least squares with coloured noise stays consistent, but its covariance is A⁻¹ (Φᵀ W Γ W Φ) A⁻¹, not A⁻¹. Γ is modelled per joint
as autoregressive (order by information criterion), joints correlated through their innovations. Rows left out contribute
nothing (their columns are zero), so gaps and masks are exact."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from .._utils.short_repr import ShortRepr
from ..regressor.kernel_choice import kernel
from ..signals.rows import KeptRows, Rows
from .autoregression import (
    autocovariance,
    burg,
    by_autocovariance,
    filtered,
    in_line,
    levinson,
    within,
)

Array = np.ndarray
#: Numbers of a run's columns that are held at a time.
HELD_NUMBERS = 30_000_000


@dataclass(frozen=True, eq=False, repr=False)
class NoiseModel(ShortRepr):
    """Autoregressive noise of n measured rows.

    `ar` (n, p+1): coefficients a with a_0 = 1, e_t + a_1 e_{t-1} + … = innovation; `innovation` (n, n): covariance of the
    innovations across joints; `variance` (n,): variance of the residual itself (torque unit squared);
    `correlation_time` (n,): rows after which the noise is as good as new (integrated autocorrelation, ≥ 1)."""

    ar: Array
    innovation: Array
    variance: Array
    correlation_time: Array

    @property
    def order(self) -> int:
        return self.ar.shape[1] - 1


def fit_noise(residual: Array, runs: Iterable[slice], shape: Array | None = None, max_order: int = 40) -> NoiseModel:
    """Fit an autoregressive model to residuals (M, n); NaN marks rows left out; `runs` are contiguous rows.

    `shape`: autocorrelation that the rows have by the filter they went through (`row_shape`), even where the torque noise is
    white: it is built in, and only what goes beyond it is fitted. By Burg's method where most rows have their past, else
    by autocovariances over the pairs that are present."""
    runs = list(runs)
    n = residual.shape[1]
    longest = max((r.stop - r.start for r in runs), default=1)
    known = np.ones(1) if shape is None else levinson(shape)
    lags = max(1, min(max_order, longest // 8, int(1.3 * np.isfinite(residual).sum(axis=0).max(initial=1) ** (1 / 3))))
    polynomials, times, variance, level = [], [], np.empty(n), np.zeros(n)
    for j in range(n):
        e = residual[:, j]
        present = np.isfinite(e)
        variance[j] = float(np.mean(e[present] ** 2)) if present.any() else 0.0
        if variance[j] <= 0 or np.count_nonzero(present) < 8:
            polynomials.append(np.ones(1))
            times.append(1.0)
            level[j] = variance[j]
            continue
        a, level[j] = _autoregression(e, runs, known, lags)
        polynomials.append(a)
        times.append(max(1.0, _integrated_time(a)))
    p = max(len(a) for a in polynomials) - 1
    ar = np.zeros((n, p + 1))
    for j, a in enumerate(polynomials):
        ar[j, : len(a)] = a
    return NoiseModel(ar, _innovation_covariance(residual, runs, ar, level), variance, np.array(times))


def _autoregression(e: Array, runs: list[slice], known: Array, lags: int) -> tuple[Array, float]:
    """Polynomial and innovation variance of one joint's residual (M,); `known`: the part that is built in."""
    line = in_line(e, runs)
    whitened = line if len(known) == 1 else filtered(line, known)
    # The past of a row at every order that is tried.
    past = ~within(~np.isfinite(whitened), lags)
    past[:lags] = False
    if 2 * np.count_nonzero(past) >= np.count_nonzero(np.isfinite(line)):
        found = burg(whitened, lags)
        if found is not None:
            return np.convolve(known, found.polynomial), found.innovation
    gamma, count = autocovariance(e, runs, lags + len(known) - 1)
    a = np.convolve(known, by_autocovariance(_whitened(gamma, known), count)) if count >= 8 else known
    return a, float(gamma[0]) / _shaping_gain(a)


def row_shape(taps: Array, factor: int, lags: int = 8) -> Array:
    """Autocorrelation (lags+1,) of rows whose samples, white before, went through an FIR filter and were decimated."""
    full = np.correlate(taps, taps, mode="full")[len(taps) - 1 :]
    kept = full[::factor][: lags + 1]
    # A trace of white noise keeps the recursion well-conditioned where the filter stops almost everything.
    return np.r_[kept[0] * (1 + 1e-3), kept[1:]] / kept[0]


def _whitened(gamma: Array, a: Array) -> Array:
    """Autocovariance of a process after the filter A, from its own at len(a) − 1 more lags."""
    both = np.correlate(a, a, mode="full")
    symmetric = np.r_[gamma[:0:-1], gamma]
    middle = len(gamma) - 1
    reach = len(a) - 1
    return np.array([both @ symmetric[middle + lag - reach : middle + lag + reach + 1] for lag in range(len(gamma) - reach)])


def _impulse_response(a: Array) -> Array:
    """Response of 1/A to a unit innovation, long enough for any stable process met here."""
    impulse = np.zeros((4000, 1))
    impulse[0] = 1.0
    return kernel().series.recursion(a, impulse, np.zeros((len(a) - 1, 1)))[len(a) - 1 :, 0]


def _shaping_gain(a: Array) -> float:
    """Variance of an autoregressive process for innovations of variance one."""
    return float(np.sum(_impulse_response(a) ** 2))


def _integrated_time(a: Array) -> float:
    """Sum of the autocorrelation over all lags of an autoregressive process: spectrum at zero over variance."""
    h = _impulse_response(a)
    return float(h.sum() ** 2 / np.sum(h**2))


def _innovation_covariance(residual: Array, runs: list[slice], ar: Array, level: Array) -> Array:
    """Covariance of the innovations: `level` (n,) on the diagonal, correlations from the instants where two joints have one.

    Where masks leave too few such instants, a correlation counts as zero rather than as chance has it."""
    n = ar.shape[0]
    total, count = np.zeros((n, n)), np.zeros((n, n))
    for run in runs:
        innovation = innovations(residual[run], ar)
        present = np.isfinite(innovation)
        filled = np.where(present, innovation, 0.0)
        total += filled.T @ filled
        count += present.T.astype(float) @ present
    spread = np.sqrt(np.divide(np.diag(total), np.diag(count), out=np.ones(n), where=np.diag(count) > 0))
    correlation = np.divide(
        total, count * np.outer(spread, spread), out=np.zeros_like(total), where=(count > 0) & np.outer(spread, spread).astype(bool)
    )
    # Within two standard errors of zero there is nothing to believe; beyond ±0.99 gaps have made it up.
    correlation = np.where(np.abs(correlation) > 2 / np.sqrt(np.maximum(count, 4.0)), np.clip(correlation, -0.99, 0.99), 0.0)
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    positive = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    own = np.sqrt(level / np.diag(positive))
    return positive * np.outer(own, own)


def noise_gram(noise: NoiseModel, rows: Iterable[Rows], weights: Array, residual: Array | None = None) -> Array:
    """Φᵀ W Γ W Φ (b, b): columns filtered by the noise's own shaping filter, run by run.

    With `residual` (M, n) the innovations' own squares stand for their variance, so that noise which is larger in some
    parts of the motion (reversals, quick motion) counts where it is (White, 1980, on prewhitened rows). Runs too long to
    be held, and innovations whose past is masked, take the stationary variance."""
    if isinstance(rows, KeptRows) and residual is not None:
        return _gram_by_blocks(noise, rows, weights, residual)
    n = noise.ar.shape[0]
    root = _root(noise.innovation)
    gram: Array | None = None
    for run in _whole_runs(rows):
        b = run[0].columns.shape[2]
        if gram is None:
            gram = np.zeros((b, b))
        state = np.zeros((n, noise.order, b))
        if residual is None or sum(block.columns.size for block in run) > HELD_NUMBERS:
            for block in run:
                shaped, state = _shaped(noise, np.where(block.valid[:, :, None], block.columns, 0.0) * weights[:, None], state)
                mixed = _mixed(root, shaped)
                gram += mixed.T @ mixed
            continue
        weighted = np.concatenate([np.where(block.valid[:, :, None], block.columns, 0.0) for block in run]) * weights[:, None]
        # e = B u with B lower triangular, hence Φᵀ e = (Bᵀ Φ)ᵀ u: the columns are filtered backwards in time.
        shaped = _shaped(noise, weighted[::-1], state)[0][::-1]
        innovation = innovations(residual[run[0].place.start : run[-1].place.stop], noise.ar)
        known = np.all(np.isfinite(innovation), axis=1)
        score = np.einsum("mnk,mn->mk", shaped[known], innovation[known])
        mixed = _mixed(root, shaped[~known])
        gram += score.T @ score + mixed.T @ mixed
    return np.zeros((0, 0)) if gram is None else gram


def _gram_by_blocks(noise: NoiseModel, rows: KeptRows, weights: Array, residual: Array) -> Array:
    """`noise_gram` with one block of rows in memory at a time, by the same rules."""
    root, n, b = _root(noise.innovation), noise.ar.shape[0], rows.count
    gram = np.zeros((b, b))
    for number, run in enumerate(rows.row_runs):
        stationary = (run.stop - run.start) * n * b > HELD_NUMBERS
        innovation = innovations(residual[run], noise.ar)
        state = np.zeros((n, noise.order, b))
        # Backwards in time where the innovations stand for themselves, for the reason given above.
        order = 1 if stationary else -1
        for block in rows.of_run(number, backwards=not stationary):
            weighted = np.where(block.valid[:, :, None], block.columns, 0.0) * weights[:, None]
            shaped, state = _shaped(noise, weighted[::order], state)
            shaped = shaped[::order]
            own = innovation[block.place.start - run.start : block.place.stop - run.start]
            known = np.zeros(len(own), bool) if stationary else np.all(np.isfinite(own), axis=1)
            score = np.einsum("mnk,mn->mk", shaped[known], own[known])
            mixed = _mixed(root, shaped[~known])
            gram += score.T @ score + mixed.T @ mixed
    return gram


def _mixed(root: Array, shaped: Array) -> Array:
    """Rows (m n, b) of shaped columns (m, n, b) with the joints mixed by a root (n, n) of their covariance."""
    m, n, b = shaped.shape
    return np.einsum("ij,mik->mjk", root, shaped).reshape(m * n, b)


def _whole_runs(rows: Iterable[Rows]) -> Iterator[list[Rows]]:
    """Blocks of rows, run by run; a run that is too long to be held comes in pieces."""
    held: list[Rows] = []
    for block in rows:
        if held and (block.run != held[0].run or sum(x.columns.size for x in held) > 4 * HELD_NUMBERS):
            yield held
            held = []
        held.append(block)
    if held:
        yield held


def _shaped(noise: NoiseModel, columns: Array, state: Array) -> tuple[Array, Array]:
    """Columns (m, n, b) through the shaping filter 1/A of each row, and the last of them, (n, p, b), from which the filter goes on."""
    out, after, p = columns.copy(), state.copy(), noise.order
    if p:
        for j in range(columns.shape[1]):
            whole = kernel().series.recursion(noise.ar[j], columns[:, j], state[j])
            out[:, j], after[j] = whole[p:], whole[len(whole) - p :]
    return out, after


def innovations(e: Array, ar: Array) -> Array:
    """Innovations (m, n) of a residual (m, n); NaN where the residual or its past is absent."""
    out = np.full(e.shape, np.nan)
    p = ar.shape[1] - 1
    if len(e) <= p:
        return out
    absent = ~np.isfinite(e)
    filled = np.where(absent, 0.0, e)
    for j, a in enumerate(ar):
        a = a[: int(np.flatnonzero(a)[-1]) + 1]
        # A coefficient of zero must not call for a sample that may be absent.
        reached = within(absent[:, j], len(a) - 1) if a.all() else np.convolve(absent[:, j], (a != 0).astype(float)) > 0.5
        missing = reached[p : len(e)] if absent[:, j].any() else False
        out[p:, j] = np.where(missing, np.nan, np.convolve(filled[:, j], a, mode="full")[p : len(e)])
    return out


def _root(covariance: Array) -> Array:
    """C with C Cᵀ = covariance (positive semidefinite)."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))
