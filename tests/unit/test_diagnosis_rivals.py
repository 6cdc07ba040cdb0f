"""Rivals: what their freedom costs them, what is gained on which joint, and which of them held-out data can tell apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from effect_robots import ROBOTS
from scipy.signal import lfilter
from test_diagnosis_parts import stage_of

from ident.diagnosis import contest, findings
from ident.diagnosis.acceptance import Found, _worth, chosen, share_on_rows
from ident.diagnosis.bank import Bank
from ident.diagnosis.candidates import Candidate, candidates
from ident.diagnosis.evidence import acts_on, by_chance, occam
from ident.diagnosis.frame import Frame, raw_columns
from ident.diagnosis.motions import Motions
from ident.diagnosis.null import Null
from ident.diagnosis.saturation import Pool, saturated
from ident.diagnosis.search import Hit, Judged, Search
from ident.diagnosis.selection import _outlasts, ranked
from ident.diagnosis.signatures import line
from ident.diagnosis.spectral import evenly_drawn
from ident.diagnosis.stage import Stage
from ident.diagnosis.whitening import whitener
from ident.effects.base import Effect, make_effect
from ident.effects.motion import Motion
from ident.effects.orders import slowest_order
from ident.robots.transmission import Side

Array = np.ndarray


def blocks_beside(frame: Frame, rng: np.random.Generator) -> list[Array]:
    """Blocks (M, n, k) that act on one joint, on some, on all; of nothing; of what the model has; one that says the same thing twice."""
    M, n = frame.problem.signals.tau.shape
    found = []
    for k in (1, 2, 2, 3, 5):
        block = rng.normal(size=(M, n, k)) * rng.uniform(1e-6, 1e6, k)
        block[:, rng.permutation(n)[: rng.integers(0, n)]] = 0.0
        found.append(block)
    twice = np.concatenate([found[1], found[1] @ rng.normal(size=(found[1].shape[2], 1))], axis=2)
    return [*found, np.zeros((M, n, 2)), raw_columns(frame.problem)[:, :, :2], twice]


@pytest.mark.parametrize("seed", range(5))
def test_the_gain_of_saturating_columns_is_the_fall_of_the_loss_on_all_joints(seed: int) -> None:
    """Against residuals of whole fits. What fits one joint's large residual may cost more on the small ones of others than it brings."""
    frame, rng = stage_of(seed, [], [make_effect("asymmetric_viscous", joints="j2")], [0.5])[0].frame, np.random.default_rng(seed)
    n, M, b = frame.columns.shape
    Q, _ = np.linalg.qr(frame.columns.reshape(-1, b))
    blocks, scale = blocks_beside(frame, rng), rng.uniform(0.5, 20.0, n)
    pool, r = Pool.of(frame, blocks, Q.reshape(n, M, b)), frame.residual * scale[:, None]
    r = (r.reshape(-1) - Q @ (Q.T @ r.reshape(-1))).reshape(n, M)
    ranks = []
    for i, gain in enumerate(pool.gains(r, scale)):
        both = np.concatenate([frame.columns, frame.whitened(blocks[i])], axis=2).reshape(n * M, -1)
        both = both / np.maximum(np.linalg.norm(both, axis=0), 1e-300)
        left = r.reshape(-1) - both @ np.linalg.lstsq(both, r.reshape(-1), rcond=1e-7)[0]
        q = pool.columns(i)
        ranks.append(q.shape[1])
        fall = np.sum((np.sum(r**2, axis=1) - np.sum(left.reshape(n, M) ** 2, axis=1)) / scale**2)
        assert gain == pytest.approx(fall - 2.0 * q.shape[1], rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(q.T @ q, np.eye(q.shape[1]), atol=1e-8)
        np.testing.assert_allclose(Q.T @ q, 0.0, atol=1e-8)
    assert ranks == [1, 2, 2, 3, 5, 0, 0, 2]


def test_saturating_takes_what_is_there_and_leaves_the_rest() -> None:
    stage, _ = stage_of(7, [], [make_effect("asymmetric_viscous", joints="j2")], [0.5])
    frame, rng = stage.frame, np.random.default_rng(7)
    missing = stage.motions.columns(make_effect("asymmetric_viscous", joints="j2", label="+"))
    nothing = [rng.normal(size=missing.shape) for _ in range(5)]
    found = saturated(frame, [*nothing, missing])
    assert [block is missing for block in found.chosen] == [True]
    assert np.sum(found.residual**2) < frame.loss - frame.fit_gain(frame.whitened(missing)) * (1.0 - 1e-6)


def hit(gains: list[float], name: str = "stribeck") -> Hit:
    """A hit whose grid gained so much."""
    effects = tuple(make_effect(name, joints="j1", v_s=v) for v in np.geomspace(1.0, 10.0, len(gains)))
    evenly = float(np.log(np.mean(np.exp(0.5 * np.array(gains)))))
    return Hit(Candidate(name, ("j1",), effects), effects[0], max(gains), np.zeros((3, 10, 1)), evenly=evenly)


def test_a_shape_costs_a_rival_as_much_as_its_choice_was_worth() -> None:
    plain = replace(hit([30.0]), evenly=-np.inf)
    free, any_does, told, in_between = (hit(g) for g in ([30.0], [30.0] * 6, [30.0] + [-400.0] * 5, [30.0] + [29.0] * 5))
    parameters = occam(any_does, 300)
    assert occam(free, 300) == pytest.approx(parameters)
    assert occam(told, 300) == pytest.approx(parameters + 2.0 * np.log(6.0))
    assert parameters < occam(in_between, 300) < occam(told, 300)
    # Where nothing is known of the others, and never more than that: what chance has for all shapes.
    assert occam(plain, 300) == pytest.approx(by_chance(plain, 300))
    assert occam(told, 300) < by_chance(told, 300)


def test_orders_drawn_evenly_by_their_logarithm() -> None:
    orders = np.linspace(0.5, 200.0, 40_000)
    flat = np.full(len(orders), 3.0)
    assert evenly_drawn(orders, flat, 7.0, 12.0) == pytest.approx(6.0, abs=1e-6)
    # Half of the orders, by their logarithm, do as well as the best one, the others not at all.
    half = np.where(orders < np.sqrt(0.5 * 200.0), 40.0, 0.0)
    assert evenly_drawn(orders, half, 2.0, 40.0) == pytest.approx(20.0 + np.log(0.5), abs=0.01)
    # Fewer orders tell different things to a joint that moves less.
    few, many = (
        replace(hit([30.0]), tried=t, candidate=Candidate("cogging", ("j1",), (make_effect("cogging", joints="j1"),)))
        for t in (12.0, 900.0)
    )
    assert by_chance(few, 300) < by_chance(many, 300) < by_chance(replace(many, tried=0.0), 300)


def test_what_gains_the_same_is_looked_at_and_named_however_many_there_are() -> None:
    stage, _ = stage_of(31, [], [make_effect("asymmetric_viscous", joints="j2")], [0.5])
    effect = make_effect("asymmetric_viscous", joints="j2", label="+")
    weak = make_effect("asymmetric_viscous", joints="j1", label="+")
    same = tuple(Candidate(f"name {i}", ("j2",), (effect,)) for i in range(18))
    others = tuple(Candidate(f"other {i}", ("j1",), (weak,)) for i in range(18))
    stage = replace(stage, search=Search(stage.frame, stage.motions, (*others, *same)))
    judged = ranked(stage)
    assert {j.hit.candidate.name for j in judged} == {c.name for c in same}
    found = chosen(stage, judged, [])
    assert found is not None
    assert len(found.rivals) == 17
    np.testing.assert_allclose(found.weights, 1.0 / 18.0, rtol=1e-6)


def test_the_share_of_a_candidate_on_each_joint() -> None:
    stage, _ = stage_of(32, [], [make_effect("asymmetric_viscous", joints="j2")], [0.5])
    effect = make_effect("asymmetric_viscous", joints="j2", label="+")
    candidate = Candidate("asymmetric_viscous", ("j2",), (effect,))
    search = Search(stage.frame, stage.motions, (candidate,))
    share = share_on_rows(search.judge(search.hit(candidate, effect)))
    assert share.sum() == pytest.approx(1.0)
    assert share[stage.problem.model.robot.joint_index("j2")] > 0.99


@pytest.mark.parametrize(("beside", "taken"), [("external_force", True), ("base_tilt", True), ("viscous", False), ("delay", False)])
def test_what_is_smaller_than_the_noise_counts_beside_laws_of_mechanics(beside: str, taken: bool) -> None:
    """Beside friction and what is made of readings it is the inexactness of their laws; as large as the noise it is none."""
    stage, _ = stage_of(32, [], [], [])
    rows = float(stage.problem.signals.valid[:, 1].sum())
    columns = np.zeros((stage.problem.model.robot.n, len(stage.problem.signals.tau), 1))
    columns[1] = 1.0

    def judged(evidence: float) -> Judged:
        seen = SimpleNamespace(hit=SimpleNamespace(columns=columns), score=SimpleNamespace(values=np.ones(1)), evidence=evidence)
        return cast(Judged, seen)

    large = SimpleNamespace(judged=judged(1e6), effect=make_effect(beside, **({} if taken else {"joints": "j2"})))
    company = [cast(Found, large)]
    assert _worth(judged(0.2 * rows), company, stage) is taken
    assert _worth(judged(0.5 * rows), company, stage)
    assert not _worth(judged(0.05 * rows), company, stage)
    assert _worth(judged(0.05 * rows), [], stage)


def test_joints_on_which_a_candidate_acts_are_those_of_what_it_adds() -> None:
    """A load's moments of inertia, per kg m², weigh a thousand times its mass, and may add next to nothing."""
    columns = np.zeros((2, 10, 2))
    columns[0, :, 0], columns[1, :, 1] = 1.0, 1000.0
    judged = cast(Judged, SimpleNamespace(hit=SimpleNamespace(columns=columns), score=SimpleNamespace(values=np.array([2.0, 1e-5]))))
    assert acts_on(judged).tolist() == [True, False]


def test_a_line_stands_out_and_smooth_noise_does_not() -> None:
    """In rows with gaps; of noise as slow as may be."""
    stage, _ = stage_of(33, [], [], [])
    rng = np.random.default_rng(1)
    t = stage.problem.signals.row_time
    found = 0
    smooth = 0
    for _ in range(40):
        noise = lfilter([1.0], [1.0, -0.95], rng.normal(size=len(t)))
        smooth += line(stage.motions, noise, 0) is not None
        white = np.where(rng.random(len(t)) < 0.7, rng.normal(size=len(t)), 0.0)
        tone = line(stage.motions, np.where(white != 0.0, white + np.sin(2 * np.pi * 0.9 * t), 0.0), 0)
        found += tone is not None and abs(float(tone.name.split("(")[1].split()[0]) - 0.9) < 0.02
    assert found >= 39
    assert smooth <= 2


@pytest.mark.parametrize("side", list(Side))
def test_nothing_in_a_drive_turns_more_slowly_than_its_joint(side: Side) -> None:
    robot = ROBOTS["scara"]()
    for j, joint in enumerate(robot.joints):
        lowest = slowest_order(robot, [j], side)
        turns = lowest * (1.0 if side == Side.JOINT else 1.0 / abs(robot.transmission.K[j, j]))
        assert lowest == 0.0 if joint.prismatic else turns == pytest.approx(0.9)


def test_a_shape_is_sought_where_any_of_the_runs_tells_of_it() -> None:
    stage, _ = stage_of(34, [], [], [])
    step = make_effect("offset_step", joints="j1", t_0=5.0)
    robot = stage.problem.model.robot
    (block, motion), *_ = stage.motions.parts
    c, half = motion.joint, len(motion) // 2
    halves = [slice(0, half), slice(half, len(motion))]
    parts = [(block, Motion.of(robot, c.q[h], c.dq[h], c.ddq[h], motion.t[h], rate=motion.rate, start=0.0)) for h in halves]
    both = Motions.__new__(Motions)
    both.problem, both.parts = stage.problem, parts
    first, second = (step.search_range(m, stage.problem.model.robot)["t_0"] for _, m in parts)
    assert both.search_range(step)["t_0"] == (first[0], second[1])
    assert second[0] > first[0]


def test_whitened_rows_are_no_larger_than_promised_where_gaps_leave_few_pairs() -> None:
    """Short pieces of slow noise: their autocovariances at lag after lag are those of no process."""
    worst = 0.0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = lfilter([1.0, -0.6, 0.5], [1.0, 0.3, 0.6], rng.normal(size=340))
        valid = np.ones(340, bool)
        for start in range(0, 340, 11):
            valid[start : start + int(rng.integers(3, 7))] = False
        white = whitener(x[:, None], valid[:, None], [slice(0, 340)])
        worst = max(worst, float(np.sum(white(np.where(valid, x, 0.0), 0) ** 2) / valid.sum()))
    assert worst < 1.5


@pytest.mark.parametrize(("period", "gap"), [(15, 3), (25, 12)])
def test_slow_columns_gain_what_chance_gives_where_gaps_are_shorter_than_the_memory_of_the_noise(period: int, gap: int) -> None:
    """Rows on both sides of a gap that counted as independent would say the same thing twice: three times the evidence."""
    M, found = 3000, []
    for seed in range(60):
        noise = lfilter([1.0], [1.0, -0.97], np.random.default_rng(seed).normal(size=M + 500))[500:]
        valid = np.arange(M) % period >= gap
        white = whitener(noise[:, None], valid[:, None], [slice(0, M)])
        slow = np.sin(6.0 * np.pi * np.arange(M)[:, None] / M + [0.0, 0.5 * np.pi])
        Z = white(np.where(valid[:, None], slow, 0.0), 0)
        found.append((Z.T @ white(np.where(valid, noise, 0.0), 0)) / np.linalg.norm(Z, axis=0))
    # χ² of 120 degrees of freedom: 0.7 … 1.35 at one in a hundred; some of the colour is lost with the fit.
    assert 0.6 < np.mean(np.square(found)) < 1.5


def test_logs_made_of_the_model_hold_the_noise_that_its_whitener_tells_of() -> None:
    stage, white = stage_of(35, [], [], [])
    valid, runs = stage.problem.signals.valid, stage.problem.signals.row_runs
    rng = np.random.default_rng(4)
    red = np.stack([lfilter([0.3], [1.0, -0.95], rng.normal(size=len(valid))) for _ in range(valid.shape[1])], axis=1)
    for noise in (white, whitener(red * white.std, valid, runs)):
        null = Null(stage.problem, noise)
        powers = [np.sum(s.frame.residual**2) / s.frame.problem.signals.valid.sum() for s in null.searches]
        assert len(powers) == 3
        assert 0.9 < np.mean(powers) < 1.2


def test_what_is_made_of_the_prediction_outlasts_what_fits_worse_than_it_does_in_its_own_model() -> None:
    soft = make_effect("joint_elasticity", joints="j2", stiffness=300.0, rotor=1e-3, damping=0.5)
    other = make_effect("asymmetric_viscous", joints="j2")

    def beside(true: Effect, size: float) -> Callable[[Effect, Effect], str]:
        """Why one outlasts another on data that hold one of them."""
        without, _ = stage_of(35, [], [true], [size])
        stages, found = dict[Effect, Stage](), dict[Effect, Found]()
        for effect in (soft, other):
            stage, _ = stage_of(35, [effect], [true], [size])
            candidate = Candidate(effect.name, ("j2",), (effect,))
            stages[effect] = replace(stage, search=Search(stage.frame, stage.motions, (candidate,)))
            hit = Hit(candidate, effect, 0.0, stage.search.whitened(effect))
            found[effect] = cast(Found, SimpleNamespace(judged=SimpleNamespace(hit=hit)))
        return lambda one, new: _outlasts(found[one], stages[one], found[new], stages[new], without)

    assert "consistent with the prediction" in beside(soft, 1.0)(soft, other)
    viscous = beside(other, 3.0)
    assert not viscous(soft, other)
    # What depends on nothing but the motion is judged beside the others as it is, unless it explains clearly more.
    assert "clearly more" in viscous(other, soft)
    assert not viscous(other, other)


def test_what_acts_on_the_rows_of_a_larger_heap_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Several effects that draw together what nothing explains on one joint of a coupled wrist: the next joint has its part of it."""

    def one(evidence: float, *rows: int) -> Any:
        return SimpleNamespace(judged=SimpleNamespace(evidence=evidence, rows=np.isin(np.arange(3), rows)))

    monkeypatch.setattr(findings, "acts_on", lambda judged: judged.rows)
    heap = [one(50.0, 0), one(40.0, 0, 1)]
    assert findings._overshadows(heap, heap[0])
    assert findings._overshadows(heap, one(80.0, 1, 2))
    assert not findings._overshadows(heap, one(100.0, 1))
    assert not findings._overshadows(heap, one(10.0, 2))


@pytest.mark.parametrize(("constant", "told"), [(4.0, True), (400.0, False)])
def test_shapes_that_do_as_well_in_a_part_of_their_range_are_left_to_held_out_data(constant: float, told: bool) -> None:
    """Friction that drifts by far more slowly than the log lasts drifts in proportion to time, however slowly it is."""
    true = make_effect("temperature_drift_coulomb", joints="j1", T=constant)
    stage, _ = stage_of(12, [], [true], [2.0 if told else 5.0])
    (candidate,) = (c for c in candidates(stage.problem.model, stage.motions) if c.name == true.name and c.joints == ("j1",))
    hit = stage.search.refined(stage.search.first(candidate))
    arena = contest.Arena(
        cast(Any, SimpleNamespace(declared=stage)), Bank(), *cast(Any, (None, None)), stage, (hit.effect,), 0, cast(Any, None)
    )
    others = [e.T for e in arena._as_likely(hit)]
    if told:
        assert not others
    else:
        assert max(others) > 2.0 * min(others)
