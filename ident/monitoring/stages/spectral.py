"""Which orders of a periodic effect are worth trying: its spectrum over the angle, taken all at once.

Columns A(t) sin(n φ(t)), A(t) cos(n φ(t)) of any order n follow from those of two orders. What they would gain is read from one
Fourier sum of the residual over φ, so that a line anywhere between the slowest and the fastest order that the rows resolve is
found without trying every order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect

if TYPE_CHECKING:
    from .frame import Frame
    from .motions import Motions

Array = np.ndarray
#: Finest grid of orders, and how many peaks are handed on.
_MOST_ORDERS = 1 << 15
_PEAKS = 4
#: An order counts as resolved while its columns keep this share of the power that slow orders have in the rows.
_RESOLVED = 0.1
#: A sample is in motion if the phase turns by this share of its fastest.
_MOVING = 1e-2
#: A period is seen if the phase turns by as much (rad): of less, a slow dependence of any kind is drawn as well.
_SEEN = 1.0
#: Orders are this much closer than a whole cycle over the longest run apart.
_FINER = 4.0


def order_parameter(effect: Effect) -> str | None:
    """The shape parameter that is an order (cycles per unit of position), if the effect has just this one."""
    shape = effect.shape()
    return shape[0].name if len(shape) == 1 and shape[0].unit.startswith("1/rad") else None


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Columns A sin n φ, A cos n φ of a periodic effect: for each run amplitudes by measured row (N,) and phase (N,); the power
    (P,) of whitened columns at some orders `probe` (P,); `orders`: those that the rows resolve, evenly spaced."""

    parts: tuple[tuple[dict[int, Array], Array], ...]
    probe: Array
    power: Array
    orders: Array

    @property
    def independent(self) -> float:
        """How many of the orders tell different things: the grid is finer than that."""
        return len(self.orders) / _FINER


def harmonics(effect: Effect, frame: Frame, motions: Motions) -> Harmonics | None:
    """The columns of a periodic effect at all orders at once; None where they are not of the harmonic kind."""
    name = order_parameter(effect)
    if name is None:
        return None
    p = effect.shape()[0]
    parts = []
    for _, motion in motions.parts:
        part = _harmonic(effect, name, motion, motions)
        if part is None:
            return None
        parts.append(part)
    longest = max((float(np.ptp(phase)) for _, phase in parts if len(phase)), default=0.0)
    if longest <= 0.0:
        return None
    step = 2.0 * np.pi / (_FINER * longest)
    if 2.0 * step >= p.upper:
        return None  # it stands still but for its encoder's flicker
    # The row filter decides how fast an order may be: found by trying a few.
    probe = np.geomspace(max(motions.search_range(effect)[name][0], 2.0 * step), p.upper, 24)
    power = _power(parts, probe, frame, motions)
    resolved = power > _RESOLVED * power.max(initial=0.0)
    if not resolved.any():
        return None
    # Orders between the last one that the rows resolve and the next, but none so fast that samples see it as a slow one.
    at = np.flatnonzero(resolved)
    low, high = float(probe[at[0]]), float(probe[min(at[-1] + 1, len(probe) - 1)])
    high = min(max(min(high, _told_apart(parts)), 2.0 * low), p.upper)
    if high <= low:
        return None  # it moves so little that the slowest order which shows is the fastest that there is
    count = int(min(_MOST_ORDERS, np.ceil((high - low) / step) + 1))
    return Harmonics(tuple(parts), probe, power, np.linspace(low, high, max(count, 2)))


def period_unseen(effect: Effect, frame: Frame, motions: Motions) -> bool:
    """Whether an effect is periodic, and the rows see next to nothing of its period: what is told is no law, but a trend."""
    name = order_parameter(effect)
    if name is None or (h := harmonics(effect, frame, motions)) is None:
        return False
    return float(getattr(effect, name)) * max(float(np.ptp(phase)) for _, phase in h.parts if len(phase)) < _SEEN


def _told_apart(parts: Sequence[tuple[dict[int, Array], Array]]) -> float:
    """The order of which half of the samples in motion turn the phase by less than half a turn each: faster ones look like slow ones."""
    turns = np.abs(np.concatenate([np.diff(phase) for _, phase in parts]))
    moving = turns[turns > _MOVING * turns.max(initial=0.0)]
    return float(np.pi / np.median(moving)) if len(moving) else np.inf


def promising_orders(h: Harmonics, frame: Frame, motions: Motions, residual: Array | None = None) -> list[float]:
    """Orders at which the effect would gain most, best first; of a whitened residual (n, M), the frame's own by default."""
    return peaks(h.orders, order_gains(h, frame, motions, residual))


def order_gains(h: Harmonics, frame: Frame, motions: Motions, residual: Array | None = None) -> Array:
    """What the effect would gain at each of its orders, up to a factor and as if its columns were at right angles to the model's."""
    residual = frame.residual if residual is None else residual
    total = np.zeros(len(h.orders), complex)
    for (block, _), (amplitudes, phase) in zip(motions.parts, h.parts, strict=True):
        for j, amplitude in amplitudes.items():
            gradient = frame.white.back(residual[j], j)[block.rows]
            full = gradient if block.row_filter is None else _spread(gradient, block.row_filter.taps, block.row_filter.factor, len(phase))
            total += _fourier(full * amplitude, phase, h.orders)
    power = np.interp(np.log(h.orders), np.log(h.probe), h.power)
    return np.asarray(np.abs(total) ** 2 / np.maximum(power, _RESOLVED * h.power.max()))


def evenly_drawn(orders: Array, gains: Array, best: float, gain: float) -> float:
    """Logarithm of the likelihood that orders drawn evenly by their logarithm have on average. `gains` are known up to a factor: at the
    order `best` it is `gain`."""
    from scipy.special import logsumexp

    own = float(np.interp(best, orders, gains))
    scale = gain / own if own > 0.0 else 0.0
    return float(logsumexp(0.5 * scale * gains, b=1.0 / orders) - np.log(np.sum(1.0 / orders)))


def _power(parts: list[tuple[dict[int, Array], Array]], orders: Array, frame: Frame, motions: Motions) -> Array:
    """Half the power (P,) of both whitened columns at each order."""
    valid = frame.problem.signals.valid
    total = np.zeros(len(orders))
    for j in {j: None for amplitudes, _ in parts for j in amplitudes}:
        rows = []
        for (block, _), (amplitudes, phase) in zip(motions.parts, parts, strict=True):
            wave = np.exp(1j * np.outer(phase, orders)) * amplitudes.get(j, np.zeros(len(phase)))[:, None]
            rows.append(block.reduce(np.concatenate([wave.real, wave.imag], axis=1)))
        white = frame.white(np.where(valid[:, j, None], np.concatenate(rows), 0.0), j)
        total += 0.5 * np.sum(white**2, axis=0).reshape(2, -1).sum(axis=0)
    return total


def _harmonic(effect: Effect, name: str, motion: object, motions: Motions) -> tuple[dict[int, Array], Array] | None:
    """Amplitudes by measured row (N,) and phase per order (N,) of the two columns; None where they are not A sin, A cos of n φ."""
    robot = motions.problem.model.robot
    transmission = robot.transmission
    lower = effect.shape()[0].lower

    def pair(n: float) -> Array:
        values = effect.with_shape(**{name: n}).columns(motion, robot)  # type: ignore[arg-type]
        if effect.side != transmission.measured:
            values = np.matmul(transmission.torque_map(effect.side, transmission.measured), values)
        return values[:, :, 1] + 1j * values[:, :, 0] if values.shape[2] == 2 else np.empty(0)

    first = pair(lower)
    if not first.size:
        return None
    rows = [int(j) for j in np.flatnonzero(np.abs(first).max(axis=0, initial=0.0) > 0)]
    if not rows:
        return None
    strongest = max(rows, key=lambda j: float(np.abs(first[:, j]).max()))
    # A small step in the order turns each sample by a small multiple of φ, whatever the sign of A.
    small = 1e-3 * lower
    turned = pair(lower + small)
    live = np.abs(first[:, strongest]) > 1e-9 * np.abs(first[:, strongest]).max()
    turn = np.zeros(len(first))
    turn[live] = np.angle(turned[live, strongest] / first[live, strongest])
    phase = np.unwrap(turn) / small
    if not live.all():
        at = np.arange(len(first))
        phase = np.interp(at, at[live], phase[live])
    amplitudes = {j: first[:, j] * np.exp(-1j * lower * phase) for j in rows}
    check = pair(3.0 * lower)[:, strongest]
    expected = amplitudes[strongest] * np.exp(3j * lower * phase)
    scale = float(np.abs(first[:, strongest]).max())
    if float(np.abs(check - expected).max()) > 1e-3 * scale:
        return None
    return {j: a.real for j, a in amplitudes.items()}, phase


def _spread(rows: Array, taps: Array, factor: int, samples: int) -> Array:
    """Transpose of a row filter: rows (m,) → samples (L,)."""
    out = np.zeros(samples)
    comb = np.zeros((len(rows) - 1) * factor + 1) if len(rows) else np.zeros(0)
    comb[::factor] = rows
    full = np.convolve(comb, taps)
    out[: len(full)] = full[:samples]
    return out


def _fourier(values: Array, phase: Array, orders: Array) -> Array:
    """Σ values exp(−i n phase) at evenly spaced orders, by spreading onto a fine even grid (error below 1 %)."""
    step = orders[1] - orders[0]
    size = 1 << int(np.ceil(np.log2(8.0 * len(orders))))
    carrier = values * np.exp(-1j * orders[0] * phase)
    place = np.mod(phase * step / (2.0 * np.pi), 1.0) * size
    below = np.floor(place).astype(int) % size
    share = place - np.floor(place)
    grid = np.zeros(size, complex)
    np.add.at(grid, below, carrier * (1.0 - share))
    np.add.at(grid, (below + 1) % size, carrier * share)
    return np.fft.fft(grid)[: len(orders)]


def peaks(orders: Array, gain: Array) -> list[float]:
    """Orders of the highest peaks, the highest first."""
    inner = (gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:])
    at = np.flatnonzero(inner) + 1
    at = np.append(at, [0, len(gain) - 1]) if len(gain) > 1 else at
    best = at[np.argsort(-gain[at])][:_PEAKS]
    return [float(orders[i]) for i in best]
