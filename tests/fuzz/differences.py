"""Readings of one file that must agree, and what every result must keep to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

import ident
from ident.errors import IdentError, UnsupportedError
from ident.logs.readers import text as whole_text
from ident.streaming import text
from ident.streaming.ingest import Reading, store_logs

from .outcomes import Difference

Array = np.ndarray
#: Arrays of a log that are read from its columns.
_ARRAYS = ("t", "q", "q_motor", "dq", "ddq", "dq_motor")


def arrays_of(log: Any) -> dict[str, Array]:
    found = {name: getattr(log, name) for name in _ARRAYS if getattr(log, name) is not None}
    # Infinite torque counts as none, wherever that is decided.
    return {**found, **{f"tau_{side}": np.where(np.isfinite(a), a, np.nan) for side, a in log.tau.items()}}


def same_log(a: Any, b: Any, what: str) -> None:
    """The very same numbers: which reader reads a file changes no bit."""
    one, two = arrays_of(a), arrays_of(b)
    if set(one) != set(two):
        raise Difference(f"{what}: {sorted(one)} and {sorted(two)}")
    for name, values in one.items():
        if values.shape != two[name].shape:
            raise Difference(f"{what}: {name} is {values.shape} and {two[name].shape}")
        if not np.array_equal(values, two[name], equal_nan=True):
            worst = float(np.nanmax(np.abs(values - two[name])))
            raise Difference(f"{what}: {name} differs by {worst:g}")


def sound_log(log: ident.Log) -> None:
    """Times rise, positions are numbers, and the arrays have one length."""
    if not (np.all(np.isfinite(log.t)) and np.all(np.diff(log.t) > 0)):
        raise Difference(f"times of {log.name} do not rise")
    for name, a in arrays_of(log).items():
        if len(a) != len(log.t):
            raise Difference(f"{name} has {len(a)} rows, t {len(log.t)}")
        if name in ("q", "q_motor") and not np.all(np.isfinite(a)):
            raise Difference(f"{name} holds a value that is not a number")


def sound_estimate(estimate: ident.Estimate) -> None:
    """Numbers are numbers, and no variance is negative."""
    if not np.all(np.isfinite(estimate.values)):
        raise Difference("values are not finite")
    if np.any(np.diag(estimate.covariance) < 0):
        raise Difference("a variance is negative")


def same_robot(a: ident.Robot, b: ident.Robot) -> None:
    """What is stored of a robot gives the robot that was read."""
    if a.joint_names != b.joint_names or a.joints != b.joints:
        raise Difference(f"joints {a.joints} and {b.joints}")
    for name in ("parent", "rotation", "translation", "axis", "prismatic", "gravity"):
        if not np.array_equal(getattr(a.tree, name), getattr(b.tree, name)):
            raise Difference(f"{name} of the tree")
    if (a.nominal is None) != (b.nominal is None) or (a.nominal is not None and not np.array_equal(a.nominal, b.nominal)):
        raise Difference("nominal inertials")


@contextmanager
def without_arrow() -> Iterator[None]:
    """Text is read as where pyarrow is not installed."""

    def found(name: str) -> Any:
        return None if name == "pyarrow" else find_spec(name)

    with patch.object(whole_text, "find_spec", found), patch.object(text, "find_spec", found):
        yield


def texts_agree(path: Path, robot: ident.Robot, logs: ident.LogSet) -> None:
    """The same text without pyarrow: the same numbers, or the same refusal."""
    with without_arrow():
        try:
            again = ident.read_logs(path, robot)
        except IdentError as error:
            raise Difference(f"read with pyarrow, refused without: {error}") from None
    _same_set(logs, again, "with and without pyarrow")


def _same_set(one: Any, two: Any, what: str) -> None:
    if len(one) != len(two):
        raise Difference(f"{what}: {len(one)} and {len(two)} runs")
    for a, b in zip(one, two, strict=True):
        same_log(a, b, what)


def streamed(path: Path, robot: ident.Robot) -> list[ident.Log]:
    """A file read piece by piece."""
    with TemporaryDirectory() as folder:
        runs = store_logs(path, Path(folder) / "rows", Reading(robot))
        return [run.read(0, len(run)) for run in runs]


def streamed_as_whole(path: Path, robot: ident.Robot, logs: ident.LogSet | None, is_text: bool = True) -> None:
    """The same file piece by piece, a text by the compiled and by the lenient reader: what whole reading made of it (None: a refusal)."""
    for what, compiled in (("streamed, compiled", None), ("streamed, lenient", lambda name: None))[: 2 if is_text else 1]:
        try:
            if compiled is None:
                runs = streamed(path, robot)
            else:
                with patch.object(text, "compiled", compiled):
                    runs = streamed(path, robot)
        except UnsupportedError:
            return  # said to be read as a whole only
        except IdentError as error:
            if logs is not None and not any("recognised" in note for note in logs.notes):
                raise Difference(f"{what}: refused what is read whole: {error}") from None
            continue
        if logs is None:
            raise Difference(f"{what}: read what is refused whole")
        if any("unwrapped" in note or "repeat the row before" in note for note in logs.notes):
            continue  # compared where it is done, on signals
        _same_set(logs, runs, what)
