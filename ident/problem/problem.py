"""A problem: a model and prepared signals, reduced sample by sample to information on base parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._utils.short_repr import ShortRepr
from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.reference import Reference
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError, DataError, UnsupportedError
from ..model import Model
from ..regressor.row_information import information
from ..robots.transmission import Side
from ..signals.known_band import within_known_band
from ..signals.rows import KeptRows, Rows
from ..signals.signals import Signals
from ..statistics.noise import row_shape
from ..statistics.torque_error import JudgedOn, TorqueError
from .check import check_problem
from .columns import PackedColumns, RowColumns
from .information import Accumulation, Form, Information

if TYPE_CHECKING:
    from ..regressor.base_parameters.reduction import BaseReduction
    from .check import ProblemCheck

Array = np.ndarray
#: Full-rate samples held in memory at a time are limited so that their columns stay below this many numbers.
_BLOCK_NUMBERS = 4_000_000
#: Rows of a block of packed columns: few enough to stay in the cache from one step of the work to the next.
_PACKED_ROWS = 1024
#: Samples whose torque is predicted at a time.
_PREDICTED = 16_384
#: Samples a row up to which products instead of reflections save time worth having.
_FEW_SAMPLES = 4


@dataclass(frozen=True, eq=False)
class PackedRows:
    """A block of m rows: their packed `columns`, `tau` (m, n), `valid` (m, n), `place` in the signals' rows, `run`."""

    columns: PackedColumns
    tau: Array
    valid: Array
    place: slice
    run: int


@dataclass(frozen=True, eq=False, repr=False)
class Problem(ShortRepr):
    """τ = Φ p on the measured side: `model` on `signals`.

    `reference` (k,): values of all parameters from which the predicted load is taken, where an effect needs it.
    `progress`: called with the share done (0 … 1) during a pass over the samples. Raises DataError if nothing can be used.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> problem = ident.Problem(robot.rigid_body(), ident.ZeroPhase()(train, robot))
    >>> problem.base.count, problem.check().rank
    (36, 36)
    """

    model: Model
    signals: Signals
    reference: Array | None = None
    progress: Callable[[float], None] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if self.signals.robot.joint_names != self.model.robot.joint_names:
            raise ConfigurationError(
                f"the signals are of robot {self.signals.robot.name!r} ({', '.join(self.signals.robot.joint_names)}), the model is of"
                f" {self.model.robot.name!r} ({', '.join(self.model.robot.joint_names)})."
            )
        if self.model.robot.floating_base:
            raise UnsupportedError(
                f"robot {self.model.robot.name!r} has a floating base, whose motion logs of joints do not tell. Fit a log of the robot on a"
                " stand or held in the air with the base fixed: leave out [robot] floating_base (from_urdf: floating_base)."
            )

    @property
    def base(self) -> BaseReduction:
        """Base parameters of the model, from its structure."""
        return self.model.base

    @property
    def tau(self) -> Array:
        """Left side of the rows, (M, n)."""
        return self.signals.tau

    @property
    def valid(self) -> Array:
        """Which rows may be used, (M, n) bool."""
        return self.signals.valid

    @property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""
        return self.signals.row_runs

    @property
    def row_time(self) -> Array:
        """Time (M,) of each row, s."""
        return self.signals.row_time

    @property
    def row_shape(self) -> Array | None:
        """Autocorrelation that the row filter gives to white torque noise; None where rows are the samples themselves."""
        row_filter = self.signals.row_filter
        return None if row_filter is None else row_shape(row_filter.taps, row_filter.factor)

    def rows(self) -> Iterable[Rows]:
        """All rows, block by block, columns over base parameters, filtered like the torque."""
        stored = self._stored
        return self._made_rows() if stored is None else stored

    @property
    def _stored(self) -> KeptRows | None:
        """Rows made before and kept on disk, where the signals are streamed."""
        return self.signals.stored_rows(self.model)

    def _made_rows(self) -> Iterator[Rows]:
        signals, model = self.signals, self.model
        keep = self.base.independent
        size = max(64, _BLOCK_NUMBERS // (model.robot.n * len(model.parameters)))
        whole_runs = Need.HISTORY in model.needs
        total = max(1, len(self.valid))
        # Where there are links the kernel makes the base columns alone, filtered on the way.
        by_kernel = not whole_runs and any(isinstance(effect, RigidBody) for effect in model.effects)
        make = RowColumns(model, signals.row_filter, None)
        for block in signals.blocks(None if whole_runs else size):
            motion = self.motion(block.samples)
            columns = make(motion) if by_kernel else block.reduce(model.columns(motion)[:, :, keep])
            yield Rows(columns, signals.tau[block.rows], signals.valid[block.rows], block.rows, block.run)
            if self.progress is not None:
                self.progress(min(1.0, block.rows.stop / total))

    def packed_rows(self) -> Iterator[PackedRows]:
        """The same rows in small blocks, without columns that are zero in a row by structure."""
        signals, model, row_filter = self.signals, self.model, self.signals.row_filter
        if not self._plain or Need.HISTORY in model.needs or not any(isinstance(effect, RigidBody) for effect in model.effects):
            for rows in self.rows():
                packed, start = PackedColumns.of(rows.columns), rows.place.start
                for first in range(0, len(rows.tau), _PACKED_ROWS):
                    part = slice(first, min(first + _PACKED_ROWS, len(rows.tau)))
                    place = slice(start + part.start, start + part.stop)
                    yield PackedRows(packed.part(part), rows.tau[part], rows.valid[part], place, rows.run)
            return
        make = RowColumns(model, row_filter)
        for block in signals.blocks(_PACKED_ROWS if row_filter is None else _PACKED_ROWS * row_filter.factor + len(row_filter.taps)):
            columns = make.packed(self.motion(block.samples))
            yield PackedRows(columns, signals.tau[block.rows], signals.valid[block.rows], block.rows, block.run)

    @property
    def _plain(self) -> bool:
        """Rows are those of the torque equation itself, made from the signals. Other formulations have columns of their own."""
        return type(self) is Problem and self._stored is None

    def motion(self, samples: slice, needs: frozenset[Need] = frozenset()) -> Motion:
        """The motion of a range of full-rate samples, with what the model's effects (and `needs`) ask for."""
        s, model = self.signals, self.model
        run = next(i for i, r in enumerate(s.runs) if r.start <= samples.start < r.stop)
        motion = Motion.of(
            model.robot,
            s.q[samples],
            s.dq[samples],
            s.ddq[samples],
            s.t[samples],
            rate=s.rate,
            torque=s.torque[samples],
            start=s.origins[run],
            cutoff_hz=s.report.cutoff_hz,
        )
        if (model.needs | needs) & {Need.LOAD, Need.REFERENCE}:
            reference = np.zeros(len(model.parameters)) if self.reference is None else self.reference
            motion = motion.with_reference(Reference(model, reference))
        return motion

    @cached_property
    def information(self) -> Information:
        """Information on the base parameters, one triangular factor per measured row."""
        total = Information.empty(self.valid.shape[1], self.base.names)
        if self._plain and not self.model.needs and self.model.effects and isinstance(self.model.effects[0], RigidBody):
            total = self._instant_information()
        else:
            for r in self.rows():
                total = total + Information.empty(total.n, total.names).with_rows(r.columns, r.tau, r.valid)
        if not total.counts.any():
            why = next((w for w in self.signals.report.warnings if w.startswith("no row of")), "`ident check` says why.")
            raise DataError(f"no row of the log can be used: every torque is missing or masked. {why[0].upper()}{why[1:]}")
        if not total.torque_squares().any():
            runs = ", ".join(self.signals.run_names[:4])
            raise DataError(
                f"torque is exactly zero in every row that can be used ({runs}): it was not recorded, or the drives were off. Name the"
                " right columns under [columns] of a study file, or give logs of driven motion."
            )
        return total

    def _instant_information(self) -> Information:
        """Information where columns depend on the instant alone: links and row filter by the kernel, which never writes columns out.

        By products rather than reflections where the condition allows it and many rows make it worth while."""
        row_filter = self.signals.row_filter
        found = Accumulation(self.base.names, self.valid.shape[1], row_filter is None or row_filter.factor <= _FEW_SAMPLES)
        self._accumulate(found)
        if not found.sound:  # what came later was worse conditioned than the beginning
            found = Accumulation(self.base.names, self.valid.shape[1], may_square=False)
            self._accumulate(found)
        return found.information

    def _accumulate(self, into: Accumulation) -> None:
        signals, model, robot = self.signals, self.model, self.model.robot
        others = Model(robot, model.effects[1:])
        rows = robot.transmission.torque_map(Side.JOINT, robot.transmission.measured) @ robot.loop.W.T
        row_filter = signals.row_filter
        size = max(4096, _BLOCK_NUMBERS // (robot.n * max(1, len(others.parameters)) + 4 * robot.n))
        for block in signals.blocks(size):
            motion, s = self.motion(block.samples), block.samples
            factors, counts = information(
                robot.tree,
                robot.tree_position(signals.q[s]),
                robot.tree_rate(signals.dq[s]),
                robot.tree_rate(signals.ddq[s]),
                signals.tau[block.rows],
                rows=rows,
                columns=self.base.independent,
                extra=others.columns(motion) if others.effects else None,
                valid=signals.valid[block.rows],
                taps=None if row_filter is None else row_filter.taps,
                factor=1 if row_filter is None else row_filter.factor,
                form="gram" if into.form == Form.GRAM else "triangle",
            )
            into.add(factors, counts)
            if self.progress is not None:
                self.progress(min(1.0, block.rows.stop / max(1, len(self.valid))))

    def predict(self, values: Array) -> Array:
        """Torque (M, n) on the measured side, filtered like the measured one, for base values (b,)."""
        out = np.empty(self.tau.shape)
        if not self._plain:
            for rows in self.rows():
                out[rows.place] = rows.columns @ values
            return out
        everything, model = self.base.expand(values), self.model
        for block in self.signals.blocks(None if Need.HISTORY in model.needs else _PREDICTED):
            out[block.rows] = block.reduce(model.torque(self.motion(block.samples), everything))
        return out

    def residual(self, values: Array) -> Array:
        """Measured minus predicted torque (M, n); NaN in rows that are not used."""
        return np.where(self.valid, self.tau - self.predict(values), np.nan)

    def at_rows(self, signal: Array) -> Array:
        """Any signal at full rate (N, …), carried to the rows (M, …) like the columns are."""
        return self.signals.filtered(signal)

    def torque_error(self, values: Array, residual: Array | None = None) -> TorqueError:
        """Error of the torque itself for base values (b,); `residual` if it is known.

        Where accelerations are raw differences it is judged within the band where the motion is known: against raw rows a right model
        looks worse than a wrong one."""
        judged = within_known_band(self.signals)
        if judged is self.signals and residual is None:
            residual = self.residual(values)
        elif judged is not self.signals:
            residual = replace(self, signals=judged).residual(values)
        assert residual is not None
        return error_on(judged, residual, raw=judged is not self.signals)

    def with_reference(self, values: Array) -> Problem:
        """The same problem with the load predicted from all parameters' values (k,)."""
        return replace(self, reference=np.asarray(values, float))

    def check(self) -> ProblemCheck:
        """Rank, condition, base parameters and excitation, before anything is estimated."""
        return check_problem(self.model.robot, self.base, self.information)


def error_on(judged: Signals, residual: Array, *, raw: bool) -> TorqueError:
    """Torque error of a residual (M, n) on signals; `raw`: they stand for raw ones, within the band where the motion is known."""
    return TorqueError.of(residual, judged.tau, JudgedOn.KNOWN_BAND if raw else JudgedOn.ROWS, judged.report.row_cutoff_hz)
