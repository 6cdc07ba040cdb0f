"""`ident check` on recordings that name their channels otherwise, the study file it writes, and torques that are not what they seem."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from command_line import FRICTION, JOINTS, write_csv

from ident.errors import ConfigurationError


@pytest.fixture
def recorded(arm, tmp_path):
    """The arm's log as a recorder of another house would write it: counted from zero, milliseconds, a channel more."""
    table = {"Time": np.round(1000 * arm.table["t"])}
    for name, key in (("act_pos", "q"), ("act_force", "tau")):
        table |= {f"{name}_{j}": arm.table[f"{key}{j + 1}"] for j in range(4)}
    table |= {f"ref_pos_{j}": arm.table[f"q{j + 1}"] + 0.001 for j in range(4)}
    return write_csv(tmp_path / "recorded.csv", table | {"mode": 0 * arm.table["t"]})


def test_a_log_alone_is_described(ident, recorded):
    ran = ident("check", "--log", recorded, "--json")
    assert ran.code == 0, ran.err
    (log,) = ran.json["logs"]
    assert log["columns"]["q4"] == "act_pos_3"
    assert log["columns"]["tau1"] == "act_force_0"
    assert log["columns"]["t"] == {"column": "Time", "scale": 0.001, "offset": 0.0}
    assert log["reference"]["q_ref2"] == "ref_pos_1"
    assert log["ignored"] == ["mode"]
    assert "not used: mode" in ran.err


@pytest.mark.parametrize("named", [False, True])
def test_the_study_that_is_written_reads_the_log_again(ident, arm, recorded, tmp_path, named):
    study = tmp_path / "study.toml"
    robot = ("--urdf", arm.urdf) if named else ()
    ran = ident("check", *robot, "--log", recorded, "--write-study", study)
    assert ran.code == 0, ran.err
    written = tomllib.loads(study.read_text())
    assert written["columns"]["q1"] == "act_pos_0"
    again = ident("fit", study, *(() if named else ("--urdf", arm.urdf)), *FRICTION, "--json")
    plain = ident("fit", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--json")
    assert again.code == plain.code == 0, again.err
    values = [{p["name"]: p["value"] for p in ran.json["parameters"]} for ran in (again, plain)]
    assert values[0] == pytest.approx(values[1], rel=1e-6)
    refused = ident("check", *robot, "--log", recorded, "--write-study", study)
    assert refused.code == 2
    assert "exists" in refused.err


def test_every_torque_with_the_opposite_sign_is_said_first_and_stops_a_diagnosis(ident, arm, tmp_path):
    turned = write_csv(tmp_path / "turned.csv", {k: -v if k.startswith("tau") else v for k, v in arm.table.items()})
    for command in ("check", "fit"):
        ran = ident(command, "--urdf", arm.urdf, "--log", turned, *FRICTION, "--quiet")
        assert ran.code == 0, ran.err
        first = next(line for line in ran.out.splitlines() if line.startswith("warning"))
        assert "every torque seems to have the opposite sign" in first
        well = ident(command, "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--quiet")
        assert "opposite sign" not in well.out
    ran = ident("diagnose", "--urdf", arm.urdf, "--log", turned, *FRICTION, "--quiet")
    assert ran.code == 3
    assert "torque_sign = -1" in ran.err
    study = tmp_path / "study.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\n[drive]\ntorque_sign = -1\neffects = ["viscous", "coulomb"]\n')
    ran = ident("fit", study, "--log", turned, "--cutoff", "10", "--json")
    assert ran.code == 0
    plain = ident("fit", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--json")
    assert [p["value"] for p in ran.json["parameters"]] == pytest.approx([p["value"] for p in plain.json["parameters"]])


@pytest.mark.parametrize(
    ("command", "then"), [("check", "Audit of"), pytest.param("diagnose", "verdict", marks=pytest.mark.slow)], ids=["check", "diagnose"]
)
def test_exchanged_columns_are_said_before_anything_else(ident, arm, tmp_path, command, then):
    """A diagnosis names effects that stand in for the exchange."""
    swapped = {"q2": "q3", "q3": "q2", "tau2": "tau3", "tau3": "tau2"}
    log = write_csv(tmp_path / "swapped.csv", {k: arm.table[swapped.get(k, k)][:2400] for k in arm.table})
    ran = ident(command, "--urdf", arm.urdf, "--log", log, *FRICTION, "--quiet")
    assert ran.code == 0, ran.err
    first = " ".join(ran.out.split("warning: ")[1].split())
    assert "positions and torques of shoulder and elbow seem to be exchanged" in first
    assert ran.out.index("exchanged") < ran.out.index(then)


def test_what_a_torque_is_can_be_declared(ident, arm, tmp_path):
    def fit(*lines):
        study = tmp_path / "study.toml"
        study.write_text("\n".join([f'[robot]\nurdf = "{arm.urdf}"', "[drive]", 'effects = ["viscous", "coulomb"]', *lines]))
        return ident("fit", study, "--log", arm.train, "--cutoff", "10", "--json")

    plain = {p["name"]: p["value"] for p in fit('torque = "link"').json["parameters"]}
    current = fit('torque = "current"', "torque_constants = [2.0, 2.0, 2.0, 2.0]")
    assert {p["name"]: p["value"] / 2 for p in current.json["parameters"]} == pytest.approx(plain)
    geared = fit('torque = "motor"', "ratio = [10.0, 10.0, 10.0, 10.0]")
    links = {p["name"]: p["value"] / 10 for p in geared.json["parameters"] if p["effect"] == "rigid_body"}
    assert links == pytest.approx({name: plain[name] for name in links})
    refused = fit('torque = "external"')
    assert refused.code == 3
    assert "external" in refused.err
    assert fit('torque = "none"').code == 3
    assert any("a command, not a measurement" in w for w in fit('torque = "command"').json["warnings"])
    wrong = fit('torque = "force"')
    assert wrong.code == 2
    assert re.search("torque must be 'link' or 'motor'", wrong.err)
    assert fit("torque_sign = [1, -1]").code == 3
    assert fit("torque_sign = 2").code == 2


def test_columns_of_a_study_may_be_scaled_and_turned(ident, arm, tmp_path):
    odd = write_csv(tmp_path / "odd.csv", arm.table | {"tau2": -2 * arm.table["tau2"]})
    study = tmp_path / "study.toml"
    start = f'[robot]\nurdf = "{arm.urdf}"\n[columns]\n'
    study.write_text(start + 'tau2 = { column = "tau2", scale = -0.5 }\n')
    ran = ident("fit", study, "--log", odd, *FRICTION, "--json")
    plain = ident("fit", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--json")
    assert [p["value"] for p in ran.json["parameters"]] == pytest.approx([p["value"] for p in plain.json["parameters"]])
    study.write_text(start + 'tau2 = { column = "tau2", factor = -0.5 }\n')
    assert ident("fit", study, "--log", odd, *FRICTION).code == 2


def test_a_recorder_of_ones_own_in_a_study(ident, arm, tmp_path):
    table = {"t": arm.table["t"]} | {f"rig_{j}": arm.table[f"q{j + 1}"] for j in range(4)}
    table |= {f"pull_{j}": 1000 * arm.table[f"tau{j + 1}"] for j in range(4)}
    log = write_csv(tmp_path / "own.csv", table)
    (tmp_path / "rig.toml").write_text(
        '[[recorder]]\nname = "our rig"\ncolumns = ["pull_0"]\neffort = "link"\neffort_scale = 1e-3\n'
        f'joints = {list(JOINTS)}\nchannels = {{ q = "rig_{{}}", tau = "pull_{{}}" }}\n'.replace("'", '"')
    )
    study = tmp_path / "study.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\n[logs]\nfit = ["own.csv"]\nrecorders = ["rig.toml"]\n')
    ran = ident("fit", study, *FRICTION, "--json")
    assert ran.code == 0, ran.err
    plain = ident("fit", "--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--json")
    assert [p["value"] for p in ran.json["parameters"]] == pytest.approx([p["value"] for p in plain.json["parameters"]], rel=1e-6)
    assert log.exists()


def test_recorders_are_checked(tmp_path):
    from ident.logs import add_recorders

    for wrong in ("recorder = 3", "[[recorder]]\nname = 'x'\n", "[[recorder]]\nname = 'x'\ncolumns = ['a']\ncounts = 'many'\n", "nothing"):
        (tmp_path / "x.toml").write_text(wrong)
        with pytest.raises(ConfigurationError, match=r"x\.toml"):
            add_recorders(tmp_path / "x.toml")


def test_what_needs_no_robot_is_checked_without_one(ident, arm, tmp_path):
    """Positions in degrees beside velocities in rad/s; one warning for all joints."""
    columns = {k: v / (np.pi / 180) if k.startswith("q") else v for k, v in arm.table.items()}
    rates = {f"dq{j + 1}": np.gradient(arm.table[f"q{j + 1}"], arm.table["t"]) for j in range(4)}
    ran = ident("check", "--log", write_csv(tmp_path / "a.csv", columns | rates), "--json")
    assert ran.code == 0, ran.err
    (found,) = [w for w in ran.json["warnings"] if "measured velocity" in w]
    assert found.startswith("q1, q2, q3, q4: ")
    ran = ident("check", "--log", write_csv(tmp_path / "b.csv", arm.table | rates))
    assert "warning" not in ran.out
    assert "(rad, m, N m" in " ".join(ran.out.split())
