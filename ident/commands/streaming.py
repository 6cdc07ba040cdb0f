"""Whether a command reads its logs whole or streams them: arguments, the choice, and the session."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..errors import ConfigurationError, IdentError
from ..logs.reading import read_logs
from ..signals.likewise import like
from ..streaming.checkpoint import Checkpoint
from ..streaming.session import THRESHOLD, StreamedSession, size_of, stored_signals, why_not
from ..study.session import Session
from .common import Output

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from ..study.study import Study

#: Threads that are taken unasked: each needs some 20 MB, and with four the memory stays below 300 MB.
_MOST_JOBS = 4


def add_streaming_arguments(parser: argparse.ArgumentParser) -> None:
    """`--stream`, `--no-stream`, `--jobs`, `--resume`, `--skip-bad-files`."""
    group = parser.add_argument_group("large logs")
    group.add_argument(
        "--stream",
        action=argparse.BooleanOptionalAction,
        help="read the logs in chunks, in constant memory (automatic from 500 MB of logs on)",
    )
    group.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help=f"threads for streamed work; they do not change the results (default: processors, {_MOST_JOBS} at most)",
    )
    group.add_argument("--resume", action="store_true", help="resume streamed work that was interrupted (from the checkpoint in --out)")
    group.add_argument("--skip-bad-files", action="store_true", help="skip files that cannot be read, with a warning in the result")


def wants_streaming(args: argparse.Namespace, study: Study, out: Output) -> bool:
    """Whether to stream: as asked, else by the size of the logs, which is then said."""
    return _large(args, study, out, lambda: why_not(study))


def _large(args: argparse.Namespace, study: Study, out: Output, why_not: Callable[[], str] = str) -> bool:
    if args.stream is not None:
        return bool(args.stream)
    if args.resume:
        return True
    size = size_of((*study.fit_files(), *study.validation_files()))
    if size < THRESHOLD:
        return False
    reason = why_not()
    if reason:
        out.note(f"note: {size / 1e9:.1f} GB of logs are read into memory, because {reason}.")
        return False
    out.note(f"note: {size / 1e9:.1f} GB of logs are streamed (--no-stream reads them into memory).")
    return True


def job_count(args: argparse.Namespace) -> int:
    """Threads for streamed work. Raises ConfigurationError."""
    if args.jobs is None:
        return min(_MOST_JOBS, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)
    if args.jobs < 1:
        raise ConfigurationError(f"--jobs {args.jobs}: must be 1 or more.")
    return int(args.jobs)


@contextmanager
def signals_from(args: argparse.Namespace, study: Study, out: Output, estimate: Estimate) -> Iterator[Signals]:
    """The study's logs as signals for a fit that was saved, prepared as that fit's were."""
    robot, prep = estimate.model.robot, like(estimate.signals_config)
    if not _large(args, study, out):
        logs = read_logs(
            [*map(str, study.fit_files())], robot, study.columns or None, skip_bad_files=args.skip_bad_files, **study.reading()
        )
        for reason in logs.left_out:
            out.note(f"left out: {reason}")
        yield prep(logs)
        return

    checkpoint = Checkpoint.scratch()
    try:
        yield stored_signals(study, estimate.model, prep, checkpoint, job_count(args), args.skip_bad_files, out.progress("reading"))
    finally:
        checkpoint.remove()


@contextmanager
def session_from(args: argparse.Namespace, study: Study, out: Output, label: str) -> Iterator[Session]:
    """The session of a command. Streamed work is thrown away when the command ends well, or cannot be taken up again anyway."""
    if not wants_streaming(args, study, out):
        yield Session(study, out.progress(label), args.skip_bad_files)
        return

    session = StreamedSession.of(
        study,
        out=out.folder,
        resume=args.resume,
        force=out.force,
        jobs=job_count(args),
        skip_bad_files=args.skip_bad_files,
        progress=out.progress(label),
    )
    try:
        yield session
    except IdentError:  # the same input would fail again
        session.checkpoint.remove()
        out.discard()
        raise
    except BaseException:
        if session.checkpoint.lasting:
            out.note(f"note: unfinished work is kept in {session.checkpoint.folder}; --resume continues it.")
        else:
            session.checkpoint.remove()
        raise
    session.checkpoint.remove()
