"""Torque error: root mean square and relative error per joint, and over all joints, on rows that are used."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

Array = np.ndarray


class JudgedOn(StrEnum):
    """What a torque error is of: the fitted rows, or what is left of raw rows within the band where the motion is known."""

    ROWS = "rows"
    KNOWN_BAND = "known_band"


@dataclass(frozen=True, eq=False)
class TorqueError:
    """`rms` (n,) in N m (N); `relative` (n,) = ‖τ − τ̂‖ / ‖τ‖ per joint on the measured side; `relative_all` over all joints.

    NaN where a joint has no usable row. `judged`: what it is of; `band_hz`: both sides were low-passed there (None: they were not)."""

    rms: Array
    relative: Array
    relative_all: float
    rows: Array
    judged: JudgedOn = JudgedOn.ROWS
    band_hz: float | None = None

    @classmethod
    def of(cls, residual: Array, tau: Array, judged: JudgedOn = JudgedOn.ROWS, band_hz: float | None = None) -> TorqueError:
        """From residuals (M, n) with NaN where a row is not used, and measured torque (M, n)."""
        use = np.isfinite(residual)
        found = cls.from_squares(
            np.sum(np.where(use, residual, 0.0) ** 2, axis=0), np.sum(np.where(use, tau, 0.0) ** 2, axis=0), use.sum(axis=0)
        )
        return replace(found, judged=judged, band_hz=band_hz)

    @classmethod
    def from_squares(cls, residual: Array, torque: Array, rows: Array) -> TorqueError:
        """From sums of squares per joint (n,) and the number of rows (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            rms = np.sqrt(residual / rows)
            relative = np.sqrt(residual / torque)
            total = float(np.sqrt(residual.sum() / torque.sum()))
        return cls(rms, relative, total, np.asarray(rows))

    def to_dict(self) -> dict[str, Any]:
        """JSON form; null where a joint has no usable row."""
        return {
            "rms": [number(x) for x in self.rms],
            "relative": [number(x) for x in self.relative],
            "relative_all": number(self.relative_all),
            "judged": self.judged.value,
            "band_hz": self.band_hz,
        }

    @property
    def about(self) -> str:
        """What the error is of, in words."""
        if self.judged == JudgedOn.KNOWN_BAND:
            return f"within the band where the motion is known, below {self.band_hz:.3g} Hz"
        return "of the rows as they are, not filtered" if self.band_hz is None else f"of rows below {self.band_hz:.3g} Hz"


def number(x: float) -> float | None:
    """A float for JSON: null where it is not finite."""
    return float(x) if np.isfinite(x) else None
