"""The published schema of study files is that of the classes, and judges files as the reader does."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from ident.errors import IdentError
from ident.study.schema import study_schema
from ident.study.study import read_study

ROOT = Path(__file__).parents[2]
jsonschema = pytest.importorskip("jsonschema")


def fits(text: str) -> bool:
    return jsonschema.Draft202012Validator(study_schema()).is_valid(tomllib.loads(text))


def reads(text: str, folder: Path) -> bool:
    (folder / "study.toml").write_text(text)
    try:
        study = read_study(folder / "study.toml")
        study.model()
        study.make_estimator()
        study.make_preparation()
    except IdentError:
        return False
    return True


def test_the_published_file_is_made_from_the_classes() -> None:
    published = json.loads((ROOT / "docs/study.schema.json").read_text(encoding="utf-8"))
    assert published == study_schema(), "write it again: python -m ident study-schema -o docs/study.schema.json --force"
    jsonschema.Draft202012Validator.check_schema(published)


@pytest.mark.parametrize("file", [*ROOT.glob("benchmarks/real/*.toml"), *ROOT.glob("docs/*.md")], ids=lambda f: f.name)
def test_studies_of_the_repository_fit(file: Path) -> None:
    """All but those that name plugins: a schema knows the built-in effects alone."""
    text = file.read_text(encoding="utf-8")
    blocks = [text] if file.suffix == ".toml" else re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    for block in blocks:
        if not any(part in block for part in ("[project.", "[[recorder]]", "[plugins]")):
            assert fits(block), next(jsonschema.Draft202012Validator(study_schema()).iter_errors(tomllib.loads(block))).message


HEAD = '[robot]\nname = "puma560"\n'


@pytest.mark.parametrize(
    "text",
    [
        HEAD,
        '[robot]\nname = "scara"\ngravity = [0, 0, -9.81]\n[drive]\nmeasured = "joint"\n',
        HEAD + '[drive]\neffects = ["viscous", { name = "stribeck", joints = ["joint1"], v_s = 0.2 }]\n',
        HEAD + '[drive]\neffects = "viscous"\n',
        HEAD + '[estimator]\nmethod = "irls"\n[signals]\nmethod = "savitzky_golay"\ndegree = 3\n',
        HEAD + '[signals]\ncutoff_hz = 10\nrows_near_reversals = "keep"\n',
        HEAD + '[plugins]\nmodules = []\n[columns]\nq1 = "a"\n[logs]\nfit = "a.csv"\nmissing = "gap"\n',
    ],
)
def test_what_the_reader_takes_fits(text: str, tmp_path: Path) -> None:
    assert reads(text, tmp_path)
    assert fits(text)


@pytest.mark.parametrize(
    "text",
    [
        HEAD + "speed = 1\n",
        HEAD + "gravity = [0, -9.81]\n",
        HEAD + 'urdf = "a.urdf"\n',
        HEAD + '[drive]\nmeasured = "both"\n',
        HEAD + '[drive]\neffects = ["stribec"]\n',
        HEAD + '[drive]\neffects = [{ name = "stribeck", v = 0.2 }]\n',
        HEAD + '[drive]\neffects = [{ name = "stribeck", v_s = "fast" }]\n',
        HEAD + '[estimator]\nmethod = "none of these"\n',
        HEAD + "[estimator]\nforget = 1\n",
        HEAD + '[signals]\nmethod = "savitzky_golay"\ndegree = "high"\n',
        HEAD + '[signals]\nrows_near_reversals = "no"\n',
        HEAD + "[logs]\nrate_hz = true\n",
        HEAD + "[columns]\nq1 = 3\n",
        HEAD + "[motors]\nx = 1\n",
    ],
)
def test_what_the_reader_refuses_does_not_fit(text: str, tmp_path: Path) -> None:
    assert not reads(text, tmp_path)
    assert not fits(text)
