"""Effects that act now and then, but hard: what the model foretells is taken from the rows between."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from test_diagnosis_parts import recorded

from ident import diagnose
from ident.diagnosis.bank import Bank
from ident.diagnosis.candidates import Candidate, candidates
from ident.diagnosis.frame import Frame
from ident.diagnosis.motions import Motions
from ident.diagnosis.search import Search
from ident.diagnosis.steady import steady_values
from ident.diagnosis.whitening import plain_whitener
from ident.effects.base import effect_types
from ident.effects.compliance import Backlash
from ident.estimators import WeightedLeastSquares
from ident.logs.log import LogSet
from ident.problem.problem import Problem
from ident.signals import ZeroPhase

Array = np.ndarray


def framed(seed: int, knocked: float) -> tuple[Frame, Array]:
    """A frame with the true values of its model, and knocks of so many times the torque of joint 2, each 0.1 s long, on it."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, seed)
    clean = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    white = plain_whitener(Problem(model, clean), WeightedLeastSquares().solve(Problem(model, clean)).residual(clean))
    side = robot.transmission.measured.value
    tau = log.tau[side].copy()
    rng = np.random.default_rng(seed)
    size = knocked * np.sqrt(np.mean(tau[:, 1] ** 2))
    # They come where the joint is pushed one way, as those of a gear with play: what is always there is no longer told from them.
    for at in rng.choice(np.flatnonzero(tau[:-40, 1] > 0.0), 40, replace=False):
        tau[at : at + 20, 1] += size
    signals = ZeroPhase(cutoff_hz=15.0)(LogSet((replace(log, tau={side: tau}),), robot=robot))
    return Frame.build(Problem(model, signals), white), values


def off(frame: Frame, values: Array, found: Array) -> float:
    """How far values are from the true ones, in standard deviations of a fit without knocks."""
    base = frame.problem.base
    return float(np.linalg.norm(frame.columns @ (np.linalg.pinv(frame.transform) @ (base.base_values(found) - base.base_values(values)))))


@pytest.mark.parametrize("seed", [3, 4])
def test_knocks_bend_a_plain_fit_but_not_the_steady_one(seed: int) -> None:
    frame, values = framed(seed, knocked=3.0)
    plain = frame.problem.base.expand(frame.base_values)
    steady = steady_values(frame)
    assert off(frame, values, plain) > 50.0
    assert off(frame, values, steady) < 0.1 * off(frame, values, plain)


@pytest.mark.parametrize("seed", [5, 6])
def test_without_knocks_the_steady_fit_is_next_to_as_good_as_the_plain_one(seed: int) -> None:
    frame, values = framed(seed, knocked=0.0)
    few = np.sqrt(len(frame.problem.base.names))
    assert off(frame, values, steady_values(frame)) < 2.0 * few


def test_columns_beside_the_model_take_part_in_the_steady_fit() -> None:
    frame, values = framed(3, knocked=0.0)
    extra = np.zeros((*frame.torque.shape, 1))
    extra[0, :, 0] = np.sin(np.arange(frame.torque.shape[1]) / 7.0)
    moved = replace(frame, torque=frame.torque + 300.0 * extra[:, :, 0])
    assert off(moved, values, steady_values(moved, extra)) < 0.2 * off(moved, values, steady_values(moved))


def test_only_abrupt_effects_are_foretold_from_the_steady_values() -> None:
    frame, _ = framed(3, knocked=3.0)
    problem = frame.problem.with_reference(frame.problem.base.expand(frame.base_values))
    motions = Motions(problem)
    search = Search(replace(frame, problem=problem), motions, (), Bank())
    abrupt = [name for name, kind in effect_types().items() if kind.abrupt]
    assert abrupt == ["backlash"]
    for candidate in candidates(problem.model, motions):
        assert (search.seen_by(candidate.variants[0]) is motions) == (candidate.name != "backlash")


def test_a_candidate_that_gains_nothing_keeps_the_first_prediction() -> None:
    frame, _ = framed(5, knocked=0.0)
    problem = frame.problem.with_reference(frame.problem.base.expand(frame.base_values))
    search = Search(replace(frame, problem=problem), Motions(problem), (), Bank())
    candidate = Candidate("backlash", ("j1",), tuple(Backlash(joints=("j1",), gap=gap) for gap in (0.001, 0.01)))
    seen = search.seen_by(candidate.variants[0])
    assert search.first(candidate).fit_gain < 100.0
    assert search.seen_by(candidate.variants[0]) is seen


@pytest.mark.slow
@pytest.mark.parametrize(("name", "joint", "size"), [("backlash", 0, 0.8), ("joint_elasticity", 0, 1.2)])
def test_what_is_between_motor_and_link_is_named_and_its_rotor_told(tmp_path: Path, name: str, joint: int, size: float) -> None:
    """On a log simulated by the benchmark's own code: a first joint, whose rotor's inertia rigid motion cannot tell from the link's."""
    generate = pytest.importorskip("benchmarks.diagnosis.generate")
    score = pytest.importorskip("benchmarks.diagnosis.score")
    case = generate.Case("scara", ((name, joint, size),), 91_000 + joint, "single")
    generate.generate(tmp_path, [case])
    (record,) = score.read_cases(tmp_path)
    loaded = score.load(tmp_path, record)
    found = diagnose(WeightedLeastSquares().solve(Problem(loaded.model, loaded.fit)), loaded.held)
    first = found.findings[0]
    assert (first.effect.name, first.effect.joints) == (name, (loaded.arm.robot.joint_names[joint],))
    rotor = float(loaded.arm.drive["Ia"][joint] * loaded.arm.robot.transmission.K_inverse[joint, joint] ** 2)
    assert first.effect.rotor == pytest.approx(rotor, rel=0.3)
    truth = record["parts"][0]["truth"]
    assert {k: getattr(first.effect, k) for k in truth} == pytest.approx(truth, rel=0.3)
