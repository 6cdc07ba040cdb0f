"""Signals whose samples stay on disk: prepared like `ident.Preparation` prepares logs in memory, by the same strategy and rules."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ConfigurationError, UnsupportedError
from ..estimate.io import model_to_dict
from ..model import Model
from ..problem.columns import can_filter
from ..robots.robot import Robot
from ..signals.assemble import half_gain, long_enough, preparation_warnings, raised_shares, require_motion
from ..signals.cutoff import HIGHEST, CutoffChoice
from ..signals.preparation import Preparation, Recorded, Velocity
from ..signals.signals import JointReport, PreparationReport, Signals
from ..signals.uniform import Recording
from .decisions import Part, decide
from .motion import Derivation, DerivedRun, Stretch
from .rows import MakeRows, RowFacts, RowPart, StoredRows, packed_bytes, rows_in
from .runs import StoredRecording, StoredResampling, stored_runs
from .stored import StoredLog
from .workers import Workers

Array = np.ndarray
Progress = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class _Samples:
    """All samples of the derived runs, one run after the other; the stretch read last is kept."""

    runs: tuple[DerivedRun, ...]
    edges: tuple[int, ...]
    last: dict[tuple[int, int], Stretch] = field(default_factory=dict)

    def at(self, start: int, stop: int) -> Stretch:
        if (start, stop) not in self.last:
            run = max(0, int(np.searchsorted(self.edges, start, side="right")) - 1)
            if stop > self.edges[run + 1]:
                raise UnsupportedError("samples of several runs at once are not read from disk.")
            found = self.runs[run].at(start - self.edges[run], stop - self.edges[run])
            self.last.clear()
            self.last[start, stop] = found
        return self.last[start, stop]

    def times(self, places: Array) -> Array:
        run = np.searchsorted(self.edges, places, side="right") - 1
        run = np.minimum(run, len(self.runs) - 1)
        start = np.array([r.run.start for r in self.runs])
        first = np.array([r.start for r in self.runs])
        return start[run] + (first[run] + places - np.array(self.edges)[run]) / self.runs[0].run.rate


@dataclass(frozen=True, eq=False)
class _Lazy:
    """One of the arrays (N,) or (N, n) of `Signals`, computed where it is asked for: slices only."""

    samples: _Samples
    name: str
    width: int

    def __len__(self) -> int:
        return self.samples.edges[-1]

    @property
    def shape(self) -> tuple[int, ...]:
        return (len(self), self.width) if self.width else (len(self),)

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __getitem__(self, key: Any) -> Any:
        if self.name == "t" and not isinstance(key, slice):
            found = self.samples.times(np.atleast_1d(np.asarray(key)))
            return found if np.ndim(key) else found[0]
        if isinstance(key, (int, np.integer)):
            return self[int(key) : int(key) + 1][0]
        if not isinstance(key, slice):
            raise UnsupportedError("samples on disk are read by slices only.")
        start, stop, step = key.indices(len(self))
        return getattr(self.samples.at(start, stop), self.name)[::step]

    def __array__(self, *_: Any, **__: Any) -> Array:
        raise UnsupportedError("this needs the whole log in memory at once; run it without streaming (--no-stream), or on a shorter log.")


@dataclass(frozen=True, eq=False)
class StreamedSignals(Signals):
    """`Signals` of logs on disk: `t`, `q`, `dq`, `ddq`, `torque` are derived anew where a slice of them is asked for; only what there is
    per row is in memory. `parts`, `stored_model`: the rows' columns on disk, if they are kept, and the model they are of."""

    parts: tuple[RowPart, ...] = ()
    stored_model: Model | None = field(default=None, repr=False)

    def stored_rows(self, model: Model) -> StoredRows | None:
        """The rows of a model as they are on disk; None where they are those of another."""
        if self.stored_model is None or (model is not self.stored_model and not _same(model, self.stored_model)):
            return None
        return StoredRows(self.parts, self.stored_model, self)


def _same(a: Model, b: Model) -> bool:
    return a.parameters == b.parameters and model_to_dict(a) == model_to_dict(b)


@dataclass(frozen=True)
class Streaming:
    """How logs on disk are prepared. `folder`: for scratch files; `workers`: who does the work; `most_bytes`: disk space that the rows'
    columns may take (beyond it they are computed anew in every pass)."""

    folder: Path
    workers: Workers
    most_bytes: int = 20_000_000_000
    progress: Progress | None = None

    def prepare(self, prep: Preparation, logs: Sequence[StoredLog], robot: Robot, model: Model | None) -> StreamedSignals:
        """Signals of logs on disk; `model`: of whose columns the rows are kept for the passes to come. Raises as `Preparation` does."""
        self.folder.mkdir(parents=True, exist_ok=True)
        recordings = [StoredRecording.of(log, robot, self.folder) for log in logs]
        for rec in recordings:
            _require(prep, rec)
        even = stored_runs(recordings, prep.resample_hz, prep.max_gap_s, prep.cutoff_hz, self.folder)
        slowest = min(1 / r.clock.step for r in recordings)
        choice = prep._choose(even, robot, HIGHEST * slowest)  # type: ignore[arg-type]
        cutoff = choice.cutoff_hz if prep.cutoff_hz is None else float(prep.cutoff_hz)
        if prep.cutoff_hz is None and prep.max_gap_s is None:
            even = stored_runs(recordings, prep.resample_hz, None, cutoff, self.folder)
        if cutoff >= 0.5 * even.rate:
            raise ConfigurationError(f"[signals] cutoff_hz = {cutoff:g} must be below half the sample rate ({0.5 * even.rate:g} Hz).")
        derivation = Derivation(prep, even.rate, cutoff, prep._row_filter(cutoff, even.rate))
        return self._assembled(prep, robot, recordings, even, derivation, choice, model)

    def _assembled(
        self,
        prep: Preparation,
        robot: Robot,
        recordings: Sequence[StoredRecording],
        even: StoredResampling,
        derivation: Derivation,
        choice: CutoffChoice,
        model: Model | None,
    ) -> StreamedSignals:
        """The chunked counterpart of `ident.signals.assemble.assemble`."""
        row_filter, cutoff, rule = derivation.row_filter, derivation.cutoff, prep.standstill
        derived = [derivation.of(run) for run in even.runs]
        kept, short = long_enough(derived, max(len(r) for r in even.runs), even.rate, cutoff, row_filter)
        warnings = [*dict.fromkeys(note for r in recordings for note in r.notes), *short]
        size = derivation.piece
        pieces = [Part(d, a, min(a + size, len(d))) for d in kept for a in range(0, len(d), size)]
        decisions = decide(robot, kept, pieces, rule, choice, cutoff, self.workers)
        signals = self._signals(prep, robot, recordings, even, kept, derivation)
        parts = tuple(
            RowPart(kept[b.run], _within(signals, b.samples, b.run), b.rows, b.run, self.folder / f"rows-{k}.f64")
            for k, b in enumerate(signals.blocks(size))
        )
        keeps = (
            model is not None and row_filter is not None and can_filter(model) and packed_bytes(model, len(signals.tau)) <= self.most_bytes
        )
        work = MakeRows(decisions, rule is not None, prep.saturated == "mask", model if keeps else None)
        facts = _gathered(work, parts, signals.tau.shape, self.workers, self.progress)
        allowed = rule.allowed(facts.rest) if rule is not None else np.ones(robot.n)
        lost = {"torque missing": facts.missing, "torque at its limit": facts.limited, "standstill": facts.rest > allowed}
        valid = ~np.logical_or.reduce(list(lost.values()))
        tau = facts.tau
        tau[facts.missing] = np.nan
        absent = np.all([r.absent for r in recordings], axis=0)
        warnings += preparation_warnings(
            robot, decisions.still, absent, rule is not None, decisions.saturation, prep.saturated, valid, lost
        )
        warnings += raised_shares(robot, rule, allowed)
        require_motion(rule, decisions.still, [r.name for r in recordings])
        joints = tuple(
            JointReport(
                s.name, s.noise, s.suggested_hz, float(decisions.top[j]), float(decisions.threshold[j]), int(valid[:, j].sum()),
                {k: int(v[:, j].sum()) for k, v in lost.items()},
            )
            for j, s in enumerate(choice.joints)
        )  # fmt: skip
        report = replace(
            signals.report,
            cutoff_reason=choice.reason
            if prep.cutoff_hz is None
            else f"as asked; from the data {choice.cutoff_hz:.3g} Hz: {choice.reason}",
            joints=joints,
            warnings=tuple(dict.fromkeys(warnings)),
        )
        near = facts.near_reversal if prep.judges_reversals else None
        stored = work.model
        return replace(signals, tau=tau, valid=valid, near_reversal=near, report=report, parts=parts if stored else (), stored_model=stored)

    def _signals(
        self,
        prep: Preparation,
        robot: Robot,
        recordings: Sequence[StoredRecording],
        even: StoredResampling,
        kept: Sequence[DerivedRun],
        derivation: Derivation,
    ) -> StreamedSignals:
        """Signals without masks yet."""
        row_filter = derivation.row_filter
        edges = (0, *np.cumsum([len(d) for d in kept]).tolist())
        samples = _Samples(tuple(kept), edges)
        arrays: Any = {k: _Lazy(samples, k, 0 if k == "t" else robot.n) for k in ("t", "q", "dq", "ddq", "torque")}
        rows = sum(rows_in(d, row_filter) for d in kept)
        report = PreparationReport(
            config=prep.config(),
            cutoff_hz=derivation.cutoff if prep.filters_positions else None,
            cutoff_reason="",
            row_cutoff_hz=None if row_filter is None else half_gain(row_filter, even.rate),
            rate_hz=even.rate,
            row_rate_hz=even.rate / (row_filter.factor if row_filter else 1),
            samples_read=sum(len(r.t) for r in recordings),
            samples=edges[-1],
            rows=rows,
            resampled=even.text,
            joints=(),
        )
        inputs = tuple({"path": s, "sha256": h} for s, h in dict.fromkeys((r.log.source, r.log.sha256) for r in recordings if r.log.source))
        return StreamedSignals(
            robot,
            **arrays,
            tau=np.empty((rows, robot.n)),
            valid=np.zeros((rows, robot.n), bool),
            runs=tuple(slice(a, b) for a, b in itertools.pairwise(edges)),
            run_names=tuple(d.run.name for d in kept),
            rate=even.rate,
            row_filter=row_filter,
            report=report,
            inputs=inputs,
            origins=tuple(d.run.origin for d in kept),
        )


def _require(prep: Preparation, rec: StoredRecording) -> None:
    """What `Preparation._require` asks of a recording in memory, from one sample and the quantities logged."""
    # Only recorded derivatives are asked for; whether they hold NaN is seen where they are used.
    wanted = isinstance(prep, Recorded) or getattr(prep, "velocity", None) == Velocity.RECORDED
    if not wanted:
        return
    for a in range(0, len(rec.log), 1 << 17) if isinstance(prep, Recorded) else (0,):
        piece = rec.log.read(a, min(a + (1 << 17), len(rec.log)))
        assert piece.q is not None
        dq = piece.velocity(rec.robot.transmission)
        prep._require(Recording(rec.name, piece.t, piece.q, piece.q, dq, piece.ddq, rec.clock, ()))


def _within(signals: Signals, samples: slice, run: int) -> slice:
    start = signals.runs[run].start
    return slice(samples.start - start, samples.stop - start)


def _gathered(work: MakeRows, parts: Sequence[RowPart], shape: tuple[int, ...], workers: Workers, progress: Progress | None) -> RowFacts:
    """The facts of all rows, part by part into place."""
    flags = [np.zeros(shape, bool) for _ in range(3)]
    whole = RowFacts(np.empty(shape), flags[0], flags[1], np.empty(shape), flags[2])
    for part, facts in zip(parts, workers.map(work, parts), strict=True):
        for name in RowFacts.__dataclass_fields__:
            getattr(whole, name)[part.place] = getattr(facts, name)
        if progress is not None:
            progress(min(1.0, part.place.stop / max(1, shape[0])))
    return whole
