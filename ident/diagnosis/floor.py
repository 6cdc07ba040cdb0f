"""The noise floor: what is left when everything that any candidate can take up is taken up.

The declared model's residual holds what it lacks, and would make that look like noise. So the model is first saturated,
greedily, with whatever candidates and generic shapes foretell of blocks that they were not fitted to; colour and level of what
is then left are the noise's. At first every row counts as independent, because structure that is still unmodelled would pass
as colour; then under the colour found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .doubtful import doubtful_rows
from .frame import Frame, raw_columns
from .motions import Motions
from .signatures import line
from .spectral import promising_orders
from .whitening import Whitener, plain_whitener, unwhitened_rows, whitener

if TYPE_CHECKING:
    from ..problem import Problem
    from .bank import Bank
    from .candidates import Candidate

Array = np.ndarray
#: Columns are added while the best ones gain more than this per column (a χ² that chance over the whole catalogue seldom
#: reaches), on all blocks and, halved, on blocks held out.
_LEAST = 30.0
_PER_COLUMN = 2.0
#: At most this share of the rows goes into saturating columns, and so many rounds and steps.
_SHARE = 0.12
_ROUNDS = 3
_STEPS = 40
#: In the steps between, only those are looked at whose last gain was this share of the best; all of them every so many steps.
_LATELY = 0.3
_ANEW = 6
#: Columns that gain less than this share of what is asked for in one round are not looked at in the next.
_HOPELESS = 0.3
#: Blocks that are whitened at a time.
_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class Floor:
    """`white`: the noise's whitener; `used` (n,): saturating columns on each joint's rows."""

    white: Whitener
    used: Array


def noise_floor(
    problem: Problem,
    motions: Motions,
    candidates: tuple[Candidate, ...],
    bank: Bank,
    generic: list[Array],
    progress: Callable[[float], None] | None = None,
) -> Floor:
    """Whitener of the noise of a problem's rows. `generic`: further columns (M, n, k) that saturate the model. `progress`: called
    with the share done. Where the bank remembers a floor of the same rows, only what gained anything there is looked at."""
    tell = progress or (lambda _: None)
    signals = problem.signals
    raw = raw_columns(problem)
    blocks = [*bank.saturating, *generic] if bank.saturating else [*_columns(motions, candidates, bank, tell), *generic]
    white = plain_whitener(problem, signals.tau)
    chosen: list[Array] = []
    used = np.zeros(signals.tau.shape[1])
    doubtful = doubtful_rows(problem)
    for attempt in range(_ROUNDS):
        frame = Frame.build(problem, white, raw)
        if attempt == 0:
            white = plain_whitener(problem, _unwhitened(frame, frame.residual))
            frame = Frame.build(problem, white, raw)
        extra = _peaks(frame, motions, candidates, bank, chosen)
        residual, chosen, used, blocks = _saturated(frame, chosen + extra + blocks)
        freed = residual / np.sqrt(np.maximum(1.0 - used / np.maximum(signals.valid.sum(axis=0), 1), 0.5))
        white = plain_whitener(problem, freed) if attempt == 0 else whitener(freed, signals.valid, signals.row_runs, doubtful)
        tell(0.5 + 0.5 * (attempt + 1) / _ROUNDS)
    bank.saturating = chosen + blocks
    return Floor(white, used)


def _columns(motions: Motions, candidates: tuple[Candidate, ...], bank: Bank, tell: Callable[[float], None]) -> list[Array]:
    """Columns (M, n, k) of every candidate at every shape of its grid."""
    bank.prepare(lambda _: motions, candidates)
    blocks: list[Array] = []
    for i, c in enumerate(candidates):
        blocks += bank.columns(motions, c.variants)
        tell(0.5 * (i + 1) / len(candidates))
    return blocks


def _saturated(frame: Frame, blocks: list[Array]) -> tuple[Array, list[Array], Array, list[Array]]:
    """Residual (M, n), not whitened, with the blocks (M, n, k) that gain most added one after the other; those blocks; columns
    used; the other blocks that gained anything worth a look at any time."""
    n, M, b = frame.columns.shape
    rows = frame.problem.signals.valid.sum(axis=0)
    Q, _ = np.linalg.qr(frame.columns.reshape(-1, b))
    live = [q for i in range(0, len(blocks), _AT_ONCE) for q in _orthogonal_each(frame, blocks[i : i + _AT_ONCE], Q)]
    folds = [
        np.concatenate([np.arange(r.start, r.stop) for r, f in zip(frame.block_rows, frame.folds, strict=True) if f == k])
        for k in range(frame.n_folds)
    ]
    r = frame.residual.reshape(-1).copy()
    kept, chosen, used = [Q], [], np.zeros(n)
    gains, most, taken = np.zeros(len(live)), np.zeros(len(live)), set()

    def look(due: Array) -> float:
        """Take the gains of some blocks anew; the best of all."""
        for k in due:
            gains[k] = _gain(live[k], r, scale, M) - _PER_COLUMN * live[k].shape[1] if live[k].shape[1] else 0.0
        np.maximum(most, gains, out=most)
        return float(gains.max(initial=0.0))

    everything = np.arange(len(live))
    for step in range(_STEPS):
        scale = _spread(r.reshape(n, M), rows)
        # What gained little lately gains little now; only now and then is it looked at again.
        due = np.flatnonzero(gains > _LATELY * gains.max(initial=0.0)) if step % _ANEW else everything
        if look(due) < _LEAST and look(everything) < _LEAST:
            break
        i = int(np.argmax(gains))
        q = live[i]
        for other in kept[1:]:
            q = q - other @ (other.T @ q)
        q = _basis(q / np.maximum(np.linalg.norm(q, axis=0), 1e-300))
        live[i] = np.zeros((n * M, 0))
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
    return _unwhitened(frame, r.reshape(n, M)), chosen, used, others


def _spread(r: Array, rows: Array) -> Array:
    """Standard deviation (n,) of each joint's whitened residual (n, M)."""
    return np.sqrt(np.maximum(np.sum(r**2, axis=1) / np.maximum(rows, 1), 1e-300))


def _gain(q: Array, r: Array, scale: Array, M: int) -> float:
    """Fall of the loss by orthonormal columns q, in units of the variance that the residual has where they are: what is gained on the
    rows of one joint may be lost on those of another."""
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


def _peaks(frame: Frame, motions: Motions, candidates: tuple[Candidate, ...], bank: Bank, chosen: list[Array]) -> list[Array]:
    """Columns of periodic candidates at the orders that the residual suggests, and of lines in its spectrum over time."""
    if chosen:
        more = np.concatenate([frame.whitened(c) for c in chosen], axis=2)
        X = np.concatenate([frame.columns, more], axis=2)
        n, M, b = X.shape
        Q, _ = np.linalg.qr(X.reshape(-1, b))
        r = frame.torque.reshape(-1)
        residual = (r - Q @ (Q.T @ r)).reshape(n, M)
    else:
        residual = frame.residual
    found = []
    for j in range(len(residual)):
        tone = line(motions, np.asarray(frame.white.back(residual[j], j)), j)
        if tone is not None:
            found.append(tone.placed(len(residual)))
    for candidate in candidates:
        if not candidate.spectral:
            continue
        h = bank.harmonics(frame, motions, candidate.variants[0])
        if h is not None:
            name = candidate.variants[0].shape()[0].name
            at = [candidate.variants[0].with_shape(**{name: order}) for order in promising_orders(h, frame, motions, residual)[:2]]
            found += motions.columns_of(at) if at else []
    return found


def _orthogonal_each(frame: Frame, blocks: list[Array], Q: Array) -> list[Array]:
    """Of each block of columns (M, n, k) an orthonormal basis of what is left of it, whitened, beside an orthonormal Q."""
    Z = frame.whitened(np.concatenate(blocks, axis=2)).reshape(len(Q), -1)
    size = np.linalg.norm(Z, axis=0)
    Z /= np.where(size > 0.0, size, 1.0)
    Z -= Q @ (Q.T @ Z)
    ends = np.cumsum([block.shape[2] for block in blocks])
    return [_basis(Z[:, end - block.shape[2] : end]) for block, end in zip(blocks, ends, strict=True)]


def _basis(Z: Array) -> Array:
    """Orthonormal basis of columns (rows, k) that were of unit length before what others have was taken out of them."""
    values, vectors = np.linalg.eigh(Z.T @ Z)
    keep = values > 1e-6
    return np.asarray((Z @ vectors[:, keep]) / np.sqrt(values[keep]))


def _unwhitened(frame: Frame, residual: Array) -> Array:
    """Whitened residuals (n, M) as they were before, (M, n); zero in rows that are not used."""
    valid = frame.problem.signals.valid
    return np.stack([unwhitened_rows(frame.white, residual[j], j, valid[:, j]) for j in range(len(residual))], axis=1)
