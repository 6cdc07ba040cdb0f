"""Names of columns that nobody foresaw: read where they tell enough, asked about where they do not, never one joint of several alone."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n, RATE = 200, 3, 250.0
T = np.arange(N) / RATE
_W = 2.0 + 1.3 * np.arange(n)
Q = 0.7 * np.sin(np.outer(T, _W) + np.arange(n)) + 0.1 * np.arange(n)
DQ = 0.7 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 20.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0 - np.arange(n)
_DEG, _TURN = np.pi / 180, 2 * np.pi


def written(path: Path, columns: Mapping[str, Array]) -> Path:
    rows = [",".join(f"{x:.15g}" for x in row) for row in np.column_stack([*columns.values()])]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


def table(time: str, unit: float, groups: Mapping[str, Array], who: tuple[str, ...] = ("1", "2", "3")) -> dict[str, Array]:
    return {time: T / unit} | {pattern.format(x): values[:, j] for pattern, values in groups.items() for j, x in enumerate(who)}


READ: dict[str, tuple[dict[str, Array], str]] = {
    "Greek symbols": (table("t", 1.0, {"θ{}": Q, "ω{}": DQ, "τ{}": TAU}), "joint"),
    "dots above symbols": (table("t", 1.0, {"q{}": Q, "q\u0307{}": DQ, "τ{}": TAU}), "joint"),
    "plural words": (table("t", 1.0, {"positions_{}": Q, "velocities_{}": DQ, "efforts_{}": TAU}), "joint"),
    "addresses on a bus": (table("t", 1.0, {"0x14{}_pos": Q, "0x14{}_vel": DQ, "0x14{}_torque": TAU}), "joint"),
    "numbers of servos": (
        table("t", 1.0, {"servo{}_position": Q, "servo{}_velocity": DQ, "servo{}_torque": TAU}, ("7", "11", "30")),
        "joint",
    ),
    "milliseconds of a microcontroller": (table("millis", 1e-3, {"angle{}": Q, "speed{}": DQ, "current{}_mA": 1e3 * TAU}), "current"),
    "microseconds of one": (table("micros", 1e-6, {"angle{}": Q, "speed{}": DQ, "torque{}": TAU}), "joint"),
    "turns as words": (
        table("time_s", 1.0, {"m{}_pos_rot": Q / _TURN, "m{}_vel_rot_s": DQ / _TURN, "m{}_torque_nm": TAU}),
        "joint",
    ),
    "turns a minute": (table("t", 1.0, {"pos{}_turns": Q / _TURN, "vel{}_rev_per_min": DQ / _TURN * 60, "trq{}": TAU}), "joint"),
    "least and most beside": (
        table("t", 1.0, {"pos_min_{}": Q - 1, "pos_max_{}": Q + 1, "pos_{}": Q, "trq_{}": TAU, "trq_std_{}": 0 * TAU + 1}),
        "joint",
    ),
    "currents that make torque": (table("t", 1.0, {"pos_{}": Q, "vel_{}": DQ, "Id_{}": 0.1 * TAU, "Iq_{}": TAU}), "current"),
    "revolutions a minute": (
        table("t", 1.0, {"pos_{} [deg]": Q / _DEG, "speed_{} [rev/min]": DQ / _TURN * 60, "trq_{} [mNm]": 1e3 * TAU}),
        "joint",
    ),
    "words before a bracket": (
        table("Time (sec)", 1.0, {"Joint Position ({}) [deg]": Q / _DEG, "Joint Torque ({}) [N·m]": TAU}, ("Base", "Shoulder", "Elbow")),
        "joint",
    ),
    "a drive's paths": (
        table(
            "Time [s]",
            1.0,
            {"Axis {}.NcToPlc.ActPos [°]": Q / _DEG, "Axis {}.NcToPlc.ActVelo [°/s]": DQ / _DEG, "Axis {}.ActTorque [Nm]": TAU},
        ),
        "joint",
    ),
}


@pytest.mark.parametrize("kind", READ)
def test_what_tells_enough_is_read(kind: str, tmp_path: Path) -> None:
    columns, side = READ[kind]
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    np.testing.assert_allclose(log.t - log.t[0], T, atol=1e-9)
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, DQ, atol=1e-12)
    assert (log.dq is None) == (not any("vel" in name.lower() or "speed" in name or "ω" in name or "\u0307" in name for name in columns))
    assert list(log.tau) == [side]
    np.testing.assert_allclose(log.tau[side], TAU, atol=1e-12)


def test_positions_of_which_nothing_tells_the_joints_are_asked_about(tmp_path: Path) -> None:
    """A gantry, or a tool's place: one of three was once read alone."""
    path = written(tmp_path / "a.csv", table("Time [s]", 1.0, {"Pos {} [mm]": 1e3 * Q, "Force {} [N]": TAU}, ("X", "Y", "Z")))
    with pytest.raises(ident.DataError, match=r"of which joints\. Map them .*q3 = \"Pos Z \[mm\]\""):
        ident.read_logs(path)
    mapping = {f"q{j + 1}": f"Pos {x} [mm]" for j, x in enumerate("XYZ")} | {f"tau{j + 1}": f"Force {x} [N]" for j, x in enumerate("XYZ")}
    log = ident.read_logs(path, columns=mapping | {"t": "Time [s]"})[0]
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-12)


def test_one_joint_with_two_encoders_is_no_such_case(tmp_path: Path) -> None:
    columns = {"time": T, "joint_position": Q[:, 0], "motor_position": 50 * Q[:, 0], "torque": TAU[:, 0]}
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    np.testing.assert_allclose(log.q, Q[:, :1], atol=1e-12)


@pytest.mark.parametrize("symbol", ["M{}", "T{}", "u_{}", "torque_raw_{}"])
def test_symbols_that_may_be_torques_are_asked_about(symbol: str, tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table("t", 1.0, {"q{}": Q, "dq{}": DQ, symbol: TAU})))[0]
    assert not log.tau
    assert f'tau3 = "{symbol.format(3)}"' in log.hint


def test_external_torques_are_said_not_to_serve(tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table("t", 1.0, {"pos{}": Q, "tau_ext{}": TAU})))[0]
    assert not log.tau
    assert any("external torques, without gravity and friction" in note for note in log.notes)


def test_numbers_with_their_units_are_refused_with_what_to_do(tmp_path: Path) -> None:
    rows = [f"{t:.3f},{q:.9f} rad,{tau:.9f}" for t, q, tau in zip(T, Q[:, 0], TAU[:, 0], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["t,q1,tau1", *rows]) + "\n")
    with pytest.raises(ident.DataError, match=r"rad' is not a number\. Write numbers only, and put their unit into the header"):
        ident.read_logs(tmp_path / "a.csv")


@pytest.mark.parametrize(("unit", "what"), [("MNm", "torque"), ("deg/ms", "vel"), ("hNm", "torque")])
def test_units_that_only_look_like_known_ones_are_not_used(unit: str, what: str, tmp_path: Path) -> None:
    names = {"pos{} [rad]": Q, "vel{} [rad/s]": DQ, "torque{} [Nm]": TAU}
    columns = table("t [s]", 1.0, {f"{what}{{}} [{unit}]" if name.startswith(what) else name: x for name, x in names.items()})
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    assert (log.dq is None, not log.tau) == (what == "vel", what == "torque")
    assert any(f"are in {unit!r}, which is not a known unit" in note for note in log.notes)


@pytest.mark.parametrize("name", ["一 " * 2000, "q2" + "焬\u3000" * 2000, "q2" + "焬 Ⰱ" * 2000])
def test_garbled_names_do_not_fill_the_message(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"t,q1,{name}\n0,1,2\n1,2,3\n2,3,4\n", encoding="utf-8")
    with pytest.raises(ident.DataError) as caught:
        ident.read_logs(tmp_path / "a.csv", ident.load_robot("scara"))
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    ("position", "torque"),
    [
        ("{}_pos_deg", "{}_torque_Nm"), ("pos_{}_deg", "tau_{}_mNm"), ("{}_q_deg", "{}_tau_Nm"), ("{}_angle_deg", "{}_effort_nm"),
        ("{}_pos_rad", "{}_torque"), ("{}_position_mrad", "{}_torque_Nmm"), ("{}_deg", "{}_Nm"), ("{} [rad]", "{} [Nm]"),
        ("{}", "{}_torque"), ("{}", "torque {}"),
    ],
)  # fmt: skip
def test_a_robots_joints_are_found_before_a_unit_and_in_its_order(position: str, torque: str, tmp_path: Path) -> None:
    scale = next((s for unit, s in (("_deg", _DEG), ("_mrad", 1e-3)) if position.endswith(unit)), 1.0)
    factor = 1e-3 if torque.endswith(("_mNm", "_Nmm")) else 1.0
    names = ("yaw", "shoulder", "wrist_b")
    links = "".join(
        f'<link name="l{j}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        for j in range(4)
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{j}"/><child link="l{j + 1}"/><axis xyz="0 1 0"/>'
        '<limit lower="-9" upper="9" velocity="9" effort="900"/></joint>'
        for j, name in enumerate(names)
    )
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(f'<robot name="arm">{links}{joints}</robot>')
    columns = {"time": T}
    for j in (2, 0, 1):  # not in the robot's order
        columns |= {position.format(names[j]): Q[:, j] / scale, torque.format(names[j]): TAU[:, j] / factor}
    (log,) = ident.read_logs(written(tmp_path / "log.csv", columns), robot=ident.Robot.from_urdf(urdf))
    np.testing.assert_allclose(log.q, Q, atol=1e-9)
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-9)
