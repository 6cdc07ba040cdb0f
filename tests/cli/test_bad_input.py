"""Bad input: each kind ends with the right exit code and a text that names what is wrong and what to do."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import ARM, FRICTION, JOINTS, write_csv

USAGE, DATA = 2, 3


@pytest.fixture
def fit(ident, arm):
    """`ident fit` of the arm's URDF on one log."""

    def run(log, *more):
        return ident("fit", "--urdf", arm.urdf, "--log", log, *FRICTION, "--quiet", *more)

    return run


def refused(ran, code: int, *patterns: str) -> None:
    """The call failed with this code, nothing on standard output, and one error text that matches every pattern."""
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert "Traceback" not in ran.err
    for pattern in patterns:
        assert re.search(pattern, ran.err), ran.err


# --- files ---------------------------------------------------------------------------------------------------------------------


def test_missing_file(fit, tmp_path):
    refused(fit(tmp_path / "none.csv"), DATA, r"ident fit: log .*none\.csv: no such file")


def test_pattern_without_a_match(fit, tmp_path):
    refused(fit(tmp_path / "*.csv"), DATA, r"no file matches '.*\*\.csv'")


def test_folder_as_a_log(fit, tmp_path):
    refused(fit(tmp_path), DATA, r"is a folder; give its files")


def test_empty_file(fit, tmp_path):
    (tmp_path / "empty.csv").write_text("")
    refused(fit(tmp_path / "empty.csv"), DATA, r"empty\.csv: the file is empty")


def test_header_only(fit, arm, tmp_path):
    path = write_csv(tmp_path / "header.csv", {name: [] for name in arm.table})
    refused(fit(path), DATA, r"header\.csv: there is a header, but no row of data")


def test_binary_file(fit, tmp_path):
    (tmp_path / "log.csv").write_bytes(bytes(range(256)) * 20)
    refused(fit(tmp_path / "log.csv"), DATA, r"log\.csv: is not a text table")


# --- columns -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lacking", "count"), [(("q4", "tau4"), 3), (("q2",), 3)])
def test_too_few_joints(fit, arm, tmp_path, lacking, count):
    path = write_csv(tmp_path / "few.csv", {k: v for k, v in arm.table.items() if k not in lacking})
    name = JOINTS[int(lacking[0][1]) - 1]
    refused(
        fit(path), DATA, rf"the robot has 4 joints, but the log has positions of {count}", rf"missing: {lacking[0]} \({name}\)", r"locked"
    )


def test_locked_joints_may_be_in_the_log(ident, arm, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(f"""[robot]\nurdf = "{arm.urdf}"\nlocked = {{ shoulder = 0.0 }}\n[logs]\nfit = ["{arm.train}"]\n""")
    ran = ident("check", study, "--json")
    assert ran.code == 0, ran.err
    assert ran.json["joints"] == ["slide", "elbow", "wrist"]
    assert "(shoulder) are not used: q2, tau2" in ran.err


def test_too_many_joints(fit, arm, tmp_path):
    path = write_csv(tmp_path / "many.csv", arm.table | {"q5": arm.table["q1"]})
    refused(fit(path), DATA, r"the robot has 4 joints, but the log has positions of 5", r"too many: q5")


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ('q1 = "slide_mm"', r"unknown column of log .*train\.csv in \[columns\] q1 = 'slide_mm'.*Known: .*q1"),
        ('qq1 = "q1"', r"unknown quantity in \[columns\] 'qq1'; did you mean 'q1'"),
    ],
)
def test_unknown_column(ident, arm, tmp_path, mapping, message):
    study = tmp_path / "study.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\n[logs]\nfit = ["{arm.train}"]\n[columns]\n{mapping}\n')
    refused(ident("fit", study), USAGE, message)


def test_validation_log_with_other_names(ident, arm, tmp_path):
    table = {"slide" if name == "q1" else name: column for name, column in arm.table.items()}
    train = write_csv(tmp_path / "own_names.csv", table)
    study = tmp_path / "study.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\n[logs]\nfit = ["{train}"]\n[columns]\nq1 = "slide"\n')
    message = r"unknown column of log .*test\.csv in \[columns\] q1 = 'slide'.*validation logs included: rename"
    refused(ident("fit", study, "--validate", arm.test), USAGE, message)


# --- values --------------------------------------------------------------------------------------------------------------------


def test_nan_block_is_refused_and_can_be_a_gap(fit, arm, tmp_path):
    hole = arm.table["q2"].astype(object)
    hole[400:500] = None
    path = write_csv(tmp_path / "hole.csv", arm.table | {"q2": hole})
    refused(fit(path), DATA, r"hole\.csv: column 'q2' has no number in 100 of 1600 rows \(data rows 401-500\)", r"--missing gap")
    ran = fit(path, "--missing", "gap")
    assert ran.code == 0
    assert "left out as a gap" in " ".join(ran.out.split())


def test_nan_in_a_torque_leaves_those_rows_out(fit, arm, tmp_path):
    hole = arm.table["tau2"].astype(object)
    hole[400:500] = "nan"
    ran = fit(write_csv(tmp_path / "hole.csv", arm.table | {"tau2": hole}))
    assert ran.code == 0
    assert "tau2" in ran.out or "shoulder" in ran.out.split("parameter")[0]


def test_text_in_a_number(fit, arm, tmp_path):
    spoiled = arm.table["tau2"].astype(object)
    spoiled[700] = "oops"
    path = write_csv(tmp_path / "text.csv", arm.table | {"tau2": spoiled})
    refused(fit(path), DATA, r"text\.csv: column 'tau2', line 702 \(data row 701\): 'oops' is not a number")


@pytest.mark.parametrize("kind", ["step back", "shuffled"])
def test_time_that_is_not_monotonic(fit, arm, tmp_path, kind):
    if kind == "shuffled":
        order = np.random.default_rng(0).permutation(len(arm.table["t"]))
        table = {k: v[order] for k, v in arm.table.items()}
    else:
        t = arm.table["t"].copy()
        t[500] = t[400]
        table = arm.table | {"t": t}
    ran = fit(write_csv(tmp_path / "time.csv", table))
    refused(ran, DATA, r"time\.csv: time runs backwards at data row \d+ \(.* s, then .* s\), in \d+ places?\. Sort or cut the log")


def test_repeated_time_is_said(fit, arm, tmp_path):
    t = arm.table["t"].copy()
    t[501:503] = t[500]
    ran = fit(write_csv(tmp_path / "repeat.csv", arm.table | {"t": t}))
    assert ran.code == 0
    assert re.search(r"2 rows repeat the time stamp before \(data rows 502-503\)", " ".join(ran.out.split()))


@pytest.mark.parametrize("suffix", ["", "_rad"])
def test_degrees_labelled_as_radians_are_warned_of(fit, arm, tmp_path, suffix):
    table = {(k + suffix if k == "q2" else k): (np.degrees(v) if k == "q2" else v) for k, v in arm.table.items()}
    path = write_csv(tmp_path / "degrees.csv", table)
    ran = fit(path)
    assert ran.code == 0
    assert re.search(r"audit: shoulder: Looks like degrees, not rad.*name the column q2_deg", " ".join(ran.out.split()))
    ran = fit(path, "--json")
    assert any("shoulder" in w and "degrees" in w for w in ran.json["warnings"])


def test_degrees_labelled_as_degrees_are_converted(fit, arm, tmp_path):
    turned = {k + "_deg": np.degrees(v) for k, v in arm.table.items() if k in ("q2", "q3", "q4")}
    table = {k: v for k, v in arm.table.items() if k + "_deg" not in turned} | turned
    given, plain = (fit(path, "--json") for path in (write_csv(tmp_path / "degrees.csv", table), arm.train))
    assert [p["value"] for p in given.json["parameters"]] == pytest.approx([p["value"] for p in plain.json["parameters"]], rel=1e-9)
    assert not any("degrees" in w for w in given.json["warnings"])


# --- motion --------------------------------------------------------------------------------------------------------------------


def test_zero_motion(fit, arm, tmp_path):
    table = {k: v if k == "t" else np.full_like(v, 0.3) for k, v in arm.table.items()}
    ran = fit(write_csv(tmp_path / "still.csv", table))
    assert ran.code == DATA
    assert "ident fit: log still: no joint moves" in ran.err
    assert "No joint moves" in ran.out  # the audit is told before the error


def test_one_joint_never_moved(fit, arm, tmp_path):
    table = arm.table | {"q3": np.full_like(arm.table["q3"], 0.3)}
    ran = fit(write_csv(tmp_path / "held.csv", table), "--json", "--validate", arm.test)
    assert ran.code == 0
    assert ran.json["status"]["code"] == "rank_deficient"
    assert "Fv_elbow" in ran.json["status"]["text"]
    assert any("elbow" in w and "ever moved" in w for w in ran.json["warnings"])
    assert "Fv_elbow" in ran.json["not_determined"]
    assert ran.json["torque_error"]["fit"]["relative"][2] is None


def test_missing_torque_column(fit, arm, tmp_path):
    ran = fit(write_csv(tmp_path / "silent.csv", {k: v for k, v in arm.table.items() if k != "tau3"}), "--json")
    assert ran.code == 0
    assert any("no torque" in w.lower() and "elbow" in w for w in ran.json["warnings"])
    assert {"Fv_elbow", "Fc_elbow"} <= set(ran.json["not_determined"])


def test_torque_that_stays_at_zero_counts_as_not_logged(ident, fit, arm, tmp_path):
    dead = write_csv(tmp_path / "dead.csv", arm.table | {"tau3": np.zeros_like(arm.table["tau3"])})
    ran = fit(dead, "--json")
    assert ran.code == 0
    assert any("torque never changes while the joint moves: elbow" in w for w in ran.json["warnings"])
    assert {"Fv_elbow", "Fc_elbow"} <= set(ran.json["not_determined"])
    checked = ident("check", "--urdf", arm.urdf, "--log", dead, *FRICTION)
    assert checked.code == 0, checked.err
    assert "joint elbow: no usable torque row" in checked.out
    none = write_csv(tmp_path / "none.csv", {k: 0 * v if k.startswith("tau") else v for k, v in arm.table.items()})
    for command in ("fit", "check"):
        ran = ident(command, "--urdf", arm.urdf, "--log", none, *FRICTION)
        assert ran.code == DATA
        assert re.search(r"log none: holds no torque.* zero in every row", ran.err), ran.err


@pytest.mark.parametrize("joint", range(4))
def test_a_torque_of_the_opposite_sign_is_named(ident, fit, arm, tmp_path, joint):
    turned = write_csv(tmp_path / "turned.csv", arm.table | {f"tau{joint + 1}": -arm.table[f"tau{joint + 1}"]})
    ran = fit(turned, "--json")
    assert ran.code == 0
    # Of the last joint, whose link can be mirrored, the position may be what is reversed.
    shared = [w for w in ran.json["warnings"] if f"torque of {JOINTS[joint]} seems to have the opposite sign" in w]
    assert len(shared) == 1, ran.json["warnings"]
    assert ("these data cannot distinguish them" in shared[0]) == (joint == 3)
    checked = ident("check", "--urdf", arm.urdf, "--log", turned, *FRICTION, "--json")
    assert any(f"torque of {JOINTS[joint]} seems to have the opposite sign" in w for w in checked.json["warnings"])


def test_torque_column_by_another_name(fit, arm, tmp_path):
    named = {("torque_3" if k == "tau3" else k): v for k, v in arm.table.items()}
    ran = fit(write_csv(tmp_path / "named.csv", named), "--json")
    assert ran.code == 0
    assert any("for elbow; did you mean 'torque_3'?" in w and 'tau3 = "torque_3"' in w for w in ran.json["warnings"])
    named = {(f"effort_{JOINTS[int(k[3:]) - 1]}" if k.startswith("tau") else k): v for k, v in arm.table.items()}
    ran = fit(write_csv(tmp_path / "efforts.csv", named))
    assert ran.code == DATA
    assert re.search(r"did you mean 'effort_slide', .*\[columns\] of a study file: tau1 = \"effort_slide\", tau2", ran.err), ran.err


def test_log_that_is_too_short(fit, arm, tmp_path):
    ran = fit(write_csv(tmp_path / "short.csv", {k: v[:20] for k, v in arm.table.items()}))
    assert ran.code == DATA
    assert "too few to differentiate" in ran.err


def test_part_held_out_too_short_is_a_warning_and_fails_the_gate(fit, arm, tmp_path):
    path = write_csv(tmp_path / "short.csv", {k: v[:640] for k, v in arm.table.items()})
    ran = fit(path, "--json", "--max-error", "0.5")
    assert ran.code == 1
    assert "gate: --max-error" in ran.err
    assert ran.json["torque_error"]["heldout"]["relative_all"] is None
    assert any("no error on held-out data" in w for w in ran.json["warnings"])


# --- drive ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ("K = [[1, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]]", r"\[drive\] K is singular: .*Give an invertible K"),
        ("K = [[1, 0], [0, 1]]", r"\[drive\] K describes 2 joints, but the robot has 4"),
        ("K = [[1, 0], [0, 1, 2]]", r"\[drive\] K must be a square matrix"),
        ("ratio = [1, 2, 3]", r"\[drive\] ratio describes 3 joints, but the robot has 4"),
        ("ratio = [1, 0, 3, 4]", r"\[drive\] ratio holds a value that is zero"),
        ("ratoi = [1, 1, 1, 1]", r"'ratoi'; did you mean 'ratio'"),
    ],
)
def test_unusable_transmission(fit, arm, tmp_path, drive, message):
    path = tmp_path / "drive.toml"
    path.write_text(f"[drive]\n{drive}\n")
    refused(fit(arm.train, "--drive", path), USAGE, message)


# --- names ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--effects", "viscuos"), r"unknown effect 'viscuos'; did you mean 'viscous'"),
        (("--method", "wlss"), r"unknown method 'wlss'; did you mean 'wls'"),
        (("--cutoff", "-3"), r"cutoff_hz must be a positive number"),
        (("--cutoff", "1000"), r"cutoff_hz = 1000 must be below half the sample rate \(100 Hz\)"),
        (("--drive", "nowhere.toml"), r"drive file nowhere\.toml: no such file"),
        (("--robot", "ur5"), r"a robot by name and a URDF are both given"),
        (("--wrong",), r"unrecognized arguments: --wrong$"),
        (("--metod", "ls"), r"unrecognized arguments: --metod.* \(for --metod this command has --method; ident fit --help .*\)"),
        (("--held", "x.csv"), r"for --held this command has --validate or --log;"),
    ],
)
def test_wrong_flags(fit, arm, flags, message):
    refused(fit(arm.train, *flags), USAGE, message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), r"COMMAND"),
        (("fti",), r"invalid choice: 'fti'"),
        (("fit",), r"no study file and no robot given"),
        (("fit", "none.toml"), r"study none\.toml: no such file"),
        (("fit", "--robot", "puma560"), r"no log to fit is given"),
        (("base", "--robot", "pumaa"), r"unknown robot 'pumaa'; did you mean 'puma560'"),
        (("validate", "--fit", "none.json", "--log", "a.csv"), r"none\.json: no such file"),
        (("judge",), r"give either a saved fit"),
        (("judge", "--robot", "puma560", "--table", "9"), r"unknown published table of puma560 '9'"),
        (("export", "none.json", "out.urdf"), r"none\.json: no such file"),
    ],
)
def test_wrong_usage(ident, arguments, message):
    refused(ident(*arguments), USAGE, message)


# --- URDF ----------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot name='x'><link name='a'>", r"robot\.urdf: cannot be parsed: .*line 1"),
        ("hello", r"robot\.urdf: cannot be parsed"),
        ("<html/>", r"root element is <html>, not <robot>"),
        (
            "<robot name='x'><link name='a'/><joint name='j' type='revolute'><parent link='a'/><child link='b'/></joint></robot>",
            r"joint 'j': its child link 'b' is not declared",
        ),
    ],
)
def test_urdf_that_does_not_parse(ident, arm, tmp_path, text, message):
    (tmp_path / "robot.urdf").write_text(text)
    refused(ident("fit", "--urdf", tmp_path / "robot.urdf", "--log", arm.train), USAGE, message)


def test_urdf_that_is_not_there(ident, arm):
    refused(ident("fit", "--urdf", "nowhere.urdf", "--log", arm.train), USAGE, r"URDF nowhere\.urdf: no such file")


def test_urdf_without_inertials_is_fine_for_fitting_and_said(ident, arm, tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(re.sub(r"<inertial>.*?</inertial>", "", ARM, flags=re.DOTALL))
    bare, whole = (ident("fit", "--urdf", urdf, "--log", arm.train, *FRICTION, "--json", "--quiet") for urdf in (path, arm.urdf))
    assert bare.code == 0
    assert re.search(r"no <inertial> .*fine for fitting", bare.err)
    assert [p["value"] for p in bare.json["parameters"]] == pytest.approx([p["value"] for p in whole.json["parameters"]], rel=1e-9)
    refused(ident("simulate", "--urdf", path, "--log", tmp_path / "x.csv"), USAGE, r"no inertials to simulate with")


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ('value="4"', 'value="-4"', r"link 'upper': its mass is -4 kg"),
        ('ixx="0.02"', 'ixx="-0.5"', r"link 'upper': its inertia about some axis is -0\.5"),
    ],
)
def test_inertials_of_no_body_stop_a_simulation_and_no_fit(ident, arm, tmp_path, right, wrong, message):
    path = tmp_path / "odd.urdf"
    path.write_text(ARM.replace(right, wrong))
    refused(ident("simulate", "--urdf", path, "--log", tmp_path / "x.csv"), USAGE, r"cannot be simulated: " + message, r"--fit")
    for command in ("fit", "check"):
        ran = ident(command, "--urdf", path, "--log", arm.train, *FRICTION, "--json", "--quiet")
        assert ran.code == 0, ran.err
        assert sum(bool(re.search(message, w)) for w in ran.json["warnings"]) == 1


def test_what_rounding_leaves_of_no_inertia_is_no_fault(ident, arm, tmp_path):
    """Massless frames of a humanoid's URDF were said to be no bodies."""
    path = tmp_path / "frame.urdf"
    inertia = '<inertia ixx="0" iyy="4e-18" izz="-1e-20" ixy="2e-20" ixz="0" iyz="0"/>'
    frame = f'<link name="tip"><inertial><mass value="0"/>{inertia}</inertial></link>'
    frame += '<joint name="weld" type="fixed"><parent link="hand"/><child link="tip"/></joint>'
    path.write_text(ARM.replace("</robot>", frame + "</robot>"))
    assert ident("fit", "--urdf", path, "--log", arm.train, *FRICTION, "--json", "--quiet").json["warnings"] == []


def test_a_hand_without_inertial_cannot_be_simulated(ident, tmp_path):
    path = tmp_path / "light.urdf"
    path.write_text(re.sub(r'(<link name="hand">).*?</inertial>', r"\1", ARM, flags=re.DOTALL))
    refused(ident("simulate", "--urdf", path, "--log", tmp_path / "x.csv"), USAGE, r"motion of joint 'wrist'.*<inertial> of link 'hand'")


@pytest.mark.parametrize("command", ["validate", "payload", "excite", "simulate"])
def test_flags_beside_a_saved_fit_that_would_not_be_used(ident, arm, saved_fit, tmp_path, command):
    """A robot's gravity or drive was passed over without a word."""
    for flag in (("--gravity", 0, 9.81, 0), ("--urdf", arm.urdf), ("--drive", tmp_path / "drive.toml")):
        new = tmp_path / "new.csv"
        log = ("--trajectory", new) if command == "excite" else ("--log", new if command == "simulate" else arm.test)
        refused(ident(command, "--fit", saved_fit, *log, *flag), USAGE, rf"--fit brings its own robot.*leave out {flag[0]}")


def test_a_floating_base_in_a_fit_says_what_to_do(ident, arm, tmp_path):
    """It was said that positions have another shape."""
    study = tmp_path / "free.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\nfloating_base = true\n[logs]\nfit = ["{arm.train}"]\n')
    for command in ("fit", "diagnose"):
        refused(ident(command, study), USAGE, r"floating base, whose motion.*with the base fixed: leave out \[robot\] floating_base")


def test_fit_that_is_damaged(ident, arm, saved_fit, tmp_path):
    kept = json.loads(saved_fit.read_text())
    for name, content in (
        ("text", "hello"),
        ("other", "{}"),
        ("damaged", json.dumps({k: v for k, v in kept.items() if k != "covariance"})),
    ):
        path = tmp_path / f"{name}.json"
        path.write_text(content)
        refused(ident("validate", "--fit", path, "--log", arm.test), USAGE, rf"fit .*{name}\.json: is (not JSON|not a saved fit|damaged)")
        refused(ident("judge", path), USAGE, rf"{name}\.json")


# --- output --------------------------------------------------------------------------------------------------------------------


def test_output_folder_that_exists(fit, arm, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "fit.json").write_text("mine")
    refused(fit(arm.train, "--out", folder), USAGE, r"--out .*out exists and is not empty; nothing was written", r"--force")
    assert (folder / "fit.json").read_text() == "mine"
    assert [p.name for p in folder.iterdir()] == ["fit.json"]
    ran = fit(arm.train, "--out", folder, "--force")
    assert ran.code == 0
    assert (folder / "fit.json").read_text().startswith("{")


def test_output_folder_that_is_a_file(fit, arm, tmp_path):
    (tmp_path / "out").write_text("x")
    refused(fit(arm.train, "--out", tmp_path / "out"), USAGE, r"out is a file; give a folder")


def test_failed_fit_leaves_no_half_written_files(fit, tmp_path):
    folder = tmp_path / "out"
    assert fit(tmp_path / "none.csv", "--out", folder).code == DATA
    assert not folder.exists() or not any(Path(folder).iterdir())


# --- options that are given again ------------------------------------------------------------------------------------------------


def test_names_given_again_add_up(ident, arm):
    once, twice = (
        ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--quiet", "--json", *effects)
        for effects in (("--effects", "viscous", "coulomb"), ("--effects", "viscous", "--effects", "coulomb"))
    )
    assert json.loads(once.out)["parameters"] == json.loads(twice.out)["parameters"]
