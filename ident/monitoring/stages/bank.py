"""Columns of candidates, kept from stage to stage of a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from .candidates import Candidate
from .frame import Frame
from .motions import Motions
from .spectral import Harmonics, harmonics

Array = np.ndarray


class Bank:
    """Columns (M, n, k) of effects that do not depend on the model's prediction, kept; others are made anew."""

    def __init__(self) -> None:
        #: What gained anything when the noise floor was last sought, (M, n, k) each.
        self.saturating: list[Array] = []
        self._kept: dict[Effect, Array] = {}
        self._harmonics: dict[Effect, Harmonics | None] = {}

    def harmonics(self, frame: Frame, motions: Motions, effect: Effect) -> Harmonics | None:
        """A periodic effect's columns at all orders at once, if they are of that kind."""
        if effect not in self._harmonics or effect.needs & {Need.LOAD, Need.REFERENCE}:
            self._harmonics[effect] = harmonics(effect, frame, motions)
        return self._harmonics[effect]

    def prepare(self, seen_by: Callable[[Effect], Motions], candidates: Sequence[Candidate]) -> None:
        """Columns of all candidates whose kind makes many of them at once for less."""
        kinds: dict[type[Effect], list[Effect]] = {}
        for candidate in candidates:
            kind = type(candidate.variants[0])
            if kind.columns_of.__func__ is not Effect.columns_of.__func__:  # type: ignore[attr-defined]
                kinds.setdefault(kind, []).extend(candidate.variants)
        for effects in kinds.values():
            self.columns(seen_by(effects[0]), effects)

    def columns(self, motions: Motions, effects: Sequence[Effect]) -> list[Array]:
        """Columns of several effects of one kind, filtered like the torque."""
        if effects[0].needs & {Need.LOAD, Need.REFERENCE}:
            return motions.kept(effects)
        new = [e for e in effects if e not in self._kept]
        if new:
            self._kept.update(zip(new, motions.columns_of(new), strict=True))
        return [self._kept[e] for e in effects]
