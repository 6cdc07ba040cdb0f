"""How probable each of several rivals is, from what each foretells of blocks that it was not fitted to.

Pseudo-Bayesian model averaging with the blocks bootstrapped (Y. Yao, A. Vehtari, D. Simpson, A. Gelman, Bayesian Analysis 13
(2018)): a rival that is better on the whole only for the sake of a few blocks does not win for sure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .search import Judged

Array = np.ndarray
_DRAWS = 400
#: Laws are never exact: of what rivals explain, differences below this share say nothing about which of them is right.
_INEXACT = 5e-5
#: How common an effect is beside the others, where nothing else tells two apart. Not listed: 1.
PRIOR = {
    "viscous": 4.0,
    "coulomb": 4.0,
    "rotor_inertia": 4.0,
    "offset": 2.0,
    "stribeck": 2.0,
    "linear_spring": 2.0,
    "payload_step": 2.0,
    "delay": 2.0,
}


def weights(judged: Sequence[Judged], thresholds: Sequence[float], more: Array | float = 0.0) -> Array:
    """Probabilities (m,) of rivals that would each explain the same thing. `thresholds`: what each one's parameters and shapes
    gain by chance; more of them count against it. `more` (m,): what each gains beyond its evidence once the fit is consistent with it."""
    gains = np.stack([j.score.gain for j in judged])
    # A rival cannot be better on blocks held out than on those it was fitted to: then the model without it was unlucky there.
    best = np.array([j.evidence for j in judged])
    total = gains.sum(axis=1)
    gains = gains * np.where(total > 0, best / np.maximum(total, 1e-300), 1.0)[:, None]
    prior = np.log([PRIOR.get(j.hit.candidate.name, 1.0) for j in judged]) - 0.5 * np.asarray(thresholds)
    rng = np.random.default_rng(0)
    blocks = gains.shape[1]
    share = rng.dirichlet(np.ones(blocks), _DRAWS) * blocks
    score = (0.5 * share @ gains.T + 0.5 * np.asarray(more)) / (1.0 + _INEXACT * float(np.max(best + more, initial=0.0))) + prior
    score -= score.max(axis=1, keepdims=True)
    w = np.exp(score)
    return np.asarray((w / w.sum(axis=1, keepdims=True)).mean(axis=0))
