"""What a log was taken for, without a robot; and the study file that says so."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .._utils.json import result
from .._utils.text import counted
from ..auditing import AuditFinding, audit
from ..errors import ConfigurationError
from ..logs.log import Log, LogSet
from ..logs.reading import read_logs
from ..study.study import Study, write_study
from ..study.tables import LogsTable
from .common import Output

#: Columns that are listed as not used, and runs that are told of, at the most.
_LISTED, _RUNS = 12, 6
#: Findings of the audit that need no robot, and tell that something was misread.
_MISREAD = {"unit", "velocity", "velocity_sign", "velocity_scale"}
_TORQUE = {"joint": "torque (N m, N)", "motor": "motor torque (N m, N)", "current": "current (A)"}


def check_recording(args: argparse.Namespace, out: Output) -> int:
    """`ident check --log FILE` alone: what is in a log, and what it would be read as."""
    rate = {"rate_hz": args.rate_hz} if args.rate_hz else {}
    study = Study(logs=LogsTable(fit=tuple(args.log), rate_hz=args.rate_hz))
    logs = read_logs(args.log, None, None, missing=args.missing or "refuse", **rate)
    for line in told(logs):
        out.say_wrapped(line)
    doubts = [f for f in audit(logs).findings if f.code in _MISREAD]
    alike: dict[str, list[AuditFinding]] = {}
    for doubt in doubts:
        alike.setdefault(re.sub(r"[\d.e+-]+", "#", doubt.text), []).append(doubt)
    said = [f"{', '.join(f.where for f in found)}: {found[0].text}" for found in alike.values()]
    for one in said:
        out.say_wrapped(f"warning: {one}")
    out.say_wrapped("No robot was given, so nothing was checked against one: add --robot NAME or --urdf FILE.")
    warnings = [*logs.notes, *said]
    if args.write_study:
        write_study_of(study, logs, Path(args.write_study), out)
    out.result(result("ident.recording/1", {"logs": [_data(log) for log in logs]}, inputs=logs.inputs, warnings=warnings), "check")
    return 0


def told(logs: Iterable[Log]) -> list[str]:
    """Lines on what logs were taken for, and what of them is not used."""
    lines: list[str] = []
    logs = list(logs)
    for log in logs[:_RUNS]:
        found = log.recording
        what = f"{found.recorder}, " if found is not None and found.recorder else ""
        step = float(np.median(np.diff(log.t)))
        joints = f" ({', '.join(log.joint_names)})" if log.joint_names else ""
        lines.append(
            f"log {log.name}: {what}{counted(len(log), 'sample')} in {log.duration:.4g} s ({1 / step:.4g} Hz),"
            f" {counted(log.n, 'joint')}{joints}"
        )
        own = f"{', '.join(_own(log))}, by ident's own names (rad, m, N m, N, A, s where no unit is given)"
        lines.append(f"  read as: {own if found is None else found.text}.")
        lines.append(f"  torque: {_torque(log).rstrip('.')}.")
        if wanted := sorted({key.rstrip("0123456789") for key in log.extra if "_ref" in key or "_cmd" in key}):
            lines.append(f"  desired motion: {', '.join(wanted)}.")
        if found is not None and found.ignored:
            more = f" and {len(found.ignored) - _LISTED} more" if len(found.ignored) > _LISTED else ""
            lines.append(f"  not used: {', '.join(found.ignored[:_LISTED])}{more}.")
        lines += [f"  note: {note.removeprefix(f'log {log.source}: ')}" for note in log.notes if ": recognised by" not in note]
    if len(logs) > _RUNS:
        lines.append(f"… and {counted(len(logs) - _RUNS, 'more run')}.")
    return lines


def _own(log: Log) -> list[str]:
    held = {"q": log.q, "q_m": log.q_motor, "dq": log.dq, "dq_m": log.dq_motor, "ddq": log.ddq, **log.tau}
    return [key for key, values in held.items() if values is not None]


def _torque(log: Log) -> str:
    if not log.tau:
        return log.hint or "none: positions alone do not determine a robot's dynamics"
    found = log.recording
    said = ", ".join(_TORQUE[side] for side in log.tau)
    return f"{said}: {found.effort}" if found is not None and found.effort else said


def _data(log: Log) -> dict[str, Any]:
    found = log.recording
    return {
        "name": log.name,
        "source": log.source,
        "samples": len(log),
        "duration": log.duration,
        "joints": list(log.joint_names),
        "torque": sorted(log.tau),
        "recorder": "" if found is None else found.recorder,
        "columns": {} if found is None else dict(found.mapping),
        "reference": {} if found is None else {key: column for key, (column, *_) in found.reference.items()},
        "ignored": [] if found is None else list(found.ignored),
        "notes": list(log.notes),
    }


def write_study_of(study: Study, logs: LogSet, path: Path, out: Output) -> None:
    """Write a study file that reads the logs as they were read. Raises ConfigurationError where they were not all read in one way."""
    mappings = [{} if log.recording is None else dict(log.recording.mapping) for log in logs]
    if any(m != mappings[0] for m in mappings):
        raise ConfigurationError(
            "--write-study: the logs were recorded in different ways, and a study file has one [columns] table. Write one study"
            " file for each."
        )
    columns = {key: value for key, value in mappings[0].items() if not (key == "t" and study.logs.rate_hz)}
    write_study(path, replace(study, columns=columns or study.columns), force=out.force)
    out.note(f"wrote {path}")
