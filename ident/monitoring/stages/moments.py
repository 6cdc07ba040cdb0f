"""When something changed: the moment at which an effect that begins or ends gains most."""

from __future__ import annotations

import numpy as np

from ...effects.base import Effect
from .frame import Frame
from .motions import Motions

Array = np.ndarray
#: What a moment that is off by a few rows gains says nothing of those between: moments are tried so close to each other (s) at last, and
#: at first so many.
CLOSE = 0.05
_FIRST = 80
#: So many of the best are followed.
_FOLLOWED = 6
#: Columns are made of so many moments at a time.
_AT_ONCE = 16


def best_moment(frame: Frame, motions: Motions, effect: Effect, name: str, within: tuple[float, float]) -> float:
    """The moment (s), to `CLOSE`, at which an effect whose shape `name` it is lowers the loss of a frame most."""
    low, high = within
    gains: dict[float, float] = {}

    def look(moments: list[float]) -> None:
        for i in range(0, len(moments), _AT_ONCE):
            part = moments[i : i + _AT_ONCE]
            columns = motions.columns_of([effect.with_shape(**{name: t}) for t in part])
            whitened = frame.whitened(np.concatenate(columns, axis=2))
            gains.update(zip(part, frame.fit_gains(whitened, columns[0].shape[2], [None] * len(part))[0].tolist(), strict=True))

    step = max(CLOSE, (high - low) / _FIRST)
    look(np.arange(low, high + 0.5 * step, step).clip(low, high).tolist())
    while step > CLOSE:
        step *= 0.5
        best = sorted(gains, key=lambda t: -gains[t])[:_FOLLOWED]
        look(sorted({float(np.clip(t + side * step, low, high)) for t in best for side in (-1.0, 1.0)} - gains.keys()))
    return max(gains, key=lambda t: gains[t])
