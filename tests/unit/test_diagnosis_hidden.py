"""What a motion could not have shown: told, of the right size, and only where another motion would show it."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from scipy.stats import chi2

from ident.diagnosis.bank import Bank
from ident.diagnosis.evidence import FALSE_ALARM
from ident.diagnosis.frame import Frame
from ident.diagnosis.hidden import Hidden, by_effect, hidden
from ident.diagnosis.stage import Stage, start
from ident.effects.motion import Motion
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log, LogSet
from ident.problem.problem import Problem
from ident.signals import ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0


def stage_of(name: str, seed: int, span: float, noise: float = 0.01, without: tuple[str, ...] = ()) -> Stage:
    """The declared model, less some effects that are not there either, on a log of a robot whose joints move by about `span` (rad; slides
    by a tenth in m)."""
    rng = np.random.default_rng(seed)
    robot = ROBOTS[name]()
    model, values = declared(robot)
    values = np.concatenate([values[part] for e, part in zip(model.effects, model.slices, strict=True) if e.name not in without])
    model = replace(model, effects=tuple(e for e in model.effects if e.name not in without))
    weight = span / np.arange(1, 6)[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), *rng.normal(size=(2, 5, robot.n)) * weight, 0.15)
    t = np.arange(round(25.0 * RATE)) / RATE
    c = motion.sample(t % motion.duration)
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE), values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    logs = LogSet((Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau}),), robot=robot)
    prepared = ZeroPhase(cutoff_hz=10.0)(logs)
    estimate = WeightedLeastSquares().solve(Problem(model, prepared))
    return start(model, prepared, estimate.all_values, Bank())


@pytest.fixture(scope="module")
def narrow() -> Stage:
    return stage_of("pendulum", 1, 0.1)


def places(found: tuple[Hidden, ...]) -> set[tuple[str, tuple[str, ...]]]:
    return {(h.effect, h.joints) for h in found}


def test_a_spring_hides_in_a_moment_where_the_joint_moves_little_and_not_where_it_moves_far(narrow: Stage) -> None:
    near, far = hidden(narrow), hidden(stage_of("pendulum", 1, 1.0))
    assert ("linear_spring", ("j1",)) in places(near)
    assert ("linear_spring", ("j1",)) not in places(far)
    spring = next(h for h in near if h.effect == "linear_spring")
    assert (spring.unit, spring.joint, spring.parameter) == ("N m/rad", "j1", "ks_j1")
    assert "move j1 slowly through its whole range" in spring.advice


def test_an_offset_hides_beside_gravity_where_the_joint_hardly_moves() -> None:
    """It is the same all the time, and so next to is gravity: the two differ by what the joint moves."""
    small = hidden(stage_of("pendulum", 1, 0.02, without=("offset",)))
    offset = next(h for h in small if h.effect == "offset")
    assert (offset.unit, offset.joint) == ("N m", "j1")
    assert offset.torque == pytest.approx(offset.least)
    assert not [h for h in hidden(stage_of("pendulum", 1, 1.0, without=("offset",))) if h.effect == "offset"]


def test_what_no_motion_shows_is_not_told(narrow: Stage) -> None:
    """A payload is links' mass, and a rotor on the only joint its inertia, however the robot moves."""
    for stage in (narrow, stage_of("scara", 2, 0.2)):
        assert not {name for name, _ in places(hidden(stage))} & {"payload", "rotor_inertia", "viscous", "coulomb", "offset"}


@pytest.mark.parametrize(("name", "seed", "span"), [("pendulum", 1, 0.1), ("scara", 5, 0.15), ("wrist", 6, 0.3)])
def test_what_is_as_large_as_told_is_just_seen(name: str, seed: int, span: float) -> None:
    """Put into the torque at that size, beside the noise that is there, it gains as much as is asked for, and a little more."""
    stage = stage_of(name, seed, span)
    found = [h for h in hidden(stage) if h.share < 1e3]
    assert found
    robot, signals = stage.problem.model.robot, stage.problem.signals
    asked = math.sqrt(float(chi2.isf(FALSE_ALARM / stage.number, 1)))
    for h in found:
        candidates = [c for c in stage.search.candidates if (c.name, c.joints) == (h.effect, h.joints)]
        variants = [c.variants[0] for c in candidates if (getattr(c.variants[0], "motors", None) or ()) == h.motors]
        gains = []
        for effect in variants:
            names = [p.name.replace("+", "") for p in effect.parameters(robot)]
            columns = stage.search.bank.columns(stage.search.seen_by(effect), [effect])[0]
            own = columns[:, :, names.index(h.parameter)]
            there = replace(stage.problem, signals=replace(signals, tau=signals.tau + h.least * own))
            Z = stage.frame.whitened(own[:, :, None])
            gains.append((math.sqrt(Frame.build(there, stage.white).fit_gain(Z)), math.sqrt(stage.frame.fit_gain(Z))))
        # A normal number away from it: what the noise alone gains by this column, with either sign.
        assert any(abs(gain - (asked + 1.645)) <= alone + 1e-6 and alone < 4.5 for gain, alone in gains), (h, gains)


def test_what_hides_is_told() -> None:
    h = Hidden("gear_coupling", ("j1",), ("j2",), "K", "rad/rad", 0.1, "j1", 3.0, "N m", 0.4, "move")
    assert json.loads(json.dumps(h.to_dict()))["motors"] == ["j2"]
    assert str(h) == "j1 (motor of j2) (up to 0.1 rad/rad: 3 N m on j1)"
    many = [replace(h, joints=(f"j{i}",), share=20.0 - i) for i in range(1, 7)]
    ((effect, places, motion),) = by_effect(many)
    assert (effect, motion) == ("gear_coupling", "move")
    assert places.startswith("j1 (motor of j2) (of any size), ")
    assert places.endswith(", 2 more")
