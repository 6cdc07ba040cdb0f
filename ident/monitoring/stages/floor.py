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
from .saturation import saturated
from .signatures import line
from .spectral import promising_orders
from .whitening import Whitener, plain_whitener, unwhitened_rows, whitener

if TYPE_CHECKING:
    from ...problem.problem import Problem
    from .bank import Bank
    from .candidates import Candidate

Array = np.ndarray
#: Times that the model is saturated, each under the noise that the one before left.
_ROUNDS = 3


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
        found = saturated(frame, chosen + extra + blocks)
        chosen, used, blocks = found.chosen, found.used, found.others
        freed = _unwhitened(frame, found.residual) / np.sqrt(np.maximum(1.0 - used / np.maximum(signals.valid.sum(axis=0), 1), 0.5))
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


def _unwhitened(frame: Frame, residual: Array) -> Array:
    """Whitened residuals (n, M) as they were before, (M, n); zero in rows that are not used."""
    valid = frame.problem.signals.valid
    return np.stack([unwhitened_rows(frame.white, residual[j], j, valid[:, j]) for j in range(len(residual))], axis=1)
