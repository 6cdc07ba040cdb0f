"""Filters without phase shift: the Butterworth low-pass run both ways, central differences, and the filter of the rows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from .._native.choice import compiled
from ..errors import ConfigurationError

Array = np.ndarray
#: Samples of a row filter, at most: longer than any run.
_LONGEST = 1 << 22

#: Weights w_1 … w_p of central differences of even order of accuracy: dq = rate Σ w_k (q_{+k} − q_{−k}),
#: ddq = rate² Σ w_k (q_{+k} + q_{−k} − 2 q) (B. Fornberg, Mathematics of Computation 51 (1988), tables 1 and 2).
_FIRST = {2: (1 / 2,), 4: (2 / 3, -1 / 12), 6: (3 / 4, -3 / 20, 1 / 60), 8: (4 / 5, -1 / 5, 4 / 105, -1 / 280)}
_SECOND = {2: (1.0,), 4: (4 / 3, -1 / 12), 6: (3 / 2, -3 / 20, 1 / 90), 8: (8 / 5, -1 / 5, 8 / 315, -1 / 560)}

_PIECE = 8192
#: Orders of accuracy that differences are known for.
ACCURACIES = tuple(_FIRST)


def require_accuracy(accuracy: int) -> None:
    """Raises ConfigurationError for an order of accuracy that is not known."""
    if accuracy not in ACCURACIES:
        raise ConfigurationError(
            f"[signals] accuracy = {accuracy!r} is not known; differences may have accuracy {', '.join(map(str, ACCURACIES))}."
        )


def central_differences(q: Array, rate: float, accuracy: int = 6) -> tuple[Array, Array]:
    """First and second time derivative of uniform samples (N, n), each (N - accuracy, n).

    Result k belongs to the instant of sample k + accuracy/2. `accuracy` is 2, 4, 6 or 8; the relative error at frequency f
    is about (2 π f/rate)^accuracy / 140 for 6."""
    if accuracy not in _FIRST:
        raise ConfigurationError(f"differences of accuracy {accuracy} are not known; use 2, 4, 6 or 8.")
    p = accuracy // 2
    size = len(q) - accuracy
    if size <= 0:
        return np.empty((0, *q.shape[1:])), np.empty((0, *q.shape[1:]))
    first, second = np.zeros((size, *q.shape[1:])), np.zeros((size, *q.shape[1:]))
    weights = [np.array(w[accuracy]) * rate**order for order, w in ((1, _FIRST), (2, _SECOND))]
    fast = compiled("_filters")
    if fast is not None and q.size:
        fast.differences(np.ascontiguousarray(q, float), size, q.size // len(q), *weights, first, second)
        return first, second
    # Piece by piece, so that what is in between stays in the cache and large logs cost no more memory than their result.
    for start in range(0, size, _PIECE):
        stop = min(start + _PIECE, size)
        middle = q[p + start : p + stop]
        for k in range(1, p + 1):
            after, before = q[p + k + start : p + k + stop], q[p - k + start : p - k + stop]
            first[start:stop] += weights[0][k - 1] * (after - before)
            # Differences before the sum: q is large against its second difference.
            second[start:stop] += weights[1][k - 1] * ((after - middle) - (middle - before))
    return first, second


def zero_phase_lowpass(x: Array, cutoff: float, rate: float, order: int = 4) -> Array:
    """Butterworth low-pass of `order`, run forwards and backwards over (N, …): no phase shift, gain 1/2 at `cutoff` (Hz)."""
    if not 0 < cutoff < 0.5 * rate:
        raise ConfigurationError(f"cut-off {cutoff:g} Hz must lie between 0 and half the sample rate ({0.5 * rate:g} Hz).")
    sections, settled = _butterworth(float(cutoff), float(rate), order)
    pad = min(len(x) - 1, math.ceil(3 * rate / cutoff))
    fast = compiled("_filters")
    if fast is not None and x.size and len(sections) <= fast.MOST_SECTIONS:
        out = np.empty(x.shape)
        table = np.ascontiguousarray(np.column_stack([sections[:, :3], sections[:, 4:], settled]))
        fast.zero_phase(table, np.ascontiguousarray(x, float), len(x), x.size // len(x), pad, out)
        return out
    return _both_ways(sections, settled, np.ascontiguousarray(x, float), pad)


def _both_ways(sections: Array, settled: Array, x: Array, pad: int) -> Array:
    """`scipy.signal.sosfiltfilt` along the first axis, started from states that are `settled` to a step of one."""
    from scipy.signal import sosfilt

    if not x.size:
        return np.zeros(x.shape)
    ends = 2 * x[:1] - x[pad:0:-1], 2 * x[-1:] - x[-2 : -2 - pad : -1]
    state = settled.reshape(len(settled), 2, *(1,) * (x.ndim - 1))
    y = np.concatenate([ends[0], x, ends[1]]) if pad else x
    for _ in range(2):
        y = sosfilt(sections, y, axis=0, zi=state * y[:1])[0][::-1]
    return np.ascontiguousarray(y[pad : pad + len(x)])


@lru_cache(maxsize=32)
def _butterworth(cutoff: float, rate: float, order: int) -> tuple[Array, Array]:
    """Second-order sections (s, 6) of the low-pass, and their states (s, 2) settled to a step of one."""
    sections = butterworth_sections(cutoff, rate, order)
    b, a = sections[:, :3], sections[:, 3:]
    gain = b.sum(axis=1) / a.sum(axis=1)
    step = np.concatenate([[1.0], np.cumprod(gain)[:-1]])  # what a step of one is before each section
    return sections, step[:, None] * np.stack([gain - b[:, 0], b[:, 2] - a[:, 2] * gain], axis=1)


def butterworth_sections(cutoff: float, rate: float, order: int) -> Array:
    """Second-order sections (s, 6), b0 b1 b2 1 a1 a2, of the digital Butterworth low-pass, as `scipy.signal.butter` has them.

    By the bilinear transform. SciPy's own takes a second to import, with statistics and all."""
    # The same operations in the same order: the poles of the analogue filter for two samples a second, then the bilinear transform.
    size = 4.0 * math.tan(math.pi * (2 * cutoff / rate) / 2.0)
    analogue = size * -np.exp(1j * math.pi * np.arange(-order + 1, order, 2) / (2 * order))
    gain = size**order * float(np.real(1.0 / np.prod(4.0 - analogue)))
    poles = ((4.0 + analogue) / (4.0 - analogue))[order // 2 :]
    poles = poles[np.argsort(np.abs(1 - np.abs(poles)))[::-1]]  # those nearest to the unit circle last
    sections = np.zeros((len(poles), 6))
    sections[:, :3] = 1.0, 2.0, 1.0
    sections[:, 3], sections[:, 4], sections[:, 5] = 1.0, -2.0 * poles.real, poles.real**2 + poles.imag**2
    if order % 2:  # a single pole, and a single zero, which goes to the last section
        single = int(np.argmin(np.abs(poles.imag)))
        sections[single, 4:] = -poles[single].real, 0.0
        sections[-1, :3] = 1.0, 1.0, 0.0
    sections[0, :3] *= gain
    return sections


def butterworth_transient(cutoff: float, order: int = 4, remaining: float = 1e-3) -> float:
    """Seconds after which a step's transient has fallen to `remaining`: the decay of the slowest pole."""
    slowest = 2 * math.pi * cutoff * math.sin(math.pi / (2 * order))
    return math.log(1 / remaining) / slowest


def savitzky_golay_window(cutoff: float, rate: float, degree: int) -> int:
    """Odd window length (samples) whose -3 dB frequency is `cutoff` (R. W. Schafer, IEEE Signal Processing Magazine 28(4), 2011)."""
    half = math.ceil(((degree + 1) * rate / (2 * cutoff) + 4.6) / 3.2)
    return 2 * max(half, degree // 2 + 1) + 1


@dataclass(frozen=True, eq=False)
class RowFilter:
    """Symmetric FIR low-pass and decimation, applied to both sides of the regression equation.

    `taps` (odd number, symmetric, sum 1); `factor`: samples a row. Of a run of L samples only rows with full support exist:
    row m is centred on sample `half + m * factor`, so no edge effect enters and no phase shift arises."""

    taps: Array
    factor: int = 1

    def __post_init__(self) -> None:
        taps = np.asarray(self.taps, float)
        if taps.ndim != 1 or len(taps) % 2 == 0 or not np.allclose(taps, taps[::-1], rtol=0, atol=1e-12 * np.abs(taps).max()):
            raise ConfigurationError("a row filter needs an odd number of symmetric taps, or it would shift the rows in time.")
        if self.factor < 1:
            raise ConfigurationError(f"a row filter's factor is a whole number of samples, at least 1, not {self.factor}.")
        object.__setattr__(self, "taps", taps)
        object.__setattr__(self, "factor", int(self.factor))

    @classmethod
    def lowpass(cls, cutoff: float, rate: float, factor: int) -> RowFilter:
        """Kaiser-windowed low-pass: gain 1/2 at `cutoff` (Hz), falling from 1 to under 1 % between 0.5 and 1.5 times it."""
        if not 0 < cutoff < 0.5 * rate:
            raise ConfigurationError(f"row cut-off {cutoff:g} Hz must lie between 0 and half the sample rate ({0.5 * rate:g} Hz).")
        # J. F. Kaiser's formulas for a window that stops 40 dB, as `scipy.signal.kaiserord` and `firwin` have them.
        beta = 0.5842 * 19.0**0.4 + 0.07886 * 19.0
        width = (40.0 - 7.95) / 2.285 / (np.pi * min(0.95, 2 * cutoff / rate)) + 1
        if not width < _LONGEST:
            raise ConfigurationError(
                f"a row cut-off of {cutoff:g} Hz at {rate:g} samples per second asks for a filter of {width:.2g} samples: decimate less, or"
                " raise the cut-off."
            )
        count = math.ceil(width) | 1
        share = 2 * cutoff / rate
        taps = share * np.sinc(share * (np.arange(count) - (count - 1) / 2)) * np.kaiser(count, beta)
        return cls(taps / taps.sum(), factor)

    @property
    def half(self) -> int:
        """Samples on each side of a row's centre."""
        return len(self.taps) // 2

    def count(self, samples: int) -> int:
        """Rows with full support in a run of so many samples."""
        return max(0, (samples - len(self.taps)) // self.factor + 1)

    def centres(self, samples: int) -> Array:
        """Samples (M,) on which the rows of a run are centred."""
        return self.half + self.factor * np.arange(self.count(samples))

    def support(self, first: int, last: int) -> slice:
        """Samples of the run that rows `first` … `last` - 1 need."""
        return slice(first * self.factor, (last - 1) * self.factor + len(self.taps))

    @cached_property
    def _block(self) -> tuple[int, Array]:
        """Rows computed at a time, and the banded matrix (rows, samples) that does it."""
        rows = max((len(self.taps) - 1) // self.factor + 1, min(64, 256 // self.factor), 1)
        band = np.zeros((rows, (rows - 1) * self.factor + len(self.taps)))
        for r in range(rows):
            band[r, r * self.factor : r * self.factor + len(self.taps)] = self.taps
        return rows, band

    def apply(self, x: Array) -> Array:
        """Filter and decimate a run or a piece of it (L, …) along time: (count(L), …)."""
        x = np.ascontiguousarray(x, float)  # the order of memory is that of the sums
        flat = x.reshape(len(x), int(np.prod(x.shape[1:])))
        total = self.count(len(x))
        out = np.empty((total, flat.shape[1]))
        rows, band = self._block
        for first in range(0, total, rows):
            last = min(first + rows, total)
            part = flat[self.support(first, last)]
            np.matmul(band[: last - first, : len(part)], part, out=out[first:last])
        return out.reshape(total, *x.shape[1:])

    @cached_property
    def magnitude(self) -> RowFilter:
        """The filter with |taps|, normalised: what share of a row's weight lies on flagged samples."""
        weight = np.abs(self.taps)
        return RowFilter(weight / weight.sum(), self.factor)

    def gain(self, frequency: Array, rate: float) -> Array:
        """Gain at frequencies (Hz): real, because the filter has no phase."""
        offset = np.arange(len(self.taps)) - self.half
        return np.cos(2 * np.pi * np.multiply.outer(np.asarray(frequency, float), offset) / rate) @ self.taps
