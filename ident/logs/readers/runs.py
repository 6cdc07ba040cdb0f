"""Several recordings in one file of named arrays: an array of structs (`runs(2).q`), or structs beside each other (`exp.run1.q`)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...errors import DataError
from ..words import words_of

Array = np.ndarray
#: Words for what a number counts beside recordings: joints.
_JOINTS = {"joint", "joints", "axis", "axes", "motor", "motors", "servo", "link", "dof", "actuator", "actuators", "leg", "arm", "j"}
#: Words for recordings.
RUNS = {
    "run", "runs", "trial", "trials", "exp", "experiment", "experiments", "test", "tests", "episode", "episodes", "demo", "demos", "rep",
    "take", "takes", "traj", "trajectory", "trajectories", "session", "record", "recording", "recordings", "measurement", "measurements",
}  # fmt: skip
#: A recording's number before an array's name or behind it, where paths are written in one word: `run1_q`, `q_trial_02`.
_BEFORE = re.compile(rf"(?P<run>({'|'.join(sorted(RUNS))})_?\d+)[_\-](?P<name>.+)", re.IGNORECASE)
_BEHIND = re.compile(rf"(?P<name>.+)[_\-](?P<run>({'|'.join(sorted(RUNS))})_?\d+)", re.IGNORECASE)


def grouped_by_run(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """The same arrays with a path for a recording's number in their names: `run1.q` for `run1_q`; as they are where it tells none."""
    told = {name: found for name in arrays if (found := _BEFORE.fullmatch(name) or _BEHIND.fullmatch(name))}
    renamed = {name: f"{told[name]['run']}.{told[name]['name']}" if name in told else name for name in arrays}
    several = len({found["run"] for found in told.values()}) > 1 and len(set(renamed.values())) == len(arrays)
    return {renamed[name]: a for name, a in arrays.items()} if several else dict(arrays)


def runs_of(arrays: Mapping[str, Array]) -> tuple[str, ...]:
    """The paths before the arrays of each recording (`runs[0]`), in order; () where the file holds one.

    Groups that differ in one number and hold arrays of the same names are recordings: where a word says so, where each holds all joints,
    or where they differ in length. With series of their length beside them, or a word for joints, they are the joints of one."""
    places: dict[tuple[str, str], dict[str, dict[str, Array]]] = {}
    for name, a in arrays.items():
        parts = name.split(".")
        for k, part in enumerate(parts[:-1]):
            pattern = re.sub(r"\d+", "#", part)
            if pattern != part:
                group = ".".join(parts[: k + 1])
                places.setdefault((".".join(parts[:k]), pattern), {}).setdefault(group, {})[name[len(group) + 1 :]] = a
                break
    for (_, pattern), groups in places.items():
        if len(groups) > 1 and set.intersection(*map(set, groups.values())) and _are_runs(pattern, groups, arrays):
            return tuple(sorted(groups, key=lambda g: [int(x) if x.isdecimal() else x for x in re.split(r"(\d+)", g)]))
    return ()


def _are_runs(pattern: str, groups: Mapping[str, Mapping[str, Array]], arrays: Mapping[str, Array]) -> bool:
    own = {f"{group}.{name}" for group, members in groups.items() for name in members}
    lengths = [max((_rows(a) for a in members.values()), default=0) for members in groups.values()]
    if words_of(pattern) & _JOINTS or max(lengths) < 2:
        return False
    if words_of(pattern) & RUNS:
        return True
    beside = {_rows(a) for name, a in arrays.items() if name not in own}
    whole = any(a.ndim == 2 and min(a.shape) > 1 for members in groups.values() for a in members.values())
    return not beside & set(lengths) and (whole or len(set(lengths)) > 1)


def _rows(a: Array) -> int:
    return max(a.shape, default=0) if a.dtype.kind in "fiub" else 0


def run_name(group: str) -> str:
    """A recording's name as MATLAB counts it: `runs[0]` is `runs(1)`."""
    return re.sub(r"\[(\d+)\]", lambda found: f"({int(found[1]) + 1})", group)


def arrays_of_run(arrays: Mapping[str, Array], inside: str) -> dict[str, Array]:
    """The arrays of the recording of this name, by their names in it, and what belongs to all; {} where there is none."""
    groups = runs_of(arrays)
    group = next((g for g in groups if run_name(g) == inside), None)
    if group is None:
        return {}
    shared = {name: a for name, a in arrays.items() if not any(name.startswith(f"{g}.") for g in groups)}
    return shared | {name[len(group) + 1 :]: a for name, a in arrays.items() if name.startswith(f"{group}.")}


def of_one_run(arrays: Mapping[str, Array], path: Path, inside: str) -> dict[str, Array]:
    """The arrays of the recording `inside` a file; all of them where that is "". Raises DataError where the file holds no such."""
    if not inside:
        return dict(arrays)
    found = arrays_of_run(arrays, inside)
    if not found:
        raise DataError(f"log {path}: holds no recording {inside!r}; it has {', '.join(map(run_name, runs_of(arrays))) or 'one'}.")
    return found
