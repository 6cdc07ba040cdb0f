"""Reading logs: the CSV contract, its aliases and units, other formats, and what may be repaired."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest
from effect_robots import ROBOTS

from ident.errors import ConfigurationError, DataError
from ident.logs.columns import resolve_columns
from ident.logs.log import Log, LogSet
from ident.logs.names import JointNames
from ident.logs.readers.tables import read_header
from ident.logs.reading import read_logs
from ident.logs.torque import measured
from ident.logs.units import split_unit
from ident.logs.unwrap import unwrapped
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.signals import ZeroPhase
from ident.streaming.ingest import Reading, store_logs

SCARA = """<robot name="slide_arm"><link name="base"/><link name="a"/><link name="b"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="5" effort="50"/></joint>
<joint name="lift" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.5" velocity="1" effort="200"/></joint></robot>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_urdf(SCARA)


def write(path: Path, header: str, rows: list[list[float | str]]) -> Path:
    text = "\n".join([header, *(",".join(str(x) for x in row) for row in rows)]) + "\n"
    if path.suffix == ".gz":
        with gzip.open(path, "wt") as file:
            file.write(text)
    else:
        path.write_text(text)
    return path


def table(n: int = 60, columns: int = 4) -> list[list[float | str]]:
    t = np.arange(n) * 0.01
    return [[float(t[k]), *(float(np.sin(t[k] * (c + 1))) for c in range(columns))] for k in range(n)]


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
def test_plain_and_compressed(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / name, "t,q1,q2,tau1,tau2", table())
    log = read_logs(path)[0]
    assert log.name == "log"
    assert log.n == 2
    np.testing.assert_array_equal(log.q[:, 1], [row[2] for row in table()])
    np.testing.assert_array_equal(log.tau["joint"][:, 0], [row[3] for row in table()])
    assert len(log.sha256) == 64


def test_units_are_converted(tmp_path: Path) -> None:
    rows = [[1000.0 * k, 90.0, 180.0, 250.0, 2000.0, 3.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "time_us,q1_deg,dq1_deg_s,q2_mm,tau1_mNm,i2_A", rows)
    log = read_logs(path)[0]
    assert log.t[1] == pytest.approx(1e-3)
    assert log.q[0] == pytest.approx([math.pi / 2, 0.25])
    assert log.tau["joint"][0, 0] == pytest.approx(2.0)
    assert np.isnan(log.tau["joint"][:, 1]).all()
    assert log.tau["current"][0, 1] == 3.0
    assert log.dq is None, "velocity of one joint alone is no velocity"
    assert any("velocity is not logged for joint 2" in note for note in log.notes)


@pytest.mark.parametrize(
    ("name", "stem", "unit"),
    [
        ("q1_rad_s2", "q1", "rad_s2"),
        ("tau_m1", "tau_m1", None),
        ("q_m1_m", "q_m1", "m"),
        ("q1_ref_m", "q1_ref", "m"),
        ("time_s", "time", "s"),
        ("boom angle [deg]", "boom angle", "deg"),
        ("q1 (rad/s)", "q1", "rad_s"),
        ("speed [m/s²]", "speed", "m_s2"),
        ("tau1[N·m]", "tau1", "Nm"),
        ("q1 [°]", "q1", "deg"),
        ("tau1 [N.m]", "tau1", "Nm"),
        ("tau1 (N-m)", "tau1", "Nm"),
        ("tau1 [m N]", "tau1", "Nm"),
        ("tau1 [mN m]", "tau1", "mNm"),
        ("tau1 [N⋅m]", "tau1", "Nm"),
        ("f1 [mN]", "f1", "mN"),
        ("dq1 [rad s^-1]", "dq1", "rad_s"),
        ("ddq1 [rad·s⁻²]", "ddq1", "rad_s2"),
        ("dq1 [deg/sec]", "dq1", "deg_s"),
        ("dq2 [cm/s]", "dq2", "cm_s"),
        ("q1 [º]", "q1", "deg"),
        ("q1 [degrees]", "q1", "deg"),
        ("q1_degrees", "q1", "deg"),
        ("time_seconds", "time", "s"),
        ("Time [msec]", "Time", "ms"),
        ("[deg] q1", "q1", "deg"),
        ("q1 [deg] (filtered)", "q1 (filtered)", "deg"),
        ("angle (left) [mrad]", "angle (left)", "mrad"),
        ("degrees", "degrees", None),
        ("torque [%]", "torque [%]", None),
        ("angle (left)", "angle (left)", None),
        ("[deg]", "[deg]", None),
    ],
)
def test_split_unit(name: str, stem: str, unit: str | None) -> None:
    assert split_unit(name) == (stem, unit)


def test_aliases_and_extra_columns(tmp_path: Path) -> None:
    rows = [[k * 0.01, 0.1 * k, 5.0, 0.2, 7.0, "idle"] for k in range(40)]
    path = write(tmp_path / "a.csv", "time_s,qm1_rad,taum1_Nm,q1_ref_rad,temperature,state", rows)
    log = read_logs(path)[0]
    assert log.q is None
    np.testing.assert_allclose(log.q_motor[:, 0], 0.1 * np.arange(40))
    assert set(log.tau) == {"motor"}
    assert set(log.extra) == {"q1_ref_rad", "temperature"}, "numbers are kept, text is not"


def test_columns_by_joint_name_in_any_order(tmp_path: Path, robot: Robot) -> None:
    rows = [[k * 0.01, 0.3, 20.0, 0.1 * k, 4.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "t,lift.position,lift.effort,/arm/shoulder/position,shoulder.effort_Nm", rows)
    log = read_logs(path, robot)[0]
    np.testing.assert_allclose(log.q[:, 0], 0.1 * np.arange(40))
    np.testing.assert_allclose(log.q[:, 1], 0.3)
    np.testing.assert_allclose(log.tau["joint"][0], [4.0, 20.0])


def test_an_effort_is_on_the_side_that_the_drive_declares(tmp_path: Path, robot: Robot) -> None:
    rows = [[k * 0.01, 0.3, 20.0, 0.1 * k, 4.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "t,lift.position,lift.effort,shoulder.position,shoulder.torque_Nm", rows)
    geared = robot.with_transmission(Transmission.from_ratio(np.array([50.0, -20.0]), Side.MOTOR))
    log = read_logs(path, geared)[0]
    assert set(log.tau) == {"motor"}
    np.testing.assert_allclose(measured(log, geared.transmission).torque[0], [4.0, 20.0])
    assert measured(log, geared.transmission).notes == ()
    told = write(tmp_path / "b.csv", "t,q2,tau2,q1,tau1", rows)
    assert set(read_logs(told, geared)[0].tau) == {"joint"}, "a name that tells the side is believed"
    mapped = read_logs(path, geared, {"tau1": "shoulder.torque_Nm", "tau2": "lift.effort"})[0]
    assert set(mapped.tau) == {"joint"}


def test_mapping_with_units_scale_and_offset(tmp_path: Path, robot: Robot) -> None:
    rows = [[k * 0.01, 90.0, 100.0, 2.0, 3.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "stamp,pan_angle_deg,height,force,pan", rows)
    columns = {
        "t": "stamp",
        "q1": "pan_angle_deg",
        "q2": {"column": "height", "unit": "mm", "offset": 50.0},
        "tau1": {"column": "pan", "scale": -2.0},
        "tau2": "force",
    }
    log = read_logs(path, robot, columns)[0]
    assert log.q[0] == pytest.approx([math.pi / 2, 0.15])
    assert log.tau["joint"][0] == pytest.approx([-6.0, 2.0])


def test_mapping_with_the_unit_on_either_side(tmp_path: Path, robot: Robot) -> None:
    """What a study's [columns] can say: texts alone, the unit with the quantity or with the file's name."""
    rows = [[k * 10.0, 90.0, 100.0, 2000.0, 3.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "stamp,pan,height_mm,force,load", rows)
    log = read_logs(path, robot, {"t_ms": "stamp", "q1_deg": "pan", "q2": "height_mm", "tau1_mNm": "force", "tau2": "load"})[0]
    assert log.t[:2] == pytest.approx([0.0, 0.01])
    assert log.q[0] == pytest.approx([math.pi / 2, 0.1])
    assert log.tau["joint"][0] == pytest.approx([2.0, 3.0])


def test_units_in_brackets(tmp_path: Path, robot: Robot) -> None:
    """As spreadsheets and drives write them: read as they are, and where a study maps a name without saying the unit again."""
    rows = [[k * 10.0, 90.0, 100.0, 2000.0, 3.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "Time [ms],q1 [deg],boom [mm],tau1 [mN m],boom force [counts]", rows)
    log = read_logs(path, robot, {"q2": "boom [mm]", "tau2": "boom force [counts]"})[0]
    assert log.t[:2] == pytest.approx([0.0, 0.01])
    assert log.q[0] == pytest.approx([math.pi / 2, 0.1])
    assert log.tau["joint"][0] == pytest.approx([2.0, 3.0])
    assert [note for note in log.notes if "SI is assumed" in note and "'boom force [counts]'" in note]
    assert len([note for note in log.notes if "SI is assumed" in note]) == 1


def test_mapping_that_renumbers_switches_numbers_off(tmp_path: Path, robot: Robot) -> None:
    """q1 = "q2": what else is numbered counts other joints, and must not be taken for the robot's."""
    path = write(tmp_path / "a.csv", "t,q1,q2,q3,dq1,dq2,dq3,tau2,tau3", table(columns=8))
    log = read_logs(path, robot, {"q1": "q2", "q2": "q3", "tau1": "tau2", "tau2": "tau3"})[0]
    assert log.dq is None
    np.testing.assert_allclose(log.q[:, 0], [row[2] for row in table(columns=8)])
    assert any("renumbers" in note for note in log.notes)


def test_motor_positions_become_joint_positions() -> None:
    K = np.array([[0.02, 0.0], [0.004, 0.01]])
    robot = Robot.from_urdf(SCARA, transmission=Transmission(K, np.array([0.5, -0.1]), Side.MOTOR))
    q_motor = np.random.default_rng(1).standard_normal((50, 2))
    log = Log("m", np.arange(50) * 0.01, q_motor=q_motor, dq_motor=q_motor, tau={"motor": q_motor})
    np.testing.assert_allclose(log.position(robot.transmission), q_motor @ K.T + [0.5, -0.1])
    np.testing.assert_allclose(log.velocity(robot.transmission), q_motor @ K.T)


class TestMeasuredTorque:
    K = np.array([[0.02, 0.0], [0.004, 0.01]])

    def log(self, **tau: np.ndarray) -> Log:
        return Log("x", np.arange(3) * 0.1, np.zeros((3, 2)), tau=tau)

    def test_logged_side_is_taken_as_it_is(self) -> None:
        tau = {"joint": np.ones((3, 2)), "motor": np.full((3, 2), 7.0)}
        found = measured(self.log(**tau), Transmission(self.K, None, Side.MOTOR))
        assert (found.torque == 7).all()
        assert not found.notes

    def test_other_side_goes_through_k(self) -> None:
        joint = np.arange(6.0).reshape(3, 2)
        found = measured(self.log(joint=joint), Transmission(self.K, None, Side.MOTOR))
        np.testing.assert_allclose(found.torque, joint @ self.K)
        assert "through K" in found.notes[0]

    def test_currents(self) -> None:
        current = np.arange(6.0).reshape(3, 2)
        drive = Transmission(self.K, None, Side.JOINT, torque_constants=np.array([0.1, 0.2]))
        found = measured(self.log(current=current), drive)
        np.testing.assert_allclose(found.torque @ self.K, current * [0.1, 0.2])

    def test_missing_torque_spoils_only_what_needs_it(self) -> None:
        # τ_m = Kᵀ τ: motor 1 needs both joints, motor 2 only joint 2.
        joint = np.column_stack([np.full(3, np.nan), np.ones(3)])
        found = measured(self.log(joint=joint), Transmission(self.K, None, Side.MOTOR))
        assert np.isnan(found.torque[:, 0]).all()
        np.testing.assert_allclose(found.torque[:, 1], self.K[1, 1])

    def test_currents_without_constants(self) -> None:
        with pytest.raises(ConfigurationError, match="torque_constants"):
            measured(self.log(current=np.ones((3, 2))), Transmission(self.K, None))

    def test_no_torque(self) -> None:
        with pytest.raises(DataError, match="no torque or current"):
            measured(self.log(), Transmission(self.K, None))


def test_mat(tmp_path: Path) -> None:
    from scipy.io import savemat

    t = np.arange(50) * 0.01
    q = np.column_stack([np.sin(t), np.cos(t)])
    savemat(tmp_path / "m.mat", {"t": t[:, None], "q_deg": np.degrees(q), "tau_m": q.T, "note": "text"})
    log = read_logs(tmp_path / "m.mat")[0]
    np.testing.assert_allclose(log.q, q)
    np.testing.assert_allclose(log.tau["motor"], q)
    savemat(tmp_path / "s.mat", {"data": {"time": t, "q1": q[:, 0], "i1_mA": 1000 * t}})
    log = read_logs(tmp_path / "s.mat")[0]
    np.testing.assert_allclose(log.tau["current"][:, 0], t)


def stamped(path: Path, t: object, **columns: object) -> Path:
    """A Parquet file of some columns."""
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pa.table({"t": t, **columns}), path)
    return path


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["M8", "m8"])
def test_a_time_stamp_has_its_unit_whatever_its_column_is_called(tmp_path: Path, unit: str, kind: str) -> None:
    pytest.importorskip("pyarrow")
    per_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    step = max(1, per_second // 200)
    ticks = step * np.arange(50) + (1_790_000_000 * per_second if kind == "M8" else 0)
    path = stamped(tmp_path / "p.parquet", ticks.astype(f"{kind}[{unit}]"), q1=np.sin(np.arange(50.0)))
    for columns in (None, {"t_ms": "t"}):
        log = read_logs(path, columns=columns)[0]
        np.testing.assert_allclose(np.diff(log.t), step / per_second, atol=1e-6)
        assert log.t[0] == pytest.approx(1.79e9 if kind == "M8" else 0.0)


def test_a_missing_time_stamp_is_none_and_a_time_is_no_position(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    t = np.datetime64("2026-05-01T12:00:00", "ms") + 5 * np.arange(2000).astype("m8[ms]")
    t[7] = np.datetime64("NaT")
    log = read_logs(stamped(tmp_path / "a.parquet", t, q1=np.sin(np.arange(2000.0))))[0]
    assert len(log.t) == 1999
    assert any("left out: 1 row without a time stamp (data row 8)" in note for note in log.notes)
    with pytest.raises(DataError, match=r"b\.parquet: column 'q1' holds times, not numbers; it cannot be position"):
        read_logs(stamped(tmp_path / "b.parquet", np.arange(2000.0), q1=t))


def test_a_mapping_that_contradicts_a_name_is_said(tmp_path: Path) -> None:
    rows = [[k * 0.01, 90.0] for k in range(40)]
    path = write(tmp_path / "a.csv", "Time [ms],A [deg]", rows)
    log = read_logs(path, columns={"t_s": "Time [ms]", "q1_rad": "A [deg]"})[0]
    assert log.t[1] == 0.01
    assert log.q[0, 0] == 90.0
    assert any("'A [deg]' says deg, but [columns] q1_rad says rad" in note for note in log.notes)
    assert any("'Time [ms]' says ms, but [columns] t_s says s" in note for note in log.notes)
    same = read_logs(path, columns={"t_ms": "Time [ms]", "q1_deg": "A [deg]"})[0]
    assert not any("says" in note for note in same.notes)


def test_parquet(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    t = np.arange(50) * 0.01
    parquet.write_table(pa.table({"t": t, "q1": np.sin(t), "tau1": [None, *t[1:].tolist()], "label": ["a"] * 50}), tmp_path / "p.parquet")
    log = read_logs(tmp_path / "p.parquet")[0]
    np.testing.assert_allclose(log.q[:, 0], np.sin(t))
    assert np.isnan(log.tau["joint"][0, 0])
    assert not log.extra


def test_blanks_around_the_names_of_a_parquet_file_are_no_part_of_them(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    t = np.arange(50) * 0.01
    parquet.write_table(pa.table({"t ": t, " q1": np.sin(t), "tau1": t, "note ": t, "twice": t, "twice ": t}), tmp_path / "p.parquet")
    log = read_logs(tmp_path / "p.parquet")[0]
    np.testing.assert_array_equal(log.q[:, 0], np.sin(t))
    assert read_header(tmp_path / "p.parquet").names == ("t", "q1", "tau1", "note", "twice", "twice ")


def test_both_csv_readers_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import ident.logs.readers.text as files

    rows = [[k * 0.001, math.pi * k, "" if k == 3 else 1e-300 * k] for k in range(50)]
    path = write(tmp_path / "a.csv", "# a comment\nt, q1 ,tau1", rows)
    fast = read_logs(path)[0]
    monkeypatch.setattr(files, "find_spec", lambda name: None)
    slow = read_logs(path)[0]
    np.testing.assert_array_equal(fast.q, slow.q)
    np.testing.assert_array_equal(fast.tau["joint"], slow.tau["joint"])
    assert np.isnan(slow.tau["joint"][3, 0])


def test_semicolons_and_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbft;q1;tau1\r\n" + b"".join(b"%f;%f;1\r\n" % (0.01 * k, k) for k in range(30)))
    log = read_logs(path)[0]
    np.testing.assert_allclose(log.q[:, 0], np.arange(30))


def test_a_plan_serves_any_piece_of_a_table() -> None:
    plan = resolve_columns(["t_ms", "q1_deg", "tau1", "other"], JointNames(("a",), (False,)))
    assert plan.sources == ("t_ms", "q1_deg", "tau1")
    assert plan.extra == ("other",)
    raw = {"t_ms": np.arange(10.0), "q1_deg": np.arange(10.0) * 3, "tau1": np.ones(10)}
    whole = plan.arrays(raw)
    pieces = [plan.arrays({k: v[s] for k, v in raw.items()}) for s in (slice(0, 4), slice(4, 10))]
    for key, array in whole.items():
        np.testing.assert_array_equal(np.concatenate([p[key] for p in pieces]), array)


class TestTime:
    def test_repeated_stamps_are_dropped_and_said(self, tmp_path: Path) -> None:
        rows = table()
        rows.insert(10, rows[9])
        log = read_logs(write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", rows))[0]
        assert len(log) == 60
        assert (np.diff(log.t) > 0).all()
        assert any("data row 11" in note for note in log.notes)

    def test_runs_written_one_after_the_other(self, tmp_path: Path) -> None:
        logs = read_logs(write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", [*table(60), *table(45)]))
        assert [len(log) for log in logs] == [60, 45]
        assert logs.names == ("a run 1", "a run 2")
        assert any("taken as 2 runs" in note for note in logs.notes)

    def test_backwards(self, tmp_path: Path) -> None:
        rows = table()
        rows[20], rows[30] = rows[30], rows[20]
        with pytest.raises(DataError, match="backwards at data row 22"):
            read_logs(write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", rows))

    def test_isolated_missing_positions_become_a_gap(self, tmp_path: Path) -> None:
        rows = table(2000)
        rows[100][1] = "nan"
        rows[900][2] = ""
        log = read_logs(write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", rows))[0]
        assert len(log) == 1998
        assert any("'q1'" in note and "data row 101" in note for note in log.notes)

    def test_one_missing_in_a_short_log(self, tmp_path: Path) -> None:
        rows = table(40)
        rows[10][1] = "inf"
        assert len(read_logs(write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", rows))[0]) == 39

    def test_missing_block_as_gap_if_asked(self, tmp_path: Path) -> None:
        rows = table(200)
        for k in range(50, 120):
            rows[k][1] = "nan"
        path = write(tmp_path / "a.csv", "t,q1,q2,tau1,tau2", rows)
        assert len(read_logs(path, missing="gap")[0]) == 130
        with pytest.raises(DataError, match=r"'q1' has no number in 70 of 200 rows \(data rows 51-120\)"):
            read_logs(path)


class TestSets:
    def logs(self, count: int = 4, n: int = 400) -> LogSet:
        t = np.arange(n) * 0.01
        return LogSet(tuple(Log(f"run{k}", t + k, np.full((n, 1), float(k)), tau={"joint": np.zeros((n, 1))}) for k in range(count)))

    def test_by_run(self) -> None:
        fit, held = self.logs().split(by="run")
        assert len(fit) == 3
        assert len(held) == 1
        assert not set(fit.names) & set(held.names)

    def test_by_fraction_takes_the_end(self) -> None:
        fit, held = self.logs(1).split(by="fraction", held=0.4)
        assert fit[0].t[-1] < held[0].t[0]
        assert len(fit[0]) + len(held[0]) == 400
        assert len(held[0]) == pytest.approx(160, abs=2)

    def test_by_blocks_shares_no_sample(self) -> None:
        fit, held = self.logs(1).split(by="blocks", held=0.25, blocks=8)
        times = [set(np.concatenate([log.t for log in part]).tolist()) for part in (fit, held)]
        assert not times[0] & times[1]
        assert len(times[0] | times[1]) == 400
        assert len(held) == 2

    def test_one_run_cannot_be_split_by_run(self) -> None:
        with pytest.raises(ConfigurationError, match="fraction"):
            self.logs(1).split(by="run")

    def test_unknown_way(self) -> None:
        with pytest.raises(ConfigurationError, match="did you mean 'fraction'"):
            self.logs().split(by="fractions")

    def test_window_and_select(self) -> None:
        logs = self.logs()
        assert len(logs.window(1.0, 2.0)[2]) == 101
        assert logs.select(["run2"]).names == ("run2",)
        with pytest.raises(ConfigurationError, match="did you mean"):
            logs.select(["run9"])
        with pytest.raises(DataError, match="the runs last"):
            logs.window(100.0, 200.0)

    def test_pattern_and_equal_names(self, tmp_path: Path) -> None:
        for folder in ("a", "b"):
            (tmp_path / folder).mkdir()
            write(tmp_path / folder / "run.csv", "t,q1,q2,tau1,tau2", table())
        logs = read_logs(str(tmp_path / "*" / "run.csv"))
        assert logs.names == ("run", "run (2)")
        assert len(logs.inputs) == 2


def test_motors_that_jump_by_a_turn_leave_the_zero_of_their_joints_open(tmp_path: Path) -> None:
    """In memory and streamed."""
    robot = ROBOTS["scara"]()
    t = np.arange(4000) / 400.0
    motors = np.outer(np.sin(1.3 * t), [12.0, 2.0, 1.0, 9.0])
    wrapped = (motors + np.pi) % (2.0 * np.pi) - np.pi
    header = "t," + ",".join(f"q_m{j + 1}" for j in range(4)) + "," + ",".join(f"tau_m{j + 1}" for j in range(4))
    path = write(tmp_path / "turns.csv", header, np.column_stack([t, wrapped, motors]).tolist())
    signals = ZeroPhase(cutoff_hz=20.0)(read_logs(path, robot))
    (run,) = store_logs(path, tmp_path / "stored", Reading(robot))
    for notes in (signals.report.warnings, run.notes):
        (said,) = [note for note in notes if "jump by a full turn" in note]
        assert "motor positions of j1, j4 jump" in said
        assert "the zero of j1 (0.126 rad a turn)" in said
        assert "j2 (" not in said
    joints = robot.transmission.joint_position(motors)
    np.testing.assert_allclose(run.read(0, len(t)).q, joints, atol=1e-9)


def test_unwrapping_only_full_turns() -> None:
    angle = np.linspace(0, 20, 400)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(unwrapped(wrapped[:, None])[:, 0], angle, atol=1e-12)
    jump = np.where(np.arange(400) < 200, 0.0, 4.0)[:, None]
    assert unwrapped(jump) is jump
