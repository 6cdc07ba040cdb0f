"""A study taken up with its logs on disk: the steps of `ident.study.session.Session`, in memory that does not grow with the logs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.text import counted
from ..effects.kinds import Need
from ..errors import DataError, IdentError, UnsupportedError
from ..estimators.base import Capability, estimator_types
from ..logs.files import content_file
from ..problem.integrated import TORQUE
from ..problem.problem import Problem
from ..signals.likewise import like
from ..study.session import HELD_SHARE, Session
from .audit import audit_stored
from .checkpoint import Checkpoint, key_of
from .clock import first_at_or_after
from .disk import give_back_memory, reuse_memory
from .ingest import Reading, store_logs
from .signals import StreamedSignals, Streaming
from .stored import StoredLog
from .tables import is_streamable
from .workers import Threads, Workers

if TYPE_CHECKING:
    from ..auditing import Audit
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..signals.preparation import Preparation
    from ..study.study import Study

Progress = Callable[[float], None]

#: Bytes of logs (text, and compressed formats as what they unpack to, roughly) from which on they are streamed unasked.
THRESHOLD = 500_000_000
#: Share of the work that each phase begins and ends at, for progress.
_PHASES = {"fit": (0.0, 0.5), "validate": (0.8, 0.9), "rows-fit": (0.5, 0.8), "rows-held": (0.9, 1.0)}
_UNPACKS = {".gz": 3.0, ".bz2": 4.0, ".xz": 4.0, ".parquet": 2.0, ".pq": 2.0}


def size_of(files: Iterable[Path]) -> int:
    """Bytes of text that the logs are worth."""
    content = [content_file(f) if f.exists() else f for f in files]
    return int(sum(f.stat().st_size * _UNPACKS.get(f.suffix.lower(), 1.0) for f in content if f.is_file()))


def why_not(study: Study) -> str:
    """Why a study cannot be streamed; "" if it can."""
    for path in (*study.fit_files(), *study.validation_files()):
        if not is_streamable(path):
            return f"log {path} is a MAT file, which cannot be streamed"
    if study.form != TORQUE:
        return f"the {study.form} form needs whole logs"
    name = study.make_estimator().name
    kinds = estimator_types()
    if Capability.STREAMING not in kinds[name].capabilities:
        able = ", ".join(k for k, kind in kinds.items() if Capability.STREAMING in kind.capabilities)
        return f"method {name!r} needs the whole log in memory (methods that do not: {able})"
    return ""


@dataclass(frozen=True, eq=False)
class StreamedSession(Session):
    """A study taken up: robot, model, logs and signals, each made when it is first needed, in the files of `checkpoint`.

    `jobs`: threads; `workers`: who does the work, if not threads of this process; `skip_bad_files`: files that cannot be read are left
    out, with a warning, rather than being an error."""

    checkpoint: Checkpoint = field(default_factory=Checkpoint.scratch)
    jobs: int = 1
    workers: Workers | None = None
    skip_bad_files: bool = False
    _held: Future[StreamedSignals] | None = field(default=None, init=False, repr=False)

    @classmethod
    def of(
        cls,
        study: Study,
        *,
        out: Path | None = None,
        resume: bool = False,
        force: bool = False,
        jobs: int = 1,
        workers: Workers | None = None,
        skip_bad_files: bool = False,
        progress: Any = None,
    ) -> StreamedSession:
        """`out`: the folder of results, beside which unfinished work is kept; without it nothing outlasts the process.

        Raises UnsupportedError for what cannot be streamed, ConfigurationError for unfinished work that is in the way."""
        reason = why_not(study)
        if reason:
            raise UnsupportedError(f"cannot be streamed: {reason}. Read it into memory (--no-stream).")
        robot = study.robot()
        needs = study.model(robot).needs
        if Need.HISTORY in needs:
            raise UnsupportedError(
                "cannot be streamed: an effect depends on all of the motion before. Read the log into memory (--no-stream)."
            )
        if out is None:
            checkpoint = Checkpoint.scratch()
        else:
            files = (*study.fit_files(), *study.validation_files())
            settings = {"study": study.to_toml(), "skip_bad_files": skip_bad_files}
            checkpoint = Checkpoint.beside(out, key_of(files, settings), resume=resume, force=force)
        return cls(study, progress, checkpoint=checkpoint, jobs=jobs, workers=workers, skip_bad_files=skip_bad_files)

    @property
    def _workers(self) -> Workers:
        return self.workers or Threads(self.jobs)

    @cached_property
    def _fit_files(self) -> tuple[tuple[StoredLog, ...], tuple[str, ...]]:
        return self._stored(self.study.fit_files(), "fit")

    @cached_property
    def _held_files(self) -> tuple[tuple[StoredLog, ...], tuple[str, ...]]:
        return self._stored(self.study.validation_files(), "validate")

    @property
    def stored(self) -> tuple[StoredLog, ...]:
        """The logs named for fitting, on disk."""
        return self._fit_files[0]

    @property
    def skipped(self) -> tuple[str, ...]:
        """What was left out because it could not be read, with the reason."""
        return self._fit_files[1] + (() if self.held_by_split else self._held_files[1])

    def _stored(self, files: Sequence[Path], name: str) -> tuple[tuple[StoredLog, ...], tuple[str, ...]]:
        self.checkpoint.require_space(2 * size_of((*self.study.fit_files(), *self.study.validation_files())) // 3)
        reading = Reading.of(self.study, self.robot)
        progress = self._phase(name)
        return store_files(files, self.checkpoint, name, reading, self._workers, skip=self.skip_bad_files, progress=progress)

    @cached_property
    def _stored_parts(self) -> tuple[tuple[StoredLog, ...], tuple[StoredLog, ...]]:
        if not self.held_by_split:
            return self.stored, self._held_files[0]
        fit, held = [], []
        for log in self.stored:
            cut = first_at_or_after(log.t, float(log.t[0]) + (1 - HELD_SHARE) * log.duration)
            fit.append(log.part(0, cut))
            held.append(log.part(cut, len(log), f"{log.name} (last part)"))
        kept = tuple(tuple(log for log in part if len(log) >= 2) for part in (fit, held))
        if not all(kept):
            raise DataError("split: the logs are too short to hold out a part.")
        return kept[0], kept[1]

    @cached_property
    def audit(self) -> Audit:
        """Audit of the logs named for fitting."""
        logs, robot = self.stored, self.robot
        if self._workers.threads < 2:
            found = audit_stored(logs, robot)
        else:
            # Whoever asks for the audit wants the signals next: one processor each. What they raise is raised when they are asked for.
            with ThreadPoolExecutor(1) as beside:
                audited = beside.submit(audit_stored, logs, robot)
                with suppress(IdentError):
                    self.fit_signals  # noqa: B018
                found = audited.result()
        give_back_memory()
        return found

    def _streaming(self, name: str) -> Streaming:
        return Streaming(self.checkpoint.part(name), self._workers, progress=self._phase(name))

    def _phase(self, name: str) -> Progress | None:
        """Progress of one phase as progress of the whole."""
        if self.progress is None:
            return None
        show, (start, stop) = self.progress, _PHASES[name]
        return lambda share: show(start + (stop - start) * share)

    @cached_property
    def fit_signals(self) -> StreamedSignals:
        """The signals that are fitted."""
        return self._streaming("rows-fit").prepare(self.study.make_preparation(), self._stored_parts[0], self.robot, self.model)

    @cached_property
    def held_signals(self) -> StreamedSignals:
        """The signals that no fit sees, prepared like the fitted ones. Raises DataError where they are too short."""
        return self._prepare_held() if self._held is None else self._held.result()

    def _prepare_held(self) -> StreamedSignals:
        prep = like(self.fit_signals.report.to_dict())
        with self._naming_held_out():
            return self._streaming("rows-held").prepare(prep, self._stored_parts[1], self.robot, self.model)

    @cached_property
    def problem(self) -> Problem:
        """The declared model on the fitted signals."""
        return Problem(self.model, self.fit_signals)

    @cached_property
    def estimate(self) -> Estimate:
        """The estimate that the study asks for."""
        if self._workers.threads < 2:
            found = super().estimate
        else:
            # The solution is sought by one thread; meanwhile the others prepare what it will be judged on.
            self.fit_signals  # noqa: B018
            with ThreadPoolExecutor(1) as beside:
                object.__setattr__(self, "_held", beside.submit(self._prepare_held))
                found = super().estimate
        return found

    @property
    def inputs_apart(self) -> tuple[tuple[dict[str, Any], ...], tuple[dict[str, Any], ...]]:
        """Paths and SHA-256 of the logs that are fitted, and of those named to validate on."""
        held = () if self.held_by_split else self._held_files[0]
        fit, others = (
            tuple({"path": s, "sha256": h} for s, h in dict.fromkeys((log.source, log.sha256) for log in logs))
            for logs in (self.stored, held)
        )
        return fit, others


def store_files(
    files: Sequence[Path], checkpoint: Checkpoint, name: str, reading: Reading, workers: Workers, *, skip: bool, progress: Progress | None
) -> tuple[tuple[StoredLog, ...], tuple[str, ...]]:
    """Every run of the files, on disk, and which files were left out and why (with `skip`; else DataError is raised)."""
    reuse_memory()
    alone = len(files) == 1 and isinstance(workers, Threads)
    reading = replace(reading, jobs=workers.threads if alone else 1)
    tasks = [ReadTask(path, checkpoint.part(f"{name}-{i}"), reading, skip, progress if alone else None) for i, path in enumerate(files)]
    logs: list[StoredLog] = []
    skipped: list[str] = []
    for i, found in enumerate(workers.map(read_task, tasks)):
        if isinstance(found, str):
            skipped.append(found)
        else:
            logs += found
        if progress is not None and not alone:
            progress((i + 1) / len(tasks))
    give_back_memory()
    if not logs:
        raise DataError(f"none of {counted(len(files), 'log')} can be read; the first: {skipped[0]}")
    return tuple(_named_apart(logs)), tuple(skipped)


def stored_signals(
    study: Study, model: Model, prep: Preparation, checkpoint: Checkpoint, jobs: int, skip: bool, progress: Progress | None
) -> StreamedSignals:
    """The logs to fit of a study as signals for a model, prepared in a given way."""
    reading = Reading.of(study, model.robot)
    checkpoint.require_space(2 * size_of(study.fit_files()) // 3)
    logs, skipped = store_files(study.fit_files(), checkpoint, "fit", reading, Threads(jobs), skip=skip, progress=progress)
    found = Streaming(checkpoint.part("rows-fit"), Threads(jobs)).prepare(prep, logs, model.robot, model)
    left_out = tuple(f"left out: {reason}" for reason in skipped)
    return replace(found, report=replace(found.report, warnings=(*left_out, *found.report.warnings)))


@dataclass(frozen=True)
class ReadTask:
    """A file to be read into a folder; `skip`: say why it cannot be read instead of raising."""

    path: Path
    folder: Path
    reading: Reading
    skip: bool
    progress: Any = None


def read_task(task: ReadTask) -> tuple[StoredLog, ...] | str:
    """The runs of a file, or why it was skipped."""
    try:
        return store_logs(task.path, task.folder, task.reading, task.progress)
    except IdentError as error:
        if not task.skip:
            raise
        return str(error)


def _named_apart(logs: list[StoredLog]) -> list[StoredLog]:
    """Runs of the same name are numbered, as `read_logs` does."""
    names: dict[str, int] = {}
    out = []
    for log in logs:
        names[log.name] = names.get(log.name, 0) + 1
        out.append(log if names[log.name] == 1 else replace(log, name=f"{log.name} ({names[log.name]})"))
    return out
