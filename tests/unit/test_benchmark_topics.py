"""Topics of the benchmarks say what they need before they begin."""

from __future__ import annotations

import re
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

import benchmarks.__main__ as benchmarks_main

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("topic", sorted(benchmarks_main.NEEDS))
def test_what_is_lacking_is_said_with_the_remedy(topic: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    missing, known = benchmarks_main.NEEDS[topic][0], benchmarks_main.version

    def version(name: str) -> str:
        if name == missing:
            raise PackageNotFoundError(name)
        return known(name)

    assert not benchmarks_main.lacking(topic), "the tests' environment has it all"
    monkeypatch.setattr(benchmarks_main, "version", version)
    monkeypatch.setattr(sys, "argv", ["benchmarks", topic, "--out", "/dev/null/never"])
    monkeypatch.setattr(Path, "mkdir", lambda *_, **__: None)
    assert benchmarks_main.main() == 1
    said = capsys.readouterr()
    assert missing in said.err
    assert "pip install" in said.err
    assert "==" not in said.out, "it began"


def test_every_package_that_a_topic_imports_is_needed_or_required() -> None:
    """Third-party packages that files of the benchmarks import are requirements of `ident`, or said to be needed, or looked for on use."""
    optional = {"pyarrow", "rosbags"}
    for topic in sorted(p.parent.name for p in (ROOT / "benchmarks").glob("*/run.py")):
        text = "\n".join(p.read_text() for p in (ROOT / "benchmarks" / topic).rglob("*.py"))
        imported = set(re.findall(r"^(?:import|from) (\w+)", text, flags=re.MULTILINE)) & optional
        assert imported <= set(benchmarks_main.NEEDS.get(topic, ())), topic
