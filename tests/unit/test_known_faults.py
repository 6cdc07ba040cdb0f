"""Kinds of input that once went wrong: each is made small here, with what is right of it."""

from __future__ import annotations

import csv
import gzip
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

import ident
from ident import cli
from ident._utils.structured import read_json, read_toml
from ident.commands import base
from ident.robots.urdf import prepare_urdf

Array = np.ndarray
LINK = (
    '<link name="{n}"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial>{more}</link>'
)
JOINT = (
    '<joint name="j{k}" type="revolute"><parent link="{a}"/><child link="{b}"/><origin xyz="0 0 0.3"/>{axis}<limit {limit}/>{more}</joint>'
)


def urdf(
    *, name: str = ' name="arm"', axis: str = '<axis xyz="0 1 0"/>', limit: str = 'lower="-2" upper="2" velocity="3" effort="9"',
    joint: str = "", link: str = "", outside: str = "", head: str = "",
) -> str:  # fmt: skip
    links = "".join(LINK.format(n=n, more=link if n == "b" else "") for n in "abc")
    joints = JOINT.format(k=1, a="a", b="b", axis='<axis xyz="0 0 1"/>', limit=limit, more="")
    joints += JOINT.format(k=2, a="b", b="c", axis=axis, limit=limit, more=joint)
    return f"{head}<robot{name}>{links}{joints}{outside}</robot>"


def count(text: str) -> int:
    return ident.base(ident.Robot.from_urdf(text)).count


PLAIN = count(urdf())


@pytest.mark.parametrize(
    "text",
    [
        urdf(name=""),
        urdf(outside="<gazebo><sensor:camera/></gazebo>"),
        urdf(link="<visual><geometry/><xacro:steel/></visual>"),
        urdf(joint='<dynamics friction="-0.25" damping="-1"/>'),
        urdf(limit='lower="-1.79769e+308" upper="1.79769e+308" velocity="1.79769e+308" effort="1e30"'),
        urdf(limit='lower="2" upper="-2" velocity="3" effort="9"'),
        urdf(outside='<material name="m"><color rgba="${c}"/></material>'),
    ],
    ids=["no name", "prefix", "macro in a visual", "negative friction", "no limits", "reversed limits", "macro in a material"],
)
def test_what_no_fit_needs_stops_nothing(text: str) -> None:
    assert count(text) == PLAIN
    assert ident.Robot.from_urdf(text).n == 2


def test_an_axis_without_numbers_is_that_of_urdf() -> None:
    assert count(urdf(axis="<axis/>")) == count(urdf(axis='<axis xyz="1 0 0"/>'))
    assert any("axis" in note for note in prepare_urdf(urdf(axis="<axis/>")).notes)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (urdf(head='<!DOCTYPE robot [<!ENTITY t "x">]>'), "document type"),
        (urdf().replace('<mass value="1"/>', '<mass value="2.0 0"/>', 1), "'a'"),
        (urdf().replace('izz="0.02"', "", 1), "izz"),
        (urdf().replace('<mass value="1"/>', "", 1), "mass"),
        (urdf(joint='<mimic joint="j1" offset="inf"/>'), "offset"),
        (urdf(joint='<mimic joint="j1" multiplier="1e300"/>'), "multiplier"),
        (urdf(outside="<xacro:arm/>").replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1), "xacro"),
    ],
    ids=["entities", "mass of two words", "moment missing", "mass missing", "offset", "multiplier", "macro for a link"],
)
def test_what_would_be_misread_is_refused(text: str, named: str) -> None:
    with pytest.raises(ident.ConfigurationError, match=named):
        ident.Robot.from_urdf(text)


def test_moments_that_no_mass_has_are_said() -> None:
    text = urdf().replace('iyy="0.03"', 'iyy="2.9"')
    (doubt,) = ident.Robot.from_urdf(text).doubts
    assert "link 'b'" in doubt
    assert "2.9" in doubt


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1"])
def test_a_name_survives_its_encoding(tmp_path: Path, encoding: str) -> None:
    text = urdf().replace('"j2"', '"jé"')
    declared = f'<?xml version="1.0" encoding="{"ISO-8859-1" if encoding == "iso-8859-1" else encoding.split("-sig", maxsplit=1)[0]}"?>\n'
    (tmp_path / "a.urdf").write_bytes((declared + text).encode(encoding))
    robot = ident.Robot.from_urdf(tmp_path / "a.urdf")
    assert robot.joint_names == ("j1", "jé")
    assert ident.Robot.from_urdf(robot.source["urdf_text"]).joint_names == robot.joint_names


@pytest.mark.parametrize("size", [1e200, np.inf, np.nan])
def test_numbers_that_are_no_robots_are_refused_where_they_are_given(size: float) -> None:
    """Of gravity of 1e200 m/s², no parameter was kept, and the fit's doubts ended in a traceback."""
    with pytest.raises(ident.ConfigurationError, match="gravity"):
        ident.Robot.from_urdf(urdf(), gravity=(0, 0, -size))
    with pytest.raises(ident.ConfigurationError, match="locked"):
        ident.Robot.from_urdf(urdf(), locked={"j2": size})
    for told in ({"K": [[size, 0], [0, 1]]}, {"zero": [size, 0]}, {"torque_constants": [1, size]}):
        with pytest.raises(ident.ConfigurationError, match=next(iter(told))):
            ident.Transmission(**{"K": np.eye(2), "zero": np.zeros(2), **told})
    with pytest.raises(ident.ConfigurationError, match="ratio"):
        ident.Transmission.from_ratio([1, size])


# --- logs -------------------------------------------------------------------------------------------------------------


def motion(n: int = 600) -> tuple[Array, Array, Array]:
    t = np.arange(n) / 100.0
    q = np.stack([np.sin(2.1 * t), 0.8 * np.sin(1.3 * t + 1)], axis=1)
    tau = np.stack([np.cos(2.1 * t), np.sin(3 * t)], axis=1) + 1e-3 * np.random.default_rng(0).normal(size=(n, 2))
    return t, q, tau


def write(path: Path, names: list[str], columns: list[Array], head: str = "") -> Path:
    with path.open("w", newline="") as file:
        file.write(head)
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(np.stack(columns, axis=1).tolist())
    return path


NAMES = ["t", "q1", "q2", "tau1", "tau2"]


@pytest.fixture
def robot() -> ident.Robot:
    return ident.Robot.from_urdf(urdf())


def test_a_header_behind_a_sign_of_comment(tmp_path: Path, robot: ident.Robot) -> None:
    t, q, tau = motion()
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, q, tau]), delimiter=",", header="a note\nt,q1,q2,tau1,tau2")
    np.testing.assert_allclose(ident.read_logs(tmp_path / "a.csv", robot)[0].q, q, atol=1e-12)


def test_unused_columns_of_one_name_stop_nothing_and_used_ones_do(tmp_path: Path, robot: ident.Robot) -> None:
    t, q, tau = motion()
    file = write(tmp_path / "a.csv", [*NAMES, "cmd", "cmd"], [t, *q.T, *tau.T, t, t])
    log = ident.read_logs(file, robot)[0]
    np.testing.assert_allclose(log.q, q)
    assert any("cmd" in note for note in log.notes)
    with pytest.raises(ident.DataError, match="q2"):
        ident.read_logs(write(tmp_path / "b.csv", [*NAMES, "q2"], [t, *q.T, *tau.T, t]), robot)


def test_angles_wrapped_to_a_full_turn_come_back_into_the_limits(tmp_path: Path, robot: ident.Robot) -> None:
    t, q, tau = motion()
    q[:, 0] -= 1.0  # begins below zero, so that whole turns are left when the jumps are joined
    file = write(tmp_path / "a.csv", ["t", "q1_deg", "q2_deg", "tau1", "tau2"], [t, *np.mod(np.rad2deg(q), 360).T, *tau.T])
    logs = ident.read_logs(file, robot)
    np.testing.assert_allclose(logs[0].q, q, atol=1e-9)
    assert not ident.audit(logs, robot).of("unit")


def test_columns_beyond_the_mapped_joints_are_others(tmp_path: Path, robot: ident.Robot) -> None:
    t, q, tau = motion()
    file = write(tmp_path / "a.csv", [*NAMES, "q3", "tau3"], [t, *q.T, *tau.T, t, t])
    with pytest.raises(ident.DataError, match="q3"):
        ident.read_logs(file, robot)
    log = ident.read_logs(file, robot, {"q1": "q1", "q2": "q2", "tau1": "tau1", "tau2": "tau2"})[0]
    assert log.n == 2


def test_rows_that_a_recorder_took_again_are_left_out(tmp_path: Path, robot: ident.Robot) -> None:
    t, q, tau = motion()
    for k in range(40, 600, 50):
        q[k], tau[k] = q[k - 1], tau[k - 1]
    log = ident.read_logs(write(tmp_path / "a.csv", NAMES, [t, *q.T, *tau.T]), robot)[0]
    assert len(log) == 600 - len(range(40, 600, 50))
    assert any("repeat the row before" in note for note in log.notes)
    still = np.concatenate([q, np.repeat(q[-1:], 200, axis=0)])
    rest = np.concatenate([tau, np.repeat(tau[-1:], 200, axis=0)])
    late = np.arange(800) / 100.0
    assert len(ident.read_logs(write(tmp_path / "b.csv", NAMES, [late, *still.T, *rest.T]), robot)[0]) >= 780


def test_a_fit_through_every_row_is_refused(robot: ident.Robot) -> None:
    rng = np.random.default_rng(1)
    t = np.arange(60) / 10.0
    log = ident.Log("short", t=t, q=np.cumsum(rng.normal(size=(60, 2)), axis=0) * 0.05, tau={"joint": rng.normal(size=(60, 2))})
    with pytest.raises(ident.DataError):
        ident.fit(log, robot, held=0, preparation=ident.ZeroPhase(cutoff_hz=0.4))


def test_a_line_without_an_end_is_no_table(tmp_path: Path, robot: ident.Robot) -> None:
    with gzip.open(tmp_path / "a.csv.gz", "wb") as file:
        for _ in range(60):
            file.write(b"1" * 100_000)
    with pytest.raises(ident.DataError, match="line"):
        ident.read_logs(tmp_path / "a.csv.gz", robot)
    (tmp_path / "b.csv").write_text("t,q1,q2,tau1,tau2\n" + "9" * 200_000 + "\n")
    with pytest.raises(ident.DataError):
        ident.read_logs(tmp_path / "b.csv", robot)


@pytest.mark.parametrize("row", ["0.02,1,0.1", "0.02,1,0.1,0.2,0.3,0.4", '0.02,"1,0.1,0.2'], ids=["short", "long", "open quotes"])
def test_tables_of_words_are_read_or_refused_by_name(tmp_path: Path, row: str) -> None:
    """A table in which a column holds names or lists goes through a reader of its own, which refuses like that of numbers."""
    path = tmp_path / "a.csv"
    path.write_text(f'time,name,position,effort,more\n0,"[\'j1\', \'j2\']","[0, 1]","[0, 1]",\n{row}\n')
    with pytest.raises(ident.DataError, match=r"a\.csv"):
        ident.read_logs(path)
    many = ",".join(["time", "id", "position", "effort", *["extra"] * 16, "name"])
    path.write_text(many + "\n" + "".join(f"{k},1,0.1,0.2\n" for k in range(60)))
    with pytest.raises(ident.DataError, match=r"a\.csv"):
        ident.read_logs(path)


def test_a_field_beyond_all_bounds_is_told_with_its_file_and_line(tmp_path: Path, robot: ident.Robot) -> None:
    (tmp_path / "a.csv").write_text("t,q1,q2,tau1,tau2\n0,0,0,0,0\n1,0," + "1" * 200_000 + ",0,0\n")
    with pytest.raises(ident.DataError, match=r"a\.csv.*line 3"):
        ident.read_logs(tmp_path / "a.csv", robot)


@pytest.mark.slow
def test_very_many_columns_take_no_longer_for_each(tmp_path: Path, robot: ident.Robot) -> None:
    """Names were once looked up in a list for each column: 30,000 of them took half a minute."""

    def seconds(more: int) -> float:
        path = tmp_path / f"{more}.csv"
        head = ",".join([*NAMES, *(f"c{k}" for k in range(more))])
        rows = "\n".join(f"{k / 100},{np.sin(0.1 * k)},{np.cos(0.1 * k)},1,2" + ",0" * more for k in range(20))
        path.write_text(f"{head}\n{rows}\n")
        start = time.process_time()
        assert ident.read_logs(path, robot)[0].n == 2
        return time.process_time() - start

    seconds(10)
    few, many = (min(seconds(count) for _ in range(2)) for count in (5_000, 20_000))
    assert many < 4 * 2 * few + 0.2


# --- structured text, writers, faults ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [".".join(["a"] * 500) + " = 1", "a = " + "[" * 500 + "]" * 500, "a = " + "9" * 5000, "a = ", "\x00"],
    ids=["dots", "deep", "digits", "open", "nul"],
)
def test_a_study_that_is_none_is_refused_quickly(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ident.ConfigurationError, match=r"a\.toml"):
        read_toml(tmp_path / "a.toml", "study")


@pytest.mark.parametrize(
    "text", ["[" * 5000 + "]" * 5000, "{", '{"a": ' + "9" * 5000 + "}", "\ufeff"], ids=["deep", "open", "digits", "empty"]
)
def test_a_result_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ident.ConfigurationError, match=r"a\.json"):
        read_json(tmp_path / "a.json", "fit")


@pytest.mark.parametrize("name", ["x" * 300 + ".json", "a/b/c.json", "folder"], ids=["long", "no folder", "a folder"])
def test_what_cannot_be_written_is_said_in_one_line(tmp_path: Path, name: str) -> None:
    train, _ = ident.demo_logs()
    (tmp_path / "folder").mkdir()
    estimate = ident.fit(train, "puma560", held=0)
    with pytest.raises(ident.ConfigurationError, match="nothing was written"):
        estimate.save(tmp_path / name, force=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder"]


def test_a_full_disk_and_a_place_that_takes_nothing_are_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A disk that takes 4096 bytes of a file and no more, and one that is read-only: exit 2, one line, what was there stays."""
    resource = pytest.importorskip("resource")
    train, _ = ident.demo_logs()
    estimate = ident.fit(train, "puma560", held=0)
    (tmp_path / "fit.json").write_text("old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(ident.ConfigurationError, match=r"File too large.*nothing was written"):
            estimate.save(tmp_path / "fit.json", force=True)
        assert cli.main(["simulate", "--robot", "scara", "--seconds", "2", "--out", str(tmp_path / "out"), "--quiet"]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert capsys.readouterr().err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "old"

    def denied(*_: object, **__: object) -> tuple[int, str]:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("tempfile.mkstemp", denied)
    with pytest.raises(ident.ConfigurationError, match=r"Read-only file system.*nothing was written"):
        estimate.save(tmp_path / "fit.json", force=True)


def test_a_fault_of_ours_ends_with_a_report_and_the_files_that_reproduce_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def broken(*_: object) -> int:
        raise ZeroDivisionError("made here")

    monkeypatch.setattr(base, "run", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "arm.urdf").write_text(urdf())
    (tmp_path / "study.toml").write_text('[robot]\nurdf = "arm.urdf"\n')
    assert cli.main(["base", str(tmp_path / "study.toml")]) == 70
    said = capsys.readouterr().err
    assert "please report" in said
    assert "Traceback" not in said
    assert said.count("\n") == 1
    (report,) = tmp_path.glob("ident-fault-*.zip")
    assert str(report) in said
    with zipfile.ZipFile(report) as archive:
        text = archive.read("report.txt").decode()
        assert archive.read("files/0/study.toml") == (tmp_path / "study.toml").read_bytes()
        assert archive.read("files/1/arm.urdf") == (tmp_path / "arm.urdf").read_bytes()
    for told in ("made here", "Traceback", f"ident {ident.__version__}", "'base'", "Python 3."):
        assert told in text
    # Where nothing can be written, the report is on standard error.
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    assert cli.main(["base", "--urdf", str(tmp_path / "arm.urdf")]) == 70
    assert "made here" in capsys.readouterr().err


@pytest.mark.parametrize("names", [("q2", "q1"), ("q0", "q1")])
def test_a_number_that_is_another_joints_name_is_asked_about(tmp_path: Path, names: tuple[str, str]) -> None:
    """By its number, a column would silently be that of the wrong joint."""
    t, q, tau = motion()
    robot = ident.Robot.from_urdf(urdf().replace('name="j1"', f'name="{names[0]}"').replace('name="j2"', f'name="{names[1]}"'))
    file = write(tmp_path / "a.csv", NAMES, [t, *q.T, *tau.T])
    with pytest.raises(ident.ConfigurationError, match="another joint is named"):
        ident.read_logs(file, robot)
    mapped = ident.read_logs(file, robot, {"q1": "q1", "q2": "q2", "tau1": "tau1", "tau2": "tau2"})[0]
    np.testing.assert_allclose(mapped.q, q)
    named = ["t", *(f"{n}.position" for n in names), *(f"{n}.effort" for n in names)]
    np.testing.assert_allclose(ident.read_logs(write(tmp_path / "b.csv", named, [t, *q.T, *tau.T]), robot)[0].q, q)


def test_a_joint_named_like_the_constant_of_a_rule_is_refused() -> None:
    """As a key of the rule, the name would take the place of the multiplier."""
    text = urdf(joint='<mimic joint="offset" multiplier="0.5" offset="0.1"/>').replace('name="j1"', 'name="offset"')
    with pytest.raises(ident.ConfigurationError, match="rename the joint"):
        ident.Robot.from_urdf(text)
    assert ident.Robot.from_urdf(urdf().replace('name="j1"', 'name="offset"')).joint_names == ("offset", "j2")
