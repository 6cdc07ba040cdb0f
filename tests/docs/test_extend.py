"""The examples of docs/extend.md, each as a user would run it: one new file, named to the command line."""

from __future__ import annotations

import json
import os
import re
import shlex
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ident
from ident.robots import robot_folder

PAGE = (Path(__file__).parents[2] / "docs/extend.md").read_text()
FILES = dict(re.findall(r"```(?:python|toml)\n# file: (\S+)\n(.*?)```", PAGE, re.DOTALL))
COMMANDS = re.findall(r"^\$ ident (.*)$", PAGE, re.MULTILINE)


def as_rig(log: ident.Log) -> bytes:
    """A log as the page's rig writes it: degrees, and the motors' torque."""
    assert log.q is not None
    names = ["clock", *(f"axis {j} pos" for j in range(log.n)), *(f"axis {j} motor torque" for j in range(log.n))]
    units = {name: "deg" for name in names if name.endswith("pos")} | {"clock": "s"}
    head = json.dumps({"channels": names, "units": units}).encode()
    head += b" " * (-len(head) % 8)
    table = np.column_stack([log.t, np.rad2deg(log.q), log.tau["motor"]])
    return b"RIG1" + struct.pack("<I", len(head)) + head + table.tobytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("extend")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    demo = robot_folder("puma560") / "demo"
    (folder / "train.csv.gz").write_bytes((demo / "train.csv.gz").read_bytes())
    (folder / "train.rig").write_bytes(as_rig(ident.read_logs(demo / "train.csv.gz")[0]))
    return folder


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    return subprocess.run(
        [sys.executable, "-m", "ident", *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_the_page_has_its_files_and_commands() -> None:
    assert set(FILES) >= {"smooth_friction.py", "ridge.py", "our_rig.py"}
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


def test_a_law_without_a_lower_bound(folder: Path) -> None:
    """A wave over the position, by a stranger: None for a bound is none."""
    text = (folder / "smooth_friction.py").read_text().replace('"smooth_coulomb"', '"belt_wave"').replace("SmoothCoulomb", "BeltWave")
    text = text.replace('(("Fsm", "{tau}", 0.0),)', '(("A", "{tau}", None),)').replace("np.tanh(own.dq / self.v)", "np.sin(own.q / self.v)")
    (folder / "belt.py").write_text(text.replace("Nature.FRICTION", "Nature.DRIVE"))
    done = run(
        folder, "fit", "--plugin", "belt.py", "--robot", "puma560", "--log", "train.csv.gz", "--effects", "belt_wave:joint1:v=0.2", "--json"
    )
    assert done.returncode == 0, done.stderr
    assert "A_joint1" in {p["name"] for p in json.loads(done.stdout)["parameters"]}


def test_the_rigs_log_is_the_same_log(folder: Path) -> None:
    def values(*options: str) -> list[float]:
        done = run(folder, "fit", *options, "--robot", "puma560", "--json")
        assert done.returncode == 0, done.stderr
        return [p["value"] for p in json.loads(done.stdout)["parameters"]]

    study = folder / "rig.toml"
    study.write_text('[plugins]\nmodules = ["our_rig.py"]\n[drive]\ntorque = "motor"\n[logs]\nfit = ["train.rig"]\n')
    assert values(str(study)) == pytest.approx(values("--log", "train.csv.gz"), rel=1e-6, abs=1e-9)


def test_a_study_names_its_modules(folder: Path) -> None:
    (folder / "study.toml").write_text(
        '[plugins]\nmodules = ["ridge.py"]\n[robot]\nname = "puma560"\n[logs]\nfit = ["train.csv.gz"]\n'
        '[estimator]\nmethod = "ridge"\npenalty = 1e-4\n'
    )
    assert json.loads(run(folder, "fit", "study.toml", "--json").stdout)["method"] == "ridge"


def test_a_saved_fit_with_the_law_serves_every_command(folder: Path) -> None:
    options = ["--robot", "double_pendulum", "--effects", "viscous", "smooth_coulomb"]
    law = ["--plugin", "smooth_friction.py"]
    assert run(folder, "simulate", "--robot", "double_pendulum", "--seconds", "4", "--log", "own.csv").returncode == 0
    assert run(folder, "fit", *law, *options, "--log", "own.csv", "--out", "own").returncode == 0
    checked = ["validate", "--fit", "own/fit.json", "--validate", "own.csv", "--no-replay"]
    unknown = run(folder, *checked)
    assert (unknown.returncode, "--plugin FILE" in unknown.stderr) == (2, True)
    for command in ([*checked, *law, "--out", "checked"], ["export", *law, "own/fit.json", "own.c"]):
        done = run(folder, *command)
        assert done.returncode == 0, done.stderr
    assert "held-out" in (folder / "checked/report.json").read_text()
    assert "tanh" in (folder / "own.c").read_text()


def test_an_error_in_a_plugin_is_told_as_the_plugins(folder: Path) -> None:
    text = (
        (folder / "ridge.py")
        .read_text()
        .replace('"ridge"', '"broken_ridge"')
        .replace("np.vstack([R, rows])", "np.vstack([R, rows.missing])")
    )
    (folder / "broken_ridge.py").write_text(text)
    done = run(folder, "fit", "--plugin", "broken_ridge.py", "--robot", "puma560", "--log", "train.csv.gz", "--method", "broken_ridge")
    assert done.returncode == 2
    assert "broken_ridge.py" in done.stderr
    assert "internal error" not in done.stderr


@pytest.mark.parametrize(
    ("right", "wrong", "needle"),
    [
        ("yield np.tanh", "return np.tanh", "use yield"),
        ("yield np.tanh(own.dq / self.v)", "yield own.dq[0]", "1 array of shape"),
        ('(("Fsm", "{tau}", 0.0),)', '("Fsm", "{tau}", 0.0)', "lower bound"),
        ('symbols = (("Fsm", "{tau}", 0.0),)', "", "not None"),
        ("{tau}", "{torque}", "{tau}"),
    ],
)
def test_a_wrong_declaration_of_a_law_is_told(folder: Path, right: str, wrong: str, needle: str) -> None:
    text = (folder / "smooth_friction.py").read_text()
    assert right in text
    (folder / "wrong_law.py").write_text(text.replace(right, wrong))
    done = run(folder, "fit", "--plugin", "wrong_law.py", "--robot", "puma560", "--log", "train.csv.gz", "--effects", "smooth_coulomb")
    assert done.returncode == 2
    assert "effect 'smooth_coulomb'" in done.stderr
    assert needle in done.stderr


def test_values_that_are_no_solution_are_refused() -> None:
    train, _ = ident.demo_logs()
    problem = ident.fit(train, "puma560", held=0).problem
    assert problem is not None
    with pytest.raises(ident.ConfigurationError, match=r"solve_triangle\(R, z\)"):
        ident.estimators.finish(problem, np.zeros(52), np.ones(6), "bare")  # type: ignore[arg-type]


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
