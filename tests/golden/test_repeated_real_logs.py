"""Instrumental variables and DIDIM on the EMPS log beside its published least-squares values (benchmarks/real/repeated.py)."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import shared_data

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.real.repeated import EMPS, EMPS_SIMULATED, attempts, emps_experiment, problem, published_friction
from ident.errors import UnsupportedError
from ident.estimate.status import StatusCode
from ident.estimators import make_estimator


@pytest.fixture(scope="module")
def emps():
    if not (shared_data() / "emps").is_dir():
        pytest.skip("the log of EMPS is not here")
    session, p = problem("emps")
    return emps_experiment(session), p


def near(found, share: float) -> None:
    for name, (value, _) in EMPS.items():
        assert found.value(name) == pytest.approx(value, rel=share, abs=3 * found.std[found.index(name)]), name


def test_instruments_along_the_reference(emps):
    experiment, p = emps
    found = make_estimator("iv", instruments="reference", loop="closed", experiment=experiment).solve(p)
    assert found.status.code == StatusCode.OK
    assert found.value("m_axis") == pytest.approx(EMPS["m_axis"][0], rel=0.01)
    near(found, 0.03)
    assert found.fit_error.relative_all < 0.0415


@pytest.mark.slow
def test_didim(emps):
    """Its torque error is that of the simulated loop, for which 5.85 % are published with the least-squares values."""
    experiment, p = emps
    found = make_estimator("didim", experiment=experiment, starts=1).solve(p)
    assert found.status.code == StatusCode.OK
    assert found.value("m_axis") == pytest.approx(EMPS["m_axis"][0], rel=0.005)
    near(found, 0.015)
    assert found.fit_error.relative_all < 0.75 * EMPS_SIMULATED / 100


@pytest.mark.slow
def test_tx40_beside_its_published_friction():
    """It logs no reference: DIDIM told nothing refuses and says what can be supposed; told that, it finds the published values."""
    if not (shared_data() / "tx40").is_dir():
        pytest.skip("the log of TX40 is not here")
    attempted = 0
    for log, label, method, p in attempts(short=False):
        if log != "tx40":
            continue
        attempted += 1
        if "told nothing" in label:
            with pytest.raises(UnsupportedError, match="assumed_experiment"):
                method.solve(p)
            continue
        # The published fit holds the rows near reversals.
        found = method.solve(replace(p, signals=replace(p.signals, near_reversal=None)))
        # The drive's torque answers to the noise of its encoders, and makes no instruments.
        assert found.status.code == (StatusCode.INVALID_INSTRUMENTS if "measured torque" in label else StatusCode.OK), label
        assert found.fit_error.relative_all < 0.08
        supposed = any("in their place" in warning for warning in found.warnings)
        assert supposed == ("DIDIM" in label or "along" in label), label
        for name, value, _, told in published_friction(p, found):
            assert value == pytest.approx(told, rel=0.08), (label, name)
    assert attempted == 6
