"""From signals to a decision."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..instruments.prepared import Instrument, prepared
from .inference.decide import Decision, decide

if TYPE_CHECKING:
    from ..model import Model
    from ..signals.signals import Signals

Array = np.ndarray


def analysed(
    model: Model,
    signals: Signals,
    note: Callable[[str], None] | None = None,
    progress: Callable[[float], None] | None = None,
    *,
    values: Array | None = None,
) -> tuple[Decision, Instrument]:
    """Decide what a model lacks on signals. `values` (k,): of its parameters, for effects that follow what the model predicts. Raises
    DataError where no run is long enough or no joint has rows."""
    fit, instrument, speeds = prepared(model, signals, values)
    return decide(fit, speeds, note, progress), instrument
