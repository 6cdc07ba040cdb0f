"""The comparison of the methods runs from end to end in its short form and writes what it says it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

run = pytest.importorskip("benchmarks.methods.run")


def test_short_comparison(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.main(True, tmp_path) == 0
    out = tmp_path / "methods"
    results = json.loads((out / "methods.json").read_text())
    for name in results["figures"]:
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    assert {"figure_3_6_1.png", "figure_3_6_2.png", "figure_3_6_3.png", "figure_3_6_4.png", "recursion.png"} <= set(results["figures"])
    quick = results["quick"]["methods"]
    error = {key: float(np.median(one["torque_error"])) for key, one in quick.items() if one["seeds"]}
    # Raw second differences spoil least squares; instruments made of the model's own motion do not mind them.
    assert error["iv"] < 0.05 * error["ls_raw"]
    assert error["wls"] < 0.05 * error["ls_raw"]
    assert all(r["bias"] <= 0.2 * r["bias_least_squares"] for r in results["requirements"])
    for recursion in results["recursion"].values():
        assert recursion["difference"] < 1e-9
        np.testing.assert_allclose(recursion["end"], recursion["batch"], rtol=1e-10)
    assert all(d["beats"] and d["holds"] for d in results["excitation"])
    said = capsys.readouterr().out
    assert "verdict on the dissertation's ranking" in said
    assert len(results["verdict"]) >= 6
