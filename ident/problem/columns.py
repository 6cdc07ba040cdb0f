"""Columns of the regression equation at the rows: filtered and decimated while they are made, without the full-rate regressor.

The same numbers as `Problem.rows`, which forms all columns at the full rate first: filter and row map are linear, and what shows on
one joint at a time is a signal with a constant row map, which the kernel takes beside the links."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from ..effects.base import Effect
from ..effects.joint_effect import JointEffect
from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.rigid_body import RigidBody
from ..model import Model
from ..regressor.row_information import packed_columns
from ..signals.filters import RowFilter

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: Needs that a stretch of samples can meet by itself, wherever it is cut.
_LOCAL = frozenset({Need.TIME, Need.TORQUE})


def can_filter(model: Model) -> bool:
    """Whether the columns of a model depend on nothing outside the samples at hand."""
    return model.needs <= _LOCAL


@dataclass(frozen=True, eq=False)
class PackedColumns:
    """Columns at m rows without those that are zero in theirs by structure: `values` (m, w); joint j has the base columns `columns[j]`,
    which stand at `places[j]` among the values."""

    values: Array
    places: tuple[Array, ...]
    columns: tuple[Array, ...]

    @classmethod
    def of(cls, dense: Array) -> PackedColumns:
        """Columns (m, n, b), all of which may be other than zero."""
        m, n, b = dense.shape
        return cls(dense.reshape(m, n * b), tuple(np.arange(j * b, (j + 1) * b) for j in range(n)), (np.arange(b),) * n)

    def part(self, rows: slice) -> PackedColumns:
        """Some of the rows."""
        return PackedColumns(self.values[rows], self.places, self.columns)

    def dense(self, count: int) -> Array:
        """The same as (m, n, b) with b = `count` columns."""
        out = np.zeros((len(self.values), len(self.places), count))
        for j, (places, columns) in enumerate(zip(self.places, self.columns, strict=True)):
            out[:, j, columns] = self.values[:, places]
        return out


@dataclass(frozen=True, eq=False)
class RowColumns:
    """Base columns of `model` at the rows of `row_filter` (None: rows are samples). `threads`: of the kernel."""

    model: Model
    row_filter: RowFilter | None
    threads: int | None = 1

    def __call__(self, motion: Motion) -> Array:
        """Columns (m, n, b) at the rows of a stretch of samples, measured side."""
        return self.packed(motion).dense(len(self.model.base.independent))

    def packed(self, motion: Motion) -> PackedColumns:
        """The same, packed."""
        robot, row_filter, layout = self.model.robot, self.row_filter, self._layout
        found = []
        if layout.chosen is not None:
            own, signals = motion.joint, [share.values(motion, robot) for share in layout.signals]
            packed, live = packed_columns(
                robot.tree,
                robot.tree_position(own.q),
                robot.tree_rate(own.dq),
                robot.tree_rate(own.ddq),
                rows=layout.rows,
                columns=layout.chosen,
                extra=np.concatenate(signals, axis=1) if signals else None,
                pattern=layout.pattern,
                taps=None if row_filter is None else row_filter.taps,
                factor=1 if row_filter is None else row_filter.factor,
                threads=self.threads,
            )
            found.append(_ColumnGroup(packed, tuple(layout.places[shown] for shown in live)))
        for effect, at, mine, to_measured in layout.others:
            values = np.ascontiguousarray(effect.columns(motion, robot)[:, :, mine])
            values = values if row_filter is None else row_filter.apply(values)
            values = values if to_measured is None else np.matmul(to_measured, values)
            found.append(_ColumnGroup(values.reshape(len(values), robot.n * len(at)), (at,) * robot.n))
        return _together(found, len(motion) if row_filter is None else row_filter.count(len(motion)), robot.n)

    @cached_property
    def _layout(self) -> _ColumnLayout:
        return _ColumnLayout.of(self.model)


@dataclass(frozen=True, eq=False)
class _ColumnLayout:
    """What makes which base columns of a model.

    The kernel makes those at `places`, columns `chosen` of the links, which the row map `rows` carries, and of `signals`, which show by a
    `pattern` (None: there are none). `others` make theirs, each with the places, which of the effect's own columns they are, and the map
    to the measured side (None: they are there)."""

    rows: Array
    chosen: Array | None
    places: Array
    signals: tuple[_Signals, ...]
    pattern: Array | None
    others: tuple[tuple[Effect, Array, Array, Array | None], ...]

    @classmethod
    def of(cls, model: Model) -> _ColumnLayout:
        """By effect."""
        robot, keep = model.robot, model.base.independent
        drive, tree = robot.transmission, robot.tree
        rows = np.zeros((robot.n, tree.nv))
        chosen: list[int] = []
        places: list[int] = []
        pattern: list[Array] = []
        signals, others = [], []
        for effect, part in zip(model.effects, model.slices, strict=True):
            at = np.flatnonzero((keep >= part.start) & (keep < part.stop))
            mine = keep[at] - part.start
            to_measured = drive.torque_map(effect.side, drive.measured)
            if not len(at):
                continue
            if isinstance(effect, RigidBody):
                rows = to_measured @ robot.loop.W.T
                chosen += mine.tolist()
                places += at.tolist()
            elif _by_joint(effect) and Need.TORQUE not in effect.needs:
                share = _Signals.of(effect, model, mine)
                chosen += range(10 * tree.nb + len(pattern), 10 * tree.nb + len(pattern) + len(at))
                places += at.tolist()
                signals.append(share)
                pattern += list(to_measured[:, share.joints].T)
            else:
                others.append((effect, at, mine, None if effect.side == drive.measured else to_measured))
        whole = np.array(pattern).T if signals else None
        return cls(rows, np.array(chosen) if chosen else None, np.array(places, int), tuple(signals), whole, tuple(others))


@dataclass(frozen=True, eq=False)
class _ColumnGroup:
    """Values (m, w) of columns, joint after joint, and which base columns each joint has."""

    values: Array
    columns: tuple[Array, ...]


def _together(groups: list[_ColumnGroup], count: int, n: int) -> PackedColumns:
    if not groups:
        return PackedColumns(np.zeros((count, 0)), (np.zeros(0, int),) * n, (np.zeros(0, int),) * n)
    columns = tuple(np.concatenate([g.columns[j] for g in groups]) for j in range(n))
    places: list[list[Array]] = [[] for _ in range(n)]
    start = 0
    for g in groups:
        for j in range(n):
            places[j].append(np.arange(start, start + len(g.columns[j])))
            start += len(g.columns[j])
    values = groups[0].values if len(groups) == 1 else np.concatenate([g.values for g in groups], axis=1)
    return PackedColumns(values, tuple(np.concatenate(p) for p in places), columns)


def _by_joint(effect: Effect) -> TypeGuard[JointEffect]:
    """Whether each column of an effect shows on one joint."""
    return isinstance(effect, JointEffect) and type(effect).columns is JointEffect.columns


@dataclass(frozen=True, eq=False)
class _Signals:
    """Columns of an effect that show on one joint each, `joints`: for each symbol which of the effect's joints `shown` (None: all), and the
    `order` in which these come one after the other (None: as they are)."""

    effect: JointEffect
    joints: Array
    shown: tuple[Array | None, ...]
    order: Array | None

    @classmethod
    def of(cls, effect: JointEffect, model: Model, mine: Array) -> _Signals:
        """For columns `mine` of the effect."""
        at, width = effect.at(model.robot), len(effect.symbols)
        joint, symbol = mine // width, mine % width
        every = np.arange(len(at))
        shown = [joint[symbol == s] for s in range(width)]
        order = np.argsort(np.concatenate([np.flatnonzero(symbol == s) for s in range(width)])) if width > 1 else None
        return cls(effect, np.asarray(at)[joint], tuple(None if np.array_equal(x, every) else x for x in shown), order)

    def values(self, motion: Motion, robot: Robot) -> Array:
        """Values (L, c) along a motion."""
        effect, at = self.effect, self.effect.at(robot)
        found = [x if shown is None else x[:, shown] for x, shown in zip(effect.column_values(motion, at), self.shown, strict=True)]
        return found[0] if self.order is None else np.concatenate(found, axis=1)[:, self.order]


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
        tree = robot.tree
        # A joint bears what lies behind it.
        bears = np.zeros((tree.nv, tree.nb), bool)
        for body in range(tree.nb):
            i = body
            while i >= 0:
                bears[slice(0, 6) if tree.floating and i == 0 else i + 5 * tree.floating, body] = True
                i = int(tree.parent[i])
        shown = bears[:, mine // 10]
        return shown if robot.loop.is_trivial else (robot.loop.W != 0).T.astype(float) @ shown > 0
    shown = np.zeros((robot.n, len(mine)), bool)
    if _by_joint(effect):
        shown[np.asarray(effect.at(robot))[mine // len(effect.symbols)], np.arange(len(mine))] = True
    else:
        shown[:] = True
    return shown
