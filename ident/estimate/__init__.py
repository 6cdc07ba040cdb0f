"""Estimates: the one result of every estimator, its status, its report, its file."""

from __future__ import annotations

from .estimate import Estimate
from .status import Status, StatusCode

__all__ = ["Estimate", "Status", "StatusCode"]
