"""Runs at one uniform rate whose samples stay on disk: what `ident.signals.uniform` makes in memory, by the same rules."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .._utils.text import counted
from ..errors import DataError
from ..logs.torque import measured
from ..robots.robot import Robot
from ..signals.resample import Clock, bridge, flag_at, interpolate, interpolate_torque, thin
from ..signals.uniform import UniformRun, dead_torque, rate_for, resampling_text, torque_notes
from .clock import clock_of, deviation, longer_steps
from .disk import PASS, DiskArray, DiskWriter
from .stored import StoredLog
from .unwrapping import unwrapped

Array = np.ndarray
#: Samples on either side from which a cubic spline is told: each knot's influence falls to 0.27 of that of the one before.
_SPLINE_REACH = 128


@dataclass(frozen=True, eq=False)
class StoredRecording:
    """A run in the robot's terms, as `ident.signals.uniform.Recording`: joint positions without jumps; `absent` (n,): no torque at all,
    or none that was measured."""

    log: StoredLog
    robot: Robot
    clock: Clock
    notes: tuple[str, ...]
    absent: Array

    @classmethod
    def of(cls, log: StoredLog, robot: Robot, folder: Path) -> StoredRecording:
        """Raises DataError where there is no torque, ConfigurationError for currents without torque constants."""
        if log.n != robot.n:
            raise DataError(
                f"log {log.name} has {counted(log.n, 'joint')}, but robot {robot.name!r} has {robot.n}: {', '.join(robot.joint_names)}."
            )
        notes = list(log.notes)
        notes_of_torque = measured(log.read(0, 1), robot.transmission).notes
        survey = log.survey(robot.transmission)
        turning = np.array([not j.prismatic for j in robot.joints])
        jumping = np.flatnonzero(survey.wrapped & turning)
        if len(jumping):
            names = ", ".join(robot.joint_names[j] for j in jumping)
            notes.append(f"log {log.name}: positions of {names} jump by a full turn; they are unwrapped.")
            log = replace(log, arrays={**log.arrays, "q": unwrapped(log.arrays["q"], jumping, folder / f"{_plain(log.name)}.q")}, blocks=())
        notes += notes_of_torque
        # Of a joint whose positions were joined, the survey's range is that of one turn: far enough for motion.
        dead = dead_torque(survey.least, survey.most, survey.high - survey.low, survey.step)
        notes += torque_notes(log.name, robot, survey.missing, survey.rows, dead, survey.least)
        return cls(log, robot, clock_of(log.t), tuple(dict.fromkeys(notes)), (survey.missing == survey.rows) | dead)

    @property
    def name(self) -> str:
        return self.log.name

    @property
    def t(self) -> DiskArray:
        return self.log.t


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A stretch without gap at one rate: `length` samples from `start` (s) on. `log`: its rows, one a sample; `absent` (n,): joints
    whose torque was not logged. `interpolated`: its rows are not those recorded."""

    name: str
    log: StoredLog
    robot: Robot
    length: int
    start: float
    rate: float
    absent: Array
    interpolated: bool
    origin: float = 0.0

    def __len__(self) -> int:
        return self.length

    @property
    def q(self) -> DiskArray:
        """Joint positions (N, n)."""
        return self.log.arrays["q"]

    def read(self, a: int, b: int, within: slice | None = None) -> UniformRun:
        """Samples `a` … `b` - 1 in memory. With `within`, missing torque is bridged as `ident.signals.resample.bridge` does over these
        samples of the run; `missing` tells where."""
        piece = self.log.read(a, b)
        assert piece.q is not None
        torque = np.where(self.absent, np.nan, measured(piece, self.robot.transmission).torque)
        missing = np.isnan(torque)
        t = self.start + np.arange(a, b) / self.rate
        if within is not None and missing.any():
            # What lies outside is given up, and nothing may lean on it.
            torque[: max(0, within.start - a)] = np.nan
            torque[max(0, within.stop - a) :] = np.nan
            torque = bridged(self.log, self.robot, torque, a, within, self.absent, lambda places: self.start + places / self.rate)
        drive = self.robot.transmission
        return UniformRun(self.name, t, piece.q, torque, missing, piece.velocity(drive), piece.ddq, self.interpolated, self.origin)


def bridged(
    log: StoredLog, robot: Robot, torque: Array, first: int, within: slice, absent: Array, time_of: Callable[[Array], Array]
) -> Array:
    """Torque (N, n) of the rows from `first` on, NaN replaced as `ident.signals.resample.bridge` would do it over the rows `within`: with
    the nearest torque on either side, however far away. `absent` (n,): joints without any. `time_of`: times of rows by their places."""
    stop = first + len(torque)
    places, values = [np.arange(first, stop)], [torque]
    missing = np.isnan(torque) & ~absent
    if missing[0].any():
        at, found = _nearest(log, robot, missing[0], range(first - 1, within.start - 1, -1))
        places.insert(0, at)
        values.insert(0, found)
    if missing[-1].any():
        at, found = _nearest(log, robot, missing[-1], range(stop, within.stop))
        places.append(at)
        values.append(found)
    lead = len(places[0]) if missing[0].any() else 0
    return bridge(time_of(np.concatenate(places)), np.concatenate(values))[lead : lead + len(torque)]


def _nearest(log: StoredLog, robot: Robot, wanted: Array, places: range) -> tuple[Array, Array]:
    """For each joint wanted, the first row along `places` with torque: the rows (k,) rising, and their torques (k, n), NaN for the rest."""
    found: dict[int, Array] = {}
    open_ = wanted.copy()
    for i in range(0, len(places), PASS):
        part = places[i : i + PASS]
        low, high = min(part[0], part[-1]), max(part[0], part[-1]) + 1
        torque = measured(log.read(low, high), robot.transmission).torque
        order = torque if part.step > 0 else torque[::-1]
        for j in np.flatnonzero(open_):
            seen = np.flatnonzero(~np.isnan(order[:, j]))
            if len(seen):
                found.setdefault(part[int(seen[0])], np.full(len(wanted), np.nan))[j] = order[seen[0], j]
                open_[j] = False
        if not open_.any():
            break
    keys = sorted(found)
    return np.array(keys, int), np.array([found[k] for k in keys]).reshape(len(keys), len(wanted))


@dataclass(frozen=True, eq=False)
class StoredResampling:
    """Uniform runs on disk, their rate (Hz), and in words what became of the time stamps."""

    runs: tuple[StoredRun, ...]
    rate: float
    text: str


def stored_runs(
    recordings: Sequence[StoredRecording], rate: float | None, longest_gap: float | None, cutoff: float | None, folder: Path
) -> StoredResampling:
    """Put recordings on one uniform rate; see `signals.uniform.uniform_runs`. Uneven stretches are resampled into files in `folder`."""
    rate = rate_for([(r.name, r.clock) for r in recordings], rate)
    runs: list[StoredRun] = []
    gaps = thinned = 0
    for i, rec in enumerate(recordings):
        limit = longest_gap or max(3.5 * rec.clock.step, 0.1 / cutoff if cutoff else 0.0)
        edges = [0, *longer_steps(rec.t, limit), len(rec.t)]
        parts = [slice(a, b) for a, b in itertools.pairwise(edges) if b - a >= 4]
        gaps += len(parts) - 1
        for k, part in enumerate(parts):
            name = rec.name if len(parts) == 1 else f"{rec.name} [{k + 1}]"
            run, lost = _uniform(rec, part, rate, name, folder / f"even-{i}-{part.start}-{part.stop}")
            thinned += lost
            runs.append(run)
    text = resampling_text(len(runs), sum(r.interpolated for r in runs), rate, [(len(r.t), r.clock) for r in recordings], gaps, thinned)
    return StoredResampling(tuple(runs), rate, text)


def _uniform(rec: StoredRecording, part: slice, rate: float, name: str, folder: Path) -> tuple[StoredRun, int]:
    log = rec.log.part(part.start, part.stop)
    start, began = float(log.t[0]), rec.log.began
    if deviation(log.t, rate) <= rec.clock.tolerance(rate):
        return StoredRun(name, log, rec.robot, len(log), start, rate, rec.absent, False, began), 0
    log, lost = _spaced(log, rec.clock.step, folder)
    length = int(np.floor((float(log.t[-1]) - start) * rate + 1e-6)) + 1
    survey = rec.log.survey(rec.robot.transmission)
    extremes = (np.where(rec.absent, -np.inf, survey.least), np.where(rec.absent, np.inf, survey.most))
    even = _resampled(log, rec.robot, rec.absent, extremes, start, rate, length, folder)
    return StoredRun(name, even, rec.robot, length, start, rate, rec.absent, True, began), lost


def _spaced(log: StoredLog, step: float, folder: Path) -> tuple[StoredLog, int]:
    """Without samples that follow the one before too closely (`ident.signals.resample.thin`), copied where there are any."""
    nearest = min((float(np.diff(p).min()) for p in log.t.pieces(overlap=1) if len(p) > 1), default=np.inf)
    if nearest >= 0.2 * step:
        return log, 0
    folder.mkdir(parents=True, exist_ok=True)
    writers = {k: DiskWriter(folder / f"spaced-{k}.f64", a.width) for k, a in log.arrays.items()}
    last: Array | None = None
    for a in range(0, len(log), PASS):
        piece = {k: array[a : a + PASS] for k, array in log.arrays.items()}
        t = piece["t"] if last is None else np.concatenate([last, piece["t"]])
        keep = thin(t, step)
        keep = keep if last is None else keep[keep > 0] - 1
        for k, writer in writers.items():
            writer.append(piece[k][keep])
        last = piece["t"][keep[-1:]] if len(keep) else last
    arrays = {k: w.close() for k, w in writers.items()}
    return replace(log, arrays=arrays, blocks=()), len(log) - len(arrays["t"])


def _resampled(
    log: StoredLog, robot: Robot, absent: Array, extremes: tuple[Array, Array], start: float, rate: float, length: int, folder: Path
) -> StoredLog:
    """A run interpolated to uniform instants, in files: positions, torque on the measured side, measured derivatives. `extremes`: least and
    most (n,) torque of the whole log."""
    folder.mkdir(parents=True, exist_ok=True)
    side = f"tau_{robot.transmission.measured.value}"
    writers: dict[str, DiskWriter] = {}
    stamps = log.t
    after = 0
    for a in range(0, length, PASS):
        at = start + np.arange(a, min(a + PASS, length)) / rate
        # The samples between which these instants lie, and as many on either side as the spline feels.
        low = max(0, after - _SPLINE_REACH)
        high = after
        while high < len(log) and stamps[high] < at[-1]:
            high = min(high + (1 << 14), len(log))
        piece_t = stamps[low:high]
        first, last = (int(np.searchsorted(piece_t, x)) + low for x in (at[0], at[-1]))
        low, high = max(0, first - _SPLINE_REACH), min(len(log), last + _SPLINE_REACH)
        piece, t = log.read(low, high), stamps[low:high]
        torque = np.where(absent, np.nan, measured(piece, robot.transmission).torque)
        gone = np.isnan(torque)
        if gone.any():
            torque = bridged(log, robot, torque, low, slice(0, len(log)), absent, _stamps(stamps, t, low))
        missing = flag_at(t, gone, at)
        values = {"t": at, "q": interpolate(t, piece.q, at), side: np.where(missing, np.nan, interpolate_torque(t, torque, at, *extremes))}  # type: ignore[arg-type]
        for k, recorded in (("dq", piece.velocity(robot.transmission)), ("ddq", piece.ddq)):
            if recorded is not None:
                values[k] = interpolate(t, recorded, at)
        for k, v in values.items():
            if k not in writers:
                writers[k] = DiskWriter(folder / f"even-{k}.f64", 0 if k == "t" else robot.n)
            writers[k].append(v)
        after = last
    return replace(log, arrays={k: w.close() for k, w in writers.items()}, blocks=())


def _stamps(stamps: DiskArray, known: Array, low: int) -> Callable[[Array], Array]:
    """Stamps by their places, of which those from `low` on are in memory."""

    def at(places: Array) -> Array:
        return np.array([known[p - low] if low <= p < low + len(known) else stamps[int(p)] for p in places.tolist()])

    return at


def _plain(name: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in name)
