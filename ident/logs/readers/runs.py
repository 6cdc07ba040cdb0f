"""Several recordings in one file of named arrays: an array of structs (`runs(2).q`), or structs beside each other (`exp.run1.q`)."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from ..words import words_of

Array = np.ndarray
#: Words for what a number counts beside recordings: joints.
_JOINTS = {"joint", "joints", "axis", "axes", "motor", "motors", "servo", "link", "dof", "actuator", "actuators", "leg", "arm", "j"}
#: Words for recordings.
RUNS = {
    "run", "runs", "trial", "trials", "exp", "experiment", "experiments", "test", "tests", "episode", "episodes", "demo", "demos", "rep",
    "take", "takes", "traj", "trajectory", "trajectories", "session", "record", "recording", "recordings", "measurement", "measurements",
}  # fmt: skip


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
