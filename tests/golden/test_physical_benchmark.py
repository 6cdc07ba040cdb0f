"""The physical benchmark on a few robots: no false alarm, no miss, every repair passes its own judgement."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("clarabel")


def test_short_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from benchmarks.physical.run import main

    assert main(short=True, folder=tmp_path) == 0
    report = json.loads((tmp_path / "physical.json").read_text())
    assert report["battery"]["false_alarms"] == report["battery"]["misses"] == 0
    assert report["cones"]["differ"] == report["cones"]["failed"] == report["cones"]["unproven"] == 0
    assert 0 < report["cones"]["possible"] < report["cones"]["count"] == 10
    costs = {row["method"]: row["distance"] for row in report["table 2"]}
    assert all(row["passes"] for row in report["table 2"])
    assert costs["possible"] <= costs["stepwise"]
    assert "table 2, possible" in capsys.readouterr().out
