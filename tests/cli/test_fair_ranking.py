"""A fit on raw second differences is ranked by an error that a right model wins: instruments before least squares, by every command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ident as package
from ident.planning import default_model
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.signals import CentralDifference, Recorded
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.sensors import Quantisation, Sensors
from ident.simulation.simulate import simulate_batch
from ident.simulation.trajectory import FourierTrajectory
from ident.statistics.torque_error import TorqueError

STUDY = """[robot]
name = "puma560"
[logs]
fit = ["train*.csv"]
validate = ["test.csv"]
[signals]
method = "central_difference"
[estimator]
"""
METHODS = {"ls": 'method = "ls"', "iv": 'method = "iv"\nloop = "open"'}


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, float]]:
    """A folder with logs of the PUMA on coarse encoders and two saved fits; the true torque error of each on exact motion."""
    folder = tmp_path_factory.mktemp("ranking")
    robot = load_robot("puma560")
    model = default_model(robot)
    values = nominal_values(model)
    lower = np.array([max(j.lower, -np.pi) for j in robot.joints])
    middle = 0.5 * (lower + np.minimum([j.upper for j in robot.joints], lower + 2 * np.pi))
    ways = []
    for seed in range(3):
        sine, cosine = 0.3 * np.random.default_rng(seed).normal(size=(2, 5, robot.n))
        ways.append(FourierTrajectory(middle, sine, cosine, 0.1))
    made = simulate_batch(
        Plant(model, values), desired=ways, controller=PDFeedforward.tuned(model, values), rate=200.0, control_rate=1000.0, step=1e-3,
        sensors=Sensors((Quantisation.counts(250.0),), Side.MOTOR, columns=("q", "tau")),
    )  # fmt: skip
    for name, run in zip(("train1", "train2", "test"), made, strict=True):
        run.to_csv(folder / f"{name}.csv")
    exact = made[-1].reread(Sensors((), Side.MOTOR, columns=("q", "dq", "ddq", "tau")), 0).log("exact")
    from ident.cli import main

    truth = {}
    for name, method in METHODS.items():
        (folder / f"{name}.toml").write_text(STUDY + method + "\n", encoding="utf-8")
        assert main(["fit", str(folder / f"{name}.toml"), "--out", str(folder / name), "--quiet"]) == 0
        truth[name] = package.Estimate.load(folder / name / "fit.json").torque_error(Recorded()(exact, robot)).relative_all
    return folder, truth


def test_raw_rows_rank_the_wrong_model_first(fits: tuple[Path, dict[str, float]]) -> None:
    folder, truth = fits
    assert truth["ls"] > 0.3
    assert truth["iv"] < 0.001
    signals = CentralDifference()(package.read_logs(str(folder / "test.csv"), load_robot("puma560")))
    raw = {}
    for name in METHODS:
        residual = package.Estimate.load(folder / name / "fit.json").residual(signals)
        raw[name] = TorqueError.of(residual, signals.tau).relative_all
    assert raw["iv"] > 2 * raw["ls"]


def test_fit_tells_the_true_error(fits: tuple[Path, dict[str, float]]) -> None:
    folder, truth = fits
    for name in METHODS:
        errors = json.loads((folder / name / "fit.json").read_text(encoding="utf-8"))["torque_error"]
        assert errors["heldout"]["relative_all"] == pytest.approx(truth[name], rel=0.1, abs=2e-3)
        assert errors["heldout"]["judged"] == errors["fit"]["judged"] == "known_band"
        assert 1.0 < errors["heldout"]["band_hz"] < 10.0
        assert "within the band where the motion is known" in (folder / name / "fit.txt").read_text(encoding="utf-8")
    # Saved and read again it is still known of what the error is.
    again = package.Estimate.load(folder / "iv" / "fit.json")
    assert again.heldout_error is not None
    assert again.heldout_error.judged == "known_band"


def test_compare_ranks_instruments_first(ident, fits: tuple[Path, dict[str, float]]) -> None:
    folder, truth = fits
    for before, after in (("ls", "iv"), ("iv", "ls")):
        ran = ident("compare", folder / before, folder / after, "--log", folder / "test.csv", "--json", "--quiet")
        assert ran.code == 0, ran.err
        assert (ran.json["gain"] > 0) == (after == "iv")
        for key, name in (("before", before), ("after", after)):
            assert ran.json[key]["heldout"]["relative_all"] == pytest.approx(truth[name], rel=0.1, abs=2e-3)
        assert "within the band where the motion is known" in ran.err
    assert ident("compare", folder / "ls", folder / "iv", "--log", folder / "test.csv", "--strict", "--quiet").code == 0


def test_validate_ranks_instruments_first_by_torque_and_by_replay(ident, fits: tuple[Path, dict[str, float]]) -> None:
    folder, _ = fits
    found = {}
    for name in METHODS:
        found[name] = ident("validate", "--fit", folder / name / "fit.json", "--validate", folder / "test.csv", "--json", "--quiet").json
    errors = {name: one["torque_error"]["heldout"]["relative_all"] for name, one in found.items()}
    assert errors["iv"] < 0.1 * errors["ls"]
    replayed = {name: np.sqrt(np.mean(np.square(one["replay"]["position_rms"]))) for name, one in found.items()}
    assert replayed["iv"] < 0.5 * replayed["ls"]


def test_filtered_signals_are_judged_by_their_own_rows(ident, fits: tuple[Path, dict[str, float]], tmp_path: Path) -> None:
    folder, _ = fits
    ran = ident("fit", "--robot", "puma560", "--log", folder / "train1.csv", "--validate", folder / "test.csv", "--json", "--quiet")
    error = ran.json["torque_error"]["heldout"]
    assert error["judged"] == "rows"
    assert f"of rows below {error['band_hz']:.3g} Hz" in ran.err


def test_what_is_streamed_says_that_its_error_is_against_raw_accelerations(ident, fits: tuple[Path, dict[str, float]]) -> None:
    folder, _ = fits
    ran = ident("fit", folder / "ls.toml", "--stream", "--json", "--quiet")
    assert ran.code == 0, ran.err
    assert ran.json["torque_error"]["heldout"]["judged"] == "rows"
    assert any("raw accelerations" in warning for warning in ran.json["warnings"])
