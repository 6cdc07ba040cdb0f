"""`ident monitor`: unchanged logs, friction that grew, a payload that appeared; and its report."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import ARM, FRICTION, analytic_log, write_csv

TRUTH = ([20.0, 1.0, 0.5, 0.1], [10.0, 2.0, 1.0, 0.2])
CONFIGURATION, DATA = 2, 3
#: kg, about the wrist's frame: a body of 0.6 kg at (0.02, 0.01, 0.05) m.
PAYLOAD = 0.6 * np.array([1, 0.02, 0.01, 0.05, 0.0026 + 2e-3, -0.0002, 0.0029 + 2e-3, -0.001, -0.0005, 0.0005 + 2e-3])


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """The arm's fit, and later logs: unchanged, with friction of the elbow grown by 0.125 N m s/rad, with a payload."""
    from ident import Robot
    from ident import friction as fr
    from ident.cli import main

    folder = tmp_path_factory.mktemp("world")
    (folder / "arm.urdf").write_text(ARM)
    robot = Robot.from_urdf(folder / "arm.urdf")
    model = robot.rigid_body() + fr.Viscous() + fr.Coulomb()
    values = np.concatenate([robot.nominal, *TRUTH])
    worn, loaded = values.copy(), values.copy()
    worn[model.names.index("Fv_elbow")] += 0.125
    loaded[30:40] += PAYLOAD
    for seed, (name, own) in enumerate({"fit": values, "same": values, "worn": worn, "loaded": loaded}.items()):
        write_csv(folder / f"{name}.csv", analytic_log(model, own, 40 + seed, seconds=20.0, noise=5e-3))
    flags = ("--urdf", str(folder / "arm.urdf"), "--log", str(folder / "fit.csv"), "--validate", str(folder / "same.csv"))
    assert main(["fit", *flags, *FRICTION, "--quiet", "--out", str(folder / "result")]) == 0
    return folder


def watch(ident, world, name, *more):
    return ident("monitor", "--fit", world / "result" / "fit.json", "--log", world / f"{name}.csv", "--quiet", *more)


def test_unchanged(ident, world):
    ran = watch(ident, world, "same", "--json", "--strict")
    assert ran.code == 0
    assert ran.json["schema"] == "ident.monitor/1"
    assert ran.json["verdict"] == "unchanged"
    assert ran.json["changes"] == ran.json["unexplained"] == ran.json["warnings"] == []
    assert "unchanged" in ran.err


def test_friction_that_grew(ident, world, tmp_path):
    ran = watch(ident, world, "worn", "--json", "--strict", "--out", tmp_path / "out")
    assert ran.code == 1
    found = ran.json
    assert found["verdict"] == "changed"
    (change,) = found["changes"]
    assert (change["effect"], change["joints"], change["how"]) == ("viscous", ["elbow"], "changed")
    (p,) = change["parameters"]
    assert p["name"] == "Fv_elbow"
    assert abs(p["value"] - 0.125) < 4 * p["std"] < 0.03
    assert p["after"] == pytest.approx(p["before"] + p["value"])
    assert "viscous friction on elbow grew by 0.12" in change["text"]
    error = found["torque_error"]
    assert error["new"]["relative"][2] > 3 * error["corrected"]["relative"][2]
    assert {i["path"] for i in found["inputs"]} == {str(world / "worn.csv")}
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"monitor.json", "monitor.txt", "report.json", "report.html", "figures"}
    assert "grew by" in (tmp_path / "out" / "report.html").read_text()
    assert json.loads((tmp_path / "out" / "monitor.json").read_text())["changes"] == found["changes"]
    assert ident("report", tmp_path / "out", "-o", tmp_path / "again.html").code == 0


def test_payload_that_appeared(ident, world):
    ran = watch(ident, world, "loaded", "--json")
    assert ran.code == 0, "without --strict a change is no failure"
    (change,) = ran.json["changes"]
    assert (change["effect"], change["how"]) == ("payload", "appeared")
    mass = change["parameters"][0]
    assert mass["unit"] == "kg"
    assert abs(mass["value"] - 0.6) < 4 * mass["std"] < 0.05


def test_payload_that_was_put_down(ident, world, tmp_path):
    flags = ("--urdf", world / "arm.urdf", "--log", world / "loaded.csv", *FRICTION, "--quiet")
    assert ident("fit", *flags, "--out", tmp_path / "loaded").code == 0
    ran = ident("monitor", "--fit", tmp_path / "loaded" / "fit.json", "--log", world / "same.csv", "--json", "--quiet")
    change = ran.json["changes"][0]
    assert (change["effect"], change["how"]) == ("payload", "disappeared")
    assert change["parameters"][0]["value"] == pytest.approx(-0.6, abs=0.02)


def test_refusals(ident, world, tmp_path):
    fit = world / "result" / "fit.json"
    assert ident("monitor", "--fit", fit).code == CONFIGURATION
    assert ident("monitor", "--fit", world / "same.csv", "--log", world / "same.csv").code == CONFIGURATION
    ran = watch(ident, world, "none", "--out", tmp_path / "out")
    assert ran.code == DATA
    assert not (tmp_path / "out").exists()
    lines = (world / "same.csv").read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(lines[:300]) + "\n")
    ran = ident("monitor", "--fit", fit, "--log", tmp_path / "short.csv", "--quiet")
    assert ran.code == DATA
    assert "longer log" in ran.err or "too" in ran.err


@pytest.fixture(scope="module")
def imperfect(tmp_path_factory):
    """A fit whose model never had the viscous friction of the elbow that depends on direction; its log and a new one, alike in that."""
    from ident import Robot, make_effect
    from ident import friction as fr
    from ident.cli import main

    folder = tmp_path_factory.mktemp("imperfect")
    (folder / "arm.urdf").write_text(ARM)
    robot = Robot.from_urdf(folder / "arm.urdf")
    model = robot.rigid_body() + fr.Viscous() + fr.Coulomb() + make_effect("asymmetric_viscous", joints=["elbow"])
    values = np.concatenate([robot.nominal, *TRUTH, [0.1]])
    for seed, name in enumerate(("fit", "new")):
        write_csv(folder / f"{name}.csv", analytic_log(model, values, 60 + seed, seconds=20.0, noise=5e-3))
    flags = ("--urdf", str(folder / "arm.urdf"), "--log", str(folder / "fit.csv"), "--validate", str(folder / "new.csv"))
    assert main(["fit", *flags, *FRICTION, "--quiet", "--out", str(folder / "result")]) == 0
    return folder


def test_what_the_model_never_had_is_no_change(ident, imperfect, tmp_path):
    """What shows in the fit's own log, too, is known, not new: here that log is gone, and a copy is named with --reference. Without any,
    it counts as a change."""
    flags = ("monitor", "--fit", imperfect / "result" / "fit.json", "--log", imperfect / "new.csv", "--quiet", "--json")
    kept = (imperfect / "fit.csv").read_bytes()
    copy = tmp_path / "copy.csv"
    copy.write_bytes(kept)
    (imperfect / "fit.csv").unlink()
    try:
        named = ident(*flags, "--reference", copy)
        alone = ident(*flags)
    finally:
        (imperfect / "fit.csv").write_bytes(kept)
    assert named.json["known"] == ["asymmetric_viscous on elbow"]
    assert named.json["changes"] == named.json["warnings"] == []
    assert "in the logs of the fit too: asymmetric_viscous on elbow" in named.err
    assert alone.json["known"] == []
    assert [(c["effect"], c["joints"]) for c in alone.json["changes"]] == [("asymmetric_viscous", ["elbow"])]
    assert any("--reference" in w for w in alone.json["warnings"])


def test_knocks_are_no_known_change(ident, world, tmp_path):
    """Something knocks against the arm: outside the catalogue, so it is said to be unexplained, and no name is given with confidence."""
    rows = (world / "same.csv").read_text().splitlines()
    head, table = rows[0].split(","), np.array([[float(x) for x in row.split(",")] for row in rows[1:]])
    t, rng = table[:, 0], np.random.default_rng(5)
    knocks = sum(s * np.exp(-0.5 * ((t - at) / 0.05) ** 2) for at, s in zip(rng.uniform(1, 19, 12), rng.normal(size=12), strict=True))
    column = head.index("tau3")
    table[:, column] += 0.5 * np.sqrt(np.mean(table[:, column] ** 2)) * knocks
    write_csv(tmp_path / "knocked.csv", dict(zip(head, table.T, strict=True)))
    ran = ident("monitor", "--fit", world / "result" / "fit.json", "--log", tmp_path / "knocked.csv", "--quiet", "--json")
    assert ran.json["verdict"] == "unexplained"
    assert "elbow" in {u["joint"] for u in ran.json["unexplained"]}
    assert "times as large as on the fit's own logs" in ran.err
    assert all(c["confidence"] < 0.5 for c in ran.json["changes"])
