"""From a log file to runs on disk: one pass over the text, resumable, in constant memory.

The columns, units and repairs are those of `ident.read_logs`; only where the rows are kept differs."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import write_atomic
from ..errors import DataError, UnsupportedError
from ..logs.column_plan import ColumnPlan
from ..logs.files import content_file
from ..logs.log import log_of
from ..logs.names import JointNames
from ..logs.planning import planned, with_desired
from ..logs.readers.header import Header
from ..logs.readers.ros import joint_state_columns
from ..logs.readers.stored import split_inside
from ..logs.readers.strangers import Strangers
from ..logs.readers.tables import read_header
from ..logs.repair import Holes, blank_unusable, drop_empty, missing_rows, repeats_told, rising_runs, usable_numbers
from ..logs.source import TableSource
from ..logs.torque import as_meant
from ..robots.robot import Robot
from .digest import FileDigest
from .disk import DiskArray, DiskWriter
from .repeats import repeated_places
from .stored import StoredLog, is_desired, survey_of
from .survey import Survey, Surveyed
from .tables import PieceOfFile, chunked_file, pieces, shows_bytes
from .unwrapping import joined_positions, moved_into_limits

if TYPE_CHECKING:
    from ..study.study import Study

Array = np.ndarray
#: Seconds between two records of how far reading has come.
_RECORD_S = 2.0
#: Rows whose survey is kept as one, at least.
_BLOCK = 1 << 16


_COUNTED = "log {path}: a sample rate instead of a time column cannot be streamed; read the log into memory (--no-stream)."
_REARRANGED = "log {path}: a table with a row for each joint, or with time steps that add up, cannot be streamed; leave out --stream."


@dataclass
class _State:
    """How far a file has been read, and what was seen on the way."""

    place: PieceOfFile = field(default_factory=PieceOfFile)
    kept: int = 0
    unstamped: Holes = field(default_factory=Holes)
    holes: dict[str, Holes] = field(default_factory=dict)
    blocks: list[Surveyed] = field(default_factory=list)
    rising: bool = True
    last_t: float = -np.inf
    last_q: list[float] | None = None
    bounds: dict[str, list[list[float]]] = field(default_factory=dict)
    left: Strangers = field(default_factory=Strangers)
    done: bool = False

    def widen(self, quantity: str, values: Array) -> None:
        """Take in values (N, n) of a quantity: the least and the largest of each column, NaN where there is none."""
        known = [np.array(self.bounds[quantity])] if quantity in self.bounds else []
        whole = np.concatenate([*known, values])
        self.bounds[quantity] = [np.fmin.reduce(whole).tolist(), np.fmax.reduce(whole).tolist()]

    def to_json(self) -> str:
        return json.dumps(
            {
                "place": asdict(self.place),
                "kept": self.kept,
                "unstamped": self.unstamped.blocks,
                "holes": {k: v.blocks for k, v in self.holes.items()},
                "blocks": [[b.first, b.survey.to_dict()] for b in self.blocks],
                "rising": self.rising,
                "last_t": self.last_t,
                "last_q": self.last_q,
                "bounds": self.bounds,
                "left": asdict(self.left),
                "done": self.done,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> _State:
        data = json.loads(text)
        return cls(
            PieceOfFile(**data["place"]),
            data["kept"],
            Holes(data["unstamped"]),
            {k: Holes(v) for k, v in data["holes"].items()},
            [Surveyed(first, Survey.from_dict(found)) for first, found in data["blocks"]],
            data["rising"],
            data["last_t"],
            data["last_q"],
            data["bounds"],
            Strangers(**data.get("left", {})),
            data["done"],
        )


@dataclass(frozen=True)
class Reading:
    """How log files are read (see `read_logs`): `columns`, the study's table; `missing`: "refuse" or "gap"; `rate_hz`, `torque`, `sign`;
    `jobs`: threads that parse."""

    robot: Robot
    columns: Mapping[str, Any] | None = None
    missing: str = "refuse"
    rate_hz: float | None = None
    torque: str | None = None
    sign: tuple[float, ...] = (1.0,)
    jobs: int = 1

    @classmethod
    def of(cls, study: Study, robot: Robot) -> Reading:
        """As a study asks for."""
        how = study.reading()
        sign = tuple(how.pop("torque_sign", (1.0,)))
        return cls(robot, study.columns or None, sign=sign, **how)

    def as_meant(self, arrays: dict[str, Array], where: str) -> list[str]:
        """Put torques where they belong, with their sign, in place; notes."""
        return as_meant(arrays, self.torque, self.sign, where)

    def plan(self, path: Path) -> tuple[Any, ColumnPlan]:
        """Header and columns of a file. Raises DataError and ConfigurationError; UnsupportedError for what cannot be streamed."""
        file = chunked_file(path)
        if file is not None:
            source = TableSource(
                f"log {path}",
                path.name.split(".")[0],
                Header(file.names, units=tuple(file.units.get(name, "") for name in file.names)),
                lambda names, optional: file.sample([*names, *optional]),
                lambda name: [f"{x:g}" for x in file.sample([name])[name]],
                path,
                file.notes,
                whole=True,
                constants=file.constants,
            )
            found = planned(source, JointNames.of(self.robot), self.columns, self.rate_hz)
            if found.table is not None:
                raise UnsupportedError(_REARRANGED.format(path=path))
            return file, replace(with_desired(found), notes=(*file.notes, *found.plan.notes))
        if self.rate_hz is not None:
            raise UnsupportedError(_COUNTED.format(path=path))
        header = read_header(path)
        if header.delimiter == " " or header.decimal != "." or header.encoding != "utf-8-sig" or header.moments:
            raise UnsupportedError(f"log {path}: this dialect cannot be streamed; leave out --stream, or write the file with commas.")
        if not self.columns and joint_state_columns(header) is not None:
            raise UnsupportedError(
                f"log {path}: JointState messages with a name array cannot be streamed; read the log into memory (--no-stream)."
            )
        found = planned(TableSource.of(path), JointNames.of(self.robot), self.columns)
        if found.table is not None:
            raise UnsupportedError(_REARRANGED.format(path=path))
        if found.plan.rate_hz is not None:
            raise UnsupportedError(_COUNTED.format(path=path))
        return header, with_desired(found)


def store_logs(path: Path, folder: Path, reading: Reading, progress: Callable[[float], None] | None = None) -> tuple[StoredLog, ...]:
    """The runs of a file, their rows in files in `folder` (which is made, and taken up where it was left).

    Raises DataError naming file, column and row."""
    where = f"log {path}"
    header, plan = reading.plan(path)
    folder.mkdir(parents=True, exist_ok=True)
    record = folder / "read.json"
    present = {c.quantity: np.zeros((1, plan.n)) for c in plan.read}
    meant = reading.as_meant(present, where)
    state = _State.from_json(record.read_text()) if record.exists() else _State()
    with FileDigest(content_file(path), shown=not state.done and shows_bytes(path)) as digest:
        arrays = _read(path, folder, header, plan, reading, [*present], state, record, digest, progress)
        sums = digest.hexdigest()
    notes = missing_rows(state.unstamped, state.holes, state.place.rows, where, missing=reading.missing)
    if state.place.rows < 2:
        what = "one row of data; a log needs many." if state.place.rows else "there is a header, but no row of data."
        raise DataError(f"{where}: {what}")
    outer, inside = split_inside(path)
    stem = inside.replace("/", " ") or path.name.split(".")[0]
    empty = _without_empty(arrays, state, where)
    hint = "the torque is zero in every row" if empty and not any(k.startswith("tau") for k in arrays) else plan.hint
    log = StoredLog(stem, arrays, str(outer), sums, (), () if empty else tuple(state.blocks), hint=hint)
    again = repeated_places(arrays, _places(state) if state.unstamped or any(state.holes.values()) else None, state.place.rows)
    if len(again):
        notes.append(repeats_told(len(again), where))
    runs = [log] if state.rising and state.kept >= 2 and not len(again) else _runs(log, state, again, where, notes)
    noted = (*state.left.notes(where), *plan.notes, *meant, *empty, *notes)
    named = [replace(r, notes=noted, origin=None, name=stem if len(runs) == 1 else f"{stem} run {i + 1}") for i, r in enumerate(runs)]
    if "q" in arrays:
        named = [moved_into_limits(r, reading.robot, folder / f"moved-{i}") for i, r in enumerate(named)]
    else:
        named = [joined_positions(r, reading.robot, folder / f"joined-{i}") for i, r in enumerate(named)]
    return tuple(named)


def _read(
    path: Path,
    folder: Path,
    header: Any,
    plan: ColumnPlan,
    reading: Reading,
    present: list[str],
    state: _State,
    record: Path,
    digest: FileDigest,
    progress: Callable[[float], None] | None,
) -> dict[str, DiskArray]:
    """Append the rows that are left to the files of the folder."""
    quantities: list[str] = [
        q for q in ("t", "q", "q_motor", "dq", "ddq", "dq_motor", "tau_joint", "tau_motor", "tau_current") if q in present
    ]
    desired = list(dict.fromkeys(c.quantity for c in plan.wanted))
    quantities += desired
    side = "q" if "q" in quantities else "q_motor"
    sources = {c.joint: c.source for c in plan.quantity(side)}
    writers = {q: DiskWriter(folder / f"{q}.f64", 0 if q == "t" else plan.n, state.kept) for q in quantities}
    if not state.done:
        state.holes = state.holes or {sources[j]: Holes() for j in sorted(sources)}
        transmission, stem = reading.robot.transmission, path.name.split(".")[0]
        told = time.monotonic()
        for piece in pieces(path, header, plan, state.place, reading.jobs, digest.show):
            reading.as_meant(piece.arrays, f"log {path}")
            rows = _present(piece.arrays, side, sources, state)
            if len(rows["t"]):
                before = None if state.last_q is None else np.array(state.last_q)
                state.rising &= bool(np.all(np.diff(rows["t"], prepend=state.last_t) > 0))
                found = survey_of(log_of(stem, rows), transmission, before)
                if state.blocks and state.blocks[-1].survey.rows < _BLOCK:
                    state.blocks[-1] = Surveyed(state.blocks[-1].first, state.blocks[-1].survey + found)
                else:
                    state.blocks.append(Surveyed(state.kept, found))
                for q in quantities:
                    writers[q].append(rows[q])
                    if q != "t" and q not in desired:
                        state.widen(q, rows[q])
                state.kept += len(rows["t"])
                state.last_t, state.last_q = float(rows["t"][-1]), rows[side][-1].tolist()
            state.place, state.left = piece.after, state.left + piece.left
            if progress is not None:
                progress(piece.share)
            if time.monotonic() - told > _RECORD_S:
                _record(writers, state, record)
                told = time.monotonic()
        state.done = True
        _record(writers, state, record)
    return {q: writer.close() for q, writer in writers.items()}


def _without_empty(arrays: dict[str, DiskArray], state: _State, where: str) -> list[str]:
    """Leave out channels that hold nothing but zeros, as `read_logs` does; what to say of them."""
    bounds = {name: np.array(values) for name, values in state.bounds.items()}
    if not bounds:
        return []
    notes = drop_empty(bounds, where)
    for name in [name for name in arrays if name != "t" and name not in bounds and not is_desired(name)]:
        del arrays[name]
    return notes


def _record(writers: Mapping[str, DiskWriter], state: _State, record: Path) -> None:
    """First the rows, then how many there are: what is recorded is there, whenever the process dies."""
    for writer in writers.values():
        writer.flush()
    write_atomic(record, state.to_json(), force=True)


def _present(table: dict[str, Array], side: str, sources: Mapping[int, str], state: _State) -> dict[str, Array]:
    """The rows with a time stamp and every position, torque finite or NaN; the other rows are noted."""
    first = state.place.rows
    blank_unusable({name: values for name, values in table.items() if not is_desired(name)})
    good = usable_numbers(table["t"])
    positions = usable_numbers(table[side])
    if good.all() and positions.all():
        return table
    state.unstamped.add(~good, first)
    for j, name in sources.items():
        state.holes[name].add(~positions[:, j], first)
    good &= positions.all(axis=1)
    return {k: v[good] for k, v in table.items()}


def _places(state: _State) -> Array:
    """The rows of the file that were stored."""
    gone = state.unstamped.flag(state.place.rows)
    for hole in state.holes.values():
        gone |= hole.flag(state.place.rows)
    return np.flatnonzero(~gone)


def _runs(log: StoredLog, state: _State, again: Array, where: str, notes: list[str]) -> list[StoredLog]:
    """A file in which time starts again or repeats, or in which some stored rows repeat (`again`): its runs, copied where rows are dropped.
    Holds the time stamps in memory."""
    places = _places(state)
    t = np.full(state.place.rows, np.nan)
    t[places] = log.t[:]
    index = np.delete(places, again)
    # Places among the rows that were stored.
    stored = np.zeros(state.place.rows, np.int64)
    stored[places] = np.arange(len(places))
    positions = log.arrays["q" if "q" in log.arrays else "q_motor"]

    def moved(rows: Array) -> Array:
        at, out = stored[rows], np.zeros(len(rows), bool)
        for start in range(1, len(positions), _BLOCK):
            here = positions[start - 1 : min(start + _BLOCK, len(positions))]
            mine = slice(*np.searchsorted(at, (start, start + _BLOCK)))
            place = at[mine] - start + 1
            out[mine] = np.any(here[place] != here[place - 1], axis=1)
        return out

    found = rising_runs(t, index, where, notes, moved)
    out = []
    for i, rows in enumerate(found.rows):
        at = stored[rows]
        whole = log.part(int(at[0]), int(at[-1]) + 1)
        out.append(whole if len(whole) == len(at) else _thinned(whole, at - at[0], i))
    return out


def _thinned(log: StoredLog, rows: Array, number: int) -> StoredLog:
    """Some rows of a run, copied."""
    arrays = {}
    for name, array in log.arrays.items():
        writer = DiskWriter(array.path.with_name(f"run-{number}-{array.path.name}"), array.width)
        for start in range(0, len(log), 1 << 16):
            stop = min(start + (1 << 16), len(log))
            mine = rows[np.searchsorted(rows, start) : np.searchsorted(rows, stop)]
            writer.append(array[start:stop][mine - start])
        arrays[name] = writer.close()
    return replace(log, arrays=arrays, blocks=())
