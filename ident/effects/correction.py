"""What a finding in the sensors or the timing means for the logged signals: how to undo it before they are prepared again."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import ConfigurationError
from ..robots.transmission import Side, Transmission

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Harmonic:
    """A periodic error of an encoder: reading − truth = `sine` sin(order q) + `cosine` cos(order q), (n,) each."""

    order: float
    sine: Array
    cosine: Array


@dataclass(frozen=True, eq=False)
class SignalCorrection:
    """Errors of n joints' (or motors') signals, each (n,) or None; `side`: where the sensors sit.

    Torque: reading(t) = gain × truth(t − delay), behind a first-order low-pass of time constant `lag`; both in s.
    `limit`: the drive delivers no more than this, whatever the log says (inf: no limit). Position: reading − truth =
    `offset` + `scale` × truth + harmonics."""

    side: Side = Side.MOTOR
    gain: Array | None = None
    delay: Array | None = None
    lag: Array | None = None
    limit: Array | None = None
    offset: Array | None = None
    scale: Array | None = None
    harmonics: tuple[Harmonic, ...] = field(default=())

    @property
    def of_torque(self) -> bool:
        """Whether the torque signal is corrected."""
        return any(x is not None for x in (self.gain, self.delay, self.lag, self.limit))

    @property
    def of_position(self) -> bool:
        """Whether the position signal is corrected."""
        return self.offset is not None or self.scale is not None or bool(self.harmonics)

    def true_position(self, q: Array, transmission: Transmission) -> Array:
        """Joint positions (N, n) that gave the readings `q` (N, n), both on the joint side."""
        if not self.of_position:
            return q
        reading = q if self.side == Side.JOINT else transmission.motor_position(q)
        zero = np.zeros(reading.shape[1])
        offset = zero if self.offset is None else self.offset
        scale = zero if self.scale is None else self.scale
        truth = reading
        # The error is a contraction of the position (an encoder that is not would not count up): iterate to the fixed point.
        for _ in range(100):
            error = offset + scale * truth
            for h in self.harmonics:
                error = error + h.sine * np.sin(h.order * truth) + h.cosine * np.cos(h.order * truth)
            step = reading - error - truth
            truth = truth + step
            if float(np.abs(step).max(initial=0.0)) < 1e-13 * (1.0 + float(np.abs(reading).max(initial=0.0))):
                return truth if self.side == Side.JOINT else transmission.joint_position(truth)
        raise ConfigurationError("the encoder error is too large to be undone: its reading does not grow with the position everywhere.")

    def true_torque(self, tau: Array, t: Array, transmission: Transmission) -> Array:
        """Torque (N, n) that gave the readings `tau` (N, n) at times `t` (N,), both on the measured side.

        Undoing a low-pass amplifies noise above 1/lag: filter afterwards. Past its ends the log is continued by its last value."""
        if not self.of_torque:
            return tau
        own = transmission.torque(tau, transmission.measured, self.side)
        out = np.array(own, float)
        if self.limit is not None:
            out = np.clip(out, -self.limit, self.limit)
        if self.gain is not None:
            out = out / self.gain
        if self.lag is not None and len(t) > 1:
            out = out + self.lag * np.gradient(out, t, axis=0)
        if self.delay is not None:
            for j, delay in enumerate(self.delay):
                if delay != 0.0:
                    out[:, j] = np.interp(t + delay, t, out[:, j])
        return transmission.torque(out, self.side, transmission.measured)
