"""Columns of the regression equation at the rows: filtered and decimated while they are made, without the full-rate regressor.

The same numbers as `Problem.rows`, which forms all columns at the full rate first: filter and row map are linear, so that what
differs from joint to joint only by a constant factor is filtered once, and mapped at the rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..effect import Effect, JointEffect, Need
from ..effects.rigid_body import RigidBody
from ..filters import RowFilter
from ..model import Model
from ..motion import Motion

Array = np.ndarray
#: Samples whose regressor is in memory at a time: what stays in the cache is fastest.
_TILE = 512
#: Needs that a stretch of samples can meet by itself, wherever it is cut.
_LOCAL = frozenset({Need.TIME, Need.TORQUE})


def can_filter(model: Model) -> bool:
    """Whether the columns of a model depend on nothing outside the samples at hand."""
    return model.needs <= _LOCAL


@dataclass(frozen=True, eq=False)
class RowColumns:
    """Base columns (m, n, b) of `model` at the rows of `row_filter`. `threads`: of the kernel."""

    model: Model
    row_filter: RowFilter
    threads: int | None = 1

    def __call__(self, motion: Motion) -> Array:
        """Columns at the rows of a stretch of samples, measured side."""
        keep, robot = self.model.base.independent, self.model.robot
        rows = self.row_filter.count(len(motion))
        out = np.zeros((rows, robot.n, len(keep)))
        for effect, part in zip(self.model.effects, self.model.slices, strict=True):
            places = np.flatnonzero((keep >= part.start) & (keep < part.stop))
            if not len(places):
                continue
            mine = keep[places] - part.start
            if isinstance(effect, RigidBody):
                values = self._links(motion, mine, rows)
            elif isinstance(effect, JointEffect) and type(effect).columns is JointEffect.columns:
                values = self._by_joint(effect, motion, mine, rows)
            else:
                values = self.row_filter.apply(np.ascontiguousarray(effect.columns(motion, robot)[:, :, mine]))
            if effect.side != robot.transmission.measured:
                values = np.matmul(robot.transmission.torque_map(effect.side, robot.transmission.measured), values)
            out[:, :, places] = values
        return out

    def _by_joint(self, effect: JointEffect, motion: Motion, mine: Array, rows: int) -> Array:
        """Columns of an effect each of which shows on one joint."""
        robot = self.model.robot
        at, width = effect.at(robot), len(effect.symbols)
        out = np.zeros((rows, robot.n, len(mine)))
        joint, symbol = mine // width, mine % width
        for s, values in enumerate(effect.basis(motion.on(effect.side).of(at), motion, at)):
            chosen = np.flatnonzero(symbol == s)
            if len(chosen):
                shown = joint[chosen]
                out[:, np.asarray(at)[shown], chosen] = self.row_filter.apply(values[:, shown])
        return out

    def _links(self, motion: Motion, mine: Array, rows: int) -> Array:
        """Columns of the links: regressor tile by tile, its live entries filtered, then carried to the independent joints."""
        from ..regressor.rigid import regressor

        robot, own = self.model.robot, motion.joint
        tree = robot.tree
        row, column = self._live(mine)
        flat = row * 10 * tree.nb + mine[column]

        def tile(a: int, b: int) -> Array:
            s = slice(a, b)
            Y = regressor(
                tree, robot.tree_position(own.q[s]), robot.tree_rate(own.dq[s]), robot.tree_rate(own.ddq[s]), threads=self.threads
            )
            return np.take(Y.reshape(b - a, -1), flat, axis=1)

        found = self._filtered(tile, len(motion), len(flat))
        out = np.zeros((rows, tree.nv, len(mine)))
        out[:, row, column] = found[:rows]
        return out if robot.loop.is_trivial else np.einsum("tj,Ntk->Njk", robot.loop.W, out)

    def _live(self, mine: Array) -> tuple[Array, Array]:
        """Entries (row, place in `mine`) of the tree's regressor that are not zero by its structure: a joint bears what lies behind it."""
        tree = self.model.robot.tree
        bears = np.zeros((tree.nv, tree.nb), bool)
        for body in range(tree.nb):
            i = body
            while i >= 0:
                bears[slice(0, 6) if tree.floating and i == 0 else i + 5 * tree.floating, body] = True
                i = int(tree.parent[i])
        row, column = np.nonzero(bears[:, mine // 10])
        return row, column

    @cached_property
    def _band(self) -> tuple[int, int, Array]:
        """Samples a tile; rows before the tile's first that it has a part in; weights (rows, samples) of the tile's samples."""
        taps, factor = self.row_filter.taps, self.row_filter.factor
        size = factor * max(1, round(_TILE / factor))
        before = (len(taps) - 1) // factor
        band = np.zeros((before + size // factor, size))
        for r in range(len(band)):
            start = (r - before) * factor
            a, b = max(0, start), min(size, start + len(taps))
            band[r, a:b] = taps[a - start : b - start]
        return size, before, band

    def _filtered(self, tile: Callable[[int, int], Array], samples: int, width: int) -> Array:
        """Sum of band times tile over all tiles: the filter's output, each sample made once."""
        size, before, band = self._band
        factor = self.row_filter.factor
        total = np.zeros((before + (samples + size) // factor + 1, width))
        for a in range(0, samples, size):
            b = min(a + size, samples)
            total[a // factor : a // factor + len(band)] += band[:, : b - a] @ tile(a, b)
        return total[before:]


def live_columns(model: Model) -> Array:
    """Which base columns can be other than zero in which row, (n, b) bool, by structure."""
    robot, keep = model.robot, model.base.independent
    drive = robot.transmission
    out = np.zeros((robot.n, len(keep)), bool)
    for effect, part in zip(model.effects, model.slices, strict=True):
        places = np.flatnonzero((keep >= part.start) & (keep < part.stop))
        shown = _shown(effect, model, keep[places] - part.start)
        if effect.side != drive.measured:
            shown = (drive.torque_map(effect.side, drive.measured) != 0).astype(float) @ shown > 0
        out[:, places] = shown
    return out


def _shown(effect: Effect, model: Model, mine: Array) -> Array:
    robot = model.robot
    if isinstance(effect, RigidBody):
        rows = RowColumns(model, RowFilter(np.ones(1), 1))
        shown = np.zeros((robot.tree.nv, len(mine)), bool)
        shown[rows._live(mine)] = True
        return shown if robot.loop.is_trivial else (robot.loop.W != 0).T.astype(float) @ shown > 0
    shown = np.zeros((robot.n, len(mine)), bool)
    if isinstance(effect, JointEffect) and type(effect).columns is JointEffect.columns:
        shown[np.asarray(effect.at(robot))[mine // len(effect.symbols)], np.arange(len(mine))] = True
    else:
        shown[:] = True
    return shown
