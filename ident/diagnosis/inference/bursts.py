"""Bursts: more energy in half a second than the rest of the log makes likely, or in many of them than noise has.

What shows only above the band in which the reference drives the motion (play in a gear, a contact, a joint that shakes) is seen so, if at
all: no column of the instrument follows it, and none may be made of the measured motion there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..thresholds import LEVEL, LOUD, MATERIAL
from .scores import blocks

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved

Array = np.ndarray
_WINDOW = 0.5
#: Hz below which bursts are looked for apart: what is slow and loud drowns in the noise of all frequencies.
_SLOW_HZ = 4.0
_USED = 0.9
#: Windows (half of one apart) on either side of the loudest that belong to its event.
_NEAR = 3
_BINS = 5
#: Quantile of the energies from which on they are the tail.
_TAIL = 0.8
#: Separate events that are often.
_OFTEN = 4


def burst(fit: Fit, frame: Solved) -> tuple[int, float] | None:
    """The motor whose residual bursts, and the family-wise probability that noise does so; None where none does.

    Energies of windows, of the whole residual and of its slow part, are compared with a gamma law fitted to the middle of their
    distribution."""
    found: tuple[int, float] | None = None
    n = frame.residual.shape[1]
    # Whitened by its own mean spectrum, a burst would be divided by itself.
    whole = fit.at_usual_noise(frame)
    for residual in (whole, _slow(fit, frame, whole)):
        for m in range(n):
            p = min(2.0 * n * _chance(fit, frame, residual, m), 1.0)
            if p < LEVEL and (found is None or p < found[1]):
                found = (m, p)
    return found


def _slow(fit: Fit, frame: Solved, residual: Array) -> Array:
    """A residual's slow part."""
    from scipy.signal import butter, sosfiltfilt

    parts = []
    for run, a, b in zip(fit.runs, frame.edges[:-1], frame.edges[1:], strict=True):
        rate, own = run.band.row_rate, residual[a:b]
        plain = _SLOW_HZ >= 0.4 * rate or len(own) < 30
        parts.append(own if plain else sosfiltfilt(butter(2, _SLOW_HZ, fs=rate, output="sos"), own, axis=0))
    return np.concatenate(parts)


def _chance(fit: Fit, frame: Solved, residual: Array, m: int) -> float:
    """Probability that noise makes what is loudest in a motor's residual."""
    from scipy.stats import gamma

    energies, paces, begun = [], [], []
    places: list[Array] = []
    for run, a, b in zip(fit.runs, frame.edges[:-1], frame.edges[1:], strict=True):
        width = max(int(_WINDOW * run.band.row_rate), 1)
        speed = np.abs(run.instrument.motor.dq[:, [m]])
        paces.append(_windows(np.clip(run.band.rows(speed)[run.band.inner, 0], 0.0, None), width))
        used = np.clip(run.band.rows(run.use[:, [m]])[run.band.inner, 0], 0.0, 1.0)
        energy, share = (_windows(x, width) for x in (residual[a:b, m] ** 2, used / width))
        good = (share > _USED) & ~_at_a_moment(fit, m, run.instrument.clock, run.band.time, width)
        paces[-1] = paces[-1][good]
        begun.append(_windows(_begun(fit, m, run.instrument.clock[0] + run.band.time), width)[good])
        energies.append(energy[good] / share[good])
        places.append(np.flatnonzero(good) + (places[-1][-1] + _NEAR + 1 if places and len(places[-1]) else 0))
    e = _at_like_noise(np.concatenate(energies), np.concatenate(paces), np.concatenate(begun))
    if len(e) < 12 or not np.median(e) > 0:
        return 1.0
    place = np.concatenate(places)
    much = LOUD**2 * float(np.median(e))
    loud = place[e > much]
    if len(loud) and 1 + int(np.sum(np.diff(loud) > _NEAR)) >= _OFTEN:
        return 0.0  # no tail of one noise: it is quiet, and often it is not
    if float(np.mean(e)) > much:
        return 0.0  # seldom, but most of all that is left
    low, middle, high = np.quantile(e, [0.16, 0.5, 0.84])
    shape = max((middle / max((high - low) / 2.0, 1e-300)) ** 2, 1.5)
    scale = middle / gamma.ppf(0.5, shape)
    return max(float(gamma.sf(e.max() / scale / (1.0 + MATERIAL) ** 2, shape)) * len(e), _by_its_own_tail(e, place))


def _by_its_own_tail(energy: Array, place: Array) -> float:
    """Probability of the largest energy if it belongs to the tail that the others show: logarithms beyond a quantile, exponential.

    `place`: of each window in time; those about the largest are the same event. The tail's slope is known from the others alone, half of
    which are independent, because they overlap: the law of the next one is Lomax's."""
    size = np.log(np.maximum(energy, 1e-300))
    top = int(np.argmax(size))
    base = float(np.quantile(size, _TAIL))
    others = size[(size > base) & (np.abs(place - place[top]) > _NEAR)] - base
    if len(others) < 5:
        return 1.0
    independent = len(others) / 2.0
    law = (1.0 + (size[top] - base) / max(float(others.sum()) / 2.0, 1e-12)) ** -independent
    return min(float(np.sum(size > base)) * float(law), 1.0)


def _windows(x: Array, width: int) -> Array:
    sums = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray((sums[width:] - sums[:-width])[:: max(width // 2, 1)])


def at_moments(fit: Fit, frame: Solved, count: int) -> Array:
    """Blocks (count,) of a frame's scores in which, or beside which, an effect of the model begins to act."""
    near = np.zeros(count, bool)
    cuts = blocks(fit, frame)
    moments = _moments(fit.effects)
    for run, a in zip(fit.runs, frame.edges[:-1], strict=True):
        time = run.instrument.clock[0] + run.band.time
        for moment in moments:
            if time[0] <= moment <= time[-1]:
                at = int(np.searchsorted(cuts, a + np.searchsorted(time, moment), side="right")) - 1
                near[max(at - 1, 0) : at + 2] = True
    return near


def _acting(fit: Fit, m: int) -> list[Effect]:
    """Accepted effects that act on motor m."""
    return [e for e in fit.effects if any(columns.acts_on(m) for columns in fit.columns(e)[1])]


def _moments(effects: Iterable[Effect]) -> list[float]:
    """When effects begin to act, s, of those that begin at a moment."""
    return [float(getattr(e, p.name)) for e in effects for p in e.shape() if p.unit == "s" and p.name.startswith("t_")]


def _at_a_moment(fit: Fit, m: int, clock: Array, time: Array, width: int) -> Array:
    """Windows in which an effect of the model begins to act on motor m: how it begins no law says."""
    inside = np.zeros(len(time), bool)
    for moment in _moments(_acting(fit, m)):
        inside |= np.abs(clock[0] + time - moment) <= _WINDOW
    return _windows(inside.astype(float), width) > 0


def _begun(fit: Fit, m: int, clock: Array) -> Array:
    """How many effects of the model have begun to act on motor m, at each time (N,)."""
    return np.sum(clock[:, None] >= np.array(_moments(_acting(fit, m))), axis=1, dtype=float)


def _at_like_noise(energy: Array, speed: Array, begun: Array) -> Array:
    """Energies over those at like speed, since the same effects began: a payload passes on more of the noise of the positions."""
    out = np.empty_like(energy)
    for phase in np.unique(begun):
        part = begun == phase
        own = _at_like_speed(energy[part], speed[part])
        out[part] = own / max(float(np.median(own)), 1e-300)
    return out


def _at_like_speed(energy: Array, speed: Array) -> Array:
    """Energies over the median of those at like speed: noise that grows with speed is no burst."""
    bins = min(_BINS, len(energy) // 12)
    if bins < 2:
        return energy
    out = energy.copy()
    for part in np.array_split(np.argsort(speed), bins):
        out[part] /= max(float(np.median(energy[part])), 1e-300)
    return out
