"""Study files and the flags that say the same."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from test_urdf_reading import chain

import ident
from ident import ConfigurationError, DataError, Study, read_study
from ident.robots.tables import read_drive
from ident.study.study import write_study

FULL = """
[robot]
urdf = "sub/arm.urdf"
gravity = [0.0, 0.0, -9.8]
locked = { j3 = 0.5 }

[drive]
measured = "motor"
K = [[0.016, 0], [0.001, 0.00926]]
zero = [0.1, 0]
torque_constants = [1, 2.5]
effects = ["rotor_inertia", "viscous", { name = "coulomb", joints = ["j1"], side = "joint" }]

[logs]
fit = ["train-*.csv", "/absolute/x.csv"]
validate = "held.csv"

[signals]
cutoff_hz = 10

[estimator]
method = "wls"

[columns]
q1 = "shoulder_pan_angle_deg"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "arm.urdf").write_text(chain("", "", ""))
    for name in ("train-2.csv", "train-1.csv", "held.csv"):
        (tmp_path / name).write_text("t\n")
    return tmp_path


def study(folder: Path, text: str) -> Study:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return read_study(path)


def test_a_full_study(folder):
    found = study(folder, FULL)
    robot = found.robot()
    assert robot.joint_names == ("j1", "j2")
    assert robot.tree.gravity[2] == -9.8
    assert robot.transmission.K == pytest.approx(np.array([[0.016, 0], [0.001, 0.00926]]), abs=0)
    assert (robot.transmission.measured, robot.transmission.zero.tolist()) == ("motor", [0.1, 0])
    assert robot.transmission.torque_constants.tolist() == [1, 2.5]
    model = found.model(robot)
    assert [e.name for e in model.effects] == ["rigid_body", "rotor_inertia", "viscous", "coulomb"]
    assert model.effects[-1].joints == ("j1",)
    assert model.effects[-1].side == "joint"
    assert found.columns == {"q1": "shoulder_pan_angle_deg"}
    assert found.make_estimator().name == "wls"
    assert found.fit_files()[:2] == (folder / "train-1.csv", folder / "train-2.csv")
    assert found.validation_files() == (folder / "held.csv",)


def test_preparation_follows_the_signals_table(folder):
    assert study(folder, FULL).make_preparation().cutoff_hz == 10
    with pytest.raises(ConfigurationError, match=r"unknown way to prepare signals 'zero_fase'; did you mean 'zero_phase'"):
        study(folder, '[signals]\nmethod = "zero_fase"').make_preparation()
    with pytest.raises(ConfigurationError, match=r"unknown key of \[signals\] 'cutof_hz'; did you mean 'cutoff_hz'"):
        study(folder, "[signals]\ncutof_hz = 3").make_preparation()
    assert study(folder, '[signals]\nmethod = "savitzky_golay"\nstandstill = { share = 0.3 }').make_preparation().standstill.share == 0.3
    assert study(folder, '[signals]\nrows_near_reversals = "keep"').make_preparation().rows_near_reversals == "keep"
    with pytest.raises(ConfigurationError, match=r"rows_near_reversals must be 'if_consistent' or 'keep', not 'kept'"):
        study(folder, '[signals]\nrows_near_reversals = "kept"').make_preparation()
    with pytest.raises(ConfigurationError, match=r"\[signals\] cutoff_hz must be a number, not 'ten'"):
        study(folder, '[signals]\ncutoff_hz = "ten"').make_preparation()


def test_options_of_an_estimator_are_checked_in_plain_words(folder):
    assert study(folder, '[estimator]\nmethod = "tls"\nacceleration_std = 0.2').make_estimator().acceleration_std == 0.2
    with pytest.raises(ConfigurationError, match=r"acceleration_std must be a list of numbers or a number, not 'x'\.$"):
        study(folder, '[estimator]\nmethod = "tls"\nacceleration_std = "x"').make_estimator()
    with pytest.raises(ConfigurationError, match=r"iterations must be a whole number, not 1\.5\.$"):
        study(folder, '[estimator]\nmethod = "wls"\niterations = 1.5').make_estimator()
    for method in ("iv", "didim"):
        with pytest.raises(ConfigurationError, match=rf"method '{method}': experiment is a Python object .*'iv' without it"):
            study(folder, f'[estimator]\nmethod = "{method}"\nexperiment = {{ controller = "pd" }}').make_estimator()


def test_built_in_robot_brings_its_drive_and_effects(folder):
    found = study(folder, '[robot]\nname = "puma560"\npayload = "none"')
    robot = found.robot()
    assert robot.transmission.measured == "motor"
    assert robot.nominal[50] == pytest.approx(1.3729, abs=1e-4)
    assert [e.name for e in found.model(robot).effects] == ["rigid_body", "rotor_inertia", "viscous", "coulomb"]
    own = study(folder, '[robot]\nname = "puma560"\n[drive]\neffects = ["viscous"]')
    assert own.robot().transmission.K == pytest.approx(robot.transmission.K, abs=0)
    assert [e.name for e in own.model().effects] == ["rigid_body", "viscous"]


def test_loops_are_declared(folder):
    found = study(folder, '[robot]\nurdf = "sub/arm.urdf"\n[loop]\nj3 = { j1 = 1, j2 = -1, offset = 0.2 }')
    assert found.robot().loop.W[2] == pytest.approx([1, -1])
    assert found.robot().loop.offset[2] == 0.2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[robot", "is not valid TOML"),
        ("[robots]\nname = 'x'", r"unknown table \(study .*study\.toml\) 'robots'; did you mean 'robot'"),
        ("robot = 3", r"\[robot\] must be a table, not 3"),
        ("[robot]\nnam = 'x'", r"unknown key of \[robot\] \(study .*study\.toml\) 'nam'; did you mean 'name'"),
        ("[robot]\nname = 3", r"study\.toml: \[robot\] name must be a text, not 3"),
        ("[robot]\nname = 'a'\nurdf = 'b'", r"\[robot\] has both name and urdf"),
        ("[robot]\ngravity = [0, 0]", r"\[robot\] gravity must be a list of 3 numbers, not \[0, 0\]"),
        ("[robot]\nlocked = ['a']", r"\[robot\] locked must be a table of joint = position"),
        ("[robot]\nlocked = { a = 'x' }", r"\[robot\] locked must be a table of joint = position"),
        ("[robot]\nfloating_base = 1", r"floating_base must be true or false"),
        ("[drive]\nmeasured = 'moter'", r"\[drive\] measured must be 'motor' or 'joint', not 'moter'"),
        ("[drive]\nratio = []", r"\[drive\] ratio must be a list of numbers"),
        ("[drive]\nratio = [1, true]", r"\[drive\] ratio must be a list of numbers"),
        ("[drive]\nratio = [1, inf]", r"\[drive\] ratio must be a list of numbers"),
        ("[drive]\nK = [[1, 2]]", r"\[drive\] K must be a square matrix"),
        ("[drive]\nK = [[1, 0], [0]]", r"\[drive\] K must be a square matrix"),
        ("[drive]\nK = [[1]]\nratio = [1]", r"\[drive\] has both ratio and K"),
        ("[drive]\neffects = [3]", r"\[drive\] effects must be a list of effect names or tables"),
        ("[drive]\neffects = [{ joints = ['a'] }]", r"\[drive\] effects must be a list of effect names or tables"),
        ("[drive]\ngear = 3", r"unknown key of \[drive\]"),
        ("[loop]\nj3 = 2", r"\[loop\] j3 must be a table of joint = factor"),
        ("loop = 1", r"\[loop\] must be a table"),
        ("[logs]\nfit = 3", r"\[logs\] fit must be a text or a list of texts, not 3"),
        ("[logs]\nfits = 'x'", r"unknown key of \[logs\] .*'fits'; did you mean 'fit'"),
        ("[columns]\nq1 = 3", r"\[columns\] must be a table of quantity ="),
        ("[columns]\nq1 = { column = 'a', factor = 2 }", r"unknown key of \[columns\] .*'factor'"),
        ("[estimator]\nmethod = 3", r"\[estimator\] method must be a text, not 3"),
        ("signals = 3", r"\[signals\] must be a table"),
    ],
)
def test_refusals_when_reading(folder, text, message):
    with pytest.raises(ConfigurationError, match=message):
        study(folder, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no robot is given"),
        ("[robot]\nurdf = 'gone.urdf'", r"URDF .*gone\.urdf: no such file"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\nratio = [1, 2]", "ratio describes 2 joints, but the robot has 3"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\nK = [[1, 0], [0, 1]]", "K describes 2 joints, but the robot has 3"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\nK = [[1, 1, 0], [1, 1, 0], [0, 0, 1]]", "K is singular"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\nzero = [1]", "zero has 1 entries, but K is 3 x 3"),
        ("[robot]\nurdf = 'sub/arm.urdf'\npayload = 'none'", "payload chooses among those that a built-in robot offers"),
        ("[robot]\nname = 'puma560'\nlocked = { joint7 = 0 }", "unknown joint in `locked` 'joint7'"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\neffects = ['vicous']", "unknown effect 'vicous'; did you mean 'viscous'"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\neffects = [{ name = 'viscous', joint = ['j1'] }]", "'joint'; did you mean 'joints'"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\neffects = [{ name = 'viscous', joints = [1] }]", r"joints must be .*, not \[1\]"),
        ("[robot]\nurdf = 'sub/arm.urdf'\n[drive]\neffects = [{ name = 'viscous', joints = ['j4'] }]", "unknown joint 'j4'"),
    ],
)
def test_refusals_when_building(folder, text, message):
    with pytest.raises(ConfigurationError, match=message):
        study(folder, text).model()


def test_unknown_method_and_option(folder):
    with pytest.raises(ConfigurationError, match="unknown method 'wlss'; did you mean 'wls'"):
        study(folder, '[estimator]\nmethod = "wlss"').make_estimator()
    with pytest.raises(ConfigurationError, match=r"unknown key of \[estimator\]"):
        study(folder, "[estimator]\nweigths = 3").make_estimator()


def test_missing_study_and_logs(folder):
    with pytest.raises(ConfigurationError, match=r"study nowhere\.toml: no such file"):
        read_study("nowhere.toml")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_study(folder)
    with pytest.raises(ConfigurationError, match="no log to fit is given"):
        study(folder, "").fit_files()
    with pytest.raises(DataError, match=r"\[logs\] fit: no file matches .*gone-\*\.csv") as error:
        study(folder, '[logs]\nfit = "gone-*.csv"').fit_files()
    assert error.value.exit_code == 3
    assert study(folder, '[logs]\nfit = "gone.csv"').fit_files() == (folder / "gone.csv",)  # the reader of logs says what is wrong with it


def test_patterns_beside_odd_folder_names(tmp_path):
    odd = tmp_path / "run [1]"
    odd.mkdir()
    (odd / "a[1].csv").write_text("")
    (odd / "b.csv").write_text("")
    assert study(odd, '[logs]\nfit = "*.csv"').fit_files() == (odd / "a[1].csv", odd / "b.csv")
    assert study(odd, '[logs]\nfit = ["a[1].csv", "b.csv", "b.csv"]').fit_files() == (odd / "a[1].csv", odd / "b.csv")


def test_flags_say_the_same_as_a_file(folder):
    drive = folder / "drive.toml"
    drive.write_text('measured = "motor"\nratio = [10, 20, 30]\n')
    found = Study.from_flags(
        urdf=folder / "sub" / "arm.urdf", drive=drive, logs=[str(folder / "train-*.csv")], method="ls", effects=["viscous,coulomb"]
    )
    assert found.robot().transmission.K == pytest.approx(np.diag([0.1, 0.05, 1 / 30]))
    assert [e.name for e in found.model().effects] == ["rigid_body", "viscous", "coulomb"]
    assert found.make_estimator().name == "ls"
    assert len(found.fit_files()) == 2
    assert found.validation_files() == ()
    assert Study.from_flags(robot="puma560").robot().n == 6
    with pytest.raises(ConfigurationError, match="both given"):
        Study.from_flags(robot="puma560", urdf="x.urdf")
    with pytest.raises(ConfigurationError, match="unknown effect 'viscus'"):
        Study.from_flags(robot="puma560", effects=["viscus"]).model()


def test_flags_replace_parts_of_a_file(folder):
    found = study(folder, FULL)
    other = found.with_flags(method="ls", effects=["viscous"], logs=["a.csv"])
    assert (other.make_estimator().name, other.logs.fit, other.logs.validate) == ("ls", ("a.csv",), found.logs.validate)
    assert [e.name for e in other.model().effects] == ["rigid_body", "viscous"]
    assert other.robot().transmission.K == pytest.approx(found.robot().transmission.K, abs=0)
    assert found.with_flags() == found


def test_drive_files(folder):
    path = folder / "d.toml"
    path.write_text("[drive]\nratio = [1, 2]\n[robot]\nname = 'x'\n")
    assert read_drive(path).ratio == (1, 2)
    path.write_text("ratio = [1, 2]\nmesured = 'motor'\n")
    with pytest.raises(ConfigurationError, match=r"unknown key of \[drive\] \(drive file .*d\.toml\) 'mesured'; did you mean 'measured'"):
        read_drive(path)
    with pytest.raises(ConfigurationError, match=r"drive file .*none\.toml: no such file"):
        read_drive(folder / "none.toml")


def test_written_and_read_again(folder):
    found = study(folder, FULL)
    elsewhere = folder / "out"
    elsewhere.mkdir()
    path = write_study(elsewhere / "study.toml", found)
    again = read_study(path)
    assert tomllib.loads(path.read_text())["robot"]["urdf"] == "../sub/arm.urdf"
    assert again.description.drive == found.description.drive
    assert again.robot().joint_names == found.robot().joint_names
    assert [p.resolve() for p in again.fit_files()[:2]] == [p.resolve() for p in found.fit_files()[:2]]
    assert (again.signals, again.estimator, again.columns) == (found.signals, found.estimator, found.columns)
    with pytest.raises(ConfigurationError, match="exists"):
        write_study(path, found)
    assert write_study(path, found, force=True) == path


def test_an_extended_model_is_written_out(folder):
    found = study(folder, FULL)
    model = found.model() + ident.make_effect("offset", joints=["j2"])
    path = write_study(folder / "extended.toml", found.with_effects(model.effects))
    assert tomllib.loads(path.read_text())["drive"]["effects"][-1] == {"name": "offset", "joints": ["j2"]}
    assert [(e.name, e.joints, e.side) for e in read_study(path).model().effects] == [(e.name, e.joints, e.side) for e in model.effects]
