"""What a fit's own uncertainty, a log's resolution and rounding allow is no finding: each by an independent count."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

import ident
from ident.diagnosis.held_out import louder, undetermined
from ident.diagnosis.prediction_variance import prediction_variance, share_variance
from ident.effects.motion import Motion
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
ROBOT = ROBOTS["wrist"]()
MODEL, VALUES = declared(ROBOT)


def prepared(seed: int, sizes: tuple[float, ...] | float = 0.6, wrong: float = 1.0) -> Signals:
    """A log of an arm: `sizes`: of each joint's motion; `wrong`: factor of its parameters."""
    rng = np.random.default_rng(seed)
    harmonics = rng.normal(size=(2, 5, ROBOT.n)) / np.arange(1, 6)[:, None] * np.asarray(sizes)
    motion = FourierTrajectory(np.zeros(ROBOT.n), *harmonics, 0.1)
    t = np.arange(2000) / 200.0
    c = motion.sample(t)
    tau = MODEL.torque(Motion.of(ROBOT, c.q, c.dq, c.ddq, t, rate=200.0), wrong * VALUES)
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return ZeroPhase(cutoff_hz=10.0)(Log(f"log{seed}", t, q=c.q, tau={ROBOT.transmission.measured.value: tau}), ROBOT)


@pytest.fixture(scope="module")
def rich() -> ident.Estimate:
    return WeightedLeastSquares().solve(Problem(MODEL, prepared(1)))


def test_the_variance_of_a_prediction_is_that_of_draws_of_the_parameters(rich: ident.Estimate) -> None:
    other = prepared(2)
    draws = np.random.default_rng(0).multivariate_normal(rich.values, rich.covariance, size=3000)
    problem, base = rich.problem_on(other), rich.model.base
    columns = [problem.predict(base.base_values(rich.base.expand(value))) for value in np.eye(len(rich.values))]
    predicted = np.einsum("db,bMn->dMn", draws, np.stack(columns)[:, ::50])
    np.testing.assert_allclose(np.sqrt(prediction_variance(rich, other)[::50]), predicted.std(axis=0), rtol=0.08)
    weight = np.zeros_like(other.tau)
    weight[::50] = np.random.default_rng(1).normal(size=weight[::50].shape)
    sums = np.einsum("dMn,Mn->d", predicted, weight[::50])
    assert share_variance(rich, other, weight) == pytest.approx(sums.var(), rel=0.12)


def test_what_the_fitted_motion_did_not_determine_is_predicted_with_no_certainty() -> None:
    """A joint that stood still has no friction that the fit could know: where it moves, nothing is predicted of it."""
    still = (0.0,) + (0.6,) * (ROBOT.n - 1)
    poor = WeightedLeastSquares().solve(Problem(MODEL, prepared(3, still)))
    assert poor.base.count < MODEL.base.count
    variance = prediction_variance(poor, prepared(4))
    assert np.isinf(variance[:, 0]).mean() > 0.5
    assert np.isfinite(prediction_variance(poor, prepared(5, still))[:, 1:]).all()


def test_an_error_that_the_covariance_allows_is_no_contradiction_and_one_beyond_it_is(rich: ident.Estimate) -> None:
    small, usual = prepared(6, 0.02), prepared(7)
    poor = WeightedLeastSquares().solve(Problem(MODEL, small))
    plain = np.nanquantile(np.abs(poor.residual(usual)), 0.9, axis=0) / np.nanquantile(np.abs(poor.residual(small)), 0.9, axis=0)
    assert plain.max() > 3.0  # its error is far larger there
    assert louder(poor, small, usual) == ()
    assert louder(rich, prepared(1), usual) == ()
    assert louder(rich, prepared(1), prepared(7, wrong=1.3))
    # Said to be left open is the one that the covariance allows, by its own error, and it alone.
    told = {one.joint: one.times for one in undetermined(poor, small, usual)}
    assert told == pytest.approx({joint: x for joint, x in zip(ROBOT.joint_names, plain, strict=True) if x > 3.0})
    assert undetermined(rich, prepared(1), prepared(1)) == ()
    assert not {one.joint for one in undetermined(rich, prepared(1), prepared(7, wrong=1.3))} & {
        one.joint for one in louder(rich, prepared(1), prepared(7, wrong=1.3))
    }


def test_a_diagnosis_says_of_which_joints_held_out_data_decide_nothing() -> None:
    """Fitted to a small motion, judged on a usual one: the verdict stands on the fitted data, and the report says what it does not know."""
    found = ident.diagnose(WeightedLeastSquares().solve(Problem(MODEL, prepared(6, 0.02))), prepared(7))
    assert found.verdict == "clean"
    open_joints = [one.joint for one in found.undetermined]
    assert open_joints
    said = [line for line in str(found).splitlines() if line.startswith("no conclusion")]
    assert len(said) == 1
    assert all(joint in said[0] for joint in open_joints)
    assert [one["joint"] for one in found.to_dict()["undetermined"]] == open_joints
    assert ident.diagnose(WeightedLeastSquares().solve(Problem(MODEL, prepared(1))), prepared(1)).undetermined == ()


@pytest.mark.parametrize(("samples", "found"), [(0.4, False), (3.0, True)])
def test_half_a_sample_of_delay_is_no_finding(samples: float, found: bool) -> None:
    """What acted between two samples no log tells; a torque that is late by three is."""
    rng = np.random.default_rng(11)
    robot = ident.load_robot("scara")
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    assert robot.nominal is not None
    values = np.concatenate([robot.nominal, np.zeros(2 * robot.n)])
    motion = FourierTrajectory(np.zeros(robot.n), *0.5 * rng.normal(size=(2, 5, robot.n)) / np.arange(1, 6)[:, None], 0.2)
    t = np.arange(0.0, 40.0, 0.01)

    def torque(at: Array, values: Array) -> Array:
        c = motion.sample(at)
        return np.asarray(model.torque(Motion.of(robot, c.q, c.dq, c.ddq, at, rate=100.0), values))

    size = np.sqrt(np.mean(torque(t, values) ** 2, axis=0)) + 1e-3
    speed = np.sqrt(np.mean(motion.sample(t).dq ** 2, axis=0))
    values[-2 * robot.n :] = np.concatenate([0.1 * size / speed, 0.2 * size])
    late = torque(t - 0.01 * samples, values)
    tau = late + 0.002 * np.sqrt(np.mean(late**2, axis=0)) * rng.normal(size=late.shape)
    log = Log("late", t, q=motion.sample(t).q, tau={robot.transmission.measured.value: tau})
    diagnosis = ident.diagnose(WeightedLeastSquares().solve(Problem(model, ZeroPhase()(log, robot))))
    assert [f.name for f in diagnosis.findings if f.name in ("delay", "filter_lag")] == (["delay"] if found else [])
