"""What the commands share: arguments, progress, output folders, JSON."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from .._utils.files import remove_all_leftovers, sha256, staged, write_atomic
from .._utils.text import WIDTH, wrapped
from ..errors import ConfigurationError
from ..estimators import make_estimator
from ..problem.integrated import FORMULATIONS
from ..streaming.checkpoint import NAME as CHECKPOINT
from ..study.session import HELD_SHARE
from ..study.study import Study, read_study

if TYPE_CHECKING:
    from ..robots.robot import Robot

#: From this share of the work on, and after so many seconds, what is left is told.
_TOLD_FROM, _TOLD_AFTER = 0.03, 3.0


def add_study_arguments(parser: argparse.ArgumentParser, *, logs: bool = True) -> None:
    """A study file, or flags for the same."""
    parser.set_defaults(named_logs=logs)
    what = "study file (TOML), or logs; or use the flags below" if logs else "study file (TOML); or use the flags below"
    parser.add_argument("study", nargs="?", help=what)
    parser.add_argument("--robot", help="built-in robot or example-robot-data robot, by name")
    parser.add_argument("--urdf", help="URDF file of the robot")
    parser.add_argument(
        "--lock",
        nargs="+",
        metavar="JOINT",
        type=locked_joint,
        help="joints that are held still and not logged (a hand's, for example): JOINT (at zero) or JOINT=POSITION",
    )
    parser.add_argument(
        "--gravity", nargs=3, type=float, metavar=("X", "Y", "Z"), help="gravity in the base frame (m/s^2), instead of the robot's own"
    )
    parser.add_argument("--drive", help="TOML file with a [drive] table: ratio or K, measured, effects …")
    if logs:
        add_log_argument(parser, "logs to fit (CSV, Parquet, MAT, HDF5, bags and more: docs/logs.md; patterns and folders allowed)")
        parser.add_argument(
            "--validate", nargs="+", metavar="FILE", help="held-out logs; without them, the last part of each log is held out"
        )
        parser.add_argument("--method", help="estimator, e.g. wls, irls, physical (all: ident fit --help); default: wls")
        parser.add_argument(
            "--form",
            choices=(*FORMULATIONS,),
            help="equations to fit: torque (default), or momentum or energy, which are integrated over windows and need no acceleration",
        )
        parser.add_argument(
            "--plan",
            dest="followed",
            metavar="FILE",
            help="manifest of a step-by-step plan that the logs follow (method sequential); without --log, its logs beside it are read",
        )
        parser.add_argument(
            "--effects",
            nargs="+",
            metavar="EFFECT",
            help="effects of the model besides the rigid body, e.g. rotor_inertia viscous coulomb; joints and shape parameters as"
            " in stribeck:joint3:v_s=1",
        )
        add_reading_arguments(parser)
        parser.add_argument("--cutoff", type=float, metavar="HZ", help="low-pass cut-off (default: chosen from the data)")


def add_log_argument(parser: argparse.ArgumentParser, what: str, *others: str) -> None:
    """`--log`, which may also be spelt `--logs`, and as `others` where a command has logs of one kind only."""
    parser.add_argument("--log", "--logs", *others, dest="log", nargs="+", action="extend", metavar="FILE", help=what)


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """How logs are read: `--missing`, `--rate-hz`."""
    parser.add_argument(
        "--missing", choices=("refuse", "gap"), help="blocks of missing positions: refuse the log (default), or leave them out as gaps"
    )
    parser.add_argument("--rate-hz", dest="rate_hz", type=positive, metavar="HZ", help="sample rate of logs without a time column")


def read_as_asked(study: Study, args: argparse.Namespace) -> Study:
    """The study with what the flags say of the reading of its logs."""
    given = {key: value for key in ("missing", "rate_hz") if (value := getattr(args, key, None))}
    return replace(study, logs=replace(study.logs, **given))


def add_output_arguments(parser: argparse.ArgumentParser) -> None:
    """`--json`, `--out`, `--force`, `--quiet`."""
    parser.add_argument("--json", action="store_true", help="machine-readable result on standard output, text for people on standard error")
    parser.add_argument("--out", metavar="DIR", help="output folder for all results; must be new or empty unless --force")
    parser.add_argument("--force", action="store_true", help="write into an existing folder, overwriting files of the same name")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def study_from(args: argparse.Namespace) -> Study:
    """The study that the arguments describe; flags override the file."""
    if not (args.study or args.robot or args.urdf):
        raise ConfigurationError(
            "no study file and no robot given: pass a study file, or use --robot NAME or --urdf FILE (and --log FILE)."
        )
    plugins = tuple(getattr(args, "plugin", None) or ())
    if args.study and Path(args.study).is_dir():
        fit = f" pass a saved fit as --fit {args.study}," if hasattr(args, "fit") else ""
        raise ConfigurationError(f"{args.study} is a folder, not a study file:{fit} pass logs as --log {args.study}.")
    study = read_study(Path(args.study)) if args.study else Study()
    study = replace(study, plugins=(*study.plugins, *plugins))
    study = study.with_flags(
        robot=args.robot,
        urdf=args.urdf,
        drive=args.drive,
        logs=getattr(args, "log", None) or (),
        validate=getattr(args, "validate", None) or (),
        method=getattr(args, "method", None),
        effects=getattr(args, "effects", None),
        form=getattr(args, "form", None),
    )
    if lock := dict(getattr(args, "lock", None) or ()):
        robot = replace(study.description.robot, locked={**(study.description.robot.locked or {}), **lock})
        study = replace(study, description=replace(study.description, robot=robot))
    if gravity := getattr(args, "gravity", None):
        study = replace(study, description=replace(study.description, robot=replace(study.description.robot, gravity=tuple(gravity))))
    followed = getattr(args, "followed", None)
    if followed is not None:
        method, path = study.estimator.method or "sequential", os.path.abspath(followed)
        make_estimator(method, plan=path)  # a method that follows no plan says which does
        study = replace(study, estimator=replace(study.estimator, method=method, options={**study.estimator.options, "plan": path}))
    study = read_as_asked(study, args)
    cutoff = getattr(args, "cutoff", None)
    if cutoff is None:
        return study
    return replace(study, signals=replace(study.signals, options={**study.signals.options, "cutoff_hz": cutoff}))


def refuse_beside_fit(args: argparse.Namespace, *more: str) -> None:
    """Refuse flags, by their names in `args`, that say what a saved fit says itself: they would not be used. `more`: of one command."""
    names = ("robot", "urdf", "lock", "gravity", "drive", "effects", "form", "cutoff", *more)
    if given := [f"--{name}" for name in names if getattr(args, name, None)]:
        raise ConfigurationError(f"--fit brings its own robot, model and cut-off; leave out {', '.join(given)}.")


def inputs_of(args: argparse.Namespace, robot: Robot, *more: str | None) -> list[dict[str, str]]:
    """Files from which a command has its robot and model, and `more` that it reads, for its result: {"path", "sha256"} each."""
    fit = getattr(args, "fit", None)
    urdf = None if "robot" in robot.source else robot.source.get("urdf")
    named = [fit] if fit else [args.study, urdf, args.drive]
    paths = [Path(path) for path in (*named, *more) if path]
    return [{"path": str(path), "sha256": sha256(path)} for path in dict.fromkeys(paths) if path.is_file()]


def locked_joint(text: str) -> tuple[str, float]:
    """JOINT, or JOINT=POSITION, for argparse."""
    name, _, position = text.partition("=")
    try:
        return name, float(position or 0.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{position!r} in {text!r} must be a position (rad, m)") from None


def positive(text: str) -> float:
    """A number above zero, for argparse."""
    value = not_negative(text)
    if value == 0:
        raise argparse.ArgumentTypeError(f"must be a positive number, not {text!r}")
    return value


def not_negative(text: str) -> float:
    """A number of zero or more, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise argparse.ArgumentTypeError(f"must be a positive number, not {text!r}")
    return value


def whole(text: str) -> int:
    """A whole number of one or more, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of 1 or more, not {text!r}")
    return int(text)


def say_split(out: Output) -> None:
    """That what is held out is the last part of each log."""
    out.say(f"held out: the last {HELD_SHARE:.0%} of each log (no validation log was given)")


class Output:
    """Where results go: text for people, JSON for programs, files into `--out`."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.json = bool(args.json)
        self.quiet = bool(args.quiet)
        self.force = bool(args.force)
        self.folder = Path(args.out) if args.out else None
        self._new: list[Path] = []
        self._scratch: Path | None = None
        self.resume = bool(getattr(args, "resume", False))
        if self.folder is not None:
            self._claim(self.folder)

    def _claim(self, folder: Path) -> None:
        if folder.exists() and not folder.is_dir():
            raise ConfigurationError(f"--out {folder} is a file; give a folder.")
        remove_all_leftovers(folder)
        held = sorted(p.name for p in folder.iterdir()) if folder.exists() else []
        unfinished = held == [CHECKPOINT]
        if unfinished and not (self.resume or self.force):
            raise ConfigurationError(
                f"--out {folder} holds the unfinished work of an interrupted command; continue it (--resume), or discard it (--force)."
            )
        if held and not unfinished and not self.force:
            raise ConfigurationError(f"--out {folder} exists and is not empty; nothing was written. Choose another folder, or add --force.")
        # Made here only to see whether it can be: a command that fails leaves no empty folder.
        self._new = [p for p in (folder, *folder.parents) if not p.exists()]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.discard()
        except OSError as error:
            raise ConfigurationError(f"--out {folder} cannot be created ({error.strerror}).") from None

    def discard(self) -> None:
        """Remove the folders that this command made, if they are empty."""
        for made in self._new:
            if made.is_dir() and not any(made.iterdir()):
                made.rmdir()

    def say(self, text: object = "") -> None:
        """Text for people: standard output, or standard error beside JSON."""
        _print(text, sys.stderr if self.json else sys.stdout)

    def say_wrapped(self, text: object) -> None:
        """The same with lines that are too long for a wide terminal broken, further lines indented."""
        self.say("\n".join(wrapped(line) if len(line) > WIDTH else line for line in str(text).splitlines()))

    def note(self, text: object) -> None:
        """A remark on the way, on standard error."""
        print(text, file=sys.stderr, flush=True)

    def result(self, data: Mapping[str, Any], name: str | None = None) -> None:
        """The machine-readable result: to standard output with `--json`, and into the folder under `name` if one is given."""
        text = json.dumps(data, indent=2)
        if self.json:
            _print(text, sys.stdout)
        if name is not None:
            self.keep(f"{name}.json", text + "\n")

    def keep(self, name: str, data: str | bytes) -> Path | None:
        """Write a file into the folder, if there is one."""
        path = self.path(name)
        return None if path is None else write_atomic(path, data, force=self.force)

    def path(self, name: str) -> Path | None:
        """Path at which an artefact of the folder is to be written, or None."""
        if self._scratch is not None:
            return self._scratch / name
        self.open()
        return None if self.folder is None else self.folder / name

    def open(self) -> None:
        """Make the folder, if there is one: now there is something to keep."""
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)

    def target(self, given: str | None, name: str) -> Path:
        """Path of the file that a command is there to write: where it was `given`, else `name` in the folder, else `name` here."""
        if given is not None:
            return Path(given)
        return Path(name) if self.folder is None else self.folder / name

    @contextmanager
    def together(self) -> Iterator[Path | None]:
        """A scratch folder for all artefacts of a command, moved into the folder together at the end; None without a folder."""
        if self.folder is None:
            yield None
            return
        with staged(self.folder, force=self.force) as scratch:
            self._scratch = scratch
            try:
                yield scratch
            finally:
                self._scratch = None

    def progress(self, label: str) -> Callable[[float], None] | None:
        """A progress line on standard error for work that lasts; None where nobody watches."""
        if self.quiet or not sys.stderr.isatty():
            return None if self.quiet else _slow_progress(label)
        return _line_progress(label)


def _print(text: object, stream: TextIO) -> None:
    """Print; where the reader went away (`| head`), go on without it, so that artefacts are kept and gates still count."""
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def time_left(passed: float, share: float) -> str:
    """ ", about 3 min left" after so many seconds for a share of the work; "" where too little is done to tell."""
    if not _TOLD_FROM <= share < 1.0 or passed < _TOLD_AFTER:
        return ""
    left = passed * (1.0 - share) / share
    return f", about {left:.0f} s left" if left < 100 else f", about {left / 60:.0f} min left"


def _line_progress(label: str) -> Callable[[float], None]:
    start = time.monotonic()
    shown = [-1]

    def show(share: float) -> None:
        percent = int(100 * share)
        if percent != shown[0] and (time.monotonic() - start > 0.5):
            shown[0] = percent
            end, passed = "\n" if share >= 1 else "", time.monotonic() - start
            print(f"\r{label} {percent:3d} %  {passed:.0f} s{time_left(passed, share):<22}", end=end, file=sys.stderr, flush=True)

    return show


def _slow_progress(label: str) -> Callable[[float], None]:
    """For logs of a terminal: a line every ten seconds."""
    start = time.monotonic()
    last = [start]

    def show(share: float) -> None:
        now = time.monotonic()
        if now - last[0] > 10:
            last[0] = now
            print(f"{label} {100 * share:.0f} %{time_left(now - start, share)}", file=sys.stderr, flush=True)

    return show
