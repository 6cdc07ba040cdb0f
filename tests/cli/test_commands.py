"""The commands on good input: JSON, artefacts, gates, and one command reading what another one wrote."""

from __future__ import annotations

import json
import os
import subprocess
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pytest
from command_line import FRICTION, JOINTS, python

COMMON = {"schema", "ident_version", "inputs", "created", "warnings"}


@pytest.fixture
def fit(ident, arm):
    """`ident fit` of the arm's own log."""

    def run(*more):
        return ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--validate", arm.test, *FRICTION, "--quiet", *more)

    return run


# --- JSON ----------------------------------------------------------------------------------------------------------------------


def test_fit_json(fit, arm):
    ran = fit("--json")
    assert ran.code == 0
    found = ran.json
    assert set(found) >= COMMON | {"method", "status", "parameters", "covariance", "rank", "condition", "samples", "torque_error"}
    assert found["schema"] == "ident.fit/1"
    assert found["method"] == "wls"
    assert set(found["status"]) >= {"code", "text"}
    assert found["rank"] == len(found["parameters"]) == 14 + 4 + 4
    for p in found["parameters"]:
        assert set(p) >= {"name", "value", "std", "unit", "expression", "effect", "joint"}
    assert np.shape(found["covariance"]) == (22, 22)
    for part in ("fit", "heldout"):
        error = found["torque_error"][part]
        assert len(error["rms"]) == len(error["relative"]) == 4
        assert 0 < error["relative_all"] < 0.01
    assert [i["path"] for i in found["inputs"]] == [str(arm.train), str(arm.test)]
    assert all(len(i["sha256"]) == 64 for i in found["inputs"])
    assert "torque error on the joint side" in ran.err  # people's text goes to standard error


def test_fit_finds_the_friction_that_made_the_log(fit):
    found = {p["name"]: p for p in fit("--json").json["parameters"]}
    truth = dict(zip((f"{kind}_{j}" for kind in ("Fv", "Fc") for j in JOINTS), [20, 1, 0.5, 0.1, 10, 2, 1, 0.2], strict=True))
    for name, value in truth.items():
        assert found[name]["value"] == pytest.approx(value, rel=0.01), name
    assert found["m_slide"]["value"] == pytest.approx(14.8, rel=1e-3)
    assert found["m_slide"]["expression"] == "m_slide + m_shoulder + m_elbow + m_wrist"


def test_validate_json(ident, arm, saved_fit):
    ran = ident("validate", "--fit", saved_fit, "--validate", arm.test, "--json", "--quiet", "--no-replay")
    assert ran.code == 0
    assert set(ran.json) >= COMMON | {"torque_error"}
    assert ran.json["schema"] == "ident.validation/1"
    assert ran.json["torque_error"]["heldout"]["relative_all"] < 0.01
    assert ran.json["replay"] is None


def test_base_json(ident, arm):
    ran = ident("base", "--urdf", arm.urdf, "--json")
    assert ran.code == 0
    assert set(ran.json) >= COMMON | {"count", "parameters", "unidentifiable", "matrix"}
    assert ran.json["schema"] == "ident.base/1"
    assert ran.json["count"] == len(ran.json["parameters"]) == 14
    assert np.shape(ran.json["matrix"]) == (14, 40)
    assert all({"parameter", "why"} <= set(u) for u in ran.json["unidentifiable"])
    assert "14 base parameters of 40" in ran.err


def test_a_saved_fit_judged_by_what_it_was_fitted_to_says_so(ident, arm, saved_fit):
    """The error on fitted data was printed as that of held-out data."""
    assert [i.get("use") for i in json.loads(saved_fit.read_text())["inputs"]] == [None, "held_out"]
    for command in (("validate", "--fit", saved_fit, "--no-replay", "--validate"), ("compare", saved_fit, saved_fit, "--log")):
        seen = ident(*command, arm.train, "--json", "--quiet")
        assert any("the fit has seen" in w and "not that of held-out data" in w for w in seen.json["warnings"]), seen.json["warnings"]
        held = ident(*command, arm.test, "--json", "--quiet")
        assert not any("the fit has seen" in w for w in held.json["warnings"])
    assert "warning: the fit has seen" in ident("validate", "--fit", saved_fit, "--no-replay", "--validate", arm.train, "--quiet").out


@pytest.mark.parametrize("subject", ["fit", "table"])
def test_judge_json(ident, saved_fit, subject):
    ran = ident("judge", saved_fit, "--json") if subject == "fit" else ident("judge", "--robot", "puma560", "--table", "1", "--json")
    assert ran.code == 0
    assert set(ran.json) >= COMMON | {
        "possible",
        "consistent",
        "min_eigenvalue",
        "worst_configuration",
        "method",
        "certified",
        "violated_links",
    }
    assert ran.json["schema"] == "ident.judgement/1"
    if subject == "fit":
        assert ran.json["possible"] is True
        assert ran.json["min_eigenvalue"] > 0
    else:
        assert ran.json["min_eigenvalue"] < 0.1


def test_check_json(ident, arm):
    ran = ident("check", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--json", "--quiet")
    assert ran.code == 0
    assert ran.json["schema"] == "ident.check/1"
    assert ran.json["joints"] == list(JOINTS)
    assert ran.json["problem"]["rank"] == 22
    assert "joints in the order of the log: slide, shoulder, elbow, wrist" in ran.err


# --- text for people -----------------------------------------------------------------------------------------------------------


def test_lines_fit_a_wide_terminal(ident, fit):
    assert max(map(len, fit().out.splitlines())) <= 160


def test_expressions_are_cut_at_a_whole_term():
    from ident.estimate.summary import shortened

    assert shortened("Izz_a + 0.5 m_b", 15) == "Izz_a + 0.5 m_b"
    assert shortened("Izz_a + 0.5 m_b - 0.25 m_c", 20) == "Izz_a + 0.5 m_b …"
    assert shortened("a_long_name + 0.5 m_b", 5) == "a_long_name …"


@pytest.mark.parametrize("command", ["demo", "check", "base", "fit", "validate", "judge", "simulate", "export"])
def test_help(ident, command):
    ran = ident(command, "--help")
    assert ran.code == 0
    assert ran.out.startswith(f"usage: ident {command}")
    for flag in ("--json", "--out", "--force"):
        assert flag in ran.out


def test_fit_help_lists_methods_and_effects(ident):
    from ident.effects.registry import effect_names
    from ident.estimators import estimator_types

    text = ident("fit", "--help").out
    for name in estimator_types():
        assert f"\n  {name} " in text
    for name in effect_names():
        assert name in text or name == "rigid_body"


# --- artefacts -----------------------------------------------------------------------------------------------------------------


def test_out_keeps_the_fit_and_nothing_temporary(saved_fit):
    assert sorted(p.name for p in saved_fit.parent.iterdir()) == ["fit.json", "fit.txt"]
    kept = json.loads(saved_fit.read_text())
    assert kept["schema"] == "ident.fit/1"
    assert "m_slide" in (saved_fit.parent / "fit.txt").read_text()


def test_artefacts_are_kept_when_the_reader_goes_away(arm, tmp_path):
    root, folder = Path(__file__).resolve().parents[2], tmp_path / "result"
    command = [*python(), "-m", "ident", "fit", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--quiet", "--out", folder]
    with subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(root)}) as running:
        assert running.stdout is not None
        running.stdout.close()
    assert running.returncode == 0
    assert (folder / "fit.json").exists()


def test_out_is_not_overwritten(ident, arm, saved_fit):
    before = saved_fit.read_bytes()
    ran = ident("base", "--urdf", arm.urdf, "--out", saved_fit.parent)
    assert ran.code == 2
    assert "--force" in ran.err
    assert saved_fit.read_bytes() == before


def test_a_saved_fit_predicts_as_the_fit_did(ident, arm, fit, saved_fit):
    again = ident("validate", "--fit", saved_fit, "--validate", arm.test, "--no-replay", "--json", "--quiet").json["torque_error"]
    first = fit("--json").json["torque_error"]
    assert again["heldout"]["relative"] == pytest.approx(first["heldout"]["relative"], rel=1e-9)
    assert again["fit"]["relative"] == pytest.approx(first["fit"]["relative"], rel=1e-9)


def test_a_saved_fit_is_judged_and_exported(ident, arm, tmp_path):
    folder = tmp_path / "result"
    flags = ("--urdf", arm.urdf, "--log", arm.train, "--method", "physical", *FRICTION, "--quiet")
    assert ident("fit", *flags, "--out", folder).code == 0
    assert ident("judge", folder / "fit.json", "--strict").code == 0
    target = tmp_path / "identified.urdf"
    ran = ident("export", folder / "fit.json", target)
    assert ran.code == 0, ran.err
    robot = ident("base", "--urdf", target, "--json")
    assert robot.json["count"] == 14
    ran = ident("export", folder / "fit.json", target)
    assert ran.code == 2
    assert "exists" in ran.err


# --- gates ---------------------------------------------------------------------------------------------------------------------


def test_fit_gate(fit):
    assert fit("--max-error", "0.05").code == 0
    ran = fit("--max-error", "1e-6", "--json")
    assert ran.code == 1
    assert "gate: relative held-out error" in ran.err
    assert ran.json["rank"] == 22  # the result is there all the same


def test_validate_gate(ident, arm, saved_fit):
    flags = ("validate", "--fit", saved_fit, "--validate", arm.test, "--no-replay", "--quiet", "--max-error")
    assert ident(*flags, "0.05").code == 0
    ran = ident(*flags, "1e-6")
    assert ran.code == 1
    assert "gate: relative error" in ran.err


def test_judge_gate(ident):
    flags = ("judge", "--robot", "puma560", "--strict", "--table")
    verdicts = {table: ident(*flags, table, "--json") for table in ("1", "2", "3")}
    assert {t: r.code for t, r in verdicts.items()} == {t: 0 if r.json["possible"] else 1 for t, r in verdicts.items()}
    assert {r.code for r in verdicts.values()} == {0, 1}


def test_check_gate(ident, arm, tmp_path):
    from command_line import write_csv

    flags = ("check", "--urdf", arm.urdf, *FRICTION, "--quiet", "--strict", "--log")
    assert ident(*flags, arm.train).code == 0
    held = write_csv(tmp_path / "held.csv", arm.table | {"q3": np.full_like(arm.table["q3"], 0.3)})
    assert ident(*flags, held).code == 1


# --- base parameters of robots that come by name ---------------------------------------------------------------------------------


def example_robots():
    """Skips where example-robot-data is not installed."""
    try:
        distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")


@pytest.mark.parametrize(
    ("name", "more", "count"),
    [
        ("puma560", (), 36),
        ("puma560", ("--rotor-inertia",), 40),  # two of six rotors join the links that they turn
        ("scara", (), 8),
        ("palletiser", (), 32),
        ("panda", (), 48),  # 43 of the arm and 5 of the gripper
        ("ur5", (), 36),
        ("ur5", ("--gravity", "0", "0", "0"), 34),
        ("ur5", ("--floating-base",), 52),
    ],
)
def test_base_by_name(ident, name, more, count):
    if name in ("panda", "ur5"):
        example_robots()
    ran = ident("base", "--robot", name, *more, "--json")
    assert ran.code == 0, ran.err
    assert ran.json["count"] == len(ran.json["parameters"]) == count
    matrix = np.array(ran.json["matrix"])
    assert np.linalg.matrix_rank(matrix) == count
    assert matrix.shape == (count, len(ran.json["columns"]))
    rotors = [c for c in ran.json["columns"] if c.startswith("Ia_")]
    assert len(rotors) == (6 if "--rotor-inertia" in more else 0)


def test_gravity_of_a_robot_on_a_wall(ident, arm, tmp_path):
    """Only a study file could tell it."""
    from ident import Robot

    robot = Robot.from_urdf(arm.urdf)
    wall = (0.0, 9.81, 0.0)
    header = arm.train.read_text().splitlines()[0]
    recorded = np.loadtxt(arm.train, delimiter=",", skiprows=1)
    names = header.split(",")
    q = recorded[:, [names.index(f"q{j}") for j in range(1, 5)]]
    still = np.zeros_like(q)
    torque = [
        model.inverse_dynamics(q, still, still, robot.nominal) for model in (robot.rigid_body(), robot.with_gravity(wall).rigid_body())
    ]
    for j in range(4):
        recorded[:, names.index(f"tau{j + 1}")] += torque[1][:, j] - torque[0][:, j]
    log = tmp_path / "wall.csv"
    np.savetxt(log, recorded, delimiter=",", header=header, comments="")
    command = ("fit", "--urdf", arm.urdf, "--log", log, *FRICTION, "--quiet", "--json")
    told = ident(*command)
    assert "--gravity 0 9.81 0" in " ".join(told.err.split())
    fitted = ident(*command, "--gravity", *wall).json
    assert fitted["torque_error"]["heldout"]["relative_all"] < 0.01 < told.json["torque_error"]["heldout"]["relative_all"]
    ran = ident("payload", "--fit", "fit.json", "--log", log, "--gravity", *wall)
    assert (ran.code, "leave out" in ran.err) == (2, True)


def test_base_with_locked_joints(ident, tmp_path):
    example_robots()
    study = tmp_path / "arm.toml"
    study.write_text('[robot]\nname = "panda"\nlocked = { panda_finger_joint1 = 0.0 }\n')
    ran = ident("base", study, "--json")
    assert ran.json["count"] == 43


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ((), 2, "no study file and no robot given"),
        (("--robot", "scarra"), 2, "did you mean 'scara'"),
        (("--robot", "scara", "--gravity", "0", "0"), 2, "expected 3 arguments"),
        (("--robot", "scara", "--principal", "none.csv"), 3, "none.csv: no such file"),
        (("--robot", "scara", "--urdf", "scara.urdf"), 2, "give one of them"),
    ],
)
def test_base_refusals(ident, arguments, code, message):
    ran = ident("base", *arguments)
    assert ran.code == code
    assert ran.out == ""
    assert message in ran.err


# --- the whole way -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["palletiser", "scara"])
def test_simulate_fit_validate(ident, tmp_path, name):
    log, folder = tmp_path / "log.csv", tmp_path / "result"
    made = ident("simulate", "--robot", name, "--log", log, "--seconds", "8", "--rate", "200", "--noise", "0.001", "--quiet", "--json")
    assert made.code == 0, made.err
    ran = ident("fit", "--robot", name, "--log", log, "--out", folder, "--quiet", "--json", "--max-error", "0.1")
    assert ran.code == 0, ran.err
    ran = ident("validate", "--fit", folder / "fit.json", "--log", log, "--quiet", "--json")
    assert ran.code == 0, ran.err
    assert ran.json["torque_error"]["heldout"]["relative_all"] < 0.1
    replay = ran.json["replay"]
    assert replay is not None
    assert ran.json["nominal"] is not None
    again = ident("simulate", "--robot", name, "--log", log)
    assert again.code == 2
    assert "exists; nothing was simulated" in again.err


def test_out_keeps_the_file_that_was_made(ident, tmp_path, monkeypatch):
    """The log or trajectory is an artefact as any other: in --out, unless its own flag says where."""
    monkeypatch.chdir(tmp_path)
    robot, short = ("--robot", "double_pendulum"), ("--seconds", "2", "--quiet", "--json")
    for command, flag, name, key, more in (
        ("simulate", "--log", "simulated.csv", "log", ()),
        ("excite", "--trajectory", "excitation.csv", "trajectory", ("--starts", "1")),
    ):
        made = ident(command, *robot, *short, *more, "--out", f"new/{command}")
        assert made.code == 0, made.err
        assert made.json[key] == str(Path("new") / command / name)
        summary = {"simulate": "simulation.json", "excite": "excitation.json"}[command]
        kept = {p.name for p in (tmp_path / "new" / command).iterdir()}
        assert kept - {"report.html", "swept.html"} == {
            name,
            summary,
        }  # a report and a page of the motion, where the drawing library is installed
        assert not (tmp_path / name).exists()
        before = (tmp_path / "new" / command / name).read_bytes()
        again = ident(command, *robot, *short, *more, "--out", f"new/{command}")
        assert (again.code, "--force" in again.err) == (2, True)
        over = ident(command, *robot, *short, *more, "--seed", "1", "--out", f"new/{command}", "--force")
        assert over.code == 0, over.err
        assert (tmp_path / "new" / command / name).read_bytes() != before
        said = ident(command, *robot, *short, *more, "--out", f"other/{command}", flag, f"{command}.csv")
        assert said.code == 0, said.err
        assert said.json[key] == f"{command}.csv"
        assert (tmp_path / f"{command}.csv").is_file()
        assert {p.name for p in (tmp_path / "other" / command).iterdir()} - {"report.html", "swept.html"} == {summary}
        alone = ident(command, *robot, *short, *more)
        assert (alone.code, alone.json[key]) == (0, name)


def test_results_without_logs_tell_what_they_were_made_of(ident, arm, saved_fit, tmp_path):
    drive = tmp_path / "drive.toml"
    drive.write_text("ratio = [100, 100, 50, 50]\n")
    robot = ("--urdf", arm.urdf, "--drive", drive)
    simulated = ("simulate", "--seconds", "2", "--quiet", "--log")
    for command in (("base",), (*simulated, tmp_path / "a.csv")):
        ran = ident(*command, *robot, "--json")
        assert [i["path"] for i in ran.json["inputs"]] == [str(arm.urdf), str(drive)], ran.err
        assert all(len(i["sha256"]) == 64 for i in ran.json["inputs"])
    ran = ident(*simulated, tmp_path / "b.csv", "--fit", saved_fit, "--json")
    assert [i["path"] for i in ran.json["inputs"]] == [str(saved_fit)]
    assert ident("base", "--robot", "double_pendulum", "--json").json["inputs"] == []


def test_logs_named_twice_are_said(ident, arm, tmp_path):
    same = tmp_path / "same.csv"
    same.write_bytes(arm.train.read_bytes())
    fit = ("fit", "--urdf", arm.urdf, *FRICTION, "--json", "--quiet", "--log")
    twice = ident(*fit, arm.train, arm.train)
    assert any(w.endswith("train.csv is named more than once, but read once.") for w in twice.json["warnings"])
    copied = ident(*fit, arm.train, same)
    assert any("same.csv has the same content as" in w and "count twice" in w for w in copied.json["warnings"])
    assert not any("twice" in w or "more than once" in w for w in ident(*fit, arm.train, arm.test).json["warnings"])


def test_what_is_missing_is_said_as_it_is(ident, arm, saved_fit, tmp_path):
    ran = ident("validate", "--fit", saved_fit)
    assert ran.code == 2
    assert all(flag in ran.err for flag in ("--validate", "--log"))
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "fit.json").write_bytes(Path(saved_fit).read_bytes())
    ran = ident("report", folder, "-o", tmp_path / "r.html")
    assert ran.code == 0, ran.err
    assert (tmp_path / "r.html").read_text().startswith("<!DOCTYPE html>")
    ran = ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--effects", "bogus")
    assert "unknown effect 'bogus'. Known:" in ran.err


def test_simulate_says_what_it_has_no_value_for(ident, tmp_path):
    log = tmp_path / "log.csv"
    made = ident("simulate", "--robot", "double_pendulum", "--log", log, "--effects", "offset", "--seconds", "1", "--quiet")
    assert made.code == 0, made.err
    assert "no value is known for offset of double_pendulum: simulated as zero" in made.err


def test_simulate_says_which_limits_it_exceeds(ident, tmp_path):
    """A chain of many links whose drives are too weak to hold it: by the log itself, on standard output and in the result."""
    link = (
        '<inertial><origin xyz="0.1 0 0.1"/><mass value="1"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>'
    )
    count = 8
    links = "".join(f'<link name="l{i}">{link}</link>' for i in range(1, count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="0.1 0 0.2" rpy="1.5708 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-1.5" upper="1.5" velocity="2" effort="20"/></joint>'
        for i in range(1, count + 1)
    )
    (tmp_path / "chain.urdf").write_text(f'<robot name="chain"><link name="l0"/>{links}{joints}</robot>')
    log = tmp_path / "chain.csv"
    ran = ident("simulate", "--urdf", tmp_path / "chain.urdf", "--seconds", "3", "--noise", "0", "--log", log, "--json", "--quiet")
    assert ran.code == 0, ran.err
    table = np.genfromtxt(log, delimiter=",", names=True)
    largest = {f"j{j}": np.abs(table[f"tau{j}"]).max() for j in range(1, count + 1)}
    said = {e["joint"]: e for e in ran.json["exceeds"] if e["kind"] == "effort"}
    assert {j for j, x in largest.items() if x > 22} <= set(said) <= {j for j, x in largest.items() if x > 18}
    assert said
    assert all(e["limit"] == 20 for e in said.values())
    assert "exceeds the effort limits of chain" in ran.err
    ran = ident("simulate", "--robot", "scara", "--seconds", "3", "--log", tmp_path / "s.csv", "--json", "--quiet")
    assert ran.json["exceeds"] == []
    assert "exceeds" not in ran.err


def test_simulated_torque_is_recorded_as_it_acts(ident, tmp_path):
    """Torque that a controller holds for a period acts half a period late; a record of what it asked for would look early."""
    from ident.effects.registry import make_effect
    from ident.logs.reading import read_logs
    from ident.problem.problem import Problem
    from ident.robots import load_robot, nominal_values
    from ident.signals import ZeroPhase

    log = tmp_path / "exact.csv"
    made = ident(
        "simulate", "--robot", "double_pendulum", "--log", log, "--seconds", "6", "--noise", "0", "--counts", "0", "--quiet", "--json"
    )
    assert made.code == 0, made.err
    robot = load_robot("double_pendulum")
    signals = ZeroPhase(cutoff_hz=20.0)(read_logs([log], robot=robot))
    delay = make_effect("delay")
    model = robot.rigid_body() + make_effect("rotor_inertia") + make_effect("viscous") + make_effect("coulomb")
    values = nominal_values(model)
    (block,) = signals.blocks(None)
    motion = Problem(model + delay, signals, reference=np.append(values, np.zeros(robot.n))).motion(block.samples)
    left = signals.tau - block.reduce(model.torque(motion, values))
    slope = block.reduce(np.einsum("Njj->Nj", delay.columns(motion, robot)))
    for j in range(robot.n):
        use = signals.valid[:, j] & np.isfinite(left[:, j])
        assert abs(slope[use, j] @ left[use, j] / (slope[use, j] @ slope[use, j])) < 1e-4


def test_python_m_ident():
    root = Path(__file__).resolve().parents[2]
    environment = os.environ | {"PYTHONPATH": str(root)}
    ran = subprocess.run([*python(), "-m", "ident", "--version"], capture_output=True, text=True, env=environment, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    from ident import __version__

    assert ran.stdout == f"ident {__version__}\n"
    ran = subprocess.run(
        [*python(), "-m", "ident", "fit", "--robot", "puma560", "--log", "no.csv"],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert (ran.returncode, ran.stdout) == (3, "")
    assert "no.csv: no such file" in ran.stderr


def test_import_is_light():
    """`import ident` must not pull in the heavy libraries: they are imported where they are used."""
    heavy = ("pinocchio", "pandas", "scipy", "matplotlib", "clarabel", "yourdfpy", "filterpy")
    code = f"import sys, ident, ident.cli; print([m for m in {heavy!r} if m in sys.modules])"
    root = Path(__file__).resolve().parents[2]
    ran = subprocess.run([*python(), "-c", code], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(root)}, check=True)
    assert ran.stdout.strip() == "[]"


@pytest.mark.slow
def test_demo(ident, tmp_path):
    ran = ident("demo", "--json", "--quiet", "--out", tmp_path / "demo")
    assert ran.code == 0
    found = ran.json
    assert found["fit"]["rank"] == 52
    assert found["fit"]["torque_error"]["heldout"]["relative_all"] < 0.01
    assert found["validation"]["replay"] is not None
    # 52 intervals of 95 %: fewer than 44 inside has a probability below 0.5 % even for independent ones.
    assert found["within_95"] >= 44
    assert (tmp_path / "demo" / "fit.json").exists()
    # The load as its source prints it: 1.6 kg at (-7, 7, 11) cm.
    assert abs(found["load"]["mass"] - 1.6) < 4 * found["load"]["mass_std"]
    assert max(abs(a - b) for a, b in zip(found["load"]["centre_of_mass"], (-0.07, 0.07, 0.11), strict=True)) < 1e-3
