"""Habits that users bring: files without flags, `--logs`, a folder for a fit, the log named ident."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import FRICTION, Arm, Ran

import ident as package

Ident = Callable[..., Ran]


def values(ran: Ran) -> list[float]:
    assert ran.code == 0, ran.err
    return [p["value"] for p in ran.json["parameters"]]


@pytest.mark.parametrize(
    "order",
    [
        ("{log}", "--urdf", "{urdf}"),
        ("--urdf", "{urdf}", "{log}"),
        ("--urdf", "{urdf}", "--logs", "{log}"),
        ("{study}", "{log}"),
        ("{log}", "{study}"),
    ],
)
def test_logs_are_understood_wherever_they_stand(ident: Ident, arm: Arm, tmp_path: Path, order: tuple[str, ...]) -> None:
    study = tmp_path / "study.toml"
    study.write_text(f'[robot]\nurdf = "{arm.urdf}"\n')
    names = {"log": str(arm.train), "urdf": str(arm.urdf), "study": str(study)}
    given = [part.format(**names) for part in order]
    found = values(ident("fit", *given, "--validate", arm.test, *FRICTION, "--json", "--quiet"))
    usual = values(ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--validate", arm.test, *FRICTION, "--json", "--quiet"))
    np.testing.assert_array_equal(found, usual)


def test_several_logs_add_up(ident: Ident, arm: Arm) -> None:
    ran = ident("fit", str(arm.train), "--urdf", arm.urdf, "--log", arm.test, *FRICTION, "--json", "--quiet")
    assert ran.code == 0, ran.err
    assert {Path(i["path"]).name for i in ran.json["inputs"]} >= {"train.csv", "test.csv"}


@pytest.mark.parametrize("more", [("a.toml", "b.toml"), ("nonsense",), ("--unknown",), ("--urdf", "x.urdf", "nonsense")])
def test_what_is_neither_is_refused(ident: Ident, more: tuple[str, ...]) -> None:
    ran = ident("fit", "study.toml", *more)
    assert ran.code == 2
    assert "Traceback" not in ran.err


def test_a_folder_where_a_fit_is_expected(ident: Ident, arm: Arm, saved_fit: Path) -> None:
    assert ident("validate", "--fit", saved_fit.parent, "--validate", arm.test, "--no-replay").code == 0
    assert package.Estimate.load(saved_fit.parent).method == "wls"
    instead = ident("validate", saved_fit.parent, "--validate", arm.test)
    assert instead.code == 2
    assert f"--fit {saved_fit.parent}" in instead.err


def test_steps_go_to_the_log_named_ident(ident: Ident, arm: Arm, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="ident"):
        package.fit(str(arm.train), arm.urdf, held=0)
    told = {record.name for record in caplog.records}
    assert {"ident.logs.reading", "ident.signals.preparation", "ident.estimators.base"} <= told
    assert all(name.startswith("ident") for name in told)
    quiet = ident("fit", arm.train, "--urdf", arm.urdf, *FRICTION, "--quiet")
    told_all = ident("-v", "fit", arm.train, "--urdf", arm.urdf, *FRICTION, "--quiet")
    assert "ident.estimators.base: wls:" not in quiet.err
    assert "ident.estimators.base: wls:" in told_all.err
    assert not [h for h in logging.getLogger("ident").handlers if not isinstance(h, logging.NullHandler)]


def test_the_schema_is_printed(ident: Ident, tmp_path: Path) -> None:
    ran = ident("study-schema")
    assert ran.code == 0
    assert json.loads(ran.out)["title"] == "ident study"
    assert ident("study-schema", "-o", tmp_path / "s.json").code == 0
    assert ident("study-schema", "-o", tmp_path / "s.json").code == 2
