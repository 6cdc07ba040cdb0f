"""Signals: prepared runs, ready to be set against a model, and the report of how they were prepared."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from ..drawing.document import Figure
from ..drawing.shown import Shown
from ..errors import ConfigurationError, DataError, unknown_name
from ..logs.log import spread
from .filters import RowFilter
from .pictures import signals_figure, signals_frame
from .timeline import Timeline

if TYPE_CHECKING:
    import pandas as pd

    from ..logs.log import LogSet
    from ..model import Model
    from ..robots.robot import Robot
    from .rows import KeptRows

Array = np.ndarray


@dataclass(frozen=True)
class JointReport:
    """How one joint fared. `noise`: standard deviation of its position (rad or m); `suggested_hz`: highest cut-off its noise allows
    (0 if it does not move); `top_speed` and `threshold` on the measured side (rad/s or m/s; below the threshold the joint
    stands still); `rows` used of all; `lost`: reason → rows lost; `repeats`: how often the same noise comes again (0: never, as far
    as is known), because the motion repeats itself to within it."""

    name: str
    noise: float
    suggested_hz: float
    top_speed: float
    threshold: float
    rows: int
    lost: dict[str, int]
    repeats: float = 0.0


@dataclass(frozen=True, repr=False)
class PreparationReport(ShortRepr):
    """What was done to the logs. `config`: the strategy's settings; `cutoff_hz` (None: positions unfiltered) and why;
    `row_cutoff_hz`, `row_rate_hz`, `rate_hz`; `samples` used of `samples_read`; `rows`: regression rows per joint before masking;
    `resampled`: what became of the time stamps; `warnings`: what the user should know."""

    config: dict[str, Any]
    cutoff_hz: float | None
    cutoff_reason: str
    row_cutoff_hz: float | None
    rate_hz: float
    row_rate_hz: float
    samples_read: int
    samples: int
    rows: int
    resampled: str
    joints: tuple[JointReport, ...]
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """For JSON results."""
        plain = {k: getattr(self, k) for k in self.__dataclass_fields__ if k != "joints"}
        return {**plain, "joints": [vars(j) for j in self.joints]}

    def text(self) -> str:
        """For people."""
        rows = (
            "rows not filtered" if self.row_cutoff_hz is None else f"rows: low-pass {self.row_cutoff_hz:.3g} Hz, {self.row_rate_hz:.4g} Hz"
        )
        cutoff = "positions not filtered" if self.cutoff_hz is None else f"cut-off {self.cutoff_hz:.3g} Hz ({self.cutoff_reason})"
        lines = [
            f"{self.config.get('method', 'prepared')}: {cutoff}",
            f"{rows}; {self.samples} of {self.samples_read} samples at {self.rate_hz:.6g} Hz, {self.rows} rows a joint",
            f"time stamps: {self.resampled}",
            f"{'joint':<24}{'noise':>10}{'cut-off':>9}{'top speed':>11}{'still <':>10}{'rows':>8}  lost",
        ]
        for j in self.joints:
            lost = ", ".join(f"{reason} {count}" for reason, count in j.lost.items() if count) or "none"
            limit = f"{j.suggested_hz:.3g}" if j.suggested_hz else "-"
            lines.append(f"{j.name[:23]:<24}{j.noise:>10.2e}{limit:>9}{j.top_speed:>11.3g}{j.threshold:>10.2g}{j.rows:>8}  {lost}")
        return "\n".join([*lines, *(f"warning: {w}" for w in self.warnings)])

    def __str__(self) -> str:
        return self.text()


@dataclass(frozen=True, eq=False)
class Block:
    """A piece of one run: `samples` at full rate, with the margins its `rows` need. `run` counts runs."""

    samples: slice
    rows: slice
    run: int
    row_filter: RowFilter | None = field(default=None, repr=False)

    def reduce(self, columns: Array) -> Array:
        """Columns (or any signal) at the samples (L, …) → at the rows (rows, …), filtered like the torque."""
        return columns if self.row_filter is None else self.row_filter.apply(columns)


@dataclass(frozen=True, eq=False, repr=False)
class Signals(Shown, ShortRepr):
    """Prepared runs, concatenated. N samples at full rate, M rows of the regression equation for each of n joints.

    `t` (N,) s; `q`, `dq`, `ddq` (N, n) joint side; `torque` (N, n) on the measured side at full rate, not filtered (NaN where
    missing); `tau` (M, n) on the measured side, filtered like the rows; `valid` (M, n): the row may be used; `runs`: the
    samples of each uniform run; `rate` in Hz; `row_filter` acts on both sides of the equation (None: rows are samples). `origins`: for each
    run the time at which its recording began (its first sample, if not given). `source`: the logs, while these are all of their rows.
    `near_reversal` (M, n), if known: a reversal or a standstill of the joint reaches into the row.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> signals = ident.ZeroPhase()(train, ident.load_robot("puma560"))
    >>> signals.valid.shape == signals.tau.shape
    True
    """

    robot: Robot
    t: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    tau: Array
    valid: Array
    runs: tuple[slice, ...]
    run_names: tuple[str, ...]
    rate: float
    row_filter: RowFilter | None
    report: PreparationReport
    inputs: tuple[dict[str, str], ...] = ()
    origins: tuple[float, ...] = ()
    source: LogSet | None = field(default=None, repr=False)
    near_reversal: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not self.origins:
            object.__setattr__(self, "origins", tuple(float(self.t[r.start]) if r.stop > r.start else 0.0 for r in self.runs))
        count = sum(self._count(r.stop - r.start) for r in self.runs)
        if len(self.tau) != count or self.valid.shape != self.tau.shape:
            raise DataError(f"signals: {len(self.tau)} rows of torque do not fit {count} rows of motion.")

    def __len__(self) -> int:
        return len(self.t)

    def __str__(self) -> str:
        return self.report.text()

    def figure(self) -> Figure:
        """Position, velocity, acceleration and torque of each joint at the rows; see `plot`."""
        return signals_figure(self.robot, Timeline.of([self]), self.dq[self.centres], self.tau, self.valid, self.row_rate)

    def to_frame(self) -> pd.DataFrame:
        """One row for each row of the regression equation: run, t, and for each joint position, velocity, acceleration, torque and whether
        it is used."""
        at = self.centres
        runs = [name for name, rows in zip(self.run_names, self.row_runs, strict=True) for _ in range(rows.stop - rows.start)]
        motion = {"position": self.q[at], "velocity": self.dq[at], "acceleration": self.ddq[at]}
        return signals_frame(self.robot, self.row_time, runs, motion | {"effort": self.tau, "used": self.valid})

    def _count(self, samples: int) -> int:
        return samples if self.row_filter is None else self.row_filter.count(samples)

    @cached_property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""
        edges = np.cumsum([0, *(self._count(r.stop - r.start) for r in self.runs)]).tolist()
        return tuple(slice(a, b) for a, b in itertools.pairwise(edges))

    def rows(self, run: int) -> slice:
        """The rows of a run."""
        return self.row_runs[run]

    @cached_property
    def centres(self) -> Array:
        """Sample (M,) on which each row is centred."""
        if self.row_filter is None:
            return np.concatenate([np.arange(r.start, r.stop) for r in self.runs]) if self.runs else np.zeros(0, int)
        return np.concatenate([r.start + self.row_filter.centres(r.stop - r.start) for r in self.runs]) if self.runs else np.zeros(0, int)

    @property
    def row_time(self) -> Array:
        """Time (M,) of each row, s."""
        return self.t[self.centres]

    @property
    def row_rate(self) -> float:
        """Rows a second."""
        return self.rate / (self.row_filter.factor if self.row_filter else 1)

    def blocks(self, samples: int | None = 65536) -> Iterator[Block]:
        """Pieces of about so many samples, run by run, in order; None: whole runs. Rows are exact at the borders."""
        for i, (run, rows) in enumerate(zip(self.runs, self.row_runs, strict=True)):
            total = rows.stop - rows.start
            filter_ = self.row_filter
            if samples is None:
                per = max(1, total)
            elif filter_ is None:
                per = max(1, samples)
            else:
                per = max(1, (samples - len(filter_.taps)) // filter_.factor + 1)
            for first in range(0, total, per):
                last = min(first + per, total)
                support = slice(first, last) if filter_ is None else filter_.support(first, last)
                yield Block(
                    slice(run.start + support.start, run.start + support.stop), slice(rows.start + first, rows.start + last), i, filter_
                )

    def stored_rows(self, model: Model) -> KeptRows | None:
        """The rows of a model, where they were made before and are kept on disk (`ident.streaming`); None here."""
        return None

    def filtered(self, signal: Array) -> Array:
        """Any signal at full rate (N, …) → at the rows (M, …), filtered like the torque."""
        parts = [block.reduce(signal[block.samples]) for block in self.blocks(None)]
        return np.concatenate(parts) if parts else np.empty((0, *signal.shape[1:]))

    def select_rows(self, rows: Sequence[slice], names: Sequence[str] | None = None) -> Signals:
        """Parts of runs as runs of their own. `rows`: slices of rows, each within one run. The rows stay exactly the same."""
        samples, kept, labels, origins = [], [], [], []
        for k, part in enumerate(rows):
            start, stop = int(part.start or 0), len(self.tau) if part.stop is None else int(part.stop)
            i = next((i for i, r in enumerate(self.row_runs) if r.start <= start and stop <= r.stop and start < stop), None)
            if i is None:
                raise ConfigurationError(f"rows {start}:{stop} do not lie within one run of the signals.")
            first = start - self.row_runs[i].start
            support = (
                slice(first, first + stop - start) if self.row_filter is None else self.row_filter.support(first, first + stop - start)
            )
            samples.append(np.arange(self.runs[i].start + support.start, self.runs[i].start + support.stop))
            kept.append(np.arange(start, stop))
            labels.append(names[k] if names else self.run_names[i])
            origins.append(self.origins[i])
        if not samples:
            raise DataError("no rows were selected.")
        at, rows_at = np.concatenate(samples), np.concatenate(kept)
        edges = np.cumsum([0, *(len(s) for s in samples)]).tolist()
        return replace(
            self,
            **{k: getattr(self, k)[at] for k in ("t", "q", "dq", "ddq", "torque")},
            tau=self.tau[rows_at],
            valid=self.valid[rows_at],
            near_reversal=None if self.near_reversal is None else self.near_reversal[rows_at],
            runs=tuple(slice(a, b) for a, b in itertools.pairwise(edges)),
            run_names=tuple(labels),
            origins=tuple(origins),
            source=None,
        )

    def select_runs(self, runs: Iterable[int | str]) -> Signals:
        """Some runs, by number or name (every run of that name), in the order of the signals."""
        wanted: set[int] = set()
        for run in runs:
            if isinstance(run, str) and run not in self.run_names:
                raise unknown_name("run", run, self.run_names)
            wanted |= {i for i, name in enumerate(self.run_names) if name == run} if isinstance(run, str) else {range(len(self.runs))[run]}
        chosen = [i for i in sorted(wanted) if self.row_runs[i].stop > self.row_runs[i].start]
        return self.select_rows([self.row_runs[i] for i in chosen], [self.run_names[i] for i in chosen])

    def split(self, by: str = "fraction", held: float = 0.25, blocks: int = 8) -> tuple[Signals, Signals]:
        """`(fit, held)` without a common sample. `by`: "fraction" (the last part of every run), "blocks" (evenly spread ones of
        `blocks` parts of every run) or "run". Prefer splitting logs before preparing them; this is for cross-validation."""
        if by == "run":
            out = spread(len(self.runs), held)
            if not out:
                raise ConfigurationError('split: one run cannot be split by run; use by="fraction" or by="blocks".')
            return self.select_runs([i for i in range(len(self.runs)) if i not in out]), self.select_runs(sorted(out))
        if by not in ("fraction", "blocks"):
            raise unknown_name("way to split", by, ("run", "fraction", "blocks"))
        # Rows on both sides of a border share samples unless they are a filter's length apart.
        apart = 0 if self.row_filter is None else -(-(len(self.row_filter.taps) - 1) // self.row_filter.factor)
        parts: tuple[list[slice], list[slice]] = ([], [])
        for run in self.row_runs:
            size = run.stop - run.start
            cuts = [0.0, 1 - held, 1.0] if by == "fraction" else [i / blocks for i in range(blocks + 1)]
            chosen = {1} if by == "fraction" else spread(blocks, held)
            edges = [run.start + round(c * size) for c in cuts]
            for i, (a, b) in enumerate(itertools.pairwise(edges)):
                first = a + (apart if i and (i in chosen) != (i - 1 in chosen) else 0)
                if first < b:
                    parts[i in chosen].append(slice(first, b))
        if not parts[0] or not parts[1]:
            raise DataError("split: the runs are too short to hold out a part.")
        return self.select_rows(parts[0]), self.select_rows(parts[1])

    def without_reversals(self, joints: Iterable[str]) -> Signals:
        """The same signals without the rows of some joints into which a reversal or standstill of theirs reaches."""
        if self.near_reversal is None:
            return self
        at = [self.robot.joint_index(j) for j in joints]
        valid = self.valid.copy()
        valid[:, at] &= ~self.near_reversal[:, at]
        return replace(self, valid=valid, source=None)

    def without(self, joints: Iterable[str]) -> Signals:
        """The same signals with all rows of some joints masked."""
        valid = self.valid.copy()
        for joint in joints:
            valid[:, self.robot.joint_index(joint)] = False
        return replace(self, valid=valid, source=None)
