"""The classes of input that are fuzzed: what files there are, how they are changed, and what is done with each."""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import ident
from ident import cli
from ident._utils.toml import to_toml
from ident.errors import ConfigurationError, DataError, IdentError
from ident.robots.urdf import prepare_urdf

from . import mutations, recordings, seeds
from .differences import same_log, same_robot, sound_estimate, sound_log, streamed_as_whole, texts_agree
from .mutations import Rng
from .outcomes import Difference

#: Suffixes of tables of text, which are read again without pyarrow too, and compared.
_TEXT = {".csv", ".tsv", ".txt"}


@dataclass(frozen=True)
class Kind:
    """`sources`: files that are right; `change`: one of them, changed; `use`: what is done with it."""

    name: str
    sources: Callable[[], Mapping[str, Any]]
    change: Callable[[Rng, str, Any], bytes]
    use: Callable[[Path], None]


# --- logs -----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def logs_of_text() -> dict[str, bytes]:
    return {**seeds.tables(), **recordings.messages()}


def use_log(path: Path) -> None:
    """Read, audit, and read in other ways too: piece by piece and, where it is a text, without pyarrow."""
    robot = seeds.robot()
    is_text = bool(_TEXT & set(path.suffixes))
    try:
        logs = ident.read_logs(path, robot)
    except IdentError:
        streamed_as_whole(path, robot, None, is_text)
        raise
    for log in logs:
        sound_log(log)
    if is_text:
        texts_agree(path, robot, logs)
    streamed_as_whole(path, robot, logs, is_text)
    try:
        ident.audit(logs, robot)
    except DataError:
        return
    if sum(len(log) for log in logs) >= 60 and path.stat().st_size % 8 == 0:  # one in eight is fitted
        sound_estimate(ident.fit(logs, robot, model=[ident.make_effect("viscous")], held=0))


def change_table(rng: Rng, name: str, data: bytes) -> bytes:
    return mutations.mutated(rng, data, mutations.TABLE)


def change_packed(rng: Rng, name: str, data: bytes) -> bytes:
    """Bytes of the packed file, or of the text in it."""
    if rng.random() < 0.5:
        return mutations.mutated(rng, data, mutations.BYTES)
    packed = recordings.PACK[Path(name).suffix](mutations.mutated(rng, seeds.table(), mutations.TABLE))
    return mutations.mutated(rng, packed, mutations.BYTES) if rng.random() < 0.2 else packed + (b"\x00" * 9 if rng.random() < 0.2 else b"")


def change_bytes(rng: Rng, name: str, data: bytes) -> bytes:
    return mutations.mutated(rng, data, mutations.BYTES)


# --- robots -----------------------------------------------------------------------------------------------------------


def change_urdf(rng: Rng, name: str, data: bytes) -> bytes:
    """Text, or an attribute or an element of it."""
    if rng.random() < 0.5:
        return mutations.mutated(rng, data, mutations.TEXT)
    from lxml import etree

    root = etree.fromstring(data)
    for _ in range(int(rng.integers(1, 3))):
        element = mutations.of(rng, list(root.iter(etree.Element)))
        way = int(rng.integers(6))
        parent = element.getparent()
        if way <= 2 and element.attrib:
            key = mutations.of(rng, list(element.attrib))
            words = element.get(key).split()
            if words and way == 0:
                words[int(rng.integers(len(words)))] = mutations.of(rng, mutations.NUMBERS)
            elif words:
                words = [str(mutations.of(rng, (*mutations.NUMBERS, "j1", "base", "a", "offset", "t")))]
            _set(element, key, " ".join(words))
        elif way == 3 and element.attrib:
            key = mutations.of(rng, list(element.attrib))
            _set(element, key + "x", element.attrib.pop(key))
        elif way == 4 and parent is not None:
            parent.remove(element)
        elif parent is not None:
            parent.insert(0, etree.fromstring(etree.tostring(element)))
    return etree.tostring(root, encoding=str(mutations.of(rng, ("utf-8", "utf-16", "iso-8859-1"))), xml_declaration=True)


def _set(element: Any, key: str, value: str) -> None:
    try:
        element.set(key, value)
    except ValueError:  # a character that no XML can hold: such come in by the bytes
        element.set(key, "?")


def use_urdf(path: Path) -> None:
    """Read, reduce, and write and read again."""
    robot = ident.Robot.from_urdf(path)
    again = ident.Robot.from_urdf(robot.source["urdf_text"])
    same_robot(robot, again)
    prepare_urdf(robot.source["urdf_text"])
    if robot.n > 8:
        return
    report = ident.base(robot)
    if not report.agreement:
        raise Difference(f"the ways of counting base parameters do not agree: {str(report)[:200]}")
    if robot.nominal is not None and not np.all(np.isfinite(robot.nominal)):
        raise Difference("nominal parameters are not finite")


# --- structured text --------------------------------------------------------------------------------------------------


def studies() -> dict[str, Any]:
    return {"full.toml": seeds.STUDY, "plain.toml": seeds.PLAIN_STUDY, "loop.toml": seeds.LOOP_STUDY}


def change_study(rng: Rng, name: str, content: Any) -> bytes:
    for _ in range(20):
        changed = mutations.tree(rng, content) if rng.random() < 0.7 else content
        try:
            text = to_toml(changed).encode("utf-8", "replace")
        except (ConfigurationError, AttributeError, TypeError):
            continue  # what TOML cannot hold
        return text if changed is not content else mutations.mutated(rng, text, mutations.TEXT)
    return b""


def use_study(path: Path) -> None:
    """Read a study, and fit with it."""
    (path.parent / "arm.urdf").write_text(seeds.URDF)
    (path.parent / "log.csv").write_bytes(seeds.table())
    study = ident.read_study(path)
    study.to_toml(path.parent)
    robot = study.robot()
    study.model(robot)
    study.make_estimator()
    study.make_preparation()
    if path.stat().st_size % 4 == 0 and study.fit_files():
        sound_estimate(ident.fit(study))


def change_fit(rng: Rng, name: str, content: Any) -> bytes:
    if rng.random() < 0.7:
        return json.dumps(mutations.tree(rng, content)).encode()
    return mutations.mutated(rng, json.dumps(content).encode(), mutations.TEXT)


def use_fit(path: Path) -> None:
    """Load a saved fit, and use it as commands do."""
    estimate = ident.Estimate.load(path)
    str(estimate)
    json.dumps(estimate.to_dict(), allow_nan=False)
    ident.validate(estimate, ident.ZeroPhase()(seeds.log_set(), estimate.model.robot))
    estimate.save(path.parent / "again.json", force=True)
    same = ident.Estimate.load(path.parent / "again.json")
    if not np.array_equal(same.values, estimate.values, equal_nan=True):
        raise Difference("values are others after a round trip")


# --- whole commands --------------------------------------------------------------------------------------------------


_DRIVE = b"ratio = [50, 30.0]\nmeasured = 'motor'\neffects = ['viscous', { name = 'coulomb', joints = ['j1'] }]\n"


@lru_cache(maxsize=1)
def commands() -> dict[str, Any]:
    """Command lines whose files are changed: name of the changed file → the command, the file, how it is changed."""
    return {
        "fit.log.csv": (("fit", "--urdf", "{right}/arm.urdf", "--log", "{file}"), seeds.table(), mutations.TABLE),
        "fit.arm.urdf": (("fit", "--urdf", "{file}", "--log", "{right}/log.csv"), seeds.URDF.encode(), mutations.TEXT),
        "check.log.csv.gz": (("check", "--urdf", "{right}/arm.urdf", "--log", "{file}"), recordings.packed()["a.csv.gz"], mutations.BYTES),
        "stream.log.csv": (("fit", "--stream", "--urdf", "{right}/arm.urdf", "--log", "{file}"), seeds.table(), mutations.TABLE),
        "base.arm.urdf": (("base", "--urdf", "{file}"), seeds.MIMIC.encode(), mutations.TEXT),
        "validate.fit.json": (("validate", "--fit", "{file}", "--log", "{right}/log.csv"), _fit(), mutations.TEXT),
        "judge.fit.json": (("judge", "{file}"), _fit(), mutations.TEXT),
        "export.fit.json": (("export", "{file}", "{out}/made.urdf"), json.dumps(seeds.possible_fit()).encode(), mutations.TEXT),
        "report.fit.json": (("report", "{file}", "-o", "{out}/made.html"), _fit(), mutations.TEXT),
        "study.toml": (("fit", "{file}"), to_toml(seeds.PLAIN_STUDY).encode(), mutations.TEXT),
        "simulate.way.csv": (("simulate", "--urdf", "{right}/arm.urdf", "--trajectory", "{file}"), _way(), mutations.TABLE),
        "plan.toml": (("simulate", "--urdf", "{right}/arm.urdf", "--plan", "{file}", "--tracking", "exact"), _plan(), mutations.TEXT),
        "drive.toml": (("base", "--urdf", "{right}/arm.urdf", "--drive", "{file}"), _DRIVE, mutations.TEXT),
    }


def _fit() -> bytes:
    return json.dumps(seeds.saved_fits()["plain.json"]).encode()


@lru_cache(maxsize=1)
def _way() -> bytes:
    t, q, _ = seeds.motion()
    rows = [f"{a:.4f},{b:.6f},{c:.6f}" for a, (b, c) in zip(t, q, strict=True)]
    return "\n".join(["t,q1,q2", *rows, ""]).encode()


@lru_cache(maxsize=1)
def _plan() -> bytes:
    plan = ident.plan(seeds.robot().rigid_body())
    return to_toml(plan.tables()).encode()


def change_command(rng: Rng, name: str, content: Any) -> bytes:
    _, data, ways = content
    return mutations.mutated(rng, data, ways)


def use_command(path: Path) -> None:
    """Run the command on the changed file; its exit code is 0, 2 or 3, and only that of a gate 1."""
    arguments = commands()[path.name][0]
    with TemporaryDirectory() as right, TemporaryDirectory() as out:
        (Path(right) / "arm.urdf").write_text(seeds.URDF)
        (Path(right) / "log.csv").write_bytes(seeds.table())
        (path.parent / "arm.urdf").write_text(seeds.URDF)
        (path.parent / "log.csv").write_bytes(seeds.table())
        given = [a.format(file=path, right=right, out=out) for a in arguments]
        given += [] if "{out}" in " ".join(arguments) else ["--out", f"{out}/results"]
        said, told = io.StringIO(), io.StringIO()
        with redirect_stdout(said), redirect_stderr(told):
            code = run_command(given)
        left = sorted(str(p.relative_to(out)) for p in Path(out).rglob("*"))
    text = told.getvalue()
    if code == 70:
        raise Difference(f"exit 70: {text[-300:]}")
    if code not in (0, 1, 2, 3):
        raise Difference(f"exit {code}: {text[-300:]}")
    if code in (2, 3):
        if not text.startswith(f"ident {given[0]}: ") and f"\nident {given[0]}: " not in text:
            raise Difference(f"exit {code} without a reason: {text[-300:]!r}")
        if left:
            raise Difference(f"exit {code}, but something was written: {left}")
        raise ConfigurationError("refused")


def run_command(arguments: list[str]) -> int:
    """A command in this process; its exit code."""
    shown = warnings.showwarning
    try:
        return cli.main(arguments)
    except SystemExit as error:
        return int(error.code or 0)
    finally:
        warnings.showwarning = shown


KINDS: dict[str, Kind] = {
    k.name: k
    for k in (
        Kind("logs", logs_of_text, change_table, use_log),
        Kind("compressed", recordings.packed, change_packed, use_log),
        Kind("binary", recordings.stored, change_bytes, use_log),
        Kind("urdf", seeds.robots, change_urdf, use_urdf),
        Kind("toml", studies, change_study, use_study),
        Kind("json", seeds.saved_fits, change_fit, use_fit),
        Kind("commands", commands, change_command, use_command),
    )
}

__all__ = ["KINDS", "Kind", "same_log"]
