"""How a link moves that has play in its gear: on one flank, free in between, caught by the other flank with a knock.

A flank takes the link up at once and lets it go when it would have to pull. When the link arrives hangs on a load that is known only so
well; but the motor feels the knock, and its acceleration shows when that was. So where a knock is due and the motor is jolted the way
the link moves, the link arrives then, and its flight is stretched to fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

Array = np.ndarray
#: A jolt stands out of the motor's usual acceleration by so many (robust) standard deviations.
_STANDS_OUT = 6.0
#: And is at least this share of that acceleration (rms): turning points are sharp, too.
_LEAST = 0.2
#: A flight may be longer or shorter than predicted by this share, or by so many samples, for the arrival to be the jolt.
_SHARE = 0.3
_SAMPLES = 3
#: Nor is it stretched more than so many times.
_STRETCH = 3.0
#: Periods of the highest frequency that the motion holds over which the motor's usual acceleration is taken.
_PERIODS = 1.5
#: A free flight is looked at for so many samples first, then for so many times more.
_FIRST, _MORE = 64, 4


@dataclass(frozen=True, eq=False)
class Jolts:
    """Where a motor is jolted: samples, and by how much, of jolts forwards and backwards; `smear`: samples over which the preparation of
    the signals spreads each."""

    forwards: tuple[Array, Array]
    backwards: tuple[Array, Array]
    smear: int

    @classmethod
    def of(cls, acceleration: Array, rate: float, cutoff_hz: float) -> Jolts:
        """Of an acceleration (N,) that holds frequencies up to `cutoff_hz`."""
        from scipy.ndimage import maximum_filter1d, median_filter

        smear = max(int(rate / cutoff_hz), 1)
        half = max(int(_PERIODS * rate / cutoff_hz), 2)
        sharp = acceleration - median_filter(acceleration, 2 * half + 1, mode="nearest")
        usual = 1.4826 * float(np.median(np.abs(sharp))) if len(sharp) else 0.0
        least = max(_STANDS_OUT * usual, _LEAST * float(np.sqrt(np.mean(acceleration**2))) if len(acceleration) else 0.0)
        both = []
        for forwards in (sharp, -sharp):
            peaks = (forwards >= maximum_filter1d(forwards, 2 * (half // 2) + 1, mode="nearest")) & (forwards > least)
            at = np.flatnonzero(peaks & (forwards > 0.0))
            both.append((at, forwards[at]))
        return cls(both[0], both[1], smear)

    def due(self, towards: float, first: int, last: int) -> int | None:
        """The largest jolt in a direction from one sample to another, if there is any."""
        at, size = self.forwards if towards > 0.0 else self.backwards
        a, b = np.searchsorted(at, [first, last + 1])
        return int(at[a + np.argmax(size[a:b])]) if b > a else None


@dataclass(frozen=True, eq=False)
class Flights:
    """The link's acceleration relative to the motor, (N,), while it is free: minus load over inertia; `step`: s."""

    acceleration: Array
    step: float

    @cached_property
    def _integrals(self) -> tuple[Array, Array]:
        """Once and twice integrated, linear between samples, (N,) each."""
        a, h = self.acceleration, self.step
        once = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * h)])
        return once, np.concatenate([[0.0], np.cumsum(h * once[:-1] + (2.0 * a[:-1] + a[1:]) * h * h / 6.0)])

    @cached_property
    def _leaving(self) -> tuple[Array, Array]:
        """Samples at which it would leave the upper and the lower flank."""
        return np.flatnonzero(self.acceleration < 0.0), np.flatnonzero(self.acceleration > 0.0)

    def leaves(self, side: float, first: int) -> int | None:
        """The first sample, from one on, at which the flank would have to pull."""
        at = self._leaving[0] if side > 0.0 else self._leaving[1]
        i = int(np.searchsorted(at, first))
        return int(at[i]) if i < len(at) else None

    def of(self, start: int, stop: int) -> tuple[Array, Array, Array]:
        """Way, velocity and acceleration from rest at a sample on, up to another one left out."""
        once, twice = (x[start:stop] for x in self._integrals)
        speed = once - once[0]
        return twice - twice[0] - once[0] * self.step * np.arange(len(twice)), speed, self.acceleration[start:stop]

    def landing(self, start: int, side: float, gap: float) -> tuple[int, float] | None:
        """The sample at which the link that leaves a flank is beyond a flank again, and which; None if it never is."""
        size, count = len(self.acceleration), _FIRST
        while True:
            stop = min(size, start + count)
            way = side * self.of(start, stop)[0]
            # Away from its flank the way is negative.
            out = np.flatnonzero((way > 0.0) | (way < -gap))
            if len(out):
                return start + int(out[0]), side if way[out[0]] > 0.0 else -side
            if stop == size:
                return None
            count *= _MORE


def played(flights: Flights, gap: float, knock: float, jolts: Jolts, side: float) -> tuple[Array, Array, Array]:
    """What the link does in a gap (whole width) beyond the motor, and its two derivatives, (N,) each.

    `knock`: s from when the link touches a flank to the middle of the push that stops it; `side`: of the flank on which it rests at
    first, 1 (the link ahead of the motor) or -1."""
    acceleration, step = flights.acceleration, flights.step
    size = len(acceleration)
    x, v, a = np.zeros(size), np.zeros(size), np.zeros(size)
    k, rest = 0, 0
    while True:
        start = flights.leaves(side, k + rest)
        if start is None or start >= size - 1:
            # It stays on this one.
            x[k:] = 0.5 * side * gap
            break
        x[k:start] = 0.5 * side * gap
        landing = flights.landing(start, side, gap)
        stop = size if landing is None else landing[0]
        way, speed, pulled = flights.of(start, stop + 1)
        if landing is not None and landing[1] != side:
            felt = _arrival(flights, jolts, start, stop, side, gap)
            if felt is not None:
                stop, way, speed, pulled = felt
        n = stop - start
        x[start:stop] = 0.5 * side * gap + way[:n]
        v[start:stop] = speed[:n]
        a[start:stop] += pulled[:n]
        if landing is None:
            break
        side = landing[1]
        # The push takes the whole speed; the two samples around its middle share it.
        touched = (0.5 * side * gap - x[stop - 1]) / (way[n] - way[n - 1]) if way[n] != way[n - 1] else 1.0
        middle = min(stop - 1 + min(max(float(touched), 0.0), 1.0) + knock / step, size - 1.0)
        first = min(int(middle), size - 2)
        a[stop] += 0.5 * pulled[n]
        a[first] -= (first + 1 - middle) * speed[n] / step
        a[first + 1] -= (middle - first) * speed[n] / step
        k, rest = stop, jolts.smear
    return x, v, a


def _arrival(flights: Flights, jolts: Jolts, start: int, due: int, side: float, gap: float) -> tuple[int, Array, Array, Array] | None:
    """When a link that left a flank is felt to arrive at the other one, around the sample at which it is due, with way, velocity and
    acceleration stretched to that; None where the motor feels nothing."""
    slack = max(_SAMPLES, int(_SHARE * (due - start)))
    at = jolts.due(-side, max(start + 1, due - slack), min(due + slack, len(flights.acceleration) - 1))
    if at is None:
        return None
    way, speed, pulled = flights.of(start, at + 1)
    stretch = -side * gap / way[-1] if way[-1] else np.inf
    if not 1.0 / _STRETCH < stretch < _STRETCH:
        return None
    return at, stretch * way, stretch * speed, stretch * pulled
