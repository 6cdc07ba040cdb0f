"""`ident fit --essential`: the essential model beside the fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import FRICTION, Arm, Ran

Ident = Callable[..., Ran]


def test_the_essential_model_is_printed_told_in_json_and_kept_as_a_fit(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    given = ("fit", "--urdf", arm.urdf, "--log", arm.train, "--validate", arm.test, *FRICTION, "--quiet")
    plain, ran = ident(*given, "--json"), ident(*given, "--essential", "--json", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    found = ran.json["essential"]
    assert "essential" not in plain.json
    assert ran.json["parameters"] == plain.json["parameters"]
    assert len(found["kept"]) + len(found["removed"]) == len(plain.json["parameters"])
    assert f"essential model: {len(found['kept'])} of" in ran.err
    checked = ident("validate", "--fit", tmp_path / "out/essential.fit.json", "--validate", arm.test, "--no-replay", "--json", "--quiet")
    assert checked.code == 0, checked.err
    assert checked.json["torque_error"]["heldout"]["relative_all"] == pytest.approx(found["heldout"]["after"]["relative_all"], rel=1e-9)
    assert "essential model" in (tmp_path / "out/essential.txt").read_text()


def test_it_is_refused_for_logs_without_torque(ident: Ident, tmp_path: Path) -> None:
    data = Path(__file__).parents[2] / "docs/data"
    study = tmp_path / "servo.toml"
    study.write_text(f'[robot]\nurdf = "{data}/servo.urdf"\n[drive]\nlaw = "pd_position"\nkp = 25.0\n[logs]\nfit = ["{data}/servo.csv"]\n')
    ran = ident("fit", study, "--essential")
    assert ran.code == 2
    assert "--essential needs logs with torque" in ran.err
