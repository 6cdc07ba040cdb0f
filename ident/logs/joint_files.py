"""One run whose joints stand in files of their own (`joint1.csv`, `joint2.csv` …): which files belong together, and one log of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from ..errors import DataError, IdentError
from .files import LogFile
from .log import Log
from .names import JointNames, parse_name
from .readers.tables import read_header

Array = np.ndarray
_NUMBERED = re.compile(r"(?:^|(?<=[^a-z]))(joint|axis|axe|achse|gelenk|giunto|junta|eje|motor|servo|actuator|dof|j)[ _.-]?(\d+)(?!\d)")
#: Clocks that differ by less than this share of a sample are one; the least share of a run that all files have to cover.
_SAME, _COVERED = 0.5, 0.5
_DESIRED = ("q_ref", "dq_ref", "ddq_ref", "q_cmd")


@dataclass(frozen=True)
class JointFiles:
    """Files of one run, in the order of the joints, and the `joints` that their names tell ("" where only numbers do)."""

    paths: tuple[Path, ...]
    joints: tuple[str, ...]

    @property
    def where(self) -> str:
        """What messages call them."""
        return f"log {self.paths[0]} … {self.paths[-1].name}"


def by_joints(files: Sequence[LogFile], joints: JointNames | None) -> list[LogFile | JointFiles]:
    """The files, with those that by their names hold a joint each of one run put together, in the place of the first.

    Files side by side whose names differ in a joint's number or name alone; with a robot, as many as it has joints. So are files whose
    columns number one joint each (`q2`, `tau2`)."""
    places: dict[tuple[Path, str], dict[object, LogFile]] = {}
    for file in files:
        told = _joint_told(file.path, joints)
        if told is not None and file.desired is None and file.path.is_file():
            own = places.setdefault((file.path.parent, told[0]), {})
            own.setdefault(told[1], file)
    groups = [found for own in places.values() if (found := _ordered(own, joints)) is not None]
    member = {path: group for group in groups for path in group.paths}
    return list(dict.fromkeys(member.get(file.path, file) for file in files))


def _joint_told(path: Path, joints: JointNames | None) -> tuple[str, object] | None:
    """What is left of a file's name without its joint, and the joint: its name, or its number; None where neither the name tells it, nor
    the columns do."""
    stem = path.name.lower()
    for name in sorted(joints.names if joints else (), key=len, reverse=True):
        words = [word for word in re.split(r"[^a-z0-9]+", name.lower()) if word != "joint"]
        pattern = re.compile(r"(?<![a-z0-9])(joint[ _.-]?)?" + r"[ _.-]?".join(map(re.escape, words)) + r"([ _.-]?joint)?(?![a-z0-9])")
        if words and (found := pattern.search(stem)):
            return f"{stem[: found.start()]}#{stem[found.end() :]}", name
    if found := _NUMBERED.search(stem):
        return f"{stem[: found.start(2)]}#{stem[found.end(2) :]}", int(found[2])
    numbers = [*re.finditer(r"\d+", stem)]
    number = _numbered_by_columns(path) if numbers else None
    if number is None:
        return None
    return f"{stem[: numbers[-1].start()]}#{stem[numbers[-1].end() :]}", number


def _numbered_by_columns(path: Path) -> int | None:
    """The one joint that a file's columns number (`q2`, `tau2`), None where they number none, or several."""
    try:
        names = read_header(path).names
    except IdentError:
        return None
    found = {named.joint for name in names if (named := parse_name(name)) is not None and named.numbered}
    return next(iter(found)) + 1 if len(found) == 1 else None


def _ordered(own: dict[object, LogFile], joints: JointNames | None) -> JointFiles | None:
    """Files by joint as a run: all of the robot's by name, or numbers without a gap from 0 or 1; None where they are none."""
    if joints is not None and set(own) == set(joints.names):
        return JointFiles(tuple(own[name].path for name in joints.names), joints.names)
    numbers = sorted(key for key in own if isinstance(key, int))
    gapless = len(numbers) == len(own) > 1 and numbers[0] <= 1 and numbers == list(range(numbers[0], numbers[0] + len(own)))
    if not gapless or (joints is not None and len(own) != len(joints.names)):
        return None
    return JointFiles(tuple(own[k].path for k in numbers), joints.names if joints else tuple("" for _ in numbers))


def single_joints(joints: JointNames | None, count: int) -> list[JointNames | None]:
    """What each of the files is matched against: its joint of the robot."""
    if joints is None:
        return [None] * count
    return [JointNames((name,), (slides,), joints.side) for name, slides in zip(joints.names, joints.prismatic, strict=True)]


def together(files: JointFiles, joints: JointNames | None, read: Callable[[Path, JointNames | None], list[Log]]) -> list[Log] | None:
    """The run of these files; None where one of them holds more than one joint. Raises DataError where they are not of one run."""
    parts: list[Log] = []
    for path, alone in zip(files.paths, single_joints(joints, len(files.paths)), strict=True):
        try:
            found = read(path, alone)
        except IdentError:
            if joints is None or parts:
                raise
            return None  # who reads it by itself says what is wrong with it
        if any(log.n != 1 for log in found):
            return None
        if len(found) != 1:
            raise DataError(f"{files.where}: each seems to hold one joint, but time restarts in {path.name}: split it into runs first.")
        parts += found
    return [_one_log(files, parts)]


def _one_log(files: JointFiles, parts: Sequence[Log]) -> Log:
    clock, said = _clock(files, parts)
    first = parts[0]
    sides = [tuple(log.tau) for log in parts]
    if len(set(sides)) > 1:
        raise DataError(f"{files.where}: their torques are of different kinds ({', '.join('/'.join(s) or 'none' for s in sides)}).")

    def column(log: Log, values: Array) -> Array:
        return values if log.t is clock or np.array_equal(log.t, clock) else np.interp(clock, log.t, values)

    def joined(pick: Callable[[Log], Array | None]) -> Array | None:
        held = [(log, values) for log in parts if (values := pick(log)) is not None]
        return np.stack([column(log, v[:, 0]) for log, v in held], axis=1) if len(held) == len(parts) else None

    q, q_motor = joined(lambda log: log.q), joined(lambda log: log.q_motor)
    if q is None and q_motor is None:
        raise DataError(f"{files.where}: some hold positions of the motors, others of the joints.")
    tau = {side: values for side in first.tau if (values := joined(lambda log, side=side: log.tau[side])) is not None}  # type: ignore[misc]
    extra = {
        f"{key}{j + 1}": column(log, log.extra[f"{key}1"])
        for key in _DESIRED
        if all(f"{key}1" in log.extra for log in parts)
        for j, log in enumerate(parts)
    }
    digest = sha256("".join(log.sha256 for log in parts).encode()).hexdigest()
    names = files.joints if all(files.joints) else ()
    listed = ", ".join(path.name for path in files.paths)
    notes = (
        f"{files.where}: {listed} each hold one joint of the same run, in this order{said}.",
        *(note for log in parts for note in log.notes),
    )
    return Log(
        _name(files),
        clock,
        q,
        q_motor,
        joined(lambda log: log.dq),
        joined(lambda log: log.ddq),
        joined(lambda log: log.dq_motor),
        tau,
        str(files.paths[0]),
        digest,
        extra,
        notes,
        hint=next((log.hint for log in parts if log.hint), ""),
        joint_names=names,
    )


def _clock(files: JointFiles, parts: Sequence[Log]) -> tuple[Array, str]:
    """The times of all, and what is said of them: those of the first, between the latest beginning and the earliest end."""
    t = parts[0].t
    step = float(np.median(np.diff(t)))
    if all(len(log) == len(t) and np.abs(log.t - t).max() < _SAME * step for log in parts):
        return t, ""
    begin, end = max(log.t[0] for log in parts), min(log.t[-1] for log in parts)
    if end - begin < _COVERED * min(log.duration for log in parts):
        raise DataError(
            f"{files.where}: each seems to hold one joint of the same run, but their times do not overlap. If they are runs of a"
            f" robot with one joint, name them accordingly (run1.csv …); if they are one run, write them with a common clock."
        )
    return t[(t >= begin) & (t <= end)], "; those with other time stamps are interpolated to those of the first"


def _name(files: JointFiles) -> str:
    first, last = (path.name.split(".")[0] for path in (files.paths[0], files.paths[-1]))
    return f"{first} … {last}"
