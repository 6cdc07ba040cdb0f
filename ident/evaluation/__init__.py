"""Evaluation on held-out data: validation, comparison, and the essential model."""

from __future__ import annotations

from .comparison import Comparison, compare
from .essential_model import Essential, essential
from .feedback import FeedbackBias, feedback_bias
from .validation import Validation, validate

__all__ = ["Comparison", "Essential", "FeedbackBias", "Validation", "compare", "essential", "feedback_bias", "validate"]
