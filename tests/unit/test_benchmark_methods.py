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
        assert name in (out / "report.html").read_text(encoding="utf-8")
    assert {"figure_3_6_1.png", "figure_3_6_2.png", "figure_3_6_3.png", "figure_3_6_4.png", "motion_error.png"} <= set(results["figures"])
    quick = results["quick"]["methods"]
    error = {key: float(np.median(one["torque_error"])) for key, one in quick.items() if one["seeds"]}
    # Raw second differences spoil least squares; instruments made of the model's own motion do not mind them.
    assert error["iv"] < 0.05 * error["ls_raw"]
    assert error["wls"] < 0.05 * error["ls_raw"]
    assert all(r["bias"] <= 0.2 * r["bias_least_squares"] for r in results["requirements"])
    for recursion in results["recursion"].values():
        assert recursion["difference"] < 1e-8
        np.testing.assert_allclose(recursion["end"], recursion["batch"], rtol=1e-8)
    assert all(d["beats"] and d["holds"] for d in results["excitation"])
    said = capsys.readouterr().out
    assert "the source's claims" in said
    claims = results["claims"]
    assert {c["topic"] for c in claims} == {"precision", "labour", "computing", "data"}
    assert {c["verdict"] for c in claims} <= {"holds", "does not hold", "not comparable"}
    for claim in claims:
        assert claim["claim"] in said
        assert claim["measured"] in said
    # Over so few samples nothing is said of 40,000 points.
    assert {c["verdict"] for c in claims if c["topic"] == "data"} == {"not comparable"}


@pytest.mark.slow
def test_requirements_on_instrumental_variables_on_the_puma() -> None:
    """40 seeds of the full comparison's quick motion, and its closed loop with the measured torque for instruments (4 minutes)."""
    data = pytest.importorskip("benchmarks.methods.data")
    methods = pytest.importorskip("benchmarks.methods.methods").METHODS
    motions = pytest.importorskip("benchmarks.methods.motions")
    random_motion = pytest.importorskip("benchmarks.methods.random_motion")
    world = pytest.importorskip("benchmarks.methods.world").puma()
    scale = data.FULL
    quick = motions.torque_driven(
        world, [random_motion.fourier(world.model, seed, scale.seconds, data.FAST) for seed in range(scale.lanes)], scale.control_rate
    )
    made = data.Data(world, scale, quick, quick.part(slice(0, 0)), quick, {})
    trials = run._torque_driven(made, quick, 40, [methods["iv"], methods["ls_raw"]], tests=False)
    verdict = pytest.importorskip("benchmarks.methods.verdict")
    for asked in verdict.criteria(trials["iv"], trials["ls_raw"], world.groups):
        assert asked.passes, asked
    assert trials["iv"].coverage() > 0.925
    for seed in (1, 2, 3):
        found = methods["iv_dynamics"].solve(data.make_case(made, made.loop(seed), seed, feedback=True))
        assert found.status.code == "invalid_instruments"
        assert found.trace["validity"]["p_value"] < 1e-3


def test_plain_instruments_over_seeds() -> None:
    """A right model has no torque error by the measure of the table, and the table shows what was asked."""
    plain = pytest.importorskip("benchmarks.methods.plain")
    world = plain.puma()
    measure = plain.unseen_measure(world)
    assert measure(0.0 * world.truth) == 0.0
    kind = plain.Kind("quick", 2.7, 8, 0.9, 1000.0)
    found = plain.plain_seeds(world, kind, (1, 2), measure)
    assert found.samples == 8 * 540
    assert found.plain.shape == (2, plain.PASSES, 3)
    least, once = (np.abs(v / found.truth - 1.0).max() for v in (found.least, found.plain[:, 0]))
    assert once < 0.1 * least
    assert np.all(found.largest[:, 2] < 0.1 * found.largest[:, 0])
    assert np.all(found.errors <= found.largest)
    assert "quick, plain IV, pass 2" in plain.plain_table([found])
