"""Autoregressive models of a residual with gaps: what is predictable in it, and what is left as innovations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..regressor.kernel_choice import kernel

Array = np.ndarray
#: Orders without a better criterion after which the search ends.
_PATIENCE = 12
#: Rows from which an autoregression is fitted at most; of longer residuals, pieces spread evenly over them.
_ENOUGH = 400_000
_PIECES = 40


@dataclass(frozen=True, eq=False)
class Autoregression:
    """`polynomial` a (p+1,), a_0 = 1: e_t + a_1 e_{t-1} + … = innovation; `innovation`: its variance."""

    polynomial: Array
    innovation: float


def burg(x: Array, max_order: int) -> Autoregression | None:
    """Burg's method on samples (N,) with NaN in the gaps; the order with the least Bayesian criterion (`_better`).

    Only samples whose whole past is present enter (Burg 1975; de Waele & Broersen, IEEE Trans. Signal Processing 48(10), 2000,
    for segments). No window is implied, so a spectrum that falls by six decades, as that of differenced rounding does,
    keeps its floor; sample autocovariances over gaps bury it. Always stable. None where too few samples have a past."""
    known = x[np.isfinite(x)]
    variance = float(np.mean(known**2)) if len(known) else 0.0
    if variance <= 0.0:
        return None
    start, count = variance, len(known)
    a, best, score, waited = np.ones(1), Autoregression(np.ones(1), variance), count * np.log(variance), 0
    errors = kernel().series.lattice(x)
    for order in range(1, max_order + 1):
        if errors.count < max(8, 3 * order) or errors.squares <= 0.0:
            return None if order == 1 else best
        reflection = -2.0 * errors.products / errors.squares
        a = np.append(a, 0.0) + reflection * np.append(a, 0.0)[::-1]
        variance *= 1.0 - reflection**2
        if not variance > 1e-12 * start:
            break
        errors.reflect(reflection)
        now = count * np.log(variance) + order * np.log(count)
        waited += 1
        if now < score:
            best, score, waited = Autoregression(a, variance), now, 0
        if waited >= _PATIENCE:
            break
    return best


def by_autocovariance(gamma: Array, count: int) -> Array:
    """Polynomial by the Levinson-Durbin recursion from autocovariances at lags 0 …; the order with the least Bayesian criterion.

    Akaike's would follow the hollows that the fitted parameters leave in the residual's spectrum, and these lie just where
    the regressor does (measured: intervals 12 % too short)."""
    orders = _rising_orders(gamma)
    best, variance = next(orders)
    if variance <= 0.0 or count < 2:
        return best
    best_score = count * np.log(variance)
    for p, (a, variance) in enumerate(orders, 1):
        if not abs(a[-1]) < 1 or variance <= 1e-12 * gamma[0] or p + 2 >= count:
            break
        score = count * np.log(variance) + p * np.log(count)
        if score < best_score:
            best, best_score = a, score
    return best


def levinson(gamma: Array) -> Array:
    """Prediction-error polynomial of the highest order that the autocovariances (p+1,) allow."""
    *_, (a, _) = _rising_orders(gamma)
    return a


def _rising_orders(gamma: Array) -> Iterator[tuple[Array, float]]:
    """Polynomials of order 0, 1, …, each with the variance of its error, by the Levinson-Durbin recursion."""
    a, variance = np.ones(1), float(gamma[0])
    yield a, variance
    for p in range(1, len(gamma)):
        reflection = -(a @ gamma[p:0:-1]) / variance
        a = np.append(a, 0.0) + reflection * np.append(a, 0.0)[::-1]
        variance *= 1 - reflection**2
        yield a, variance


def lower_orders(polynomial: Array, innovation: float) -> list[tuple[Array, float]]:
    """Best predictors of order 0 … p of the process, each with the variance of its error, by the recursion downwards."""
    a, variance = np.asarray(polynomial, float), float(innovation)
    found = [(a, variance)]
    while len(a) > 1:
        reflection = a[-1]
        left = max(1.0 - reflection**2, 1e-12)
        a = (a[:-1] - reflection * a[:0:-1]) / left
        variance /= left
        found.append((a, variance))
    return found[::-1]


def rising(polynomial: Array, innovation: float, motion: Array, order: int = 40) -> Autoregression:
    """The noise as an instrument should weigh it: as strong as it is where the motion is, rising with frequency, never falling.

    `motion` (F,): power of the motion at F frequencies from zero to half the rate. Differenced positions are noisy where motion
    is quick, and weigh less there. A residual that is strong where motion is slow is as much the model's error as noise;
    weighting it down would move the estimate to frequencies that say little (EMPS: 7 % of the mass)."""
    grid = max(1024, len(motion) - 1)
    spectrum = innovation / np.maximum(np.abs(np.fft.rfft(polynomial, 2 * grid)) ** 2, 1e-300)
    place = np.linspace(0.0, 1.0, grid + 1)
    power = np.interp(place, np.linspace(0.0, 1.0, len(motion)), motion)
    total = np.cumsum(power)
    if not total[-1] > 0.0:
        power, total = np.ones(grid + 1), np.cumsum(np.ones(grid + 1))
    level = float(np.exp(power @ np.log(spectrum) / total[-1]))
    above = np.searchsorted(total, 0.5 * total[-1])
    wanted = np.empty(grid + 1)
    wanted[above:] = np.maximum(level, np.maximum.accumulate(spectrum[above:]))
    wanted[:above] = wanted[above]
    if wanted[-1] <= wanted[0]:
        return Autoregression(np.ones(1), float(wanted[0]))
    gamma = np.fft.irfft(wanted)[: order + 1]
    a = levinson(gamma)
    return Autoregression(a, float(a @ gamma))


def autocovariance(e: Array, runs: Iterable[slice], lags: int) -> tuple[Array, int]:
    """Autocovariance at lags 0 … `lags` over the pairs present (NaN = absent), and how many pairs there are at a typical lag."""
    total, pairs = np.zeros(lags + 1), np.zeros(lags + 1)
    for run in runs:
        x = e[run]
        present = np.isfinite(x)
        size = 1 << int(np.ceil(np.log2(max(2, 2 * len(x)))))
        for values, out in ((np.where(present, x, 0.0), total), (present.astype(float), pairs)):
            spectrum = np.fft.rfft(values, size)
            sums = np.fft.irfft(spectrum * np.conj(spectrum), size)[: lags + 1]
            out[: len(sums)] += sums
    return np.divide(total, pairs, out=np.zeros_like(total), where=pairs > 0.5), int(np.median(pairs))


def in_line(e: Array, runs: Iterable[slice]) -> Array:
    """The runs of e (M,) one after the other with NaN between them; of very many rows, pieces spread evenly."""
    runs = list(runs)
    total = sum(r.stop - r.start for r in runs)
    if total > _ENOUGH:
        share = _ENOUGH / total
        pieces = []
        for r in runs:
            edges = np.linspace(r.start, r.stop, max(1, round(_PIECES * (r.stop - r.start) / total)) + 1).astype(int).tolist()
            pieces += [slice(a, a + max(1, int(share * (b - a)))) for a, b in pairwise(edges)]
        runs = pieces
    gap = np.full(1, np.nan)
    return np.concatenate([part for r in runs for part in (e[r], gap)]) if runs else np.empty(0)


def within(here: Array, rows: int) -> Array:
    """Whether there is one (N,) among each row and the `rows` before it, those before the first left out; `here` (N,) bool."""
    count = np.cumsum(here)
    count[rows + 1 :] -= count[: max(len(here) - rows - 1, 0)].copy()
    return np.asarray(count > 0)


def filtered(x: Array, polynomial: Array) -> Array:
    """Innovations (N,) of samples (N,); NaN where the sample or its past is absent."""
    p = len(polynomial) - 1
    out = np.full(x.shape, np.nan)
    if len(x) > p:
        out[p:] = sum(polynomial[lag] * x[p - lag : len(x) - lag] for lag in range(p + 1))
    return out
