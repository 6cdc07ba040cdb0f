"""One linear operator for torque and columns alike: low-pass and decimation by the Fourier transform, odd reflection at the ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

Array = np.ndarray
#: Seconds of reflection at either end, and of rows at either end that are left out because it reaches into them.
_PAD = 1.0
_DROP = 0.6


@dataclass(frozen=True)
class Band:
    """Rows of one run: what lies below `top_hz`, at `rate / factor`.

    `samples`: of the run at `rate` (Hz). Columns and torque go through the same operator, so that the model's equation stays exact."""

    samples: int
    rate: float
    factor: int
    top_hz: float

    @property
    def row_rate(self) -> float:
        return self.rate / self.factor

    @cached_property
    def _pad(self) -> int:
        return min(int(_PAD * self.rate), self.samples - 1)

    @cached_property
    def _length(self) -> int:
        from scipy.fft import next_fast_len

        rows = int(np.ceil((self.samples + 2 * self._pad) / self.factor))
        return int(next_fast_len(rows, real=True)) * self.factor

    @cached_property
    def count(self) -> int:
        """Rows with those of the reflection."""
        return self._length // self.factor

    @cached_property
    def inner(self) -> slice:
        """The rows that count."""
        drop = int(_DROP * self.rate)
        return slice((self._pad + drop) // self.factor, (self._pad + self.samples - drop) // self.factor)

    @cached_property
    def time(self) -> Array:
        """Seconds from the run's start of the rows that count."""
        return (np.arange(self.inner.start, self.inner.stop) * self.factor - self._pad) / self.rate

    @cached_property
    def frequencies(self) -> Array:
        """Of the rows' Fourier transform, Hz."""
        return np.fft.rfftfreq(self.count, 1.0 / self.row_rate)

    @cached_property
    def _gain(self) -> Array:
        f = np.fft.rfftfreq(self._length, 1.0 / self.rate)[: self.count // 2 + 1]
        ramp = np.clip((1.1 * self.top_hz - f) / (0.2 * self.top_hz), 0.0, 1.0)
        return 0.5 - 0.5 * np.cos(np.pi * ramp)

    @cached_property
    def _bins(self) -> int:
        """Frequencies that the low-pass leaves anything of."""
        return int(np.flatnonzero(self._gain)[-1]) + 1

    def spectra(self, x: Array, use: Array | float = 1.0, precision: type[np.floating] = np.float64) -> Array:
        """Spectra (k, F) of columns x (N, k) times `use` (N,) as rows."""
        from scipy.fft import rfft

        before, end = self._pad, self._pad + self.samples
        whole = np.empty((x.shape[1], self._length), precision)
        inner = whole[:, before:end]
        np.multiply(x.T, use, out=inner, casting="same_kind")
        np.subtract(2 * inner[:, :1], inner[:, before:0:-1], out=whole[:, :before])
        reach = min(self._length - end, self.samples - 1)
        np.subtract(2 * inner[:, -1:], inner[:, -2 : -2 - reach : -1], out=whole[:, end : end + reach])
        whole[:, end + reach :] = whole[:, end + reach - 1, None]
        gain = (self._gain[: self._bins] / self.factor).astype(precision)
        return np.asarray(rfft(whole, axis=1)[:, : self._bins] * gain)

    def rows(self, x: Array, use: Array | float = 1.0) -> Array:
        """Columns x (N, k) times `use` (N,) as rows (count, k), those of the reflection included."""
        return self.of_spectra(self.spectra(x, use)).T

    def of_spectra(self, spectra: Array) -> Array:
        """Rows (…, count) of spectra (…, F), those of the reflection included."""
        from scipy.fft import irfft

        return np.asarray(irfft(spectra, self.count))

    def behind(self, spectra: Array, gain: Array) -> Array:
        """Rows (…, R) of spectra (…, F) behind filters of these gains (…, over `frequencies`); those that count."""
        return self.of_spectra(spectra * gain[..., : self._bins].astype(spectra.real.dtype))[..., self.inner]
