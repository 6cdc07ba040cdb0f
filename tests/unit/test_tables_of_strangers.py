"""Tables of text as strangers write them: headers over two rows, on their side, in other languages, encodings and notations of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n, RATE = 240, 3, 200.0
T = np.arange(N) / RATE
_W = 2.0 + 1.3 * np.arange(n)
Q = 0.7 * np.sin(np.outer(T, _W) + np.arange(n)) + 0.1 * np.arange(n)
DQ = 0.7 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 20.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0 - np.arange(n) + 0.1 * np.random.default_rng(0).normal(size=(N, n))


def each(pattern: str) -> list[str]:
    return [pattern.format(j) for j in range(1, n + 1)]


def table(path: Path, header: Sequence[str], columns: Sequence[Array], mark: str = ",", comma: str = ".", encoding: str = "utf-8") -> Path:
    """A text with these lines before the rows."""
    rows = [mark.join(f"{x:.10g}".replace(".", comma) for x in row) for row in np.column_stack(columns)]
    path.write_bytes(("\n".join([*header, *rows]) + "\n").encode(encoding))
    return path


def is_the_motion(log: ident.Log, *, rates: bool = True, side: str | None = "joint") -> None:
    np.testing.assert_allclose(log.t - log.t[0], T, atol=2e-6)
    np.testing.assert_allclose(log.q, Q, atol=1e-6)
    assert (log.dq is not None) == rates
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, DQ, atol=1e-5)
    assert list(log.tau) == ([] if side is None else [side])
    if side is not None:
        np.testing.assert_allclose(log.tau[side], TAU, atol=1e-5)


STACKED: dict[str, tuple[list[str], float, bool]] = {
    "quantities above joints": (["time,position,,,velocity,,,torque,,", ",J1,J2,J3,J1,J2,J3,J1,J2,J3"], 1.0, False),
    "quantities again above joints": (
        [
            "time,position,position,position,velocity,velocity,velocity,effort,effort,effort",
            "s,shoulder,elbow,wrist,shoulder,elbow,wrist,shoulder,elbow,wrist",
        ],
        1.0,
        False,
    ),
    "joints above quantities": (
        ["Time,Joint 1,,,Joint 2,,,Joint 3,,", "[s]" + ",pos [deg],vel [deg/s],torque [Nm]" * n],
        np.pi / 180,
        True,
    ),
    "and a row of units": (
        ["time,position,,,velocity,,,torque,,", ",J1,J2,J3,J1,J2,J3,J1,J2,J3", "s,deg,deg,deg,deg/s,deg/s,deg/s,Nm,Nm,Nm"],
        np.pi / 180,
        False,
    ),
    "numbers below merged cells": (["time,position,,,velocity,,,torque,,", ",1,2,3,1,2,3,1,2,3"], 1.0, False),
    "units alone below merged cells": (
        ["time,position,,,velocity,,,torque,,", "s,deg,deg,deg,deg/s,deg/s,deg/s,Nm,Nm,Nm"],
        np.pi / 180,
        False,
    ),
    "behind lines that tell of the recording": (
        ["Recorder,lab 3", "Date,2024-05-01", "time,position,,,velocity,,,torque,,", ",J1,J2,J3,J1,J2,J3,J1,J2,J3"],
        1.0,
        False,
    ),
}


@pytest.mark.parametrize("kind", STACKED)
@pytest.mark.parametrize("german", [False, True])
def test_headers_over_two_rows(tmp_path: Path, kind: str, german: bool) -> None:
    header, unit, by_joint = STACKED[kind]
    columns = [Q[:, j] / unit if k == 0 else DQ[:, j] / unit if k == 1 else TAU[:, j] for j in range(n) for k in range(3)]
    values = columns if by_joint else [columns[3 * j + k] for k in range(3) for j in range(n)]
    mark, comma = (";", ",") if german else (",", ".")
    path = table(tmp_path / "a.csv", [line.replace(",", mark) for line in header], [T, *values], mark, comma)
    is_the_motion(ident.read_logs(path)[0])


def test_columns_by_levels_as_pandas_writes_them(tmp_path: Path) -> None:
    import pandas as pd

    names = pd.MultiIndex.from_product([["position", "velocity", "effort"], ["J1", "J2", "J3"]])
    pd.DataFrame(np.hstack([Q, DQ, TAU]), columns=names, index=pd.Index(T, name="time")).to_csv(tmp_path / "a.csv")
    is_the_motion(ident.read_logs(tmp_path / "a.csv")[0])


@pytest.mark.parametrize("units", [False, True])
@pytest.mark.parametrize(("mark", "comma"), [(",", "."), ("\t", ","), (" ", ".")])
def test_a_row_for_each_channel(tmp_path: Path, mark: str, comma: str, units: bool) -> None:
    channels = [("time", "ms", 1e3 * T)] if units else [("time", "", T)]
    channels += [(f"position_{j + 1}", "deg", np.rad2deg(Q[:, j])) if units else (f"position_{j + 1}", "", Q[:, j]) for j in range(n)]
    channels += [(f"torque_{j + 1}", "Nm", TAU[:, j]) for j in range(n)]
    lines = [mark.join([name, *([unit] if units else []), *(f"{x:.10g}".replace(".", comma) for x in v)]) for name, unit, v in channels]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    is_the_motion(ident.read_logs(tmp_path / "a.csv")[0], rates=False)


def test_rows_that_begin_with_a_label_are_no_channels(tmp_path: Path) -> None:
    """Samples, each with its state in front: not one column for each of them."""
    rows = [",".join(["RUN", *(f"{x:.9g}" for x in np.tile(Q[k], 10))]) for k in range(N)]
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    with pytest.raises(ident.DataError, match="no joint position found"):
        ident.read_logs(tmp_path / "a.csv")


@pytest.mark.parametrize("mark", [",", "  ", ";"])
@pytest.mark.parametrize("packed", [False, True])
def test_numbers_of_fortran(tmp_path: Path, mark: str, packed: bool) -> None:
    rows = [mark.join(f"{x:18.11E}".replace("E", "D").strip() for x in row) for row in np.column_stack([T, Q, DQ, TAU])]
    text = "\n".join([mark.join(["time", *each("q{}"), *each("dq{}"), *each("tau{}")]), *rows]) + "\n"
    path = tmp_path / "a.dat"
    if packed:
        import gzip

        path = tmp_path / "a.dat.gz"
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text)
    is_the_motion(ident.read_logs(path)[0])


def test_numbers_of_fortran_on_the_seam_of_two_blocks_are_not_cut(tmp_path: Path) -> None:
    many = 40_000
    t = np.arange(many) / RATE
    rows = np.column_stack([t, np.sin(t), np.cos(3 * t)])
    text = "\n".join(["time,q1,tau1", *(",".join(f"{x:.13E}".replace("E", "D") for x in row) for row in rows)]) + "\n"
    assert len(text) > 2 << 20
    (tmp_path / "a.csv").write_text(text)
    log = ident.read_logs(tmp_path / "a.csv")[0]
    np.testing.assert_allclose(np.column_stack([log.t, log.q[:, 0], log.tau["joint"][:, 0]]), rows, rtol=0, atol=1e-12)


LANGUAGES: dict[str, tuple[str, str, str, str, str, float]] = {
    "Chinese": ("gb18030", "时间(ms)", "关节{}位置(°)", "关节{}速度(°/s)", "关节{}力矩(Nm)", np.pi / 180),
    "Chinese without units": ("gb18030", "时间", "关节{}角度", "关节{}角速度", "关节{}力矩", 1.0),
    "Chinese of Taiwan": ("big5", "時間", "關節{}位置", "關節{}速度", "關節{}力矩", 1.0),
    "Japanese": ("shift_jis", "時刻", "関節{}角度", "関節{}角速度", "関節{}トルク", 1.0),
    "Korean": ("cp949", "시간", "관절{} 위치", "관절{} 속도", "관절{} 토크", 1.0),
    "Russian": ("cp1251", "время", "положение {} (град)", "скорость {} (град/с)", "момент {} (Н·м)", np.pi / 180),
    "Polish": ("cp1250", "czas", "położenie {}", "prędkość {}", "moment {}", 1.0),
    "Spanish": ("cp1252", "Tiempo [s]", "Posición {} [°]", "Velocidad {} [°/s]", "Momento {} [N·m]", np.pi / 180),
    "Italian": ("cp1252", "tempo", "posizione_giunto{}", "velocità_giunto{}", "coppia_giunto{}", 1.0),
    "Portuguese": ("utf-8", "tempo_s", "posição_junta{}", "velocidade_junta{}", "torque_junta{}", 1.0),
    "Turkish": ("utf-8", "zaman", "eklem {} açı (°)", "eklem {} hız (°/s)", "eklem {} tork", np.pi / 180),
    "Czech": ("cp1250", "čas", "poloha {}", "rychlost {}", "moment {}", 1.0),
}


@pytest.mark.parametrize("kind", LANGUAGES)
@pytest.mark.parametrize("own", [False, True], ids=["UTF-8", "own encoding"])
def test_other_languages(tmp_path: Path, kind: str, own: bool) -> None:
    encoding, time, q, dq, tau, unit = LANGUAGES[kind]
    clock = 1e-3 if "ms" in time else 1.0
    header = ",".join([time, *each(q), *each(dq), *each(tau)])
    path = table(tmp_path / "a.csv", [header], [T / clock, Q / unit, DQ / unit, TAU], encoding=encoding if own else "utf-8")
    is_the_motion(ident.read_logs(path)[0])


@pytest.mark.parametrize("encoding", ["utf-8", "cp1250"])
def test_names_of_joints_beside_words_of_other_languages(tmp_path: Path, encoding: str) -> None:
    """The words broke at their accents, and one joint of three was read."""
    joints = ("bark", "łokieć", "nadgarstek")
    header = ",".join(["czas [s]", *(f"{x} położenie [°]" for x in joints), *(f"{x} moment [Nm]" for x in joints)])
    log = ident.read_logs(table(tmp_path / "a.csv", [header], [T, np.rad2deg(Q), TAU], encoding=encoding))[0]
    is_the_motion(log, rates=False)


def test_motors_that_turn_farther_than_the_joints_have_gears(tmp_path: Path) -> None:
    header = ",".join(["time", *each("motor_pos_{}"), *each("joint_pos_{}"), *each("motor_torque_{}")])
    log = ident.read_logs(table(tmp_path / "a.csv", [header], [T, 100 * Q, Q, TAU]))[0]
    is_the_motion(log, rates=False, side="motor")
    assert any("turn about 100 times as far as the joints" in note for note in log.notes)
    log = ident.read_logs(table(tmp_path / "b.csv", [header], [T, Q + 1e-4, Q, TAU]))[0]
    assert list(log.tau) == ["joint"]


def test_mujoco(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=T, qpos=Q, qvel=DQ, qfrc_actuator=TAU, qfrc_bias=0.7 * TAU, ctrl=2 * TAU)
    log = ident.read_logs(tmp_path / "a.npz")[0]
    is_the_motion(log)
    assert log.recording is not None
    assert log.recording.recorder == "MuJoCo"


def test_commands_and_estimates_of_other_languages_are_no_measurements(tmp_path: Path) -> None:
    header = ",".join(["时间", *each("关节{}目标位置"), *each("关节{}实际位置"), *each("关节{}估计外力矩"), *each("关节{}电流")])
    log = ident.read_logs(table(tmp_path / "a.csv", [header], [T, Q + 0.03, Q, 0.1 * TAU, TAU], encoding="gb18030"))[0]
    is_the_motion(log, rates=False, side="current")
    np.testing.assert_allclose(log.extra["q_ref2"], Q[:, 1] + 0.03, atol=1e-6)


def test_units_behind_a_comma_between_semicolons(tmp_path: Path) -> None:
    header = ";".join(["время, мс", *each("угол {}, град"), *each("момент {}, Н·м")])
    is_the_motion(ident.read_logs(table(tmp_path / "a.csv", [header], [1e3 * T, np.rad2deg(Q), TAU], ";", ","))[0], rates=False)


def test_milliseconds_behind_a_colon(tmp_path: Path) -> None:
    stamps = [(datetime(2024, 5, 1, 23, 59, 59, 500_000) + timedelta(seconds=float(t))).strftime("%H:%M:%S:%f")[:-3] for t in T]
    rows = [",".join([s, *(f"{x:.10g}" for x in row)]) for s, row in zip(stamps, np.hstack([Q, TAU]), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([",".join(["timestamp", *each("q{}"), *each("tau{}")]), *rows]) + "\n")
    is_the_motion(ident.read_logs(tmp_path / "a.csv")[0], rates=False)


@pytest.mark.parametrize("unit", ["permille", "pct", "counts", "percent"])
def test_a_share_at_the_end_of_a_name_is_no_newton_metre(tmp_path: Path, unit: str) -> None:
    header = ",".join(["time_ms", *each("pos_{}_deg"), *each(f"torque_{{}}_{unit}")])
    log = ident.read_logs(table(tmp_path / "a.csv", [header], [1e3 * T, np.rad2deg(Q), TAU]))[0]
    is_the_motion(log, rates=False, side=None)
    assert any(f"are in '{unit}', which is not a known unit" in note for note in log.notes)


MIXED: dict[str, list[str]] = {
    "symbols": ["theta1 [deg]", "d2 [mm]", "theta3 [deg]", "tau1 [Nm]", "F2 [N]", "tau3 [Nm]"],
    "suffixes": ["J1_pos_deg", "J2_pos_mm", "J3_pos_deg", "J1_torque_Nm", "J2_force_N", "J3_torque_Nm"],
    "metres": ["q1_deg", "d2_m", "q3_deg", "tau1_Nm", "f2_N", "tau3_Nm"],
}


@pytest.mark.parametrize("kind", MIXED)
def test_angles_and_ways_under_symbols_of_their_own(tmp_path: Path, kind: str) -> None:
    way = 1.0 if kind == "metres" else 1e3
    columns = [T, np.rad2deg(Q[:, 0]), way * Q[:, 1], np.rad2deg(Q[:, 2]), TAU]
    is_the_motion(ident.read_logs(table(tmp_path / "a.csv", [",".join(["time", *MIXED[kind]])], columns))[0], rates=False)


@pytest.mark.parametrize("position", ["Achse {} Ist", "{}.LageIst", "{}/PosActual"])
def test_joints_by_name_whose_units_tell_what_they_hold(tmp_path: Path, position: str) -> None:
    """`Achse elbow Ist [Grad]` has no word for a position; a slide of the same robot is in mm, its torque is a force."""
    kinds = [("pan", "revolute"), ("swing", "revolute"), ("reach", "prismatic")]
    links = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name}" type="{kind}"><parent link="{f"l{k - 1}" if k else "base"}"/><child link="l{k}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="9" effort="9"/></joint>'
        for k, (name, kind) in enumerate(kinds)
    )
    arm = ident.Robot.from_urdf(f'<robot name="boomer"><link name="base"/>{links}</robot>')
    header = ["Uhrzeit [s]", *(f"{position.format(x)} [{u}]" for x, u in (("pan", "Grad"), ("reach", "mm"), ("swing", "Grad")))]
    header += ["Moment pan [Nm]", "Kraft reach [N]", "Moment swing [Nm]"]
    order, scale = [0, 2, 1], np.array([180 / np.pi, 1e3, 180 / np.pi])
    path = table(tmp_path / "a.csv", [";".join(header)], [T, *(Q[:, order] * scale).T, *TAU[:, order].T], ";", ",")
    (log,) = ident.read_logs(path, arm)
    is_the_motion(log, rates=False)
    assert not any("SI is assumed" in note for note in log.notes)


def test_a_measurement_file_of_labview(tmp_path: Path) -> None:
    """Its preamble has as many fields as its rows; the header, which ends in a comment of none, follows what ends the preamble."""
    many = "\t".join
    head = ["LabVIEW Measurement", many(["Separator", "Tab"]), "***End_of_Header***", "", many(["Channels", "9"])]
    head += [
        many([word, *[value] * 9]) for word, value in (("Samples", "240"), ("X_Dimension", "Time"), ("X0", "0.0E+0"), ("Delta_X", "0.005"))
    ]
    head += ["***End_of_Header***", many(["X_Value", *each("pos {}"), *each("vel {}"), *each("torque {}"), "Comment"])]
    is_the_motion(ident.read_logs(table(tmp_path / "a.lvm", head, [T, Q, DQ, TAU], "\t"))[0])


@pytest.mark.parametrize("label", ["", "columns: ", "Fields : "])
def test_names_in_a_comment_before_the_numbers(label: str, tmp_path: Path) -> None:
    head = ["# recorded on Tuesday", " ".join([f"# {label}time", *each("q{}"), *each("dq{}"), *each("tau{}")])]
    is_the_motion(ident.read_logs(table(tmp_path / "a.dat", head, [T, Q, DQ, TAU], " "))[0])


def test_decimal_commas_are_seen_beside_times_of_day(tmp_path: Path) -> None:
    times = [f"12:00:{1 + t:09.6f}".replace(".", ",") for t in T]
    rows = [";".join([time, *(f"{x:.9g}".replace(".", ",") for x in row)]) for time, row in zip(times, np.hstack([Q, TAU]), strict=True)]
    head = ";".join(["Uhrzeit", *each("Achse {} Position [rad]"), *each("Achse {} Moment [Nm]")])
    (tmp_path / "a.csv").write_text("\n".join([head, *rows]) + "\n")
    is_the_motion(ident.read_logs(tmp_path / "a.csv")[0], rates=False)
