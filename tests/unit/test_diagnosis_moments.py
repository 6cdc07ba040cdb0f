"""Effects that begin at a moment: when they do, and what is not held against them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ident
from benchmarks.diagnosis.feedback.world import Case, geared, simulated
from ident.diagnosis.design.catalogue import Catalogue
from ident.diagnosis.inference import refinement
from ident.diagnosis.inference.bursts import _at_like_noise
from ident.diagnosis.inference.refinement import likeliest
from ident.diagnosis.inference.scores import Scores
from ident.diagnosis.thresholds import LOUD
from tests.searches import searched, with_torque

Array = np.ndarray
AT = 12.3


@pytest.fixture(scope="module")
def case() -> Case:
    robot, drive = geared("scara", 50.0)
    (case,) = simulated(robot, drive, [], [105], seconds=24.0, rate=250.0)
    return case


def step(case: Case, at: float) -> ident.Effect:
    return ident.make_effect("offset_step", joints=[case.robot.joint_names[1]], label="+").with_shape(t_0=at)


def size_of(case: Case) -> float:
    return 0.5 * float(np.std(next(iter(case.log.tau.values()))[:, 1]))


def stepped(case: Case) -> Case:
    return with_torque(case, 1, size_of(case) * (case.log.t - case.log.t[0] >= AT))


def test_the_likeliest_moment_may_be_the_one_there_is(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shape that scores best along a smoothed motion is not always the likeliest."""
    effect, joints = step(case, AT), (case.robot.joint_names[1],)
    state = searched(stepped(case), effect)
    monkeypatch.setattr(refinement, "sharpened", lambda e, *_: e.with_shape(t_0=e.t_0 + 0.4))
    assert likeliest([effect, effect.with_shape(t_0=AT - 3.0)], joints, (), state.fit_without(0), state.frame) == effect


def test_noise_is_compared_since_the_same_effects_began() -> None:
    """A payload passes on more of the noise of the positions: its half of the log is no burst."""
    rng = np.random.default_rng(3)
    begun = (np.arange(120) >= 75).astype(float)
    energy, speed = rng.gamma(12.0, size=120) * np.where(begun > 0, 30.0, 1.0), rng.uniform(0.1, 2.0, 120)
    told, untold = (_at_like_noise(energy, speed, phase) for phase in (begun, np.zeros(120)))
    assert told.max() < LOUD**2 * np.median(told)
    assert untold.max() > LOUD**2 * np.median(untold)


def test_what_the_log_does_not_resolve_is_told_anew_for_the_blocks_that_count(case: Case) -> None:
    """A delay below what the log resolves, all of it in one block of time: without that block there is none."""
    joint = case.robot.joint_names[1]
    state = searched(case)
    delay = ident.make_effect("delay", joints=[joint], label="+")
    scores = Scores.of(state.fit, state.frame, Catalogue.of_effects(state.fit, [(delay, (joint,))]))
    assert scores.of_blocks(np.ones(scores.raw_blocks.shape[1], bool)) == pytest.approx(scores.plain)
    raw = np.zeros_like(scores.raw_blocks)
    raw[0, 11] = 0.5 * delay.unresolved(state.fit.runs[0].interval) * float(scores.squares[0][0, 0])
    once = replace(scores, raw_blocks=raw)
    others = np.arange(raw.shape[1]) != 11
    assert once.of_blocks(others)[0] == pytest.approx(0.0, abs=1e-9)
    raw[0, 11] *= 10.0
    assert replace(scores, raw_blocks=raw).of_blocks(~others)[0] > 3.0
