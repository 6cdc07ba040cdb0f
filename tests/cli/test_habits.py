"""Habits that users bring: files without flags, `--logs`, a folder for a fit, the log named ident."""

from __future__ import annotations

import json
import logging
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import FRICTION, Arm, Ran

import ident as package
from ident.cli import build_parser
from ident.commands import COMMANDS
from ident.commands.examples import EXAMPLES
from ident.commands.names import take_names

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


def test_the_rate_of_a_log_without_a_time_is_asked_for_with_every_fit(ident: Ident, arm: Arm, saved_fit: Path, tmp_path: Path) -> None:
    """A recording that counts its rows only: `--rate-hz` is understood beside a saved fit, too."""
    untimed = tmp_path / "untimed.csv"
    rows = arm.test.read_text().splitlines()
    untimed.write_text("\n".join(",".join(row.split(",")[1:]) for row in rows) + "\n")
    given = {
        "validate": ("--fit", saved_fit, "--validate", untimed, "--no-replay"),
        "compare": (saved_fit, saved_fit, "--log", untimed),
        "monitor": ("--fit", saved_fit, "--log", untimed),
    }
    for command, arguments in given.items():
        asked = ident(command, *arguments)
        assert asked.code in (2, 3), command
        assert "--rate-hz" in asked.err
    for command in ("validate", "compare"):
        timed = ident(command, *(arm.test if x == untimed else x for x in given[command]), "--json", "--quiet")
        ran = ident(command, *given[command], "--rate-hz", "200", "--json", "--quiet")
        assert ran.code == 0, ran.err
        error = [r.json["torque_error"]["heldout"] if command == "validate" else r.json["after"]["heldout"] for r in (ran, timed)]
        assert error[0]["rms"] == pytest.approx(error[1]["rms"], rel=1e-6)


def test_effects_on_some_joints_with_a_shape(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    """`--effects NAME:JOINTS:KEY=VALUE` is what a study file says with a table."""
    study = tmp_path / "study.toml"
    study.write_text(
        f'[robot]\nurdf = "{arm.urdf}"\n[drive]\neffects = ["viscous", {{ name = "stribeck", joints = ["elbow", "wrist"], v_s = 0.3 }}]\n'
    )
    logs = ("--log", arm.train, "--validate", arm.test, "--json", "--quiet")
    by_flag = ident("fit", "--urdf", arm.urdf, "--effects", "viscous", "stribeck:elbow,wrist:v_s=0.3", *logs)
    by_file = ident("fit", study, *logs)
    np.testing.assert_array_equal(values(by_flag), values(by_file))
    assert [p["joint"] for p in by_flag.json["parameters"] if p["effect"] == "stribeck"] == ["elbow", "wrist"]


@pytest.mark.parametrize(
    ("effect", "needle"),
    [
        ("stribeck:elbow:v_s=0.1:x", "NAME:JOINTS:KEY=VALUE"),
        ("stribeck:elbow,v_s=0.1", "NAME:JOINTS:KEY=VALUE"),
        ("stribeck:elbo", "did you mean 'elbow'"),
        ("stribeck:elbow:v_s=fast", "v_s"),
        ("stribek:elbow", "did you mean 'stribeck'"),
        ("stribeck:elbow:vs=1", "v_s"),
    ],
)
def test_effects_that_cannot_be_read_are_told(ident: Ident, arm: Arm, effect: str, needle: str) -> None:
    ran = ident("fit", "--urdf", arm.urdf, "--log", arm.train, "--effects", effect)
    assert ran.code == 2
    assert needle in " ".join(ran.err.split())


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_a_command_has_examples_that_it_understands(ident: Ident, command: str) -> None:
    ran = ident(command, "--help")
    assert ran.code == 0
    shown = [line.strip() for line in ran.out.partition("\nexample:\n")[2].splitlines() if line.startswith("  ") and "ident " in line]
    assert shown[: len(EXAMPLES[command])] == list(EXAMPLES[command])
    for line in EXAMPLES[command]:
        words = shlex.split(line.removeprefix('eval "$(').removesuffix(')"'))
        args, more = build_parser(command).parse_known_args(words[1:])
        assert take_names(args, more), line
        assert args.command == command


def test_a_file_may_stand_where_a_robot_is_named(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    ran = ident("base", "--robot", arm.urdf)
    assert ran.code == 0, ran.err
    assert ran.out == ident("base", "--urdf", arm.urdf).out
    ran = ident("base", "--robot", tmp_path / "none.urdf")
    assert ran.code == 2
    assert "give it as a URDF" in ran.err
