"""Logs as recorded: reading, splitting into fitted and held-out parts, torque on the measured side."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import sha256
from .._utils.short_repr import ShortRepr
from ..drawing.document import Figure
from ..drawing.shown import Shown
from ..errors import ConfigurationError, DataError, IdentError, unknown_name
from ..robots.transmission import Transmission
from .columns import ColumnPlan, resolve_columns
from .names import JointNames
from .pictures import TORQUE, log_figure, log_frame
from .readers.bag import is_bag
from .readers.frames import chosen_columns, frame_columns, is_frame
from .readers.ros import joint_state_columns, read_joint_states
from .readers.tables import Header, read_columns, read_header
from .recognise import recognised
from .repair import blank_unusable, repeated_rows, usable_rows
from .torque import MeasuredTorque, measured
from .unwrap import motor_turn_notes, unwrapped, within_limits, wrapping

if TYPE_CHECKING:
    import pandas as pd

    from ..robots.robot import Robot

Array = np.ndarray
#: The time of a log that has none, counted from its rate.
_COUNTED = "\x00counted"


@dataclass(frozen=True, eq=False, repr=False)
class Log(Shown, ShortRepr):
    """One run as recorded, in SI, joints in the robot's order. N samples, n joints.

    `t` (N,) s, rising, otherwise as recorded; `q` (N, n) on the joint side, or None where only `q_motor` (N, n) was logged.
    `dq`, `ddq`, `dq_motor` (N, n): measured ones, else None. `tau`: by "joint", "motor" (torque) or "current" → (N, n); a joint
    without torque has a column of NaN. `source`, `sha256`: the file. `extra`: other numeric columns (N,).
    `notes`: what was repaired or left out when reading. `origin`: time at which the recording began, where this is a part of it.
    `hint`: where there is no torque, which columns of the file look like it.

    Examples
    --------
    >>> import ident
    >>> import numpy as np
    >>> log = ident.Log("run", t=np.arange(5) * 0.01, q=np.zeros((5, 2)), tau={"joint": np.zeros((5, 2))})
    >>> log.n, len(log)
    (2, 5)
    """

    name: str
    t: Array
    q: Array | None = None
    q_motor: Array | None = None
    dq: Array | None = None
    ddq: Array | None = None
    dq_motor: Array | None = None
    tau: Mapping[str, Array] = field(default_factory=dict)
    source: str = ""
    sha256: str = ""
    extra: Mapping[str, Array] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()
    origin: float | None = None
    hint: str = ""

    def __post_init__(self) -> None:
        positions = self.q if self.q is not None else self.q_motor
        if positions is None:
            raise DataError(f"log {self.name}: holds no positions.")
        if self.t.ndim != 1 or positions.ndim != 2:
            raise DataError(f"log {self.name}: time must be (N,) and positions (N, n), not {self.t.shape} and {positions.shape}.")
        for label, array in (("q", self.q), ("q_motor", self.q_motor), ("dq", self.dq), ("ddq", self.ddq), *self.tau.items()):
            if array is not None and array.shape != (len(self.t), positions.shape[1]):
                raise DataError(f"log {self.name}: {label} has shape {array.shape}, expected {(len(self.t), positions.shape[1])}.")
        unknown = set(self.tau) - {"joint", "motor", "current"}
        if unknown:
            raise unknown_name("side of torque", min(unknown), ("joint", "motor", "current"))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def n(self) -> int:
        """Number of joints."""
        positions = self.q if self.q is not None else self.q_motor
        assert positions is not None
        return positions.shape[1]

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    @property
    def began(self) -> float:
        """Time at which the recording began."""
        return self.origin if self.origin is not None else float(self.t[0]) if len(self.t) else 0.0

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        robot: Robot | None = None,
        columns: Mapping[str, Any] | None = None,
        *,
        name: str = "frame",
        **reading: Any,
    ) -> Log:
        """A log from a pandas DataFrame whose columns are named as a file's would be.

        `columns`, `reading`: as of `read_logs`. Raises DataError for a table that cannot be used as one run.

        Examples
        --------
        >>> import ident
        >>> train, test = ident.demo_logs()
        >>> ident.Log.from_frame(train[0].to_frame()).n
        6
        """
        logs = read_logs(frame, robot, columns, **reading)
        if len(logs) > 1:
            raise DataError(f"log {name}: {len(logs)} runs are in one table; read them with ident.read_logs(frame).")
        return replace(logs[0], name=name)

    def to_frame(self) -> pd.DataFrame:
        """One row per sample, columns by the names of docs/formats.md, SI; `read_logs` takes it back."""
        motor = self.q_motor if self.q is None else None
        arrays = {"q": self.q, "q_m": motor, "dq": self.dq, "ddq": self.ddq, "dq_m": self.dq_motor}
        return log_frame(self.t, arrays | {TORQUE[side][0]: values for side, values in self.tau.items()}, self.extra)

    def figure(self) -> Figure:
        """Position and torque of each joint over time; see `plot`."""
        position = ("motor position (rad)", self.q_motor) if self.q is None else ("position (rad, m)", self.q)
        torque = [(TORQUE[side][1], values) for side, values in self.tau.items()]
        return log_figure(self.name, self.t, [(label, values) for label, values in (position, *torque[:1]) if values is not None])

    def position(self, transmission: Transmission) -> Array:
        """Joint positions (N, n), from the motors' where only those were logged."""
        if self.q is not None:
            return self.q
        assert self.q_motor is not None
        return transmission.joint_position(unwrapped(self.q_motor))

    def velocity(self, transmission: Transmission) -> Array | None:
        """Measured joint velocities (N, n), from the motors' where only those were logged; None without any."""
        if self.dq is not None or self.dq_motor is None:
            return self.dq
        return transmission.joint_rate(self.dq_motor)

    def rows(self, selection: slice | Array, name: str | None = None) -> Log:
        """Some rows of the log, as a log."""

        def cut(a: Array | None) -> Array | None:
            return None if a is None else a[selection]

        return replace(
            self,
            name=self.name if name is None else name,
            t=self.t[selection],
            q=cut(self.q),
            q_motor=cut(self.q_motor),
            dq=cut(self.dq),
            ddq=cut(self.ddq),
            dq_motor=cut(self.dq_motor),
            tau={k: v[selection] for k, v in self.tau.items()},
            extra={k: v[selection] for k, v in self.extra.items()},
            origin=self.began,
        )


@dataclass(frozen=True, eq=False, repr=False)
class LogSet(ShortRepr):
    """Runs of one robot. `robot` is the one they were read for, if it was given; `left_out`: files that could not be read, and why.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> first, last = train.split(by="fraction", held=0.25)
    >>> len(first), len(last)
    (1, 1)
    """

    logs: tuple[Log, ...]
    robot: Robot | None = None
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "logs", tuple(self.logs))
        if not self.logs:
            raise DataError("there is no log.")
        counts = {log.n for log in self.logs}
        if len(counts) > 1:
            raise DataError("logs of different joint counts: " + ", ".join(f"{log.name} {log.n}" for log in self.logs) + ".")

    def __len__(self) -> int:
        return len(self.logs)

    def __iter__(self) -> Iterator[Log]:
        return iter(self.logs)

    def __getitem__(self, i: int) -> Log:
        return self.logs[i]

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.logs[0].n

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(log.name for log in self.logs)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was repaired or left out when reading, each once."""
        return tuple(dict.fromkeys(note for log in self.logs for note in log.notes))

    @cached_property
    def inputs(self) -> tuple[dict[str, str], ...]:
        """Files read, for results: {"path", "sha256"}, each once."""
        return tuple({"path": s, "sha256": h} for s, h in dict.fromkeys((log.source, log.sha256) for log in self.logs if log.source))

    def with_robot(self, robot: Robot) -> LogSet:
        """The same logs, of this robot."""
        if robot.n != self.n:
            raise DataError(f"the logs have {self.n} joints, but robot {robot.name!r} has {robot.n}: {', '.join(robot.joint_names)}.")
        return replace(self, robot=robot)

    def select(self, names: Iterable[str]) -> LogSet:
        """Some runs, by name."""
        wanted = list(names)
        for name in wanted:
            if name not in self.names:
                raise unknown_name("run", name, self.names)
        return replace(self, logs=tuple(log for log in self.logs if log.name in wanted))

    def window(self, start: float, stop: float) -> LogSet:
        """The part of every run between two times (s), counted from the run's first sample. Raises DataError if nothing is left."""
        parts = []
        for log in self.logs:
            from_start = log.t - log.t[0]
            parts.append(log.rows((from_start >= start) & (from_start <= stop)))
        kept = tuple(log for log in parts if len(log) >= 2)
        if not kept:
            raise DataError(
                f"no sample lies between {start} s and {stop} s; the runs last"
                f" {', '.join(f'{log.duration:.3g} s' for log in self.logs[:6])}."
            )
        return replace(self, logs=kept)

    def split(self, by: str = "run", held: float = 0.25, blocks: int = 8) -> tuple[LogSet, LogSet]:
        """Two sets without a common sample: `(fit, held)`.

        `by`: "run": whole runs are held out, evenly spread; "fraction": the last part of every run; "blocks": of `blocks` equal
        parts of every run, evenly spread ones. `held` is the share held out. Raises ConfigurationError."""
        if not 0 < held < 1:
            raise ConfigurationError(f"split: held = {held} must lie between 0 and 1.")
        if by == "run":
            chosen = spread(len(self), held)
            if not chosen or len(chosen) == len(self):
                raise ConfigurationError(
                    f'split: {len(self)} run cannot be split by run; use by="fraction" or by="blocks", or give more logs.'
                )
            return (
                replace(self, logs=tuple(log for i, log in enumerate(self.logs) if i not in chosen)),
                replace(self, logs=tuple(log for i, log in enumerate(self.logs) if i in chosen)),
            )
        if by == "fraction":
            parts: list[tuple[Log, bool]] = []
            for log in self.logs:
                cut = int(np.searchsorted(log.t, log.t[0] + (1 - held) * log.duration))
                parts += [(log.rows(slice(0, cut)), False), (log.rows(slice(cut, None), f"{log.name} (last part)"), True)]
        elif by == "blocks":
            chosen = spread(blocks, held)
            if not chosen or len(chosen) >= blocks:
                raise ConfigurationError(f"split: {blocks} blocks cannot hold out a share of {held}.")
            parts = []
            for log in self.logs:
                edges = np.searchsorted(log.t, log.t[0] + log.duration * np.arange(blocks + 1) / blocks)
                edges[-1] = len(log)
                parts += [(log.rows(slice(edges[i], edges[i + 1]), f"{log.name} (part {i + 1})"), i in chosen) for i in range(blocks)]
        else:
            raise unknown_name("way to split", by, ("run", "fraction", "blocks"))
        fit, out = (tuple(log for log, h in parts if h == wanted and len(log) >= 2) for wanted in (False, True))
        if not fit or not out:
            raise DataError("split: the logs are too short to hold out a part.")
        return replace(self, logs=fit), replace(self, logs=out)


def spread(count: int, share: float) -> set[int]:
    """About `share` of `count` indices, evenly spread, never the first alone of several."""
    number = min(count - 1, max(1, round(share * count))) if count > 1 else 0
    return {int((i + 0.5) * count / number + 0.5 * (count / number > 2)) if number else 0 for i in range(number)} if number else set()


def read_logs(
    paths: str | Path | pd.DataFrame | Sequence[str | Path | pd.DataFrame],
    robot: Robot | None = None,
    columns: Mapping[str, Any] | None = None,
    *,
    missing: str = "refuse",
    extra: bool = True,
    rate_hz: float | None = None,
    skip_bad_files: bool = False,
) -> LogSet:
    """Read recordings: CSV in its dialects, compressed or not; Parquet, MAT, NPZ, ROS 1 and ROS 2 bags, MCAP, LeRobot folders.

    Columns that go by other names are recognised by the structure of their names; the log's notes say what was taken for what.

    Parameters
    ----------
    paths : str, Path, DataFrame or sequence
        A file, a pattern (`runs/*.csv`), the folder of a bag or a dataset, a pandas DataFrame with a file's columns, or several.
    robot : Robot, optional
        Checks the joint count, matches columns by joint name, and carries motor-side positions to the joints.
    columns : mapping, optional
        The study file's `[columns]` table.
    missing : str
        "refuse" blocks of missing positions, or leave them out as a "gap".
    extra : bool
        Read columns that are nothing of ours, too.
    rate_hz : float, optional
        Samples per second of logs without a time.
    skip_bad_files : bool
        Leave out files that cannot be read; `left_out` of the result says which and why. One must be left.

    Returns
    -------
    LogSet
        SI units, joints in the robot's order (without a robot, in the file's).

    Raises
    ------
    DataError
        A file that cannot be used, with file, column and row.
    ConfigurationError
        A mapping that does not fit, or a package to install.

    Examples
    --------
    >>> import ident
    >>> from ident.robots import robot_folder
    >>> logs = ident.read_logs(robot_folder("puma560") / "demo/train.csv.gz", ident.load_robot("puma560"))
    >>> logs.n
    6
    """
    if missing not in ("refuse", "gap"):
        raise unknown_name("treatment of missing positions", missing, ("refuse", "gap"))
    joints = None if robot is None else JointNames.of(robot)
    logs: list[Log] = []
    left_out: list[str] = []
    for source in _sources(paths):
        try:
            logs += _read(source, joints, columns, missing, extra, rate_hz)
        except IdentError as error:
            if not skip_bad_files:
                raise
            left_out.append(str(error))
    if left_out and not logs:
        raise DataError(f"none of the {len(left_out)} logs can be read; the first: {left_out[0]}")
    names: dict[str, int] = {}
    for i, log in enumerate(logs):
        names[log.name] = names.get(log.name, 0) + 1
        if names[log.name] > 1:
            logs[i] = replace(log, name=f"{log.name} ({names[log.name]})")
    if robot is not None:
        logs = [_turned(log, robot) if log.q is not None else _joined(log, robot) for log in logs]
    return LogSet(tuple(logs), robot, tuple(left_out))


def _sources(paths: Any) -> list[Path | pd.DataFrame]:
    """Files, and tables in memory, in the order given."""
    given: list[Any] = [paths] if isinstance(paths, str | Path) or is_frame(paths) else list(paths)
    if not any(is_frame(one) for one in given):
        return [*_files(given)]
    return [source for one in given for source in ([one] if is_frame(one) else _files([one]))]


def _files(paths: Sequence[str | Path]) -> list[Path]:
    try:
        return _expanded(paths)
    except (OSError, ValueError) as error:  # a name that is too long, or holds a NUL
        if isinstance(error, DataError):
            raise
        raise DataError(f"log: one of the names cannot be that of a file ({getattr(error, 'strerror', None) or error}).") from None


def _expanded(paths: Sequence[str | Path]) -> list[Path]:
    out: list[Path] = []
    for entry in paths:
        text = str(entry)
        if any(c in text for c in "*?[") and not Path(text).exists():
            found = sorted(glob.glob(text, recursive=True))
            if not found:
                raise DataError(f"log {text}: no file matches.")
            out += [Path(f) for f in found]
        elif Path(text).is_dir() and not is_bag(Path(text)):
            out += _in_folder(Path(text))
        else:
            out.append(Path(text))
    if not out:
        raise DataError("no log file was given.")
    return out


def _in_folder(folder: Path) -> list[Path]:
    """The logs of a dataset's folder (LeRobot: data/chunk-*/*.parquet); the folder itself where it is none."""
    episodes = sorted(folder.glob("data/**/*.parquet"))
    return episodes or [folder]


def _joined(log: Log, robot: Robot) -> Log:
    """A log of which only motor positions were recorded, with joint positions beside them."""
    assert log.q_motor is not None
    notes = (*log.notes, *motor_turn_notes(log.name, robot, wrapping(log.q_motor)))
    return replace(log, q=log.position(robot.transmission), notes=notes)


def _content(path: Path) -> Path:
    """The file that holds a log: of a ROS 2 bag's folder, its data."""
    return next((p for p in sorted(path.iterdir()) if p.suffix in (".db3", ".mcap")), path) if path.is_dir() else path


@dataclass(frozen=True)
class _Table:
    """A table to be read as a log: what messages call it, its name, its header, the content of columns, and the file that it is."""

    where: str
    name: str
    header: Header
    read: Callable[[Sequence[str], Sequence[str]], dict[str, Array]]
    path: Path | None = None

    @classmethod
    def of(cls, source: Path | pd.DataFrame) -> _Table:
        if isinstance(source, Path):
            header = read_header(source)

            def read(names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
                return read_columns(source, header, names, optional=optional)

            return cls(f"log {source}", source.name.split(".")[0], header, read, source)
        columns = frame_columns(source)
        return cls("log DataFrame", "frame", Header(tuple(columns)), partial(chosen_columns, columns))


def _planned(
    table: _Table, joints: JointNames | None, columns: Mapping[str, Any] | None, rate_hz: float | None
) -> tuple[ColumnPlan, Mapping[str, tuple[str, float]]]:
    """Which column is what, by our own names, by the user's mapping, or as a recording is recognised; and what was wanted."""
    where, header = table.where, table.header
    if rate_hz is not None and not rate_hz > 0:
        raise ConfigurationError(f"rate_hz must be a positive number of samples per second, not {rate_hz!r}.")
    names = header.names
    if rate_hz is not None and not any(n.lower() in ("t", "time", "timestamp") for n in names) and "t" not in (columns or {}):
        names = (*names, _COUNTED)
        columns = {**columns, "t": _COUNTED} if columns else None
    counted = columns or ({"t": _COUNTED} if _COUNTED in names else None)
    try:
        return resolve_columns(names, joints, counted, where=where), {}
    except DataError:
        if columns:
            raise
        known: dict[str, Array] = {}

        def read(names: Sequence[str]) -> dict[str, Array]:
            new = [n for n in dict.fromkeys(names) if n not in known]
            if new:
                known.update(table.read(new, ()))
            return known

        try:
            found = recognised(header.names, read, None if joints is None else joints.names, header.units)
        except DataError:
            found = None
        if found is None:
            raise
        mapping = {"t": _COUNTED, **found.mapping} if _COUNTED in names else found.mapping
        plan = resolve_columns(names, joints, mapping, where=where)
        said = f"{where}: recognised by its columns: {found.text}."
        return replace(plan, notes=(said, *plan.notes)), found.reference


def _turned(log: Log, robot: Robot) -> Log:
    """A log whose joint positions lie within the joints' limits, where whole turns are all that keeps them out (0 … 360 degrees)."""
    assert log.q is not None
    if log.q.shape[1] != robot.n:
        return log
    q, moved = within_limits(unwrapped(log.q), robot)
    if not moved:
        return log
    said = f"log {log.name}: positions of {', '.join(moved)} are joined over full turns and moved by whole turns into the joint limits."
    return replace(log, q=q, notes=(*log.notes, said))


def _read(
    source: Path | pd.DataFrame,
    joints: JointNames | None,
    columns: Mapping[str, Any] | None,
    missing: str,
    extra: bool,
    rate_hz: float | None,
) -> list[Log]:
    file = _Table.of(source)
    where, path = file.where, file.path
    layout = None if columns or path is None else joint_state_columns(file.header)
    if layout is not None and path is not None:
        table = read_joint_states(path, file.header, layout, joints.names if joints else None)
        plan = resolve_columns(tuple(table), joints, None, where=where)
        extras: dict[str, Array] = {}
    else:
        plan, reference = _planned(file, joints, columns, rate_hz)
        stored = tuple(name for name in plan.sources if name != _COUNTED)
        table = file.read(stored, plan.extra if extra else ())
        if rate_hz is not None and _COUNTED in plan.sources:
            table[_COUNTED] = np.arange(len(table[stored[0]])) / rate_hz
        extras = {name: table[name] for name in plan.extra if name in table}
        extras |= {key: table[name] * factor for key, (name, factor) in reference.items() if name in table}
    arrays = plan.arrays(table)
    blank_unusable(arrays)
    rows = len(arrays["t"])
    if rows == 0:
        raise DataError(f"{where}: there is a header, but no row of data.")
    if rows < 2:
        raise DataError(f"{where}: one row of data; a log needs many.")
    side = "q" if "q" in arrays else "q_motor"
    positions = {c.source: arrays[side][:, c.joint] for c in plan.quantity(side)}
    pieces = usable_rows(arrays["t"], positions, where, missing=missing, repeated=repeated_rows(arrays))
    digest = "" if path is None else sha256(_content(path))
    whole = len(pieces.rows) == 1 and len(pieces.rows[0]) == rows
    logs = []
    for i, index in enumerate(pieces.rows):
        cut: slice | Array = slice(None) if whole else index
        recorded = {k: v[cut] for k, v in arrays.items()}
        logs.append(
            Log(
                name=file.name if len(pieces.rows) == 1 else f"{file.name} run {i + 1}",
                t=recorded["t"],
                q=recorded.get("q"),
                q_motor=recorded.get("q_motor"),
                dq=recorded.get("dq"),
                ddq=recorded.get("ddq"),
                dq_motor=recorded.get("dq_motor"),
                tau={k.removeprefix("tau_"): v for k, v in recorded.items() if k.startswith("tau_")},
                source="" if path is None else str(path),
                sha256=digest,
                extra={k: v[cut] for k, v in extras.items()},
                notes=(*plan.notes, *pieces.notes),
                hint=plan.hint,
            )
        )
    return logs


__all__ = ["Log", "LogSet", "MeasuredTorque", "measured", "read_logs", "spread"]
