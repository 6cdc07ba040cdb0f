"""`ident judge --repair` on a saved fit, `ident export` of friction below zero, and what happens without the solver."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from command_line import FRICTION, python

from ident.estimate.estimate import Estimate
from ident.physical import judge, solver_available
from ident.robots.robot import Robot


@pytest.fixture(scope="module")
def short_fit(arm, tmp_path_factory):
    """A fit of so little data that no real links give it: 3.5 s of the log, with noise."""
    from ident.cli import main

    lines = arm.train.read_text().splitlines()
    folder = tmp_path_factory.mktemp("short")
    rng = np.random.default_rng(3)
    head = lines[0].split(",")
    rows = [[float(x) for x in line.split(",")] for line in lines[1:700]]
    for row in rows:
        for i, name in enumerate(head):
            if name.startswith("tau"):
                row[i] += 1.5 * rng.standard_normal()
    text = [",".join(head), *(",".join(map(repr, row)) for row in rows)]
    (folder / "short.csv").write_text("\n".join(text) + "\n")
    out = folder / "fit"
    flags = ["--urdf", str(arm.urdf), "--log", str(folder / "short.csv"), "--validate", str(arm.test), *FRICTION]
    assert main(["fit", *flags, "--out", str(out), "--quiet"]) in (0, 1)
    return out / "fit.json"


@pytest.mark.parametrize("method", ["fit", "consistent", "possible", "stepwise", "cone"])
def test_a_repaired_fit_is_written(ident, arm, short_fit, tmp_path, method):
    assert not judge(Estimate.load(short_fit)).consistent.consistent
    before = short_fit.read_bytes()
    ran = ident("judge", short_fit, "--repair", method, "--validate", arm.test, "--out", tmp_path / "out", "--json")
    assert ran.code == 0, ran.err
    repair = ran.json["repair"]
    assert repair["method"] == method
    assert repair["possible"]["possible"]
    assert set(repair["torque_error"]) == {"fitted", "held out"}
    assert {"change", "change_std"} <= set(repair["torque_error"]["held out"])
    if method in ("fit", "consistent"):
        assert repair["consistent"]["consistent"]
        assert repair["binding"]["costs"]
        assert "Constraints that bind" in ran.err
    assert short_fit.read_bytes() == before
    assert {p.name for p in (tmp_path / "out").iterdir()} - {"report.html", "figures"} == {"fit.json", "judgement.json", "report.json"}
    # The file is a fit like any other: judged, used for prediction, exported.
    again = Estimate.load(tmp_path / "out" / "fit.json")
    assert again.method == f"wls, repaired ({method})"
    assert again.values == pytest.approx(list(repair["values"].values()))
    assert again.heldout_error is not None
    assert ident("judge", tmp_path / "out" / "fit.json", "--strict").code == 0
    ran = ident("export", tmp_path / "out" / "fit.json", tmp_path / "arm.urdf")
    assert ran.code == (0 if judge(again).consistent.consistent else 2), ran.err
    if method in ("fit", "consistent"):
        assert Robot.from_urdf(tmp_path / "arm.urdf").nominal is not None


def test_nothing_is_written_where_the_repair_fails(ident, short_fit, tmp_path):
    ran = ident("judge", short_fit, "--repair", "fit", "--total-mass", "-5", "-1", "--out", tmp_path / "out")
    assert ran.code == 2
    assert "no parameters satisfy all constraints together; loosen the bounds" in ran.err
    assert not (tmp_path / "out").exists()
    ran = ident("judge", short_fit, "--repair", "fit", "--total-mass", "5", "2", "--out", tmp_path / "new")
    assert ran.code == 2
    assert "above the most" in ran.err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--repair", "magic"), "unknown repair method 'magic'"),
        (("--validate", "x.csv"), "add --repair METHOD"),
        (("--repair", "fit", "--validate", "none.csv"), r"none.csv"),
        (("--repair", "possible", "--spread", "0.3"), "neither bounds nor a prior"),
    ],
)
def test_wrong_requests(ident, short_fit, flags, words):
    ran = ident("judge", short_fit, *flags)
    assert ran.code in (2, 3)
    assert words in ran.err


def test_an_existing_result_is_kept(ident, short_fit, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fit.json").write_text("mine")
    assert ident("judge", short_fit, "--repair", "fit", "--out", tmp_path / "out").code == 2
    assert (tmp_path / "out" / "fit.json").read_text() == "mine"


def with_value(source, target, name, value, std):
    """A saved fit with another value and standard deviation of a parameter."""
    data = json.loads(source.read_text())
    i = next(k for k, p in enumerate(data["parameters"]) if p["name"] == name)
    data["parameters"][i] |= {"value": value, "std": std}
    C = np.array(data["covariance"])
    C[i], C[:, i] = 0.0, 0.0
    C[i, i] = std**2
    data["covariance"] = C.tolist()
    target.write_text(json.dumps(data))
    return target


def test_friction_that_may_be_zero(ident, saved_fit, tmp_path):
    """Below zero by less than two standard deviations: a note, and zero in the export."""
    near = with_value(saved_fit, tmp_path / "near.json", "Fc_wrist", -0.003, 0.002)
    ran = ident("judge", near, "--json")
    assert ran.code == 0
    assert ran.json["consistent"] is True
    assert not ran.json["violated_parameters"]
    assert any("consistent with zero: Fc_wrist -0.003 ± 0.002" in note for note in ran.json["notes"])
    assert "consistent with zero" in ran.err
    ran = ident("export", near, tmp_path / "near.urdf")
    assert ran.code == 0
    assert "set to zero" in ran.out
    text = (tmp_path / "near.urdf").read_text()
    assert 'friction="0.0"' in text
    assert 'friction="-' not in text


def test_friction_of_the_wrong_sign(ident, saved_fit, tmp_path):
    far = with_value(saved_fit, tmp_path / "far.json", "Fc_wrist", -0.003, 0.0005)
    ran = ident("judge", far, "--json")
    assert ran.json["consistent"] is False
    assert ran.json["violated_parameters"] == ["Fc_wrist"]
    ran = ident("export", far, tmp_path / "far.urdf")
    assert ran.code == 2
    assert "wrong sign: Fc_wrist" in ran.err
    assert "--repair fit" in ran.err
    assert not (tmp_path / "far.urdf").exists()


@pytest.fixture
def no_solver(monkeypatch):
    """As if Clarabel were not installed: it is not found, and importing it fails."""
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "clarabel" else find(name, *rest))
    monkeypatch.setitem(sys.modules, "clarabel", None)
    assert not solver_available()


def test_without_the_solver(ident, arm, short_fit, tmp_path, no_solver):
    """Judged as far as can be, repaired by factors, and all of it said."""
    ran = ident("judge", short_fit, "--repair", "fit", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    assert "was not judged: the solver is not installed (pip install 'ident[sdp]')" in ran.out
    assert "log-Cholesky factors, nonlinear least squares (fallback)" in ran.out
    assert "local optimum" in " ".join(ran.out.split())
    data = json.loads((tmp_path / "out" / "judgement.json").read_text())
    assert data["consistent"] is None
    assert data["repair"]["possible"]["possible"]
    ran = ident("judge", short_fit, "--repair", "possible")
    assert ran.code == 0
    ran = ident("judge", short_fit, "--repair", "fit", "--total-mass", "1", "20")
    assert ran.code == 2
    assert "pip install 'ident[sdp]'" in ran.err


def test_what_was_repaired_without_the_solver_is_consistent(ident, short_fit, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        import importlib.util

        find = importlib.util.find_spec
        patch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "clarabel" else find(name, *rest))
        assert ident("judge", short_fit, "--repair", "fit", "--out", tmp_path / "out").code == 0
    assert judge(Estimate.load(tmp_path / "out" / "fit.json")).consistent.consistent


def test_importing_needs_no_solver():
    """`import ident` and the judgement module load without Clarabel."""
    code = "import sys; sys.modules['clarabel'] = None; import ident, ident.physical; print('loaded')"
    assert subprocess.run([*python(), "-c", code], capture_output=True, text=True, check=True).stdout == "loaded\n"


def test_the_sources_judgements_of_a_published_table(ident):
    """Each matrix by its name: the grid of leading minors, and the cones as far as their rays allow."""
    ran = ident("judge", "--robot", "puma560", "--table", "3", "--grid", "4", "--cone", "trailing", "--json")
    assert ran.code == 0, ran.err
    rotors, links = "H + K^-T R K^-1", "H"
    assert ran.json["matrix"] == rotors
    assert ran.json["possible"] is True
    assert ran.json["alone"]["possible"] is False
    assert ran.json["alone"]["min_eigenvalue"] == pytest.approx(-0.0079, abs=5e-5)
    assert {name: found["possible"] for name, found in ran.json["cone"].items()} == {rotors: None, links: False}
    assert {found["evaluations"] for found in ran.json["grid"].values()} == {4**5}
    assert ran.json["grid"][rotors]["possible"] is True
    assert "the verdicts differ" in ran.err
    assert "9,765,625 rays" in ran.err
    # What the words mean stands last.
    assert "consistent: real bodies" in ran.err.rstrip().splitlines()[-1]


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--repair", "cone"), "9,765,625 rays"),
        (("--cone", "leading", "--limits"), "leave out --limits"),
        (("--grid", "0"), "at least one position"),
        (("--grid", "100"), "fewer points"),
    ],
)
def test_what_the_sources_judgements_cannot_do(ident, flags, words):
    ran = ident("judge", "--robot", "puma560", "--table", "3", *flags)
    assert ran.code == 2
    assert words in ran.err


def test_a_fit_without_rotors_has_one_matrix(ident, saved_fit):
    ran = ident("judge", saved_fit, "--grid", "3", "--json")
    assert ran.code == 0, ran.err
    assert ran.json["matrix"] == "H"
    assert ran.json["alone"] is None
    assert list(ran.json["grid"]) == ["H"]
