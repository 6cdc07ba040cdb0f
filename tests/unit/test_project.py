"""The package itself: light to import, complete when installed, described once."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
import tomllib
from pathlib import Path, PurePosixPath

import pytest

import ident

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("pinocchio", "pandas", "scipy", "matplotlib", "clarabel", "yourdfpy", "filterpy", "dask", "pyarrow", "numba")


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def loaded_by(code: str) -> set[str]:
    """Top-level modules that a fresh interpreter holds after running `code`."""
    run = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys\nprint(*sys.modules)"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return {name.split(".")[0] for name in run.stdout.split()}


@pytest.mark.parametrize(
    "code", ["import ident", "import ident; ident.Robot, ident.Transmission, ident.Study, ident.Model, ident.make_effect"]
)
def test_heavy_libraries_load_when_they_are_used(code):
    assert not loaded_by(code) & set(HEAVY)


def test_every_public_name_loads():
    for name in ident.__all__:
        assert getattr(ident, name) is not None, name
    assert set(ident.__all__) <= set(dir(ident))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        ident.nothing  # noqa: B018


def test_data_files_are_packaged(project):
    """Every file beside the code that is not code is covered by a pattern of package data."""
    patterns = project["tool"]["setuptools"]["package-data"]["ident"]
    package = ROOT / "ident"
    missed = []
    for folder, folders, files in os.walk(package):
        folders[:] = [f for f in folders if f != "__pycache__"]
        for file in files:
            path = PurePosixPath((Path(folder) / file).relative_to(package).as_posix())
            if path.suffix in (".py", ".pyc", ".so", ".pyd"):
                continue
            if not any(path.match(p.removeprefix("**/")) for p in patterns):
                missed.append(str(path))
    assert not missed


def test_one_version(project):
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "ident._utils.version.__version__"}
    try:
        installed = importlib.metadata.version("ident")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("not installed: the tests run from a checkout")
    assert installed == ident.__version__


def test_console_script_and_extras(project):
    assert project["project"]["scripts"]["ident"] == "ident.cli:main"
    assert {"report", "sdp", "dask", "bags", "robots", "test"} <= set(project["project"]["optional-dependencies"])
    core = {d.split(">")[0].split("[")[0] for d in project["project"]["dependencies"]}
    assert core == {"numpy", "scipy", "pin", "pandas", "lxml", "yourdfpy", "filterpy", "threadpoolctl"}


def test_the_check_is_a_script_that_parses():
    script = ROOT / ".ci" / "run"
    if not script.is_file():
        pytest.skip("not a checkout")
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_no_path_of_one_machine():
    """Nothing in the project names the place where it was made."""
    marks = [f"/{place}/" for place in ("work", "root", "tmp")] + ["/home" + "/"]
    files = [
        f
        for folder in ("ident", "benchmarks", "docs")
        for f in (ROOT / folder).rglob("*")
        if f.suffix in (".py", ".md", ".toml", ".json", ".urdf")
    ]
    found = [str(f) for f in files if any(mark in f.read_text(encoding="utf-8") for mark in marks)]
    assert not found
