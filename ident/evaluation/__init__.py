"""Evaluation on held-out data: validation and comparison."""

from __future__ import annotations

from .comparison import Comparison, compare
from .validation import Validation, validate

__all__ = ["Comparison", "Validation", "compare", "validate"]
