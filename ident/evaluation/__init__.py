"""Evaluation on held-out data: validation, comparison, and the essential model."""

from __future__ import annotations

from .comparison import Comparison, compare
from .essential_model import Essential, essential
from .instrument_comparison import AgainstInstruments, against_instruments
from .validation import Validation, validate

__all__ = ["AgainstInstruments", "Comparison", "Essential", "Validation", "against_instruments", "compare", "essential", "validate"]
