"""Evaluation takes logs as they are read, and prepares them as those of the fit were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident
from ident.robots import robot_folder

TRAIN, TEST = (robot_folder("puma560") / f"demo/{part}.csv.gz" for part in ("train", "validate"))


@pytest.fixture(scope="module")
def estimate() -> ident.Estimate:
    return ident.fit(TRAIN, "puma560", held=0)


@pytest.mark.parametrize("given", [TEST, str(TEST), ident.demo_logs()[1], ident.demo_logs()[1][0]], ids=["path", "text", "logs", "log"])
def test_logs_are_prepared_as_those_of_the_fit(given: Any, estimate: ident.Estimate) -> None:
    """A path was an AttributeError, and ZeroPhase() chose another cut-off for the logs held out."""
    signals = estimate.prepared(given)
    assert signals.report.cutoff_hz == estimate.signals_config["cutoff_hz"]
    assert estimate.prepared(signals) is signals
    error = ident.validate(estimate, given).error
    np.testing.assert_array_equal(error.rms, ident.validate(estimate, signals).error.rms)


@pytest.mark.parametrize(
    "evaluated",
    [
        lambda estimate: ident.compare(estimate, estimate, TEST).error_after.relative_all,
        lambda estimate: ident.essential(estimate, TEST).reduced.heldout_error.relative_all,
        lambda estimate: ident.validate(estimate, TEST).error.relative_all,
    ],
    ids=["compare", "essential", "validate"],
)
def test_a_path_serves_every_evaluation(evaluated: Callable[[ident.Estimate], float], estimate: ident.Estimate) -> None:
    assert evaluated(estimate) < 0.01


def test_a_saved_fit_prepares_logs_too(estimate: ident.Estimate, tmp_path: Path) -> None:
    estimate.save(tmp_path / "fit.json")
    loaded = ident.Estimate.load(tmp_path / "fit.json")
    assert ident.monitor(loaded, TEST).verdict == "unchanged"
    with pytest.raises(ident.ConfigurationError, match="does not hold how its logs were prepared"):
        replace(loaded, signals_config={}).prepared(TEST)


def test_a_payload_is_of_two_fits(estimate: ident.Estimate) -> None:
    with pytest.raises(ident.ConfigurationError, match=r"with_load must be an estimate .* not str"):
        ident.payload(estimate, "loaded.csv")  # type: ignore[arg-type]


def test_a_log_of_lists() -> None:
    log = ident.Log("run", [0.0, 0.1], q=[[0, 1], [2, 3]], tau={"joint": [[0, 1], [2, 3]]})  # type: ignore[arg-type, dict-item]
    assert log.n == 2
    assert log.tau["joint"].dtype == float
    with pytest.raises(ident.ConfigurationError, match="tau tells its side"):
        ident.Log("run", np.zeros(2), q=np.zeros((2, 2)), tau=np.zeros((2, 2)))  # type: ignore[arg-type]
    with pytest.raises(ident.DataError, match="no table of numbers"):
        ident.Log("run", np.zeros(2), q=[[0, 1], [2]])  # type: ignore[arg-type]
