"""The momentum and the energy form from the command line and from a study file, against the form of torque and the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

import ident as package

FLAGS = ("--effects", "viscous", "coulomb", "--cutoff", "10", "--json", "--quiet")


def test_every_form_finds_the_friction_that_made_the_log(ident, arm, tmp_path: Path) -> None:
    truth = {"Fv_shoulder": 1.0, "Fc_shoulder": 2.0, "Fc_slide": 10.0}
    found = {}
    for form, share in (("torque", 0.01), ("momentum", 0.01), ("energy", 0.05)):
        out = tmp_path / form
        ran = ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--validate", arm.test, "--form", form, "--out", out, *FLAGS)
        assert ran.code == 0, ran.err
        values = {p["name"]: p["value"] for p in ran.json["parameters"]}
        assert {name: values[name] for name in truth} == {name: pytest.approx(value, rel=share) for name, value in truth.items()}
        assert ran.json["trace"].get("form", "torque") == form
        assert ran.json["torque_error"]["heldout"]["relative_all"] < 0.05
        assert (f"{form} form" in ran.err) == (form != "torque")
        # Saved and read again it predicts torque as before.
        again = package.Estimate.load(out)
        assert again.values == pytest.approx(list(values.values()))
        checked = ident("validate", "--fit", out / "fit.json", "--validate", arm.test, "--no-replay", "--json", "--quiet")
        assert checked.json["torque_error"]["heldout"]["relative_all"] == pytest.approx(ran.json["torque_error"]["heldout"]["relative_all"])
        found[form] = values
    assert found["torque"] != found["momentum"] != found["energy"]


def test_a_study_names_the_form(ident, arm, tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    text = f'[robot]\nurdf = "{arm.urdf}"\n[drive]\neffects = ["viscous", "coulomb"]\n[logs]\nfit = ["{arm.train}"]\n'
    study.write_text(text + '[signals]\ncutoff_hz = 10\n[estimator]\nmethod = "ls"\nform = "momentum"\n', encoding="utf-8")
    by_study = ident("fit", study, "--json", "--quiet").json
    by_flag = ident("fit", study, "--method", "ls", "--form", "momentum", "--json", "--quiet").json
    other = ident("fit", study, "--form", "torque", "--json", "--quiet").json
    values = [[p["value"] for p in one["parameters"]] for one in (by_study, by_flag, other)]
    assert values[0] == values[1] != values[2]
    assert 'form = "momentum"' in package.read_study(study).to_toml()
    study.write_text(text + '[estimator]\nform = "power"\n', encoding="utf-8")
    wrong = ident("fit", study, "--quiet")
    assert (wrong.code, "momentum" in wrong.err) == (2, True)


def test_what_takes_no_other_form_says_so(ident, arm) -> None:
    where = ("--urdf", arm.urdf, "--log", arm.train, "--quiet")
    method = ident("fit", *where, "--method", "iv", "--form", "momentum")
    assert (method.code, "momentum form" in method.err) == (2, True)
    assert "wls" in method.err
    diagnosis = ident("diagnose", *where, "--form", "energy")
    assert (diagnosis.code, "leave out the energy form" in diagnosis.err) == (2, True)
