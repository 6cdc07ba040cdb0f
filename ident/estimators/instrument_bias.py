"""How much bias instruments can make that share the noise of the torque they are made of.

Accelerations of a model at the measured torque hold its noise through the inverse of the inertia matrix, and so does the equation's left
side. Where the torque was commanded nothing else is shared: the motion knows nothing of the noise of the torque's reading. Instruments of
some rows ago do not share it, so the difference of both estimates shows the bias, beside chance of known covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .instrument_tests import DifferenceTest

Array = np.ndarray


@dataclass(frozen=True)
class SharedNoise:
    """What the difference to earlier instruments says of bias: the greatest is of parameter `name`, `largest` standard deviations of
    its estimate; `torque`: rms torque error it makes, relative, less what chance accounts for; `test`: that it is there at all."""

    name: str
    largest: float
    torque: float
    test: DifferenceTest

    def text(self) -> str:
        """A sentence for people."""
        return (
            "the instruments are correlated with the noise of the torque reading, as instruments made from a measured"
            " torque are (χ² = {self.test.statistic:.0f} with {self.test.degrees} degrees of freedom against instruments of earlier rows);"
            f" the resulting bias can be about {100 * self.torque:.2g} % in torque, and largest in {self.name}:"
            f" {self.largest:.1f} of its standard deviations."
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {"parameter": self.name, "largest": self.largest, "torque": self.torque}


def shared_noise(difference: Array, covariance: Array, gram: Array, torques: float, test: DifferenceTest) -> SharedNoise:
    """From the difference (b,) to the estimate of earlier instruments and its `covariance` (b, b); `gram` (b, b): ΩᵀΩ of the
    instruments, whose motion is free of the sensors' noise, `torques`: the rows' sum of squared torque."""
    beyond = float(difference @ gram @ difference) - float(np.sum(gram * covariance))
    return SharedNoise(test.name, test.largest, float(np.sqrt(max(0.0, beyond) / max(torques, 1e-300))), test)
