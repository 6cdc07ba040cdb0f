"""The examples of docs/extend.md, each as a user would run it: one new file, named to the command line."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from ident.robots import robot_folder

PAGE = (Path(__file__).parents[2] / "docs/extend.md").read_text()
FILES = dict(re.findall(r"```python\n# file: (\S+)\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = re.findall(r"^\$ ident (.*)$", PAGE, re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extend")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    demo = robot_folder("puma560") / "demo"
    (folder / "train.csv.gz").write_bytes((demo / "train.csv.gz").read_bytes())
    return folder


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(
        [sys.executable, "-m", "ident", *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_the_page_has_its_files_and_commands() -> None:
    assert set(FILES) >= {"smooth_friction.py", "ridge.py"}
    assert len(COMMANDS) >= len(FILES)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page(folder: Path, command: str) -> None:
    done = run(folder, *shlex.split(command), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["schema"].startswith("ident.")


def test_the_law_is_fitted_where_the_log_has_it(folder: Path) -> None:
    """At a speed far below those of the log, tanh is the sign: the fit equals that with Coulomb friction."""
    options = ["--robot", "puma560", "--log", "train.csv.gz", "--json"]
    smooth = run(folder, "fit", "--plugin", "smooth_friction.py", *options, "--effects", "rotor_inertia", "viscous", "smooth_coulomb")
    plain = run(folder, "fit", *options, "--effects", "rotor_inertia", "viscous", "coulomb")
    found = {p["name"]: p["value"] for p in json.loads(smooth.stdout)["parameters"]}
    known = {p["name"]: p["value"] for p in json.loads(plain.stdout)["parameters"]}
    assert found["Fsm_joint1"] == pytest.approx(known["Fc_joint1"], rel=0.05)


def test_a_study_names_its_modules(folder: Path) -> None:
    (folder / "study.toml").write_text(
        '[plugins]\nmodules = ["ridge.py"]\n[robot]\nname = "puma560"\n[logs]\nfit = ["train.csv.gz"]\n'
        '[estimator]\nmethod = "ridge"\npenalty = 1e-4\n'
    )
    assert json.loads(run(folder, "fit", "study.toml", "--json").stdout)["method"] == "ridge"


@pytest.mark.parametrize(
    ("name", "text", "needle"),
    [("nosuch.py", None, "nosuch.py"), ("broken.py", "x = 1 / 0\n", "line 1"), ("nosuchmodule", None, "nosuchmodule")],
)
def test_a_plugin_that_fails_is_named(folder: Path, name: str, text: str | None, needle: str) -> None:
    if text is not None:
        (folder / name).write_text(text)
    done = run(folder, "fit", "--plugin", name, "--robot", "puma560", "--log", "train.csv.gz")
    assert done.returncode == 2
    assert needle in done.stderr
    assert "Traceback" not in done.stderr
