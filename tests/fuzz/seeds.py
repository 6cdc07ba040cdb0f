"""Small files that are right, of which the fuzzer makes wrong ones."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import ident
from ident.robots import robot_folder
from tests.recorded import recorded

Array = np.ndarray
ROWS, RATE = 160, 50.0
_EVENING = datetime(2024, 2, 1, 23, 59, 59, tzinfo=UTC)

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0.01 0.02 0.1" rpy="0 0 0.3"/><mass value="1.5"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial>
    <visual><origin xyz="0 0 0"/><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="b"><inertial><origin xyz="0 0 0.2"/><mass value="0.8"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/></inertial></link>
  <link name="tool"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" velocity="3" effort="50"/><dynamics damping="0.2" friction="0.1"/></joint>
  <joint name="j2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0" rpy="1.5708 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="hold" type="fixed"><parent link="b"/><child link="tool"/><origin xyz="0 0 0.2"/></joint>
</robot>
"""
MIMIC = URDF.replace(
    "</robot>",
    """  <link name="f"><inertial><mass value="0.2"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <joint name="j3" type="prismatic"><parent link="tool"/><child link="f"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.1" velocity="1" effort="9"/>
    <mimic joint="j2" multiplier="0.5" offset="0.1"/></joint>
</robot>
""",
)


@lru_cache(maxsize=1)
def robot() -> ident.Robot:
    return ident.Robot.from_urdf(URDF)


def motion(rows: int = ROWS) -> tuple[Array, Array, Array]:
    """Time, positions and torques of the two joints."""
    t = np.arange(rows) / RATE
    q = np.stack([0.9 * np.sin(2.1 * t), 0.8 * np.sin(1.3 * t + 1)], axis=1)
    rng = np.random.default_rng(0)
    tau = np.stack([np.cos(2.1 * t), 3 * np.sin(q[:, 1])], axis=1) + 0.01 * rng.normal(size=(rows, 2))
    return t, q, tau


@lru_cache(maxsize=32)
def table(
    names: str = "t,q1,q2,tau1,tau2",
    delimiter: str = ",",
    decimal: str = ".",
    head: str = "",
    end: str = "\n",
    scale: float = 1.0,
    rows: int = ROWS,
) -> bytes:
    """A log as text."""
    t, q, tau = motion(rows)
    values = np.column_stack([t, q * scale, tau])
    text = end.join(delimiter.join(f"{x:.7g}".replace(".", decimal) for x in row) for row in values)
    return (head + names.replace(",", delimiter) + end + text + end).encode()


@lru_cache(maxsize=1)
def tables() -> dict[str, bytes]:
    """Logs as text, in several dialects; name of the file → bytes."""
    plain = table()
    return {
        "plain.csv": plain,
        "semicolon.csv": table(delimiter=";", decimal=","),
        "tab.tsv": table(delimiter="\t"),
        "hash.csv": table(head="# a note\n").replace(b"\nt,", b"\n# t,"),
        "degrees.csv": table("t,q1_deg,q2_deg,tau1,tau2", scale=180 / np.pi),
        "units.csv": table("t [s],q1 [rad],q2 [rad],tau1 [Nm],tau2 [Nm]"),
        "ros.csv": table("time,j1.position,j2.position,j1.effort,j2.effort", end="\r\n"),
        "spaces.txt": table(delimiter=" "),
        "quoted.csv": table('"t","q1","q2","tau1","tau2"'),
        "sep.csv": b"sep=;\n" + table(delimiter=";"),
        "extra.csv": b"\n".join(line + b",word,7" for line in table("t,q1,q2,tau1,tau2").splitlines()),
        "preamble.txt": b"Name\ttrace 1\nStart\t01.02.2024 10:00:00\n\n"
        + table("Time [s],pos1 [rad],pos2 [rad],trq1 [Nm],trq2 [Nm]", "\t"),
        "scope.csv": _scope(),
        "ends.csv": table().replace(b"\n", b",\n").replace(b",\n", b"\n", 1),
        "bars.csv": table(delimiter="|"),
        "wide.csv": table().decode().encode("utf-16"),
        "comments.csv": plain.replace(b"\n0.4,", b"\n# a note\n0.4,").replace(b"\n0.8,", b"\nt,q1,q2,tau1,tau2\n0.8,")[:-1],
        "stamps.csv": _stamped("sec,nanosec", lambda t: f"{17_000 + int(t)},{round(1e9 * (t % 1))}"),
        "moments.csv": _stamped("Date,Time", lambda t: (_EVENING + timedelta(seconds=t)).strftime("%d.%m.%Y,%H:%M:%S.%f")),
        "cells.csv": _cells(),
        "echo.csv": _echo(),
        "long.csv": _long(),
    }


def _rows() -> list[list[float]]:
    t, q, tau = motion()
    return np.column_stack([t, q, tau]).tolist()


def _stamped(names: str, stamp: Any) -> bytes:
    rows = [",".join([stamp(t), *(f"{x:.7g}" for x in rest)]) for t, *rest in _rows()]
    return "\n".join([f"{names},position_1,position_2,effort_1,effort_2", *rows, ""]).encode()


def _cells() -> bytes:
    rows = [f'{t!r},"[{a!r}, {b!r}]","[{c!r}, {d!r}]"' for t, a, b, c, d in _rows()]
    return "\n".join(["time,q,tau", *rows, ""]).encode()


def _echo() -> bytes:
    return "".join(
        f"{int(t)},{round(1e9 * (t % 1))},base,j1,j2,{a!r},{b!r},{-a!r},{-b!r},{c!r},{d!r}\n" for t, a, b, c, d in _rows()
    ).encode()


def _long() -> bytes:
    rows = [f"{t!r},{j},{q!r},{tau!r}" for t, a, b, c, d in _rows() for j, q, tau in (("j1", a, c), ("j2", b, d))]
    return "\n".join(["time,joint,position,effort", *rows, ""]).encode()


def _scope() -> bytes:
    """An export of TwinCAT Scope."""
    channels = ["Axis 1 ActPos", "Axis 2 ActPos", "Axis 1 ActTorque", "Axis 2 ActTorque"]
    head = [["Name", "Scope Project"], [x for name in channels for x in ("Name", name)], ["SampleTime[ms]", "20"] * 4, []]
    rows = [[x for v in rest for x in (f"{1e3 * t:g}", f"{v:.7g}")] for t, *rest in _rows()]
    return "\n".join(["\t".join(row) for row in [*head, *rows]] + [""]).encode()


def _made(name: str, write: Any) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


STUDY: dict[str, Any] = {
    "robot": {"urdf": "arm.urdf", "gravity": [0.0, 0.0, -9.81], "joints": ["j1", "j2"]},
    "drive": {
        "ratio": [50.0, 30.0],
        "measured": "motor",
        "zero": [0.0, 0.1],
        "torque_constants": [0.1, 0.2],
        "effects": ["viscous", {"name": "coulomb"}, {"name": "stribeck", "joints": ["j1"]}],
    },
    "logs": {"fit": ["log.csv"], "missing": "gap", "rate_hz": 50.0},
    "signals": {"method": "zero_phase", "cutoff_hz": 8.0, "decimate": True},
    "estimator": {"method": "irls", "iterations": 20},
    "columns": {"t": "t", "q1": "q1", "q2": "q2", "tau_m1": "tau1", "tau_m2": "tau2"},
}
LOOP_STUDY: dict[str, Any] = {
    "robot": {"urdf": "arm.urdf", "locked": {"j1": 0.2}},
    "drive": {"K": [[1.0]], "effects": [{"name": "payload"}, "offset"]},
    "logs": {"fit": ["log.csv"]},
    "signals": {"method": "savitzky_golay"},
    "estimator": {"method": "ls"},
}
PLAIN_STUDY: dict[str, Any] = {
    "robot": {"urdf": "arm.urdf"},
    "drive": {"effects": ["viscous", "coulomb"]},
    "logs": {"fit": ["log.csv"]},
    "signals": {"method": "zero_phase"},
    "estimator": {"method": "wls"},
}


@lru_cache(maxsize=1)
def log_set() -> ident.LogSet:
    t, q, tau = motion()
    return ident.LogSet((ident.Log("run", t=t, q=q, tau={"joint": tau}),), robot())


@lru_cache(maxsize=1)
def saved_fits() -> dict[str, Any]:
    """Saved fits, as data."""
    out = {}
    for name, effects in {"plain": ["viscous"], "rich": ["viscous", "coulomb", "offset"]}.items():
        estimate = ident.fit(log_set(), robot(), model=[ident.make_effect(e) for e in effects], held=0)
        out[f"{name}.json"] = json.loads(_made("fit.json", lambda p, e=estimate: e.save(p)))
    return out


@lru_cache(maxsize=1)
def possible_fit() -> dict[str, Any]:
    """A saved fit that some real body has, as data: what can be exported."""
    model = robot().rigid_body() + ident.make_effect("viscous")
    values = np.concatenate([robot().nominal, [0.3, 0.2]])
    log = recorded(robot(), model, values, seed=1, seconds=6.0, noise=1e-4)
    estimate = ident.fit(log, robot(), model=[ident.make_effect("viscous")], held=0)
    return dict(json.loads(_made("fit.json", estimate.save)))


@lru_cache(maxsize=1)
def robots() -> dict[str, bytes]:
    """URDFs: two of our own, and two that come with ident."""
    out = {"arm.urdf": URDF.encode(), "mimic.urdf": MIMIC.encode()}
    for name in ("scara", "puma560"):
        found = sorted(robot_folder(name).glob("*.urdf"))
        out |= {f"{name}.urdf": found[0].read_bytes()} if found else {}
    return out
