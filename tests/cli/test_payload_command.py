"""`ident payload`: a load from two logs, or from one on top of a saved fit."""

from __future__ import annotations

import numpy as np
import pytest
from command_line import FRICTION, JOINTS, analytic_log, write_csv

from ident.physical.pseudo_inertia import from_centre_of_mass, smallest_eigenvalues

MASS, COM = 0.9, np.array([0.03, -0.02, 0.12])
LOAD = from_centre_of_mass(MASS, COM, np.diag([0.004, 0.005, 0.003]))


@pytest.fixture(scope="module")
def loaded(arm, tmp_path_factory):
    """A log of the arm with a load on its hand."""
    from ident import Robot
    from ident import friction as fr

    robot = Robot.from_urdf(arm.urdf)
    model = robot.rigid_body() + fr.Viscous() + fr.Coulomb()
    links = robot.nominal.copy()
    links[30:40] += LOAD
    values = np.concatenate([links, [20.0, 1.0, 0.5, 0.1], [10.0, 2.0, 1.0, 0.2]])
    return write_csv(tmp_path_factory.mktemp("load") / "loaded.csv", analytic_log(model, values, 7))


def ten(body):
    return {p["name"].removesuffix("_payload"): p for p in body["parameters"]}


@pytest.mark.parametrize("way", ["pair", "fit"])
def test_a_load_is_found(ident, arm, saved_fit, loaded, tmp_path, way):
    before = ("--fit", saved_fit) if way == "fit" else ("--urdf", arm.urdf, "--without", arm.train, *FRICTION)
    ran = ident("payload", *before, "--log", loaded, "--json", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    body = ran.json
    assert body["schema"] == "ident.payload/1"
    assert body["link"] == "hand"
    assert body["significant"] is True
    assert len(body["inputs"]) >= 2
    found = ten(body)
    assert list(found) == ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    assert abs(body["mass"] - MASS) < 4 * body["mass_std"]
    assert body["mass_std"] < 0.05
    for value, p in zip(LOAD, found.values(), strict=True):
        if p["std"] is not None:
            assert abs(p["unconstrained"] - value) < 4.5 * p["std"], p
    assert set(body["unknown"]) == {s for s, p in found.items() if p["std"] is None}
    assert smallest_eigenvalues(np.array([p["value"] for p in found.values()]))[0] > 0
    assert "payload on hand" in ran.err
    assert (tmp_path / "out" / "payload.json").is_file()


@pytest.mark.parametrize("wrong", ["opposite sign", "contradicts the rest of the logs"])
def test_a_wrong_log_with_the_load_is_told_of(ident, saved_fit, loaded, tmp_path, wrong):
    """A wrong load came without a word, or none with advice on bounds that nobody had set."""
    names, rows = loaded.read_text().splitlines()[0].split(","), np.loadtxt(loaded, delimiter=",", skiprows=1)
    torques = [names.index(f"tau{j + 1}") for j in range(4)]
    if wrong == "opposite sign":
        rows[:, torques] *= -1.0
    else:
        t = rows[:, names.index("t")]
        inside = (t > 6.0) & (t < 6.4)
        rows[np.ix_(inside, torques)] += np.sin(np.pi * (t[inside, None] - 6.0) / 0.4) * np.array([40.0, 10.0, 10.0, 2.0])
    path = tmp_path / "wrong.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    ran = ident("payload", "--fit", saved_fit, "--log", path)
    said = " ".join(ran.out.split())
    assert "warning: of the fit with the load:" in said
    assert wrong in said


@pytest.mark.parametrize("command", ["payload", pytest.param("monitor", marks=pytest.mark.slow)])
def test_positions_in_another_unit_are_told_of(ident, saved_fit, loaded, tmp_path, command):
    names, rows = loaded.read_text().splitlines()[0].split(","), np.loadtxt(loaded, delimiter=",", skiprows=1)
    rows = rows[:1200]
    rows[:, [names.index(f"q{j + 1}") for j in range(1, 4)]] *= 180 / np.pi
    path = tmp_path / "degrees.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    ran = ident(command, "--fit", saved_fit, "--log", path)
    assert "Looks like degrees" in " ".join(ran.out.split()), ran.out + ran.err


def test_no_load(ident, arm, saved_fit):
    ran = ident("payload", "--fit", saved_fit, "--log", arm.test, "--strict")
    assert ran.code == 1
    assert "no payload beyond chance" in ran.out
    assert "not significantly different from zero" in ran.out


def test_another_link(ident, saved_fit, loaded):
    body = ident("payload", "--fit", saved_fit, "--log", loaded, "--link", "fore", "--json").json
    assert body["link"] == "fore"
    assert body["identifiable"] < 10
    assert body["unknown"]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ((), "no log with the load"),
        (("--log", "{loaded}"), "no study file and no robot"),
        (("--log", "{loaded}", "--urdf", "{urdf}"), "without it"),
        (("--log", "{loaded}", "--fit", "{fit}", "--urdf", "{urdf}"), "brings its own"),
        (("--log", "{loaded}", "--fit", "{fit}", "--link", "nose"), "unknown moving link 'nose'"),
        (("--log", "nothing.csv", "--fit", "{fit}"), r"nothing\.csv"),
        (("--log", "{loaded}", "--fit", "none.json"), r"none\.json: no such file"),
    ],
)
def test_wrong_requests(ident, arm, saved_fit, loaded, flags, words):
    given = [f.format(loaded=loaded, urdf=arm.urdf, fit=saved_fit) for f in flags]
    ran = ident("payload", *given)
    assert ran.code in (2, 3)
    assert ran.out == ""
    import re

    assert re.search(words, ran.err), ran.err


def test_data_that_show_nothing(ident, arm, saved_fit, tmp_path):
    """A log at standstill says which log it is about; exit 3."""
    n = 400
    table = (
        {"t": np.arange(n) / 200}
        | {f"q{j + 1}": np.zeros(n) for j in range(len(JOINTS))}
        | {f"tau{j + 1}": np.zeros(n) for j in range(len(JOINTS))}
    )
    still = write_csv(tmp_path / "still.csv", table)
    ran = ident("payload", "--fit", saved_fit, "--log", still)
    assert ran.code == 3
    assert "still" in ran.err
