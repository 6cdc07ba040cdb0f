"""From logs to a consistent estimate, its repair, payload and export: what a user calls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from physical_models import puma_model

import ident
from ident.effects.motion import Motion
from ident.errors import ConfigurationError
from ident.estimate.status import StatusCode
from ident.estimators import WeightedLeastSquares, make_estimator
from ident.exporting import Identified, export_urdf
from ident.logs.log import Log, LogSet
from ident.physical import judge, payload_of, repair_estimate, standard_parameters, subject_of, with_repair
from ident.physical.pseudo_inertia import from_centre_of_mass, smallest_eigenvalues
from ident.physical.structure import InertiaStructure
from ident.problem.problem import Problem
from ident.robots import nominal_values
from ident.robots.robot import Robot
from ident.signals import Recorded, Signals

Array = np.ndarray


def signals(seed: int, *, still: tuple[int, ...] = (), load: Array | None = None, noise: float = 0.3) -> Signals:
    """A short noisy log of the PUMA 560 along Fourier motion; joints `still` do not move."""
    model = puma_model()
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 6.0, 0.02)
    q, dq, ddq = (np.zeros((len(t), 6)) for _ in range(3))
    for h in range(1, 6):
        w = 2 * np.pi * 0.2 * h
        a, b = rng.normal(size=(2, 6)) * 0.5 / h
        a[list(still)], b[list(still)] = 0.0, 0.0
        q += a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None]
        dq += w * (a * np.cos(w * t)[:, None] - b * np.sin(w * t)[:, None])
        ddq -= w * w * (a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None])
    values = nominal_values(model)
    if load is not None:
        values[50:60] += load
    tau = model.torque(Motion.of(model.robot, q, dq, ddq, t), values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    log = Log("run", t, q, dq=dq, ddq=ddq, tau={"motor": tau})
    return Recorded()(LogSet((log,), model.robot))


@pytest.fixture(scope="module")
def fitted() -> tuple[ident.Estimate, Problem, Signals]:
    problem = Problem(puma_model(), signals(1))
    return WeightedLeastSquares().solve(problem), problem, signals(2)


def test_physical_estimator(fitted: tuple[ident.Estimate, Problem, Signals]) -> None:
    """Least squares on a short noisy log is not consistent; the constrained fit is, and predicts unseen motion no worse."""
    plain, problem, held = fitted
    assert not judge(plain).consistent.consistent  # type: ignore[union-attr]
    found = make_estimator("physical").solve(problem)
    verdict = judge(found)
    assert verdict.possible.possible
    assert verdict.possible.certified
    assert verdict.consistent is not None
    assert verdict.consistent.consistent
    assert found.status.code == StatusCode.AT_BOUND
    assert "No real robot" in found.status.text
    assert found.trace["cost"] > 1
    assert "Constraints that bind" in " ".join(found.summary().split())
    assert found.trace["binding"]["costs"]
    total = float(problem.model.robot.nominal[::10].sum())  # type: ignore[index]
    assert 0.2 * total < Identified.of(found).inertial[::10].sum() < 2 * total
    assert set(found.trace["unconstrained"]) == set(found.names)
    assert found.torque_error(held).relative_all <= 1.01 * plain.torque_error(held).relative_all
    truth = found.base.base_values(nominal_values(puma_model()))
    assert np.linalg.norm((found.values - truth) / plain.std) < np.linalg.norm((plain.values - truth) / plain.std)


def test_physical_estimator_with_knowledge(fitted: tuple[ident.Estimate, Problem, Signals]) -> None:
    _, problem, held = fitted
    plain = make_estimator("physical").solve(problem)
    total = float(problem.model.robot.nominal[::10].sum())  # type: ignore[index]
    known = make_estimator("physical", spread=0.3, metric="entropic", total_mass=(0.9 * total, 1.1 * total)).solve(problem)
    standard = Identified.of(known)
    assert judge(known).consistent.consistent  # type: ignore[union-attr]
    assert known.torque_error(held).relative_all < plain.torque_error(held).relative_all
    assert np.all(smallest_eigenvalues(standard.inertial) > 0)
    other = make_estimator("physical", solver="log_cholesky").solve(problem)
    assert any("fallback" in text for text in other.warnings)
    # The exact fit gives away one squared standard deviation for links that make sense.
    assert other.trace["cost"] >= plain.trace["cost"] - 1.01


def test_consistent_solution_is_least_squares() -> None:
    """Where the unconstrained solution is consistent, the physical estimate is that solution."""
    problem = Problem(puma_model(), signals(3, noise=0.0))
    plain, found = WeightedLeastSquares().solve(problem), make_estimator("physical").solve(problem)
    assert np.allclose(found.values, plain.values, rtol=1e-9, atol=1e-12)
    assert found.status.code == StatusCode.OK


@pytest.mark.parametrize(
    ("keys", "words"),
    [({"solver": "magic"}, "solver"), ({"metric": "straight"}, "metric"), ({"spread": -1.0}, "spread must be positive")],
)
def test_bad_configurations(keys: dict[str, object], words: str, fitted: tuple[ident.Estimate, Problem, Signals]) -> None:
    with pytest.raises(ConfigurationError, match=words):
        make_estimator("physical", **keys).solve(fitted[1])


def test_repair_of_an_estimate(fitted: tuple[ident.Estimate, Problem, Signals], tmp_path: Path) -> None:
    plain, _, held = fitted
    found = repair_estimate(plain, held=held)
    assert found.consistent is not None
    assert found.consistent.consistent
    assert set(found.errors) == {"fitted", "held out"}
    repaired = with_repair(plain, found)
    assert np.array_equal(repaired.values, found.values)
    assert repaired.fit_error.relative_all == pytest.approx(found.errors["fitted"]["after"]["relative_all"])
    written = export_urdf(repaired, None, tmp_path / "out.urdf")
    again = Robot.from_urdf(tmp_path / "out.urdf")
    structure = InertiaStructure.from_model(plain.model, plain.base)
    full = Identified.of(repaired).values
    assert np.allclose(again.nominal, full[structure.inertial], rtol=1e-9, atol=1e-12)
    assert np.allclose(structure.regroup @ full, found.values, rtol=1e-8, atol=1e-8)
    assert written.bodies[5].link == "link6"
    with pytest.raises(ConfigurationError, match="physical"):
        export_urdf(plain, None, tmp_path / "no.urdf")
    assert not (tmp_path / "no.urdf").exists()


def test_a_joint_that_did_not_move() -> None:
    """What the log could not show is said, and chosen so that the robot is real."""
    plain = WeightedLeastSquares().solve(Problem(puma_model(), signals(4, still=(3,))))
    assert plain.dropped
    subject = subject_of(plain)
    assert subject.unseen is not None
    assert subject.unseen.shape[1] == len(plain.dropped)
    assert "not determined by the data" in subject.notes[0]
    # Unseen directions change nothing that the estimate holds.
    seen = plain.base.regroup @ subject.structure.lift
    assert np.abs(seen @ subject.unseen).max() < 1e-9
    assert np.allclose(seen @ subject.values, plain.values, rtol=1e-9, atol=1e-9)
    for method in ("fit", "consistent"):
        found = repair_estimate(plain, method)
        assert found.consistent is not None
        assert found.consistent.consistent
        assert np.isfinite(found.distance)
    physical = make_estimator("physical").solve(Problem(puma_model(), signals(4, still=(3,))))
    assert len(physical.values) == len(plain.values)
    structure = InertiaStructure.from_model(physical.model, physical.base)
    assert np.all(smallest_eigenvalues(standard_parameters(structure, physical.values).inertial) > 0)


def test_payload_of_two_estimates() -> None:
    load = from_centre_of_mass(1.6, np.array([-0.07, 0.07, 0.11]), np.diag([0.0075, 0.0075, 0.013]))
    without = WeightedLeastSquares().solve(Problem(puma_model(), signals(5, noise=0.01)))
    with_load = WeightedLeastSquares().solve(Problem(puma_model(), signals(6, noise=0.01, load=load)))
    found = payload_of(without, with_load)
    assert found.significant
    assert found.mass == pytest.approx(1.6, abs=4 * found.mass_std)
    assert np.all(np.abs(found.unconstrained - load) < 5 * found.std)
    from dataclasses import replace

    # Covariances say it all: the information blocks are not needed.
    saved = payload_of(replace(without, information=None), replace(with_load, information=None))
    assert np.allclose(saved.values, found.values, rtol=1e-9)
    # A joint that stood still with the load leaves things open, and that is said.
    still = WeightedLeastSquares().solve(Problem(puma_model(), signals(7, noise=0.01, load=load, still=(3,))))
    partly = payload_of(without, still)
    assert abs(partly.mass - 1.6) < 5 * partly.mass_std
    assert any("with the load" in note for note in partly.notes)
    with pytest.raises(ConfigurationError, match="different models"):
        payload_of(without, replace(with_load, model=puma_model().robot.rigid_body()))
