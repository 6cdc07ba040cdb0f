"""Speeds whose sign friction follows: those of the motors, and, where gears couple joints, those of the joints beside them.

Friction of a motor reverses with the motor, that of a joint's own bearings with the joint. Behind a gear of its own a joint reverses
when its motor does; in a coupled wrist both happen apart from each other, and each is in the rows of all torques that
the friction reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .transmission import Side, Transmission

Array = np.ndarray
#: Entries of a coupling below this share of the largest are rounding.
_NONE = 1e-12


@dataclass(frozen=True, eq=False)
class Reversals:
    """m speeds of a drive whose friction reverses with them: `rates` (m, n) times the joint velocities; `measured` (m, n): times the
    velocities on the measured side; `reaches` (n, m) bool: the measured torques that the friction of each is in."""

    rates: Array
    measured: Array
    reaches: Array

    @classmethod
    def of(cls, transmission: Transmission) -> Reversals:
        K, on = transmission.K, transmission.measured
        coupled = np.flatnonzero(np.count_nonzero(K, axis=1) > 1)
        rates = np.concatenate([transmission.K_inverse, np.eye(len(K))[coupled]])
        reaches = np.hstack([transmission.torque_map(Side.MOTOR, on), transmission.torque_map(Side.JOINT, on)[:, coupled]])
        return cls(rates, _rounded(rates if on == Side.JOINT else rates @ K), _rounded(reaches) != 0.0)

    def speeds(self, dq: Array) -> Array:
        """Their magnitudes (N, m), from joint velocities (N, n)."""
        return np.asarray(np.abs(dq @ self.rates.T))

    def limits(self, threshold: Array) -> Array:
        """For each (m,) the largest it can be where no speed on the measured side is above its threshold (n,); one that is not known
        counts as zero."""
        return np.asarray(np.abs(self.measured) @ np.where(np.isfinite(threshold), threshold, 0.0))

    def reached(self, speeds: Array, limits: Array, top: Array) -> Array:
        """Samples (N, n) of the measured torques that the friction of any speed below its limit (m,) is in; `speeds` (N, m). One whose
        `top` (m,) is not above its limit does not reverse: what stands still all the time rubs the same way, or is held."""
        slow = (speeds <= limits) & (top > limits)
        return np.stack([slow[:, own].any(axis=1) for own in self.reaches], axis=1)


def _rounded(A: Array) -> Array:
    return np.where(np.abs(A) > _NONE * np.abs(A).max(), A, 0.0)
