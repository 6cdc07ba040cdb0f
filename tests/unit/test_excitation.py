"""Exciting trajectories: within limits, better than chance, and as informative as they promise."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import pendulum, seven

from ident.effects.motion import Motion
from ident.effects.offset import Offset
from ident.errors import ConfigurationError, UnsupportedError
from ident.excitation import (
    Both,
    BSplineFamily,
    ConditionNumber,
    DOptimality,
    Excitation,
    FourierFamily,
    Limits,
    excite,
    random_excitation,
    tell_apart,
)
from ident.excitation.information import MotionInformation
from ident.excitation.search import TrajectorySearch
from ident.friction import AsymmetricViscous, Coulomb, RotorInertia, Stribeck, Viscous
from ident.model import Model
from ident.robots import load_robot, nominal_values


def _model(name: str) -> Model:
    joints = [f"panda_joint{i}" for i in range(1, 8)] if name == "panda" else None
    try:
        robot = load_robot(name, joints=joints)
    except ConfigurationError as error:
        if name == "puma560":
            raise
        pytest.skip(f"robot {name} is not installed: {error}")
    return robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()


@pytest.fixture(scope="module")
def puma() -> Model:
    return _model("puma560")


def _check_limits(found: Excitation) -> None:
    """All limits hold to 1e-9 however finely one looks."""
    limits, T = found.limits, found.trajectory.duration
    motion = found.trajectory.sample(np.linspace(0, T, 20001))
    assert np.all(motion.q <= limits.upper + 1e-9)
    assert np.all(motion.q >= limits.lower - 1e-9)
    assert np.all(np.abs(motion.dq) <= limits.velocity + 1e-9)
    assert np.all(np.abs(motion.ddq) <= limits.acceleration + 1e-9)
    model = found.model
    robot = model.robot
    if np.isfinite(limits.torque).any() and robot.nominal is not None:
        tau = model.torque(Motion.of(robot, motion.q, motion.dq, motion.ddq), nominal_values(model))
        on_joint = robot.transmission.torque(tau, robot.transmission.measured, "joint")
        assert np.all(np.abs(on_joint) <= limits.torque + 1e-9)


def _beats(found: Excitation, chance: list[Excitation]) -> None:
    volume = DOptimality()
    assert volume.exact(found.information, found.names) < min(volume.exact(c.information, c.names) for c in chance)
    assert found.condition < min(c.condition for c in chance)


def test_designed_motion_beats_random_motion_within_limits(puma: Model) -> None:
    family = FourierFamily(8.0, 4)
    found = excite(puma, family=family, starts=1, iterations=20)
    _check_limits(found)
    chance = [random_excitation(puma, family=family, seed=s) for s in range(20)]
    _beats(found, chance)
    for c in chance[:3]:
        _check_limits(c)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["puma560", "panda", "ur5"])
def test_better_than_the_best_of_a_hundred(name: str) -> None:
    """In volume and in condition number, by one design that looks at both, and each by a design of its own."""
    model = _model(name)
    chance = [random_excitation(model, seed=s) for s in range(100)]
    found = excite(model)
    _check_limits(found)
    _beats(found, chance)
    for measure in (DOptimality(), ConditionNumber()):
        own = excite(model, measure=measure, starts=2)
        _check_limits(own)
        best = min(measure.exact(c.information, c.names) for c in chance)
        assert measure.exact(own.information, own.names) < best


def test_gradient_is_that_of_the_function() -> None:
    """Against central differences, on a smooth model: measure, barrier of all limits, torque included."""
    robot = load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous()
    limits = Limits.of(robot, torque=[90.0, 150.0, 80.0, 12.0, 12.0, 12.0], jerk=40.0)
    info = MotionInformation(model, nominal_values(model), np.array([0.1, 0.2, 0.1, 0.01, 0.01, 0.01]))
    rng = np.random.default_rng(0)
    for family in (FourierFamily(6.0, 3), BSplineFamily(6.0, 9)):
        for measure in (DOptimality(), ConditionNumber(), Both(0.7), DOptimality(model.base.names[3:6])):
            search = TrajectorySearch(info, limits, family, measure)
            start = search.random(rng, 0.6)
            x = np.concatenate([start.coefficients.reshape(-1), start.offset])
            value, gradient = search.barrier_value(x, 0.05, True)
            assert np.isfinite(value)
            d = rng.normal(size=x.size)
            d /= np.linalg.norm(d)
            h = 1e-5
            slope = (search.barrier_value(x + h * d, 0.05, False)[0] - search.barrier_value(x - h * d, 0.05, False)[0]) / (2 * h)
            assert abs(gradient @ d - slope) < 1e-5 * (1 + np.abs(gradient).max())


def test_expected_deviations_hold_in_monte_carlo(puma: Model) -> None:
    noise = np.array([0.5, 0.5, 0.3, 0.05, 0.04, 0.04]) * 0.1
    found = random_excitation(puma, noise=noise, family=FourierFamily(5.0, 4), rate=100.0, seed=2)
    t = np.arange(501) / 100.0
    motion = found.trajectory.sample(t)
    columns = puma.columns(Motion.of(puma.robot, motion.q, motion.dq, motion.ddq))[:, :, puma.base.independent]
    flat = (columns / noise[:, None]).reshape(-1, len(found.names))
    truth = puma.base.base_values(nominal_values(puma))
    rng = np.random.default_rng(0)
    runs = 400
    data = (columns @ truth / noise).reshape(-1, 1) + rng.normal(size=(flat.shape[0], runs))
    scale = np.linalg.norm(flat, axis=0)
    estimates = np.linalg.lstsq(flat / scale, data, rcond=None)[0] / scale[:, None]
    ratio = estimates.std(axis=1, ddof=1) / found.expected_std()
    # The deviation of a standard deviation of 400 runs is 1/sqrt(800) = 3.5 %.
    assert np.all(np.abs(ratio - 1) < 5 * 0.0354)
    assert abs(ratio.mean() - 1) < 0.02


def test_length_for_an_accuracy_is_that_of_enough_passes(puma: Model) -> None:
    found = random_excitation(puma, family=FourierFamily(5.0, 4), seed=1)
    std = found.expected_std()
    name = found.names[7]
    assert found.seconds_for({name: std[7] / 3.0}) == pytest.approx(9 * 5.0)
    np.testing.assert_allclose(found.expected_std(passes=9.0), std / 3.0)
    with pytest.raises(ConfigurationError, match="Izz"):
        found.seconds_for({"Izz_joint33": 1.0})


def test_one_parameter_can_be_sharpened(puma: Model) -> None:
    name = "Ixy_joint5"
    assert name in puma.base.names
    place = puma.base.names.index(name)
    family = FourierFamily(6.0, 3)
    whole = excite(puma, family=family, measure=DOptimality(), starts=1, iterations=15)
    sharp = excite(puma, family=family, measure=DOptimality((name,)), starts=1, iterations=15)
    assert sharp.expected_std()[place] < 0.9 * whole.expected_std()[place]


def test_two_effects_are_told_apart_better() -> None:
    robot = seven()
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    rivals = AsymmetricViscous(joints=("j2",)), Stribeck(joints=("j2",), v_s=8.0)
    both, measure = tell_apart(model, *rivals)
    assert len(measure.parameters) == 2
    family = BSplineFamily(6.0, 8)
    found = excite(both, family=family, measure=measure, starts=1, iterations=8)
    chance = min(random_excitation(both, family=family, measure=measure, seed=s).value for s in range(10))
    assert found.value < chance
    vertical = pendulum()
    declared = model + rivals[1]
    same, measure = tell_apart(declared, Coulomb(), Stribeck())
    assert same is declared, "both are in the model"
    assert {"Fc_j1", "Fc_j2", "Fs_j2"} <= set(measure.parameters)
    with pytest.raises(ConfigurationError, match="distinguished from itself"):
        tell_apart(model, Coulomb(), Coulomb())
    with pytest.raises(UnsupportedError, match="rotor_inertia"):
        tell_apart(vertical.rigid_body(), RotorInertia(), Offset())


def test_result_is_written_and_told(puma: Model, tmp_path) -> None:
    import pandas as pd

    found = random_excitation(puma, family=FourierFamily(5.0, 4), rate=100.0)
    table = pd.read_csv(found.to_csv(tmp_path / "excitation.csv"))
    assert list(table.columns[:7]) == ["t", "q1", "q2", "q3", "q4", "q5", "q6"]
    np.testing.assert_array_equal(table[["q1", "q2", "q3"]].to_numpy(), found.trajectory.sample(table["t"].to_numpy()).q[:, :3])
    told = found.to_dict(nominal_values(puma))
    assert len(told["parameters"]) == 52
    assert all(p["expected_std"] > 0 for p in told["parameters"])
    assert "condition" in str(found)


def test_limits_from_the_description_and_given() -> None:
    robot = pendulum()
    limits = Limits.of(robot, share=0.5)
    np.testing.assert_allclose([limits.lower[0], limits.upper[0], limits.velocity[0], limits.torque[0]], [-1.25, 1.25, 2.5, 50.0])
    np.testing.assert_allclose(limits.acceleration, 2.5 / 0.3)
    assert Limits.of(robot, acceleration=4.0).acceleration[0] == 4.0
    with pytest.raises(ConfigurationError, match="velocity"):
        Limits.of(robot, velocity=0.0)
    with pytest.raises(ConfigurationError, match="lower limit below"):
        Limits.of(robot, lower=[2.0], upper=[1.0])
    with pytest.raises(ConfigurationError, match="one number or 1"):
        Limits.of(robot, velocity=[1.0, 2.0])
    heavy = robot.rigid_body() + Viscous()
    with pytest.raises(ConfigurationError, match="carry the robot"):
        excite(heavy, limits=Limits.of(robot, torque=1e-6), starts=1)
