"""The catalogue as rows: every effect at every place, in a few shapes, and the generic shapes, made along the instrument's motion."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.registry import effect_types
from ...errors import IdentError
from ..scoring.columns import effect_columns
from ..scoring.fit import Fit, depends
from .places import is_order, places
from .shapes import shapes

if TYPE_CHECKING:
    from ...effects.motion import Motion

Array = np.ndarray
Gains = tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that are scored together: an effect in one shape, or (effect None) a generic shape. `columns`: their places among all."""

    name: str
    joints: tuple[str, ...]
    effect: Effect | None
    columns: Array = field(repr=False)

    @property
    def named(self) -> bool:
        return self.effect is not None

    @property
    def kind(self) -> tuple[str, tuple[str, ...]]:
        """What it is and where, whatever its shape."""
        return self.name, self.joints


@dataclass(eq=False)
class Catalogue:
    """Groups, and for each motor which columns act on it (`places`) and their rows for each run (count, k)."""

    groups: list[Group]
    places: list[Array]
    rows: list[list[Array]]
    count: int
    _whitened: tuple[Gains, list[tuple[int, Array, Array]]] | None = field(default=None, repr=False)

    @classmethod
    def of(cls, fit: Fit, speeds: Array) -> Catalogue:
        """Everything that could be beside the fit's model."""
        made = cls([], [], [], 0)
        changes = [] if fit.known is None else list(fit.known.own)
        made._fill(fit, [*changes, *_effects(fit, (kind for kind in _causes() if Need.TORQUE not in kind.needs))], speeds)
        return made

    @classmethod
    def of_effects(cls, fit: Fit, effects: Sequence[tuple[Effect, tuple[str, ...]]]) -> Catalogue:
        """These effects alone."""
        made = cls([], [], [], 0)
        made._fill(fit, effects, None)
        return made

    @classmethod
    def of_readings(cls, fit: Fit) -> Catalogue:
        """Effects of the torque's reading itself (what a drive demands beyond its limit). No instrument knows it, so that any noise goes
        with it: such a score says what to try, and never that something is left."""
        return cls.of_effects(fit, [*_effects(fit, (kind for kind in _causes() if Need.TORQUE in kind.needs))])

    def updated(self, fit: Fit) -> None:
        """Columns that depend on what the model predicts, made anew from the fit's values."""
        self._whitened = None
        chosen = [g for g in self.groups if g.effect is not None and depends(g.effect)]
        motions = fit.motions(instrument=True)
        new: list[dict[int, list[Array]]] = [defaultdict(list) for _ in range(fit.robot.n)]
        ids: list[list[int]] = [[] for _ in range(fit.robot.n)]
        for g in chosen:
            assert g.effect is not None
            own = fit.motions(instrument=True, effect=g.effect) if is_order(g.effect) else motions
            for m, rows in _rows(fit, g.effect, own).items():
                ids[m] += g.columns.tolist()
                for i, x in enumerate(rows):
                    new[m][i].append(x)
        for m in range(fit.robot.n):
            if not ids[m]:
                continue
            where = {int(c): k for k, c in enumerate(self.places[m])}
            known = [k for k, c in enumerate(ids[m]) if c in where]
            at = [where[ids[m][k]] for k in known]
            for i in range(len(fit.runs)):
                self.rows[m][i][:, at] = np.concatenate(new[m][i], axis=1)[:, known]

    def whitened(self, fit: Fit, gains: Gains) -> list[tuple[int, Array, Array]]:
        """Motors with the places of their columns, and these behind whitening filters (k, R); kept until others are asked for."""
        if self._whitened is None or self._whitened[0] is not gains:
            self._whitened = None
            heard = [m for m, ids in enumerate(self.places) if len(ids) and any(gain[m].any() for gain in gains)]
            self._whitened = gains, [(m, self.places[m], fit.filtered(self.rows[m], gains, m).T) for m in heard]
        return self._whitened[1]

    def raw_squares(self, fit: Fit, gains: Gains) -> list[Array]:
        """Gram matrices (K, d, d) of the columns of each group behind whitening filters, for each width of `of_width`."""
        found = [np.zeros((*ix.shape, ix.shape[1])) for _, ix in self.of_width.values()]
        for _, ids, C in self.whitened(fit, gains):
            at = np.full(self.count, -1)
            at[ids] = np.arange(len(ids))
            for square, (_, ix) in zip(found, self.of_width.values(), strict=True):
                here = at[ix[:, 0]] >= 0
                own = C[at[ix[here]]]
                square[here] += own @ own.swapaxes(1, 2)
        return found

    @cached_property
    def of_width(self) -> dict[int, tuple[Array, Array]]:
        """By their number of columns d, which groups have it, and their columns (K, d)."""
        widths = np.array([len(g.columns) for g in self.groups], int)
        found = {int(d): np.flatnonzero(widths == d) for d in np.unique(widths)}
        return {d: (which, np.stack([self.groups[k].columns for k in which.tolist()])) for d, which in found.items()}

    def _fill(self, fit: Fit, effects: Sequence[tuple[Effect, tuple[str, ...]]], speeds: Array | None) -> None:
        n, motions = fit.robot.n, fit.motions(instrument=True)
        ids: list[list[Array]] = [[] for _ in range(n)]
        parts: list[list[list[Array]]] = [[[] for _ in fit.runs] for _ in range(n)]

        def add(name: str, joints: tuple[str, ...], effect: Effect | None, width: int, rows: dict[int, list[Array]]) -> None:
            columns = np.arange(self.count, self.count + width)
            self.count += width
            self.groups.append(Group(name, joints, effect, columns))
            for m, each in rows.items():
                ids[m].append(columns)
                for i, x in enumerate(each):
                    parts[m][i].append(x.astype(np.float32))

        for effect, joints in effects:
            try:
                width = len(effect.parameters(fit.robot))
                rows = _rows(fit, effect, fit.motions(instrument=True, effect=effect) if is_order(effect) else motions)
            except IdentError:
                continue
            if rows:
                add(effect.name, joints, effect, width, rows)
        for name, j, columns in shapes(motions, speeds) if speeds is not None else ():
            rows = {j: [run.masked(x, j) for run, x in zip(fit.runs, columns, strict=True)]}
            add(name, (fit.robot.joint_names[j],), None, columns[0].shape[1], rows)
        empty = np.zeros(0, int)
        self.places = [np.concatenate(x) if x else empty for x in ids]
        self.rows = [
            [np.concatenate(x, axis=1) if x else np.zeros((run.band.count, 0), np.float32) for x, run in zip(each, fit.runs, strict=True)]
            for each in parts
        ]


def _rows(fit: Fit, effect: Effect, motions: Sequence[Motion]) -> dict[int, list[Array]]:
    """Rows (count, k) of an effect for each motor on which it acts, run by run."""
    values = [effect_columns(effect, motion, fit.robot) for motion in motions]
    live = [m for m in range(fit.robot.n) if any(v[:, m].any() for v in values)]
    return {m: [run.masked(v[:, m], m) for run, v in zip(fit.runs, values, strict=True)] for m in live}


def _causes() -> Iterator[type[Effect]]:
    """Kinds of effects that can be what a model lacks."""
    return (kind for name, kind in effect_types().items() if kind.cause and name != "rigid_body")


def _effects(fit: Fit, kinds: Iterable[type[Effect]]) -> Iterator[tuple[Effect, tuple[str, ...]]]:
    for kind in kinds:
        yield from places(kind, fit.declared, fit.sought(kind))
