"""Trigonometric polynomials of several angles: values, and whether one is positive everywhere, decided by boxes that are halved."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

Array = np.ndarray

#: Values below this share of the root mean square cannot be distinguished from zero.
_ZERO = 1e-11
#: Positions evaluated together.
_CHUNK = 20_000


class Sign(StrEnum):
    """POSITIVE: proven at every position. NOT_POSITIVE: a position shows it. OPEN: neither within the boxes allowed."""

    POSITIVE = "positive"
    NOT_POSITIVE = "not positive"
    OPEN = "open"


@dataclass(frozen=True, eq=False)
class TrigonometricPolynomial:
    """g(angles) = Re sum of coefficients (f,) * exp(i frequencies (f, a) @ angles (a,)).

    Examples
    --------
    >>> import numpy as np
    >>> from ident.physical.trigonometric import TrigonometricPolynomial
    >>> g = TrigonometricPolynomial(np.array([[0], [1]]), np.array([2.0, 1.0]))
    >>> g.sign()[0].value
    'positive'
    """

    frequencies: Array
    coefficients: Array

    def both(self, angles: Array) -> tuple[Array, Array]:
        """Values (N,) and slopes (N, a) at angles (N, a)."""
        turned = np.exp(1j * (angles @ self.frequencies.T)) * self.coefficients
        return turned.real.sum(axis=1), -(turned.imag @ self.frequencies)

    def rms(self) -> float:
        """Root mean square over all angles (each frequency, or its opposite, stands once)."""
        still = ~self.frequencies.any(axis=1)
        squares = np.abs(self.coefficients) ** 2
        return float(np.sqrt(squares[still].sum() + 0.5 * squares[~still].sum()))

    def sign(self, most: int = 400_000) -> tuple[Sign, float, Array]:
        """Whether g is positive everywhere, with the lowest value met and its angles (a,).

        A box of half width w about c has g >= g(c) - w |slope|_1 - w² / 2 * sum |coefficient| |frequency|_1²: where that is positive
        it is done, else it is cut in halves along every angle. `most`: boxes in all."""
        a = self.frequencies.shape[1]
        size = self.rms()
        bend = float(np.abs(self.coefficients) @ np.abs(self.frequencies).sum(axis=1) ** 2)
        # Sixteen boxes per angle at the start, or fewer that leave most of the boxes to the halving.
        points = min(16, int((most / 8) ** (1.0 / max(a, 1))))
        width = np.pi / points
        angles = grid(points, a) + width
        halves = np.array(list(product((-0.5, 0.5), repeat=a))).reshape(2**a, a)
        lowest, at, used = np.inf, np.zeros(a), 0
        while len(angles):
            used += len(angles)
            if used > most:
                return Sign.OPEN, lowest, at
            parts = [self.both(angles[k : k + _CHUNK]) for k in range(0, len(angles), _CHUNK)]
            value = np.concatenate([p[0] for p in parts])
            slope = np.concatenate([p[1] for p in parts])
            k = int(np.argmin(value))
            if value[k] < lowest:
                lowest, at = float(value[k]), angles[k]
            if lowest <= _ZERO * size:
                return Sign.NOT_POSITIVE, lowest, at
            left = value - width * np.abs(slope).sum(axis=1) - 0.5 * width**2 * bend <= 0.0
            angles = (angles[left][:, None] + width * halves).reshape(int(left.sum()) * 2**a, a)
            width *= 0.5
        return Sign.POSITIVE, lowest, at


def grid(points: int, angles: int) -> Array:
    """Positions (points**angles, angles), evenly over whole turns from -pi on."""
    if not angles:
        return np.zeros((1, 0))
    axis = -np.pi + 2 * np.pi * np.arange(points) / points
    return np.stack(np.meshgrid(*[axis] * angles, indexing="ij"), axis=-1).reshape(points**angles, angles)


def coefficients_on_grid(values: Array, points: int, angles: int) -> tuple[Array, Array]:
    """Frequencies (f, angles) and coefficients (..., f) of real functions given on `grid(points, angles)` as values (..., points**angles).

    Exact for degrees below points / 2 in every angle. Of each pair of opposite frequencies one stands, with both coefficients' weight."""
    if not angles:
        return np.zeros((1, 0), int), values.astype(complex)
    shape = (*values.shape[:-1], *[points] * angles)
    axes = tuple(range(values.ndim - 1, values.ndim - 1 + angles))
    turned = np.fft.fftn(values.reshape(shape), axes=axes).reshape(*values.shape[:-1], points**angles) / points**angles
    k = np.fft.fftfreq(points, 1.0 / points).round().astype(int)
    frequencies = np.stack(np.meshgrid(*[k] * angles, indexing="ij"), axis=-1).reshape(points**angles, angles)
    # The grid starts at -pi.
    turned = turned * np.where(frequencies.sum(axis=1) % 2, -1.0, 1.0)
    first = np.array([next((int(np.sign(x)) for x in row if x), 0) for row in frequencies])
    turned, frequencies = turned[..., first >= 0], frequencies[first >= 0]
    turned = turned * np.where(first[first >= 0] > 0, 2.0, 1.0)
    largest = np.abs(turned).max(axis=tuple(range(turned.ndim - 1)), initial=0.0)
    kept = largest > 1e-12 * max(float(largest.max(initial=0.0)), 1e-300)
    return frequencies[kept], turned[..., kept]
