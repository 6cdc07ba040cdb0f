"""Logs as recorded: reading, splitting into fitted and held-out parts, torque on the measured side."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.text import counted
from ..drawing.document import Figure
from ..drawing.shown import Shown
from ..errors import ConfigurationError, DataError, unknown_name
from ..robots.transmission import Transmission
from .pictures import TORQUE, log_figure, log_frame
from .recognise import RecordedChannels
from .unwrap import unwrapped

if TYPE_CHECKING:
    import pandas as pd

    from ..robots.robot import Robot

Array = np.ndarray
#: What the name of a part has beside that of its run.
_PART = re.compile(r" \((?:last part|part \d+)\)$")


@dataclass(frozen=True, eq=False, repr=False)
class Log(Shown, ShortRepr):
    """One run as recorded, in SI, joints in the robot's order. N samples, n joints.

    `t` (N,) s, rising, otherwise as recorded; `q` (N, n) on the joint side, or None where only `q_motor` (N, n) was logged.
    `dq`, `ddq`, `dq_motor` (N, n): measured ones, else None. `tau`: by "joint", "motor" (torque) or "current" → (N, n); a joint
    without torque has a column of NaN. `source`, `sha256`: the file. `extra`: other numeric columns (N,).
    `notes`: what was repaired or left out when reading. `origin`: time at which the recording began, where this is a part of it.
    `hint`: where there is no torque, which columns of the file look like it. `joint_names`: as the file, or the robot it was read for,
    tells them. `recording`: what the file's channels were taken for, and which were ignored, where they had to be recognised.

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
    joint_names: tuple[str, ...] = ()
    recording: RecordedChannels | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._take_arrays()
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

    def _take_arrays(self) -> None:
        """Lists are taken as arrays."""
        if not isinstance(self.tau, Mapping):
            raise ConfigurationError(f"log {self.name}: tau tells its side: {{'joint': array}}, 'motor' or 'current', not an array alone.")
        try:
            given = {name: getattr(self, name) for name in ("t", "q", "q_motor", "dq", "ddq", "dq_motor")}
            for name, values in given.items():
                if values is not None and not isinstance(values, np.ndarray):
                    object.__setattr__(self, name, np.asarray(values, float))
            if any(not isinstance(values, np.ndarray) for values in self.tau.values()):
                object.__setattr__(self, "tau", {side: np.asarray(values, float) for side, values in self.tau.items()})
        except (TypeError, ValueError) as error:
            raise DataError(f"log {self.name}: holds what is no table of numbers ({error}).") from None

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


def log_of(
    name: str, arrays: Mapping[str, Array], source: str = "", sha256: str = "", notes: tuple[str, ...] = (), origin: float | None = None
) -> Log:
    """A log in memory from SI arrays by quantity (`ColumnPlan.arrays`)."""
    return Log(
        name=name,
        t=arrays["t"],
        q=arrays.get("q"),
        q_motor=arrays.get("q_motor"),
        dq=arrays.get("dq"),
        ddq=arrays.get("ddq"),
        dq_motor=arrays.get("dq_motor"),
        tau={k.removeprefix("tau_"): v for k, v in arrays.items() if k.startswith("tau_")},
        source=source,
        sha256=sha256,
        notes=notes,
        origin=origin,
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

    def to_frame(self) -> pd.DataFrame:
        """The logs' tables one below the other, with the name of each row's run in the column `run`."""
        import pandas as pd

        return pd.concat([log.to_frame().assign(run=log.name) for log in self.logs], ignore_index=True)

    def with_robot(self, robot: Robot) -> LogSet:
        """The same logs, of this robot."""
        if robot.n != self.n:
            raise DataError(
                f"the logs have {counted(self.n, 'joint')}, but robot {robot.name!r} has {robot.n}: {', '.join(robot.joint_names)}."
            )
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


def run_of(name: str) -> str:
    """Name of the run that a log is, or that `LogSet.split` made it a part of."""
    return _PART.sub("", name)


def spread(count: int, share: float) -> set[int]:
    """About `share` of `count` indices, evenly spread, never the first alone of several."""
    number = min(count - 1, max(1, round(share * count))) if count > 1 else 0
    return {int((i + 0.5) * count / number + 0.5 * (count / number > 2)) if number else 0 for i in range(number)} if number else set()
