"""Commands on logs of commands without torque, and on fits to them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

DATA = Path(__file__).parents[2] / "docs" / "data"


@pytest.fixture(scope="module")
def servo(tmp_path_factory) -> Path:
    """A folder with a study of a servo's log."""
    folder = tmp_path_factory.mktemp("servo")
    for name in ("servo.urdf", "servo.csv", "servo_check.csv", "servo.toml"):
        shutil.copy(DATA / name, folder)
    return folder


@pytest.fixture
def fitted(ident, servo) -> Path:
    if not (servo / "fit" / "fit.json").exists():
        assert ident("fit", servo / "servo.toml", "--out", servo / "fit", "--quiet").code == 0
    return servo / "fit"


def test_a_saved_fit_is_judged_by_another_log(ident, fitted, servo):
    ran = ident("validate", "--fit", fitted, "--log", servo / "servo_check.csv", "--json")
    assert ran.code == 0
    assert ran.json["schema"] == "ident.drive_validation/1"
    assert ran.json["joints"] == ["hip", "knee"]
    # Its readings have 0.5 mrad of noise.
    np.testing.assert_allclose(ran.json["rms"], 5e-4, rtol=0.15)
    assert [log["name"] for log in ran.json["logs"]] == ["servo_check"]
    assert not ran.json["warnings"]
    again = ident("validate", "--fit", fitted / "fit.json", "--log", servo / "servo.csv", "--json")
    assert "has seen" in again.json["warnings"][0]


def test_a_study_is_judged_by_what_it_holds_out(ident, servo, tmp_path):
    ran = ident("validate", servo / "servo.toml", "--out", tmp_path / "out")
    assert ran.code == 0
    assert "servo (last part)" in ran.out
    assert "held out: the last 25% of each log" in ran.out
    assert (tmp_path / "out" / "report.html").exists()
    assert ident("validate", servo / "servo.toml", "--max-error", "0.1").code == 2


@pytest.mark.parametrize("command", ["monitor --fit {fit} --log {log}", "payload --fit {fit} --log {log}", "judge {fit}/fit.json",
                                     "compare {fit}/fit.json {fit}/fit.json --log {log}"])  # fmt: skip
def test_what_needs_a_measured_torque_says_so(ident, fitted, servo, command):
    ran = ident(*command.format(fit=fitted, log=servo / "servo.csv").split())
    assert ran.code == 2
    assert "drive law" in ran.err
    assert "ident validate --fit" in ran.err


@pytest.mark.parametrize("command", ["check", "fit"])
def test_check_refuses_what_fit_refuses(ident, servo, tmp_path, command):
    """Commands of the opposite sign."""
    table = pd.read_csv(servo / "servo.csv")
    sent = [name for name in table.columns if name.startswith("q_cmd1")]
    assert sent
    table[sent] *= -1.0
    for name in ("servo.urdf", "servo.toml"):
        shutil.copy(servo / name, tmp_path)
    table.to_csv(tmp_path / "servo.csv", index=False)
    ran = ident(command, tmp_path / "servo.toml")
    assert ran.code == 3
    assert "hip" in ran.err
