"""The drive train as data: θ = K θ_m + zero, τ_m = Kᵀ τ (K may couple joints, as in a robot's wrist)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import condition
from ..errors import ConfigurationError, unknown_name

Array = np.ndarray
#: Beyond this, or below its inverse, a number is no drive's: sums of it overflow.
_MOST = 1e12


class Side(StrEnum):
    """The side of the transmission on which a quantity is given.

    Examples
    --------
    >>> import ident
    >>> ident.Side("motor") is ident.Side.MOTOR
    True
    """

    JOINT = "joint"
    MOTOR = "motor"

    @classmethod
    def _missing_(cls, value: object) -> Side:
        raise unknown_name("side of the transmission", str(value), [side.value for side in cls])


@dataclass(frozen=True, eq=False, repr=False)
class Transmission(ShortRepr):
    """An invertible linear transmission between n joints and n motors.

    `K` (n, n): joint velocity = K @ motor velocity. `zero` (n,): joint positions at motor zero (rad or m).
    `measured`: the side of the logged torque. `torque_constants` (n,) in N m/A turn currents into motor torque.

    Examples
    --------
    >>> import ident
    >>> import numpy as np
    >>> drive = ident.Transmission.from_ratio(np.array([100.0, -50.0]), ident.Side.MOTOR)
    >>> drive.joint_position(np.array([[1.0, 1.0]]))
    array([[ 0.01, -0.02]])
    """

    K: Array
    zero: Array
    measured: Side = Side.JOINT
    torque_constants: Array | None = None

    def __post_init__(self) -> None:
        K = np.asarray(self.K, float)
        if K.ndim != 2 or K.shape[0] != K.shape[1]:
            raise ConfigurationError(f"[drive] K must be a square matrix, but its shape is {K.shape}.")
        n = K.shape[0]
        if not np.all(np.abs(K) <= _MOST):
            raise ConfigurationError(f"[drive] K holds a value that is not finite, or beyond {_MOST:g}.")
        norms = np.linalg.norm(K, axis=1)
        if n and (np.any(norms < 1.0 / _MOST) or condition(K / norms[:, None]) > 1e12):
            raise ConfigurationError("[drive] K is singular: some motion of the joints is driven by no motor. Give an invertible K.")
        zero = np.zeros(n) if self.zero is None else np.asarray(self.zero, float).reshape(-1)
        if zero.shape != (n,):
            raise ConfigurationError(f"[drive] zero has {zero.size} entries, but K is {n} x {n}.")
        if not np.all(np.abs(zero) <= _MOST):
            raise ConfigurationError(f"[drive] zero holds a value that is not finite, or beyond {_MOST:g}.")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "zero", zero)
        object.__setattr__(self, "measured", Side(self.measured))
        if self.torque_constants is not None:
            constants = np.asarray(self.torque_constants, float).reshape(-1)
            if constants.shape != (n,):
                raise ConfigurationError(f"[drive] torque_constants has {constants.size} entries for {n} motors.")
            if not np.all((np.abs(constants) >= 1.0 / _MOST) & (np.abs(constants) <= _MOST)):
                raise ConfigurationError("[drive] torque_constants holds a value that is zero, not finite or implausibly large or small.")
            object.__setattr__(self, "torque_constants", constants)

    @classmethod
    def of(cls, given: Transmission | Array, measured: Side | str = Side.JOINT) -> Transmission:
        """A transmission as it is, or that of an array: (n,) signed gear ratios, (n, n) the matrix K, torque on the `measured` side."""
        if isinstance(given, Transmission):
            return given
        array, side = np.asarray(given, float), Side(measured)
        return cls.from_ratio(array, side) if array.ndim == 1 else cls(array, np.zeros(len(array)), side)

    @classmethod
    def identity(cls, n: int, measured: Side = Side.JOINT) -> Transmission:
        """Direct drive: motor and joint move alike."""
        return cls(np.eye(n), np.zeros(n), measured)

    @classmethod
    def from_ratio(cls, ratio: Array, measured: Side = Side.JOINT) -> Transmission:
        """From signed gear ratios (n,), motor turns per joint turn."""
        ratio = np.asarray(ratio, float).reshape(-1)
        if not np.all((np.abs(ratio) >= 1.0 / _MOST) & (np.abs(ratio) <= _MOST)):
            raise ConfigurationError("[drive] ratio holds a value that is zero, not finite or implausibly large or small.")
        return cls(np.diag(1.0 / ratio), np.zeros(ratio.size), measured)

    def restricted(self, keep: Sequence[int]) -> Transmission:
        """The drive of some of the joints (indices), where the others do not move.

        Raises ConfigurationError if K couples them with the others: their motors would then carry torque of joints that
        are held, which no row of the kept motors reveals."""
        keep = list(keep)
        rest = [i for i in range(self.n) if i not in keep]
        if np.any(self.K[np.ix_(keep, rest)]) or np.any(self.K[np.ix_(rest, keep)]):
            raise ConfigurationError(
                "[drive] K couples joints that move with joints that are locked;"
                " give the K of the moving joints, or lock the whole coupled group."
            )
        constants = None if self.torque_constants is None else self.torque_constants[keep]
        return Transmission(self.K[np.ix_(keep, keep)], self.zero[keep], self.measured, constants)

    @property
    def n(self) -> int:
        """Number of joints, and of motors."""
        return self.K.shape[0]

    @cached_property
    def K_inverse(self) -> Array:
        """K⁻¹ (n, n)."""
        return np.linalg.inv(self.K)

    @property
    def is_diagonal(self) -> bool:
        return np.array_equal(self.K, np.diag(np.diag(self.K)))

    def motor_position(self, q: Array) -> Array:
        """Motor positions (..., n) from joint positions (..., n)."""
        return (q - self.zero) @ self.K_inverse.T

    def motor_rate(self, dq: Array) -> Array:
        """Motor velocities or accelerations (..., n) from those of the joints."""
        return dq @ self.K_inverse.T

    def joint_position(self, q_motor: Array) -> Array:
        """Joint positions (..., n) from motor positions (..., n)."""
        return q_motor @ self.K.T + self.zero

    def joint_rate(self, dq_motor: Array) -> Array:
        """Joint velocities or accelerations (..., n) from those of the motors."""
        return dq_motor @ self.K.T

    @cached_property
    def is_trivial(self) -> bool:
        """Whether motors and joints turn alike: every map between the sides is the identity."""
        return bool(np.array_equal(self.K, np.eye(self.n)))

    def torque_map(self, source: Side, target: Side) -> Array:
        """Matrix T (n, n) with `torque on target side = T @ torque on source side`."""
        if source == target:
            return np.eye(self.n)
        return self.K.T if target == Side.MOTOR else self.K_inverse.T

    def torque(self, torque: Array, source: Side, target: Side) -> Array:
        """Torque (..., n) carried from one side to the other; what is missing there (NaN) is missing only where it takes part."""
        if source == target:
            return torque
        carried = self.torque_map(source, target).T
        missing = np.isnan(torque)
        if not missing.any():
            return torque @ carried
        return np.where(missing @ (carried != 0), np.nan, np.where(missing, 0.0, torque) @ carried)
