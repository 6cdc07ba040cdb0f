"""What a log does not tell outright: units of angles, unknown units, how often it was sampled, joints that slide beside others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import ident
from ident._utils.text import counted

Array = np.ndarray
N, n, RATE = 400, 3, 250.0
T = np.arange(N) / RATE
_W = 2.0 + 1.3 * np.arange(n)
Q = 0.08 * np.sin(np.outer(T, _W) + np.arange(n))
DQ = 0.08 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 20.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0 - np.arange(n)
_DEG = np.pi / 180


def written(path: Path, columns: Mapping[str, Array], before: str = "", mark: str = ",") -> Path:
    rows = [mark.join(f"{x:.15g}" for x in row) for row in np.column_stack([*columns.values()])]
    path.write_text(before + "\n".join([mark.join(columns), *rows]) + "\n", encoding="utf-8")
    return path


def table(groups: Mapping[str, Array], *, time: str = "t", first: int = 1) -> dict[str, Array]:
    told = {pattern.format(j + first): values[:, j] for pattern, values in groups.items() for j in range(n)}
    return ({time: T} if time else {}) | told


def noted(log: ident.Log, text: str) -> bool:
    return any(text in note for note in log.notes)


# Positions as the file has them (times of a degree or a radian), velocities likewise, and what is said.
AGREED: dict[str, tuple[dict[str, Array], str]] = {
    "degrees, velocities say rad/s": ({"pos_{}": Q / _DEG, "vel_{}_rad_s": DQ}, "in degrees"),
    "degrees, velocities in rad/s without a unit": ({"pos_{}": Q / _DEG, "vel_{}": DQ}, "in degrees"),
    "radians, velocities in deg/s without a unit": ({"pos_{}": Q, "vel_{}": DQ / _DEG}, "are in deg/s, as the change of"),
    "told degrees, velocities in rad/s without a unit": ({"pos_{}_deg": Q / _DEG, "vel_{}": DQ}, "are in rad/s, as the change of"),
    "told velocities that agree": ({"pos_{}": Q, "vel_{} [rad/s]": DQ}, ""),
    "nothing tells": ({"pos_{}": Q, "vel_{}": DQ}, "taken as rad, m"),
    "nothing beside": ({"pos_{}": Q}, "taken as rad, m"),
}


@pytest.mark.parametrize("kind", AGREED)
@pytest.mark.parametrize("timed", [True, False])
def test_velocities_tell_the_unit_of_positions(kind: str, timed: bool, tmp_path: Path) -> None:
    groups, said = AGREED[kind]
    path = written(tmp_path / "a.csv", table({**groups, "torque_{}": TAU}, time="t" if timed else ""))
    log = ident.read_logs(path, rate_hz=None if timed else RATE)[0]
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, DQ, atol=1e-12)
    assert noted(log, said)
    assert said == "taken as rad, m" or not noted(log, "no unit given")


@pytest.mark.parametrize("gear", [50.0, 60.0, 100.0])
def test_speeds_of_motors_are_not_taken_for_degrees(gear: float, tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table({"pos_{}": Q, "vel_{}": gear * DQ, "torque_{}": TAU})))[0]
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    assert not noted(log, "deg/s")
    log = ident.read_logs(written(tmp_path / "b.csv", table({"pos_{}": gear * Q, "vel_{}": DQ, "torque_{}": TAU})))[0]
    np.testing.assert_allclose(log.q, gear * Q, atol=1e-12)


def test_noise_of_positions_hides_no_degrees(tmp_path: Path) -> None:
    noisy = Q / _DEG + 0.05 * np.random.default_rng(0).standard_normal(Q.shape)
    log = ident.read_logs(written(tmp_path / "a.csv", table({"pos_{}": noisy, "vel_{}": DQ, "torque_{}": TAU})))[0]
    np.testing.assert_allclose(log.q, noisy * _DEG, atol=1e-12)


def test_wheels_beyond_two_turns_are_in_radians_where_velocities_tell(tmp_path: Path) -> None:
    far = Q + 12.0 * T[:, None]
    path = written(tmp_path / "a.csv", table({"angle_{}": far, "speed_{} [rad/s]": DQ + 12.0, "torque_{}": TAU}))
    np.testing.assert_allclose(ident.read_logs(path)[0].q, far, atol=1e-12)


def test_positions_of_our_own_names_in_degrees_are_told_by_their_velocities(tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table({"q{}": Q / _DEG, "dq{}": DQ, "tau{}": TAU})))
    assert "The position seems to be in degrees" in ident.audit(log).of("velocity_scale")[0].text
    log = ident.read_logs(written(tmp_path / "b.csv", table({"q{}": Q, "dq{}": DQ / _DEG, "tau{}": TAU})))
    assert "It seems to be in degrees: name it dq1_deg_s" in ident.audit(log).of("velocity_scale")[0].text


UNKNOWN = {
    "torque in brackets": ({"q{}": Q, "tau{} [MNm]": TAU}, "tau1", "MNm", "N m"),
    "torque as a suffix": ({"q{}": Q, "tau{}_MNm": TAU}, "tau1", "MNm", "N m"),
    "torque by another name": ({"q{}": Q, "torque {} [%]": TAU}, "tau1", "%", "N m"),
    "motor torque": ({"q{}": Q, "tau_m{} [hNm]": TAU}, "tau_m1", "hNm", "N m"),
    "current": ({"q{}": Q, "i{} [Arms]": TAU}, "i1", "Arms", "A"),
    "velocity": ({"q{}": Q, "dq{} [deg/ms]": DQ, "tau{}": TAU}, "dq1", "deg/ms", "rad/s"),
    "recognised": ({"pos {}": Q, "torque {}_kdNm": TAU}, "tau1", "kdNm", "N m"),
}


@pytest.mark.parametrize("kind", UNKNOWN)
def test_a_unit_that_nobody_knows_is_told_with_the_remedy(kind: str, tmp_path: Path) -> None:
    groups, key, unit, si = UNKNOWN[kind]
    log = ident.read_logs(written(tmp_path / "a.csv", table(groups)))[0]
    assert (log.dq is None, bool(log.tau)) == (True, kind == "velocity")
    assert noted(log, f"in {unit!r}, which is not a known unit, and are not used: give its size in {si}")
    assert noted(log, f'{key} = {{ column = "{[*groups][1].format(1)}", scale = … }}')


def test_one_torque_in_a_unit_that_nobody_knows_is_not_offered_as_it_is(tmp_path: Path) -> None:
    columns = table({"q{}": Q, "tau{}": TAU})
    columns = {("tau2 [MNm]" if name == "tau2" else name): values for name, values in columns.items()}
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    assert np.isnan(log.tau["joint"][:, 1]).all()
    assert noted(log, "'tau2 [MNm]' is in 'MNm', which is not a known unit, and is not used")
    assert not noted(log, 'tau2 = "tau2 [MNm]"')
    columns = {("t [fortnights]" if name == "t" else name): values for name, values in table({"q{}": Q, "tau{}": TAU}).items()}
    with pytest.raises(ident.DataError, match="'fortnights', which is not a known unit of time"):
        ident.read_logs(written(tmp_path / "b.csv", columns))


@pytest.mark.parametrize(
    ("unit", "size"),
    [("mdeg", 1e-3 * _DEG), ("cdeg", 1e-2 * _DEG), ("arcmin", _DEG / 60), ("grader", _DEG), ("stopnie", _DEG), ("urad", 1e-6)],
)
def test_units_of_angles_however_written(unit: str, size: float, tmp_path: Path) -> None:
    form = ("angle{} [UNIT]", "angle{} / UNIT", "angle{} <UNIT>", "angle{} {{UNIT}}")[len(unit) % 4]
    path = written(tmp_path / "a.csv", table({form.replace("UNIT", unit): Q / size, "torque{} [N·mm]": 1e3 * TAU}))
    log = ident.read_logs(path)[0]
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("tau{}_Ncm", 0.01),
        ("tau{}_kgfcm", 0.0980665),
        ("tau{}_in_lb", 0.112984829),
        ("tau{}_ftlb", 1.355817948),
        ("tau{}_ozin", 0.007061552),
    ],
)
def test_torques_of_the_workshop_as_suffixes(name: str, size: float, tmp_path: Path) -> None:
    """They were left out, and no note said so."""
    log = ident.read_logs(written(tmp_path / "a.csv", table({"q{}": Q, name: TAU / size})))[0]
    np.testing.assert_allclose(log.tau["joint"], TAU, rtol=1e-6)


@pytest.mark.parametrize("name", ["rate_{}", "rate{}", "joint_rate_{}", "angle rate {}", "velo{}", "spd_{}", "thetadot_{}"])
def test_rates_are_velocities(name: str, tmp_path: Path) -> None:
    own = len(name) % 2 == 0
    path = written(tmp_path / "a.csv", table({"q{}" if own else "pos {}": Q, name: DQ, "tau{}" if own else "torque {}": TAU}))
    log = ident.read_logs(path)[0]
    assert log.dq is not None
    np.testing.assert_allclose(log.dq, DQ, atol=1e-12)


@pytest.mark.parametrize("name", ["sample_rate_{}", "torque_rate_{}", "packet rate {}", "log_rate_{}"])
def test_rates_of_something_else_are_none(name: str, tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table({"pos {}": Q, name: DQ, "trq {}": TAU})))[0]
    assert log.dq is None
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-12)


SAMPLED = (
    "# fs = 250\n", "# rig 7\n# sample rate: 250 Hz\n# by Ann\n", "// dt: 4 ms\n", "% Fs: 0.25 kHz\n", "# recorded at 250 Hz\n",
    "# Abtastrate = 250 Hz\n", "# gain = 3, sampling period = 0,004 s\n", "# fréquence d'échantillonnage : 250 Hz\n",
    "# 采样频率: 250 Hz\n",
    "# control rate: 1000 Hz, log rate: 250 Hz\n", "# cycle time: 4 ms\n",
)  # fmt: skip


@pytest.mark.parametrize("before", SAMPLED)
def test_a_comment_tells_how_often_it_was_sampled(before: str, tmp_path: Path) -> None:
    names = (("q{}", "tau{}"), ("angle {} [rad]", "torque {} [Nm]"))[len(before) % 2]
    log = ident.read_logs(written(tmp_path / "a.csv", table({names[0]: Q, names[1]: TAU}, time=""), before))[0]
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    assert noted(log, "holds no time; ")
    np.testing.assert_allclose(log.q, Q, atol=1e-12)


def test_lines_of_a_name_and_a_value_tell_it_too(tmp_path: Path) -> None:
    before = "Instrument;Rig 3\nSampling interval;4;ms\nOperator;Ann\n\n"
    path = written(tmp_path / "a.csv", table({"angle {} [rad]": Q, "torque {} [Nm]": TAU}, time=""), before, ";")
    np.testing.assert_allclose(ident.read_logs(path)[0].t, T, atol=1e-9)


@pytest.mark.parametrize("before", ["# gain = 250\n", "# sampling rate = 1,000 Hz\n", "# recording time: 9 s\n", "# cutoff: 250 Hz\n"])
def test_other_numbers_in_comments_tell_no_sampling(before: str, tmp_path: Path) -> None:
    with pytest.raises(ident.DataError, match="rate_hz = 500"):
        ident.read_logs(written(tmp_path / "a.csv", table({"q{}": Q, "tau{}": TAU}, time=""), before))


def test_two_rates_are_asked_about_and_a_time_counts_more_than_any(tmp_path: Path) -> None:
    with pytest.raises(ident.DataError, match=r"not clear which is that of the samples"):
        ident.read_logs(written(tmp_path / "a.csv", table({"q{}": Q, "tau{}": TAU}, time=""), "# fs = 250\n# sample rate: 500 Hz\n"))
    log = ident.read_logs(written(tmp_path / "b.csv", table({"q{}": Q, "tau{}": TAU}), "# fs = 1000\n"))[0]
    np.testing.assert_allclose(log.t, T, atol=1e-12)


RAIL = {
    "no units": (("rail pos", "shoulder pos", "elbow pos"), ("rail force", "shoulder torque", "elbow torque"), (1.0, 1.0, 1.0)),
    "other words": (("rail travel", "shoulder angle", "elbow angle"), ("rail force", "shoulder torque", "elbow torque"), (1.0, 1.0, 1.0)),
    "units": (
        ("rail travel [mm]", "shoulder angle [deg]", "elbow angle [deg]"),
        ("rail force [N]", "shoulder torque [Nm]", "elbow torque [Nm]"),
        (1e-3, _DEG, _DEG),
    ),
}


@pytest.mark.parametrize("kind", RAIL)
def test_a_rail_stands_beside_joints_that_turn(kind: str, tmp_path: Path) -> None:
    positions, torques, sizes = RAIL[kind]
    columns = {"t": T} | {x: Q[:, j] / sizes[j] for j, x in enumerate(positions)} | {x: TAU[:, j] for j, x in enumerate(torques)}
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    assert log.joint_names == ("rail", "shoulder", "elbow")
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-12)


def test_a_question_about_positions_comes_with_time_and_torques(tmp_path: Path) -> None:
    columns = {"Zeit": T, "X Weg": Q[:, 0], "C Winkel": Q[:, 1], "X Kraft": TAU[:, 0], "C Moment": TAU[:, 1]}
    with pytest.raises(ident.DataError) as caught:
        ident.read_logs(written(tmp_path / "a.csv", columns))
    wanted = 't = "Zeit", q1 = "X Weg", q2 = "C Winkel", tau1 = "X Kraft", tau2 = "C Moment".'
    assert str(caught.value).endswith(wanted)
    pairs = (entry.split(" = ") for entry in wanted.rstrip(".").split(", "))
    log = ident.read_logs(tmp_path / "a.csv", columns={key: name.strip('"') for key, name in pairs})[0]
    np.testing.assert_allclose(log.tau["joint"], TAU[:, :2], atol=1e-12)


def test_turns_of_odrive_are_known(tmp_path: Path) -> None:
    names = {"axis{}.encoder.pos_estimate": Q / (2 * np.pi), "axis{}.encoder.vel_estimate": DQ / (2 * np.pi), "axis{}.Iq_measured": TAU}
    log = ident.read_logs(written(tmp_path / "a.csv", table(names, first=0)))[0]
    np.testing.assert_allclose(log.q, Q, atol=1e-12)
    np.testing.assert_allclose(log.dq, DQ, atol=1e-12)
    assert [*log.tau] == ["current"]


@pytest.mark.parametrize("line", ["|---|---|---|", "|:--|--:|:-:|"])
def test_a_line_of_dashes_below_the_header_is_none_of_units(line: str, tmp_path: Path) -> None:
    rows = [f"| {t:.4f} | {q:.12f} | {tau:.12f} |" for t, q, tau in zip(T, Q[:, 0], TAU[:, 0], strict=True)]
    (tmp_path / "a.md").write_text("\n".join(["| t | q1 | tau1 |", line, *rows]) + "\n")
    np.testing.assert_allclose(ident.read_logs(tmp_path / "a.md")[0].q, Q[:, :1], atol=1e-11)


def test_one_damaged_stamp_does_not_make_seconds_nanoseconds(tmp_path: Path) -> None:
    columns = table({"q{}": Q, "tau{}": TAU})
    damaged = columns["t"].copy()
    damaged[0] = 1e30
    log = ident.read_logs(written(tmp_path / "log.csv", columns | {"t": damaged}))[0]
    np.testing.assert_allclose(log.t, T[1:])


def test_spanish_torques_and_a_unit_of_angles_that_nobody_knows(tmp_path: Path) -> None:
    names = ("yaw", "lift", "extend")
    unit = {"known": ("grados", "mm"), "unknown": ("grd", "mm")}
    for kind, (turning, sliding) in unit.items():
        units = (turning, turning, sliding)
        columns = {"Tiempo [s]": T} | {f"{x} posición [{u}]": 50.0 * Q[:, j] for j, (x, u) in enumerate(zip(names, units, strict=True))}
        columns |= {f"{x} par [Nm]": TAU[:, j] for j, x in enumerate(names[:2])} | {f"{names[2]} fuerza [N]": TAU[:, 2]}
        path = written(tmp_path / f"{kind}.csv", columns, mark=";")
        if kind == "unknown":
            with pytest.raises(ident.errors.DataError, match="'grd', which is not a known unit"):
                ident.read_logs(path, robot=_slider(names))
            continue
        log = ident.read_logs(path, robot=_slider(names))[0]
        np.testing.assert_allclose(log.tau["joint"], TAU)


def _slider(names: tuple[str, ...]) -> ident.Robot:
    links = "".join(f'<link name="l{j}"/>' for j in range(4))
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = links.replace("/>", f">{inertial}</link>")
    kinds = ("continuous", "continuous", "prismatic")
    limit = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
    joints = "".join(
        f'<joint name="{x}" type="{k}"><parent link="l{j}"/><child link="l{j + 1}"/><axis xyz="0 0 1"/>{limit}</joint>'
        for j, (x, k) in enumerate(zip(names, kinds, strict=True))
    )
    return ident.Robot.from_urdf(f'<robot name="r">{links}{joints}</robot>')


def test_counted_nouns() -> None:
    assert [counted(k, "row", "repeat") for k in (0, 1, 2)] == ["0 rows repeat", "1 row repeats", "2 rows repeat"]
    assert [counted(k, "stretch", "are", plural="stretches") for k in (1, 3)] == ["1 stretch is", "3 stretches are"]
    assert counted(1, "message", "name", of=" on a topic") == "1 message on a topic names"
