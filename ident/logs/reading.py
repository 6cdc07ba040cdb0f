"""Reading logs from files: columns planned, values repaired, runs told apart."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import sha256
from .._utils.text import counted
from ..errors import DataError, IdentError, unknown_name
from ..robots.robot import require_robot
from .channel_group import joint_of
from .columns import resolve_columns
from .command_columns import named_commands, without_commands
from .files import LogFile, content_file, log_files
from .joint_files import JointFiles, by_joints, together
from .locked import locked_notes
from .log import Log, LogSet, log_of
from .names import JointNames
from .planning import COUNTED, PlannedLog, planned
from .readers.frames import is_frame
from .readers.ros import joint_state_columns, read_joint_states
from .readers.stored import split_inside
from .references import numbered_reference
from .repair import blank_unusable, drop_empty, repeated_rows, usable_rows
from .source import TableSource
from .torque import as_meant
from .unwrap import from_one_turn, motor_turn_notes, unwrapped, within_limits, wrapping

if TYPE_CHECKING:
    import pandas as pd

    from ..robots.robot import Robot

Array = np.ndarray
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Request:
    """How logs are to be read."""

    joints: JointNames | None
    columns: Mapping[str, Any] | None
    commands: Mapping[str, str]
    missing: str
    extra: bool
    rate_hz: float | None
    torque: str | None
    sign: tuple[float, ...]


def read_logs(
    paths: str | Path | pd.DataFrame | Sequence[str | Path | pd.DataFrame],
    robot: Robot | None = None,
    columns: Mapping[str, Any] | None = None,
    *,
    missing: str = "refuse",
    extra: bool = True,
    rate_hz: float | None = None,
    torque: str | None = None,
    torque_sign: Sequence[float] = (1.0,),
    skip_bad_files: bool = False,
) -> LogSet:
    """Read recordings: CSV in its dialects, compressed or not; Parquet, MAT, NPZ, HDF5, ROS 1 and ROS 2 bags, MCAP, JSON and XML messages.

    Columns that go by other names are recognised by the structure of their names; `Log.recording` and the notes say what was taken for
    what, and what was ignored.

    Parameters
    ----------
    paths : str, Path, DataFrame or sequence
        A file, a pattern (`runs/*.csv`), the folder of a bag, of a data set or of logs (also of files of one joint each), a recording
        inside a file (`demo.hdf5/data/demo_3`), a pandas DataFrame with a file's columns, or several.
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
    torque : str, optional
        What a torque is whose column tells neither side nor unit: "link" (behind the gears), "motor", "current", "estimated" or "command"
        (said in the notes), "none" (not used); "external", without gravity and friction, is refused.
    torque_sign : sequence
        1 or -1, for all joints or for each: by what torques and currents are multiplied.
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
    require_robot(robot)
    columns, commands = without_commands(columns)
    joints = None if robot is None else JointNames.of(robot)
    request = _Request(joints, columns, commands, missing, extra, rate_hz, torque, tuple(torque_sign))
    logs, left_out = _all_of(_sources(paths, joints), request, skip_bad_files)
    if robot is not None:
        logs = [_turned(log, robot) if log.q is not None else _joined(log, robot) for log in logs]
        logs = [replace(log, notes=(*log.notes, *locked_notes(log, robot))) for log in logs]
    return LogSet(tuple(logs), robot, tuple(left_out))


def _all_of(sources: Sequence[LogFile | JointFiles | pd.DataFrame], request: _Request, skip_bad_files: bool) -> tuple[list[Log], list[str]]:
    """Every log, its name told apart from those of the others, and why files are left out where bad ones may be."""
    logs: list[Log] = []
    left_out: list[str] = []
    for source in sources:
        try:
            logs += _logs_of(source, request)
        except IdentError as error:
            if not skip_bad_files:
                raise
            left_out.append(str(error))
    if left_out and not logs:
        raise DataError(f"none of {counted(len(left_out), 'log')} can be read; the first: {left_out[0]}")
    names: dict[str, int] = {}
    for i, log in enumerate(logs):
        _LOG.info("read %s: %d samples, %d joints, %.4g s", log.source or log.name, len(log), log.n, log.duration)
        names[log.name] = names.get(log.name, 0) + 1
        if names[log.name] > 1:
            logs[i] = replace(log, name=f"{log.name} ({names[log.name]})")
    return logs, left_out


def logs_of(data: Any, robot: Robot | None) -> LogSet:
    """Logs as they are, one or several; else what `read_logs` reads."""
    if isinstance(data, LogSet):
        return data
    if isinstance(data, Log):
        return LogSet((data,), robot)
    if isinstance(data, list | tuple) and data and all(isinstance(x, Log) for x in data):
        return LogSet(tuple(data), robot)
    return read_logs(data, robot)


def _joined(log: Log, robot: Robot) -> Log:
    """A log of which only motor positions were recorded, with joint positions beside them."""
    assert log.q_motor is not None
    notes = (*log.notes, *motor_turn_notes(log.name, robot, wrapping(log.q_motor)))
    return replace(log, q=log.position(robot.transmission), notes=notes)


def _turned(log: Log, robot: Robot) -> Log:
    """A log whose joint positions lie within the joints' limits, where whole turns are all that keeps them out (0 … 360 degrees)."""
    assert log.q is not None
    if log.q.shape[1] != robot.n:
        return log
    q, moved = within_limits(unwrapped(log.q), robot)
    if not moved:
        return log
    said = f"log {log.name}: positions of {', '.join(moved)} are unwrapped, and shifted by full turns into the joint limits."
    return replace(log, q=q, notes=(*log.notes, said))


def _sources(paths: Any, joints: JointNames | None) -> list[LogFile | JointFiles | pd.DataFrame]:
    """Files, and tables in memory, in the order given."""
    given: list[Any] = [paths] if isinstance(paths, str | Path) or is_frame(paths) else list(paths)
    if not any(is_frame(one) for one in given):
        return [*by_joints(log_files(given), joints)]
    return [source for one in given for source in ([one] if is_frame(one) else log_files([one]))]


def _logs_of(source: LogFile | JointFiles | pd.DataFrame, request: _Request) -> list[Log]:
    if isinstance(source, LogFile):
        return _with_desired(source, request)
    if not isinstance(source, JointFiles):
        return _read(source, request)
    found = together(source, request.joints, lambda path, joint: _read(path, replace(request, joints=joint)))
    return found if found is not None else [log for path in source.paths for log in _read(path, request)]


def _with_desired(file: LogFile, request: _Request) -> list[Log]:
    """The logs of a file, with the desired motion of the file beside it on their clock, if there is one."""
    logs = _read(file.path, request)
    if file.desired is None:
        return logs
    try:
        desired = _read(file.desired, request)[0]
    except DataError:
        return logs
    out = []
    for log in logs:
        said = f"log {file.path}: {file.desired.name} beside it holds the desired motion of the same run."
        extras = dict(log.extra)
        if desired.q is not None and log.q is not None and desired.q.shape[1] == log.q.shape[1] and np.ptp(desired.q, axis=0).any():
            for j in range(log.n):
                extras[f"q_ref{j + 1}"] = np.interp(log.t, desired.t, desired.q[:, j], left=np.nan, right=np.nan)
        else:
            said += " It holds no motion, and is not used."
        out.append(replace(log, extra=extras, notes=(*log.notes, said)))
    return out


def _read(given: Path | pd.DataFrame, request: _Request) -> list[Log]:
    source = TableSource.of(given)
    where, path = source.where, source.path
    joints, columns = request.joints, request.columns
    layout = None if columns or path is None else joint_state_columns(source.header)
    if layout is not None and path is not None:
        table = read_joint_states(path, source.header, layout, joints.names if joints else None)
        found = PlannedLog(resolve_columns(tuple(table), joints, None, where=where))
        extras: dict[str, Array] = {}
    else:
        found = planned(source, joints, columns, request.rate_hz)
        table, extras = _values(source, found, request)
    plan = found.plan
    arrays = plan.arrays(table)
    blank_unusable(arrays)
    meant = as_meant(arrays, request.torque, request.sign, where)
    rows = len(arrays["t"])
    if rows == 0:
        raise DataError(f"{where}: there is a header, but no row of data.")
    if rows < 2:
        raise DataError(f"{where}: one row of data; a log needs many.")
    empty = drop_empty(arrays, where)
    notes = [*source.notes, *plan.notes, *meant, *empty]
    hint = "the torque is zero in every row" if empty and not any(k.startswith("tau") for k in arrays) else plan.hint
    side = "q" if "q" in arrays else "q_motor"
    if found.recording is not None and side == "q" and joints is None:
        arrays["q"], turned = from_one_turn(arrays["q"])
        notes += [f"{where}: positions within one turn (0 … 360 degrees) are unwrapped."] if turned else []
    positions = {c.source: arrays[side][:, c.joint] for c in plan.quantity(side)}
    pieces = usable_rows(arrays["t"], positions, where, missing=request.missing, repeated=repeated_rows(arrays))
    extras = _numbered_references(extras, joints.names if joints else plan.joints)
    if request.extra:
        extras = named_commands(extras, request.commands, source.header.names, where)
    outer, inside = (None, "") if path is None else split_inside(path)
    stem = inside.replace("/", " ") or source.name
    digest = "" if outer is None else sha256(content_file(outer))
    whole = len(pieces.rows) == 1 and len(pieces.rows[0]) == rows
    logs = []
    for i, index in enumerate(pieces.rows):
        cut: slice | Array = slice(None) if whole else index
        recorded = {k: v[cut] for k, v in arrays.items()}
        name = stem if len(pieces.rows) == 1 else f"{stem} run {i + 1}"
        log = log_of(name, recorded, "" if outer is None else str(outer), digest, (*notes, *pieces.notes))
        logs.append(
            replace(
                log,
                extra={k: v[cut] for k, v in extras.items()},
                hint=hint,
                joint_names=joints.names if joints else tuple(joint_of(name) for name in plan.joints),
                recording=found.recording,
            )
        )
    return logs


def _values(source: TableSource, found: PlannedLog, request: _Request) -> tuple[dict[str, Array], dict[str, Array]]:
    """The planned columns of a file, and others."""
    plan = found.plan
    stored = tuple(name for name in plan.sources if name != COUNTED)
    if found.table is not None:
        table = dict(found.table)
    else:
        table = source.read(stored, plan.extra if request.extra else ())
    if plan.rate_hz is not None:
        table[COUNTED] = np.arange(len(table[stored[0]])) / plan.rate_hz
    extras = {name: table[name] for name in plan.extra if name in table}
    missing = [name for name, *_ in found.reference.values() if name not in table]
    table |= source.read(missing, ()) if missing else {}
    extras |= {key: table[name] * factor + offset for key, (name, factor, offset) in found.reference.items()}
    return table, extras


def _numbered_references(extras: dict[str, Array], names: Sequence[str]) -> dict[str, Array]:
    """Desired motion by joint name (`elbow.position_reference`) as by number (`q_ref3`)."""
    return {numbered_reference(name, names) or name: values for name, values in extras.items()}
