"""Columns of one run on its motors, as spectra of their rows: what whitening filters of any model are laid over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .band import Band
    from .rows import RunRows

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Spectra:
    """`width` columns on n motors. `live`: for each motor those that act on it (k,), `values`: their spectra (k, F)."""

    band: Band
    width: int
    live: tuple[Array, ...]
    values: tuple[Array, ...]

    @classmethod
    def of(cls, columns: Array, run: RunRows) -> Spectra:
        """Columns (N, n, width) of torque of the motors."""
        live = tuple(np.flatnonzero(columns[:, m].any(axis=0)) for m in range(columns.shape[1]))
        values = tuple(run.masked_spectra(columns[:, m, ids], m) for m, ids in enumerate(live))
        return cls(run.band, columns.shape[2], live, values)

    @property
    def empty(self) -> bool:
        """They act on no motor."""
        return not any(map(len, self.live))

    def acts_on(self, m: int) -> bool:
        return len(self.live[m]) > 0

    def behind(self, gains: Array) -> Array:
        """Rows (R, n, width) behind whitening filters of these gains (n, …)."""
        out = np.zeros((self.band.inner.stop - self.band.inner.start, len(self.live), self.width))
        for m, (ids, values) in enumerate(zip(self.live, self.values, strict=True)):
            if len(ids):
                out[:, m, ids] = self.band.behind(values, gains[m]).T
        return out

    def summed(self, theta: Array) -> Array:
        """The spectrum (n, F) of the columns times their coefficients (width,)."""
        return np.stack([theta[ids] @ values for ids, values in zip(self.live, self.values, strict=True)])
