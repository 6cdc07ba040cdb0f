"""The motion of each run of a problem, and what effects make of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.motion import Motion
from .frame import acting_on

if TYPE_CHECKING:
    from ...problem.problem import Problem
    from ...signals.signals import Block

Array = np.ndarray
#: Predictions that differ by less than this share (rms, every joint) make the same columns.
_ALIKE = 0.01
#: Columns that are filtered at a time.
_AT_ONCE = 64


class Motions:
    """The motion of each run of a problem with what effects may ask for, made once: many candidates look at the same motion."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        needs = frozenset({Need.LOAD, Need.REFERENCE}) if problem.reference is not None else frozenset[Need]()
        self.parts: list[tuple[Block, Motion]] = [(block, problem.motion(block.samples, needs)) for block in problem.signals.blocks(None)]
        self._kept: dict[Effect, Array] = {}

    def sharing(self, other: Motions) -> Motions:
        """These motions with what the others have made already, if their prediction is the same but for little."""
        if self.problem.signals is other.problem.signals and all(
            _alike(mine, theirs) for (_, mine), (_, theirs) in zip(self.parts, other.parts, strict=True)
        ):
            self._kept = other._kept
        return self

    def search_range(self, effect: Effect) -> dict[str, tuple[float, float]]:
        """Where an effect's shapes may lie: in any of the runs."""
        every = [effect.search_range(motion, self.problem.model.robot) for _, motion in self.parts]
        out = {}
        for p in effect.shape():
            # A run that tells nothing of it leaves its bounds.
            told = [x[p.name] for x in every if x[p.name] != (p.lower, p.upper)]
            out[p.name] = (min(low for low, _ in told), max(high for _, high in told)) if told else (p.lower, p.upper)
        return out

    def columns(self, effect: Effect) -> Array:
        """Columns (M, n, k) of an effect on the measured side, filtered like the torque."""
        return self.columns_of([effect])[0]

    def columns_of(self, effects: Sequence[Effect]) -> list[Array]:
        """`columns` of several effects of one kind."""
        robot = self.problem.model.robot
        out: list[list[Array]] = [[] for _ in effects]
        for block, motion in self.parts:
            waiting: list[tuple[int, tuple[int, ...], list[int], Array]] = []
            for i, values in enumerate(type(effects[0]).columns_of(effects, motion, robot)):
                # Filtered where the effect acts, and then brought to the measured side: there are fewer rows than samples.
                live = acting_on(values)
                waiting.append((i, values.shape[1:], live, values[:, live].reshape(len(values), -1)))
                if sum(own.shape[1] for _, _, _, own in waiting) >= _AT_ONCE:
                    self._reduce(block, effects, waiting, out)
                    waiting = []
            self._reduce(block, effects, waiting, out)
        return [np.concatenate(parts) for parts in out]

    def _reduce(
        self,
        block: Block,
        effects: Sequence[Effect],
        waiting: list[tuple[int, tuple[int, ...], list[int], Array]],
        out: list[list[Array]],
    ) -> None:
        """Filter columns of several effects at once: for each its index, their shape (n, k), the joints they act on and what they are
        there; what comes of them goes to `out`."""
        if not waiting:
            return
        transmission = self.problem.model.robot.transmission
        every = block.reduce(np.concatenate([own for _, _, _, own in waiting], axis=1))
        start = 0
        for i, (n, k), live, own in waiting:
            reduced = every[:, start : start + own.shape[1]].reshape(len(every), len(live), k)
            start += own.shape[1]
            if effects[i].side != transmission.measured:
                out[i].append(np.matmul(transmission.torque_map(effects[i].side, transmission.measured)[:, live], reduced))
            else:
                full = np.zeros((len(every), n, k))
                full[:, live] = reduced
                out[i].append(full)

    def kept(self, effects: Sequence[Effect]) -> list[Array]:
        """`columns_of`, remembered."""
        new = [e for e in effects if e not in self._kept]
        if new:
            self._kept.update(zip(new, self.columns_of(new), strict=True))
        return [self._kept[e] for e in effects]


def _alike(one: Motion, other: Motion) -> bool:
    """Whether two predictions on the same motion differ by so little that columns made from either serve for both."""
    if one.load is None or other.load is None or one.reference is None or other.reference is None:
        return one.load is other.load
    pairs = ((one.load, other.load), (one.predicted, other.predicted))
    return all(bool(np.all(np.sum((a - b) ** 2, axis=0) <= _ALIKE**2 * np.sum(b**2, axis=0))) for a, b in pairs)
