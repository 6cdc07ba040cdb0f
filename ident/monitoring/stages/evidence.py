"""Evidence: how much of it chance yields, and from which on a candidate counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...effects.kinds import Need

if TYPE_CHECKING:
    from .search import Hit, Judged

Array = np.ndarray
#: Probability that chance alone carries any candidate of the whole catalogue over the threshold.
FALSE_ALARM = 2e-3
#: Independent values of a smooth shape: so many for each of several at once, as a spring with a rotor and damping is many resonances.
_ALONG = 6.0
#: Independent orders of a periodic effect that is not known to have been looked for over fewer.
_MOST_ORDERS = 4000.0
#: Evidence below which a candidate is weak.
WEAK = 100.0


def threshold(hit: Hit, number: int) -> float:
    """Evidence from which on a candidate counts. Columns made of the measured torque hold its noise, which follows itself: there, weak
    evidence is none."""
    return max(by_chance(hit, number), WEAK if Need.TORQUE in hit.effect.needs else 0.0)


def by_chance(hit: Hit, number: int) -> float:
    """Evidence that chance reaches with probability FALSE_ALARM over `number` candidates, for this one's parameters and shapes."""
    from scipy.stats import chi2

    shapes = len(hit.effect.shape())
    # Independent shapes that a search looks at: a few along each smooth one, some tens of moments, many along an order.
    moment = Need.TIME in hit.effect.needs and shapes > 0
    trials = (hit.tried or _MOST_ORDERS) if hit.candidate.spectral else 50.0 if moment else _ALONG**shapes
    return float(chi2.isf(FALSE_ALARM / (number * trials), hit.columns.shape[2])) + 2.0 * shapes


def occam(hit: Hit, number: int) -> float:
    """By how much (twice a log-likelihood) a hit's freedom counts against it beside rivals: what chance reaches with its parameters and
    shapes. Shapes count no more than they were needed: where any of them does as well, having had the choice was worth nothing."""
    from scipy.stats import chi2

    parameters = float(chi2.isf(FALSE_ALARM / number, hit.columns.shape[2]))
    return parameters + min(by_chance(hit, number) - parameters, max(hit.fit_gain - 2.0 * hit.evenly, 0.0))


def surplus(judged: Judged, number: int) -> float:
    """Evidence above the threshold."""
    return judged.evidence - threshold(judged.hit, number)


def touched(columns: Array) -> Array:
    """Joints (n,) bool on whose rows whitened columns (n, M, k) weigh."""
    power = np.sum(columns**2, axis=(1, 2))
    return power > 0.05 * power.max(initial=0.0)


def acts_on(judged: Judged) -> Array:
    """Joints (n,) bool on whose rows what a candidate adds weighs: its columns at the values they have, kilograms beside their inertia."""
    return touched((judged.hit.columns @ judged.score.values)[:, :, None])
