"""What was accepted while another effect was missing, once that one is there: it is dropped, or gives way to a simpler effect inside it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ident
from benchmarks.diagnosis.feedback.world import Case, geared, simulated
from ident.diagnosis.inference import candidates
from ident.diagnosis.inference.candidates import simpler
from ident.diagnosis.inference.confidence_set import drop_unnecessary
from ident.diagnosis.inference.refinement import refined
from tests.searches import searched, with_torque

PENDULUM = """<robot name="one"><link name="a"/><link name="b"><inertial><origin xyz="0 0 -.3"/><mass value="10"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" velocity="9" effort="900"/></joint></robot>"""


@pytest.fixture(scope="module")
def case() -> Case:
    robot, drive = geared("scara", 50.0)
    (case,) = simulated(robot, drive, [], [105], seconds=24.0, rate=250.0)
    return case


def size_of(case: Case) -> float:
    return 0.5 * float(np.std(next(iter(case.log.tau.values()))[:, 1]))


def test_a_spring_gives_way_to_the_constant_that_it_stands_for_and_not_to_less_than_there_is(case: Case) -> None:
    joint = case.robot.joint_names[1]
    spring = ident.make_effect("nonlinear_spring", joints=[joint], label="+")
    q = case.log.q[:, 1]  # type: ignore[index]
    told = {}
    for name, extra in (("offset", np.ones(len(q))), ("linear_spring", (q - q.mean()) / np.abs(q - q.mean()).max())):
        found = simpler(searched(with_torque(case, 1, size_of(case) * extra), spring), 0)
        told[name] = found and (found[0].name, found[1])
    assert told == {name: (name, (joint,)) for name in told}


def test_a_delay_of_all_joints_gives_way_to_that_of_the_one_that_has_it(case: Case) -> None:
    joint = case.robot.joint_names[1]
    tau = next(iter(case.log.tau.values()))[:, 1]
    late = np.interp(case.log.t - 0.05, case.log.t, tau) - tau
    every = ident.make_effect("delay", joints=list(case.robot.joint_names), label="+")
    found = simpler(searched(with_torque(case, 1, late), every.with_shape(**{every.shape()[0].name: 0.025})), 0)
    assert found is not None
    assert found[1] == (joint,)


def test_a_lone_effect_stands_only_where_it_is_seen(case: Case) -> None:
    offset = ident.make_effect("offset", joints=[case.robot.joint_names[1]], label="+")
    there, absent = searched(with_torque(case, 1, np.full(len(case.log.t), size_of(case))), offset), searched(case, offset)
    for state in (there, absent):
        drop_unnecessary(state, lambda _: None)
    assert [e for e, _ in there.accepted] == [offset]
    assert not absent.accepted


def test_nothing_turns_more_slowly_than_the_joint(case: Case) -> None:
    """A travel of a twentieth of a turn tells orders apart by many only: the search around one does not leave where orders can be."""
    robot = ident.Robot.from_urdf(PENDULUM)
    rng, t = np.random.default_rng(3), np.arange(6000) / 200.0
    w, a = 2.0 * np.pi * np.array([0.2, 0.5, 1.1]), np.array([0.1, 0.04, 0.02])
    q, v, acceleration = np.sin(np.outer(t, w)) @ a, np.cos(np.outer(t, w)) @ (a * w), -np.sin(np.outer(t, w)) @ (a * w**2)
    tau = 2.0 * acceleration + 3.0 * np.sign(v) + 2.0 * v + 1.0 + 0.01 * rng.normal(size=t.size)
    log = ident.Log("short", t, q=(q + 2e-6 * rng.normal(size=t.size))[:, None], tau={"joint": tau[:, None]})
    model = ident.Model(robot, [ident.make_effect(e) for e in ("rigid_body", "viscous", "coulomb")])
    offset = ident.make_effect("offset", joints=["j1"], label="+")
    state = searched(replace(case, robot=robot, model=model, log=log), offset)
    effect = ident.make_effect("cogging", joints=["j1"], angle="joint", order=1.0, label="+")
    fit = state.fit_without(0)
    assert refined(effect, ("j1",), fit, fit.behind(state.frame.gains)).order >= 0.9  # type: ignore[attr-defined]


def test_a_drive_gives_way_by_a_small_part_of_its_travel(case: Case) -> None:
    """A spring so soft that the link hangs far from its motor is a shape of the load, and none of a gear."""
    fit = searched(case).fit
    for joint in case.robot.joint_names[:2]:
        effect = ident.make_effect("joint_elasticity", joints=[joint], label="+")
        j = case.robot.joint_names.index(joint)
        for motion in fit.motions(instrument=True):
            low, high = effect.search_range(motion, case.robot)["stiffness"]
            sag = np.abs(motion.load[:, j]).max() / low  # type: ignore[index]
            assert 0.0 < sag <= 0.1 * np.ptp(motion.joint.q[:, j]) * (1.0 + 1e-9)
            assert high > low


def test_a_limit_that_takes_some_share_of_what_exceeds_it_is_noise(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """The excess of a noisy reading over some level goes with its own noise, by a share that may be many deviations from none."""
    joint = case.robot.joint_names[1]
    effect = ident.make_effect("saturation", joints=[joint], label="+")
    state = searched(case)
    # Nothing else speaks against it: neither its range, nor what would deny it.
    monkeypatch.setattr(candidates, "search_range", lambda *_: {})
    monkeypatch.setattr(type(effect), "denied_by", lambda _: None)
    stands = {}
    for value, std in ((1.02, 0.004), (0.96, 0.03), (0.84, 0.065), (0.82, 0.047), (1.17, 0.04)):
        frame = SimpleNamespace(theta=np.array([value]), std=np.array([std]))
        trial = candidates.Trial(effect, (joint,), (1, 1, False), state.fit, frame)  # type: ignore[arg-type]
        stands[value] = candidates._stands(state, trial)
    assert stands == {1.02: True, 0.96: True, 0.84: False, 0.82: False, 1.17: False}
