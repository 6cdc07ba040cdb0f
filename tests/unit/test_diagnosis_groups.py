"""What a robot mostly has on all joints is found on those that ask for it, and on no other."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.diagnosis import Diagnosis, diagnose
from ident.effects.base import Effect
from ident.effects.motion import Motion
from ident.effects.offset import Offset
from ident.estimators import WeightedLeastSquares
from ident.friction.drive import Coulomb, RotorInertia, Viscous
from ident.logs.log import Log, LogSet
from ident.model import Model
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0


@cache
def log_of(name: str, seed: int) -> Signals:
    """A robot with rotor inertia, friction and offsets on all joints, along sines."""
    robot = ROBOTS[name]()
    model, values = declared(robot)
    rng, order = np.random.default_rng(seed), np.arange(1, 25)
    weight = 1.0 / (4.0 + order)[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    a, b = (rng.normal(size=(24, robot.n)) * weight for _ in range(2))
    t = np.arange(round(38.0 * RATE)) / RATE
    c = FourierTrajectory(np.zeros(robot.n), a, b, 0.025).sample(t)
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE), values)
    tau = tau + np.array([0.05 if joint.prismatic else 0.02 for joint in robot.joints]) * rng.normal(size=tau.shape)
    logs = LogSet((Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau}),), robot=robot)
    return ZeroPhase(cutoff_hz=15.0)(logs)


def diagnosis(name: str, seed: int, *effects: Effect) -> Diagnosis:
    fit, held = log_of(name, seed), log_of(name, seed + 1)
    model: Model = fit.robot.rigid_body()
    for effect in effects:
        model = model + effect
    return diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)


def values_are_true(found: Diagnosis) -> bool:
    model, values = declared(found.signals.robot)
    truth = dict(zip(model.names, values, strict=True))
    return all(abs(p.value - truth[p.name]) < 4.0 * p.std for f in found.findings for p in f.parameters)


@pytest.mark.parametrize("seed", [1, 11])
def test_a_rigid_body_alone_lacks_friction_and_offsets_of_all_joints(seed: int) -> None:
    found = diagnosis("scara", seed, RotorInertia())
    joints = found.signals.robot.joint_names
    assert found.verdict == "explained"
    assert sorted((f.name, f.joints) for f in found.findings) == [(name, joints) for name in ("coulomb", "offset", "viscous")]
    assert values_are_true(found)


@pytest.mark.parametrize("seed", [3, 13])
def test_some_joints_get_it_and_no_others(seed: int) -> None:
    found = diagnosis("scara", seed, RotorInertia(), Viscous(), Offset(), Coulomb(joints=("j2", "j4")))
    assert [(f.name, f.joints) for f in found.findings] == [("coulomb", ("j1", "j3"))]
    assert found.verdict == "explained"
    assert values_are_true(found)


def test_one_joint_gets_it_alone() -> None:
    found = diagnosis("scara", 5, RotorInertia(), Viscous(), Offset(), Coulomb(joints=("j1", "j3", "j4")))
    assert [(f.name, f.joints) for f in found.findings] == [("coulomb", ("j2",))]
    assert found.verdict == "explained"


@pytest.mark.parametrize("seed", [7, 17])
def test_two_offsets_are_told_one_by_one_with_the_asymmetric_friction_that_does_as_well(seed: int) -> None:
    found = diagnosis("scara", seed, RotorInertia(), Viscous(), Coulomb(), Offset(joints=("j3", "j4")))
    assert sorted((f.name, f.joints) for f in found.findings) == [("offset", ("j1",)), ("offset", ("j2",))]
    assert all("asymmetric_coulomb" in {i.effect for i in f.imitators if i.likely and i.joints == f.joints} for f in found.findings)
    assert values_are_true(found)
