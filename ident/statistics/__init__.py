"""Statistics of residuals: autoregression, noise models, torque error."""

from __future__ import annotations

from .torque_error import TorqueError

__all__ = ["TorqueError"]
