"""Torque noise to reckon with, from a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray


def sample_noise(estimate: Estimate, rate: float) -> Array | None:
    """Standard deviation (n,) of each joint's torque at a sampling rate, if it were white: of the same density at low frequency as what
    the fit left on its rows, which are filtered and fewer. None where the estimate does not say how many rows a second it had.

    Raises ConfigurationError where it had no rows of a joint."""
    rows_hz, noise = estimate.signals_config.get("row_rate_hz"), estimate.noise
    if not rows_hz:
        return None
    blind = [name for name, v in zip(estimate.model.robot.joint_names, noise.variance, strict=True) if not v > 0]
    if blind:
        raise ConfigurationError(
            f"the fit has no noise of {', '.join(blind)} (no row of it was fitted); give --noise, one value per joint."
        )
    return np.asarray(np.sqrt(noise.variance * noise.correlation_time * rate / rows_hz))
