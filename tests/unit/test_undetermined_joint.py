"""A joint of which the fit had no row: nothing that is made of the fit may tell its parameters, or judge it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.effects.motion import Motion
from ident.errors import ConfigurationError
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.evaluation.comparison import compare
from ident.evaluation.validation import validate
from ident.excitation import sample_noise
from ident.exporting import Identified
from ident.exporting.targets.urdf_file import urdf_dynamics as _urdf_dynamics
from ident.logs.log import Log, LogSet
from ident.monitoring import monitor
from ident.physical.estimates import known_rows, repair_estimate, with_repair
from ident.physical.structure import InertiaStructure
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0
#: The joint without rows.
BLIND = 2
NOISE = np.array([0.05, 0.04, 0.06, 0.02])


def prepared(seed: int) -> Signals:
    """A log of a SCARA with white torque noise of known size."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    rng = np.random.default_rng(seed)
    order = np.arange(1, 25)
    weight = (1.0 / (4.0 + order))[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), rng.normal(size=(24, robot.n)) * weight, rng.normal(size=(24, robot.n)) * weight, 0.025)
    t = np.arange(round(38.0 * RATE)) / RATE
    c = motion.sample(t)
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE), values) + NOISE * rng.normal(size=c.q.shape)
    return ZeroPhase(cutoff_hz=15.0)(LogSet((Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau}),), robot=robot))


def fitted(signals: Signals) -> Estimate:
    return WeightedLeastSquares().solve(Problem(declared(signals.robot)[0], signals))


def without(signals: Signals) -> Signals:
    """The same, but for the torque of one joint."""
    missing = np.arange(signals.robot.n) == BLIND
    return replace(
        signals,
        valid=signals.valid & ~missing,
        tau=np.where(missing, np.nan, signals.tau),
        torque=np.where(missing, np.nan, signals.torque),
    )


@pytest.fixture(scope="module")
def parts() -> tuple[Signals, Signals]:
    return prepared(1), prepared(2)


@pytest.fixture(scope="module")
def blind(parts: tuple[Signals, Signals]) -> Estimate:
    found = fitted(without(parts[0]))
    assert found.fit_error.rows[BLIND] == 0
    assert found.dropped
    return found


def test_a_gain_is_weighed_by_the_noise_that_either_fit_knows(parts: tuple[Signals, Signals], blind: Estimate) -> None:
    full = fitted(parts[0])
    there = compare(full, blind, parts[1])
    assert there.floor == pytest.approx(np.where(np.arange(4) == BLIND, full.fit_error.rms, blind.fit_error.rms))
    assert there.error_after.rms[BLIND] > 3.0 * there.error_before.rms[BLIND]
    assert there.gain < -1.0
    # Where neither has any, the joint has no part in it.
    weight = blind.fit_error.rms**-2.0
    other = replace(blind, values=1.01 * blind.values)
    errors = [e.torque_error(parts[1]) for e in (other, blind)]
    before, after = (np.nansum(weight * e.rms**2 * e.rows) for e in errors)
    assert compare(other, blind, parts[1]).gain == pytest.approx(1.0 - after / before)


def test_monitoring_says_that_it_knows_nothing_of_a_joint(parts: tuple[Signals, Signals], blind: Estimate) -> None:
    name = blind.model.robot.joint_names[BLIND]
    found = monitor(blind, parts[1])
    assert found.verdict == "unexplained"
    (said,) = [u for u in found.unexplained if u.signature == "not known from the fit"]
    assert said.joint == name
    assert "fit again" in said.evidence
    # Of a log that does not have its torque, either, nothing is asked.
    assert monitor(blind, without(parts[1])).verdict == "unchanged"


def test_only_what_was_determined_is_exported(parts: tuple[Signals, Signals], blind: Estimate) -> None:
    repaired = with_repair(blind, repair_estimate(blind))
    name = blind.model.robot.joint_names[BLIND]
    for estimate in (blind, repaired):
        found = Identified.of(estimate)
        assert {p for p in found.undetermined if p.endswith(name)} == set(found.undetermined) != set()
        values = dict(zip(found.model.names, found.values, strict=True))
        assert all(values[p] == 0.0 for p in found.undetermined)
        assert any("not determined by the data" in note and found.undetermined[0] in note for note in found.notes)
        assert all(told.tolist() == [True, True, False, True] for told in found.identified().values())
    assert Identified.of(fitted(parts[0])).undetermined == ()


def test_a_urdf_keeps_what_the_model_does_not_have() -> None:
    from ident.friction import Viscous

    robot = ROBOTS["seven"]()
    assert robot.transmission.is_diagonal
    first, second = robot.joint_names[:2]
    model = robot.rigid_body() + Viscous(joints=(first, second))
    values = np.r_[np.ones(len(model.parameters) - 2), 2.0, 3.0]
    k = np.abs(np.diagonal(robot.transmission.K))
    told, _ = _urdf_dynamics(Identified(model, values))
    assert told == {"damping": {first: pytest.approx(2.0 / k[0] ** 2), second: pytest.approx(3.0 / k[1] ** 2)}, "friction": {}}
    told, _ = _urdf_dynamics(Identified(model, values, undetermined=(model.names[-1],)))
    assert list(told["damping"]) == [first]


def test_a_repair_does_not_make_known_what_the_data_did_not_see(blind: Estimate) -> None:
    repaired = with_repair(blind, repair_estimate(blind))
    assert repaired.dropped == blind.dropped
    assert len(repaired.values) == repaired.model.base.count > len(blind.values)
    std = dict(zip(repaired.names, repaired.std, strict=True))
    assert all(std[name] > np.abs(repaired.values).max() for name in blind.dropped)
    # What both know of the parameters is the same.
    structure = InertiaStructure.from_model(repaired.model, repaired.model.base)
    R0, R1 = (known_rows(e, structure)[0] for e in (blind, repaired))
    np.testing.assert_allclose(R1.T @ R1, R0.T @ R0, atol=1e-5 * np.abs(R0.T @ R0).max())


def test_validation_without_a_replay_says_why(parts: tuple[Signals, Signals]) -> None:
    full = fitted(parts[0])
    found = validate(full, without(parts[1]), simulate=True)
    assert found.replay is None
    assert np.isfinite(found.error.rms[[0, 1, 3]]).all()
    (note,) = found.notes
    assert f"({full.model.robot.joint_names[BLIND]}: none at all)" in note
    assert note in str(found)
    assert found.to_dict()["notes"] == [note]
    assert validate(full, parts[1]).notes == ()


def test_an_excitation_takes_thesample_noise_a_fit(parts: tuple[Signals, Signals], blind: Estimate) -> None:
    """White noise of known size, whatever filter the rows went through."""
    full: Any = replace(fitted(parts[0]), signals_config=parts[0].report.to_dict())
    assert sample_noise(full, RATE) == pytest.approx(NOISE, rel=0.2)
    assert sample_noise(full, 2.0 * RATE) == pytest.approx(np.sqrt(2.0) * np.array(sample_noise(full, RATE)))
    with pytest.raises(ConfigurationError, match=f"no noise of {full.model.robot.joint_names[BLIND]}"):
        sample_noise(replace(blind, signals_config=full.signals_config), RATE)
