"""The newer parts of the diagnosis: shapes settled together, their deviations, fits that depend on themselves, what anyone can see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident._utils.fixed_point import MOST, Repetition
from ident.auditing.columns import position_jumps
from ident.diagnosis import diagnose, selection
from ident.diagnosis.acceptance import Found
from ident.diagnosis.bank import Bank
from ident.diagnosis.candidates import Candidate
from ident.diagnosis.consistent import consistent
from ident.diagnosis.findings import Finding
from ident.diagnosis.frame import Frame, raw_columns
from ident.diagnosis.in_plain_sight import apart, jumps, lost
from ident.diagnosis.motions import Motions
from ident.diagnosis.null import Null
from ident.diagnosis.precision import found_parameters, settled, support
from ident.diagnosis.refit import Refit
from ident.diagnosis.search import Judged, Search
from ident.diagnosis.stage import Stage
from ident.diagnosis.whitening import Whitener, plain_whitener
from ident.effects.base import Effect, make_effect
from ident.effects.motion import Motion
from ident.effects.reference import Reference
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log, LogSet
from ident.model import Model
from ident.problem.problem import Problem
from ident.reporting.diagnosis import headline
from ident.robots.robot import Robot
from ident.signals import Signals, ZeroPhase
from ident.signals.cutoff import choose_cutoff
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
RATE = 200.0
NOISE = 0.05


def recorded(robot: Robot, model: Model, values: Array, seed: int, seconds: float = 38.0, noise: float = NOISE) -> Log:
    """A log of an arm along sines, with white torque noise."""
    rng = np.random.default_rng(seed)
    order = np.arange(1, 25)
    weight = (1.0 / (4.0 + order))[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), rng.normal(size=(24, robot.n)) * weight, rng.normal(size=(24, robot.n)) * weight, 0.025)
    t = np.arange(round(seconds * RATE)) / RATE
    c = motion.sample(t)
    still = Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE)
    tau = model.torque(still.with_reference(Reference(model, values)), values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau})


def stage_of(seed: int, effects: list[Effect], true: list[Effect], sizes: list[float]) -> tuple[Stage, Whitener]:
    """A stage of the declared model with `effects`, on a log that holds the `true` ones with these sizes."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    whole = model
    for effect in true:
        whole = whole + effect
    log = recorded(robot, whole, np.append(values, sizes), seed)
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    white = plain_whitener(Problem(whole, prepared), WeightedLeastSquares().solve(Problem(whole, prepared)).residual(prepared))
    return rebuilt(model, prepared, white, effects), white


def rebuilt(model: Model, prepared: Signals, white: Whitener, effects: list[Effect] | tuple[Effect, ...]) -> Stage:
    for effect in effects:
        model = model + effect
    problem, frame = consistent(Problem(model, prepared), white)
    motions = Motions(problem)
    return Stage(problem, white, frame, motions, Search(frame, motions, (), Bank()))


def settle(seed: int) -> tuple[Stage, tuple[Effect, ...]]:
    """Two effects with shapes, begun at wrong ones."""
    true = [make_effect("stribeck", joints="j1", v_s=15.0), make_effect("offset_step", joints="j2", t_0=8.003)]
    begun = [make_effect("stribeck", joints="j1", v_s=20.0), make_effect("offset_step", joints="j2", t_0=8.05)]
    stage, white = stage_of(seed, begun, true, [1.0, 2.0])
    model, _ = declared(stage.problem.model.robot)
    return settled(stage, begun, lambda own: rebuilt(model, stage.problem.signals, white, own))


def test_shapes_of_all_effects_settle_together_where_nothing_more_is_gained() -> None:
    stage, effects = settle(1)
    white = stage.white
    model, _ = declared(stage.problem.model.robot)
    for i, (name, step) in enumerate((("v_s", 0.5), ("t_0", 0.02))):
        for sign in (1.0, -1.0):
            moved = effects[i].with_shape(**{name: getattr(effects[i], name) + sign * step})
            other = rebuilt(model, stage.problem.signals, white, [moved if k == i else e for k, e in enumerate(effects)])
            assert other.frame.loss > stage.frame.loss - 0.02


def test_deviations_of_parameters_and_shapes_cover_the_truth() -> None:
    truth = {"Fs": 1.0, "v_s": 15.0, "step": 2.0, "t_0": 8.003}
    scores = []
    for seed in range(12):
        stage, effects = settle(100 + seed)
        for own in found_parameters(stage, effects):
            for p in own:
                symbol = p.name.removesuffix("_j1").removesuffix("_j2")
                scores.append((p.value - truth[symbol]) / p.std)
    z = np.abs(scores)
    # 48 scores: 95 % intervals that hold cover fewer than 40 of them once in a few thousand tries.
    assert np.sum(z < 1.96) >= 40
    assert np.median(z) > 0.2, "intervals that are far too wide say nothing"


def test_an_effect_that_gains_nothing_has_no_support() -> None:
    true = [make_effect("asymmetric_viscous", joints="j1")]
    both = [*true, make_effect("asymmetric_viscous", joints="j2")]
    stage, white = stage_of(5, both, true, [0.05])
    model, _ = declared(stage.problem.model.robot)
    assert support(stage, both[0]) > 100.0
    assert support(stage, both[1]) < 20.0
    without = rebuilt(model, stage.problem.signals, white, both[1:])
    assert support(stage, both[0]) == pytest.approx(without.frame.loss - stage.frame.loss, rel=1e-3)


def test_an_effect_without_a_trace_in_the_log_has_no_support_and_breaks_nothing() -> None:
    late = make_effect("offset_step", joints="j1", t_0=900.0)
    stage, white = stage_of(5, [late], [], [])
    assert support(stage, late) == 0.0
    (own,) = found_parameters(stage, [late])
    assert not np.isfinite(own[1].std)
    model, _ = declared(stage.problem.model.robot)
    settled(stage, [late], lambda effects: rebuilt(model, stage.problem.signals, white, effects))


def test_what_the_model_takes_up_itself_is_not_known() -> None:
    stage, _ = stage_of(6, [], [], [])
    frame = stage.frame
    stribeck = stage.search.whitened(make_effect("stribeck", joints="j1", v_s=15.0))
    std = Refit.of(frame, np.concatenate([stribeck, frame.columns[:, :, :1]], axis=2)).std
    assert np.isfinite(std[0])
    assert np.isinf(std[1])
    # Against the inverse of the whole normal matrix.
    X = np.concatenate([frame.columns, stribeck], axis=2).reshape(-1, frame.columns.shape[2] + 1)
    assert std[0] == pytest.approx(np.sqrt(np.linalg.inv(X.T @ X)[-1, -1]), rel=1e-6)


@pytest.mark.parametrize("rate", [0.5, 0.95, -1.3])
def test_repetition_finds_values_that_reproduce_themselves(rate: float) -> None:
    """Plain repetition would creep (0.95) or swing ever wider (-1.3)."""
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    A = Q @ np.diag([rate, 0.3, 0.1, 0.0, 0.0, 0.0]) @ Q.T
    right = rng.normal(size=6)
    x, repetition = np.zeros(6), Repetition(np.ones(6))
    for _ in range(MOST):
        x = repetition.next(x, right + A @ (x - right))
    np.testing.assert_allclose(x, right, atol=1e-6)


def test_a_fit_is_consistent_with_its_own_prediction() -> None:
    stage, white = stage_of(
        7, [make_effect("load_dependent_friction", joints="j1")], [make_effect("load_dependent_friction", joints="j1")], [0.2]
    )
    values = stage.problem.base.expand(stage.frame.base_values)
    again = stage.problem.with_reference(values)
    fresh = Frame.build(again, white, raw_columns(again))
    np.testing.assert_allclose(fresh.base_values, stage.frame.base_values, rtol=1e-3, atol=1e-6)


def test_what_makes_room_for_each_other_is_not_accepted_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    stage, _ = stage_of(10, [], [], [])
    effect = make_effect("asymmetric_viscous", joints="j1")
    candidate = Candidate("asymmetric_viscous", ("j1",), (effect,))
    stage = replace(stage, search=Search(stage.frame, stage.motions, (candidate,), Bank()))
    judged = stage.search.judge(stage.search.hit(candidate, effect))
    rounds = []

    def dropped(first: Stage, stage: Stage, found: list[Found], due: object, bank: Bank, say: object) -> tuple[Stage, list[Found]]:
        return stage, []

    def chosen(stage: Stage, plausible: list[Judged], beside: list[Found]) -> Found | None:
        rounds.append(len(plausible))
        assert len(rounds) < 50, "for ever"
        return Found(plausible[0], (), np.ones(1)) if plausible else None

    monkeypatch.setattr(selection, "ranked", lambda *args, **more: [judged])
    monkeypatch.setattr(selection, "chosen", chosen)
    monkeypatch.setattr(selection, "_re_examined", dropped)
    monkeypatch.setattr(selection, "with_effects", lambda *args: stage)
    monkeypatch.setattr(selection, "with_noise_beneath", lambda first, stage, bank: (first, stage))
    assert selection.select(stage, Bank()).found == ()
    assert rounds == [1, 1, 0]


def two_found() -> tuple[Stage, list[Judged]]:
    """A log with two effects that the model lacks, and both of them judged."""
    own = [make_effect("asymmetric_viscous", joints=j) for j in ("j1", "j2")]
    stage, _ = stage_of(11, [], own, [2.0, 2.0])
    listed = tuple(Candidate("asymmetric_viscous", e.joints or (), (e,)) for e in own)
    stage = replace(stage, search=Search(stage.frame, stage.motions, listed, Bank()))
    return stage, [stage.search.judge(stage.search.hit(c, c.variants[0])) for c in listed]


@pytest.mark.parametrize("near", [True, False])
def test_what_came_near_is_looked_at_again_on_its_own_joints(monkeypatch: pytest.MonkeyPatch, near: bool) -> None:
    """An offset of either of two coupled joints, one of which carries a weight, is the same torque."""
    stage, (one, other) = two_found()
    share = 0.9 if near else 0.5
    rival = replace(other, held=share * one.evidence)
    assert rival.evidence == share * one.evidence
    looked_at = []

    def ranked(stage: Stage, more: object = (), joints: frozenset[str] | None = None) -> list[Judged]:
        looked_at.append(joints)
        return []

    monkeypatch.setattr(selection, "ranked", ranked)
    monkeypatch.setattr(selection, "chosen", lambda stage, plausible, beside: None)
    found = [Found(one, (rival,), np.array([0.6, 0.4]))]
    selection._re_examined(stage, stage, [*found, Found(other, (), np.ones(1))], found, Bank(), lambda text: None)
    assert looked_at == [frozenset({"j1", "j2"} if near else {"j1"})]


@pytest.mark.parametrize("itself", [True, False])
def test_what_is_replaced_may_be_from_any_joint(monkeypatch: pytest.MonkeyPatch, itself: bool) -> None:
    """A group of offsets drew what was found later on one of its joints; what is left of it was on none of them."""
    stage, (one, other) = two_found()
    looked_at = []

    def ranked(stage: Stage, more: object = (), joints: frozenset[str] | None = None) -> list[Judged]:
        looked_at.append(joints)
        return [one if itself or joints is None else other]

    monkeypatch.setattr(selection, "ranked", ranked)
    monkeypatch.setattr(selection, "chosen", lambda stage, plausible, beside: Found(plausible[0], (), np.ones(1)))
    due, newest = Found(one, (), np.ones(1)), Found(other, (), np.ones(1))
    _, found = selection._re_examined(stage, stage, [due, newest], [due], Bank(), lambda text: None)
    assert looked_at == ([frozenset({"j1"})] if itself else [frozenset({"j1"}), None])
    assert [f.judged.hit.candidate.joints for f in found] == [("j1",), ("j2",)]


@pytest.mark.parametrize("holds", [True, False])
def test_what_is_dropped_in_the_end_makes_room_for_what_came_near(monkeypatch: pytest.MonkeyPatch, holds: bool) -> None:
    """The search goes on without it; what came nearest in the last round is kept, for other data to confirm."""
    stage, judged = two_found()
    rounds = []

    def chosen(stage: Stage, plausible: list[Judged], beside: list[Found]) -> Found | None:
        rounds.append([j.hit.candidate.joints[0] for j in plausible])
        return Found(plausible[0], (), np.ones(1)) if plausible and not beside else None

    def settled_together(first: Stage, stage: Stage, found: list[Found], *_: object) -> tuple[Stage, list[Found]]:
        return stage, [f for f in found if holds and f.effect.joints == ("j2",)]

    monkeypatch.setattr(selection, "ranked", lambda *args, **more: judged)
    monkeypatch.setattr(selection, "chosen", chosen)
    monkeypatch.setattr(selection, "settled_together", settled_together)
    monkeypatch.setattr(selection, "with_noise_beneath", lambda first, stage, bank: (first, stage))
    looked = selection.select(stage, Bank())
    assert [f.effect.joints for f in looked.found] == ([("j2",)] if holds else [])
    assert rounds[0] == ["j1", "j2"]
    assert rounds[2] == ["j2"]
    assert [j.hit.candidate.joints[0] for j in looked.nearest] == ["j1", "j2"], "of the last round"


@pytest.mark.parametrize(("std", "kept"), [(0.7, False), (0.4, True)])
def test_a_value_that_scatters_as_far_as_it_is_large_is_nothing(monkeypatch: pytest.MonkeyPatch, std: float, kept: bool) -> None:
    """Its evidence counts blocks of time as if noise alone told them apart; their scatter says how far they agree."""
    stage, judged = two_found()
    one = Found(judged[0], (), np.ones(1))
    with_it = selection.with_effects(stage, [one.effect], stage, Bank())
    monkeypatch.setattr(selection, "unbound", lambda stage, effects: [(np.array([1.0]), np.array([std]))])
    said: list[str] = []
    _, left = selection.settled_together(stage, with_it, [one], Bank(), said.append)
    assert bool(left) is kept
    assert kept or "1 ± 0.7 is not told from nothing" in said[0]


def test_jumps_are_told_from_motion() -> None:
    t = np.arange(4000) / RATE
    rng = np.random.default_rng(1)
    x = np.sin(1.3 * t) + 0.3 * np.sin(7.0 * t) + 1e-5 * rng.normal(size=len(t))
    assert len(position_jumps(t, x)) == 0
    slipped = x + 0.2 * (t >= 11.0)
    assert abs(t[position_jumps(t, slipped)[0]] - 11.0) <= 1.5 / RATE
    glitch = x.copy()
    glitch[1234] += 0.05
    assert 1234 in position_jumps(t, glitch)
    # A hole in the log is no jump.
    keep = (t < 5.0) | (t > 6.0)
    assert len(position_jumps(t[keep], x[keep])) == 0


def test_a_position_that_jumps_is_said_where_rows_rest_on_it() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 3)
    slipped = log.q.copy()
    slipped[2500:, 1] += 0.3
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((replace(log, q=slipped),), robot=robot))
    (found,) = jumps(prepared)
    assert found.joint == "j2"
    assert "12.5 s" in found.evidence or "12.495 s" in found.evidence
    early = log.q.copy()
    early[:2, 1] += 0.3
    assert jumps(ZeroPhase(cutoff_hz=15.0)(LogSet((replace(log, q=early),), robot=robot))) == ()


def test_held_out_data_of_another_kind_are_said() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 4)
    fit, same = (ZeroPhase(cutoff_hz=15.0)(part) for part in LogSet((log,), robot=robot).split(by="fraction", held=0.4))
    estimate = WeightedLeastSquares().solve(Problem(model, fit))
    assert apart(estimate, fit, same) == ()
    side = robot.transmission.measured.value
    other = log.tau[side].copy()
    other[:, 2] += 0.5 * np.sqrt(np.mean(other[:, 2] ** 2)) * np.sign(np.sin(3.0 * log.t))
    _, held = LogSet((replace(log, tau={side: other}),), robot=robot).split(by="fraction", held=0.4)
    assert [u.joint for u in apart(estimate, fit, ZeroPhase(cutoff_hz=15.0)(held))] == ["j3"]


def test_a_joint_that_moves_without_a_usable_row_is_said_and_one_that_stands_is_not() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 8)
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    assert lost(prepared) == ()
    valid = prepared.valid.copy()
    valid[:, 1] = False
    assert [u.joint for u in lost(replace(prepared, valid=valid))] == ["j2"]
    still = replace(prepared, valid=valid, q=np.where(np.arange(robot.n) == 1, 0.3, prepared.q))
    assert lost(still) == ()


def test_a_joint_that_cannot_be_looked_at_leaves_the_verdict_open() -> None:
    """Anything of the catalogue may sit there: the model is not said to be complete, nor a structure to be none of the catalogue's."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 8)
    parts = [ZeroPhase(cutoff_hz=15.0)(part) for part in LogSet((log,), robot=robot).split(by="fraction", held=0.3)]
    fit, held = (replace(part, valid=part.valid & (np.arange(robot.n) != 1)) for part in parts)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert (found.verdict, found.findings, [u.joint for u in found.unexplained]) == ("ambiguous", (), ["j2"])
    assert str(found).startswith("verdict: ambiguous: nothing can be said about j2")
    assert headline(found) == "Ambiguous: nothing can be said about j2"


@pytest.mark.parametrize("flicker", [1e-9, 1e-4])
def test_a_joint_that_stands_but_for_its_encoder_is_no_obstacle(flicker: float) -> None:
    """No order of a ripple can be told from so little; one beyond all bounds had ended the search."""
    rng = np.random.default_rng(5)
    robot = ROBOTS["wrist"]()
    model, values = declared(robot)
    motion = FourierTrajectory(np.zeros(robot.n), *0.5 * rng.normal(size=(2, 4, robot.n)) / np.arange(1, 5)[:, None], 0.1)
    t = np.arange(2000) / 200.0
    c = motion.sample(t)
    moving = np.array([1.0, 1.0, 0.0])
    tau = model.torque(Motion.of(robot, c.q * moving, c.dq * moving, c.ddq * moving, t, rate=200.0), values)
    tau += 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    q = c.q * moving + flicker * (1.0 - moving) * rng.integers(0, 2, c.q.shape)
    log = Log("standing", t, q=q, tau={robot.transmission.measured.value: tau})
    fit, held = (ZeroPhase(cutoff_hz=15.0)(part) for part in LogSet((log,), robot=robot).split(by="fraction", held=0.25))
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert not any("j3" in f.joints for f in found.findings)


def test_a_joint_whose_position_jumps_does_not_take_the_cutoff_of_all() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(6000) / RATE
    q = np.stack([np.sin(2.0 * t), np.cos(1.5 * t), np.sin(1.1 * t + 1.0)], axis=1) + 1e-6 * rng.normal(size=(len(t), 3))
    names, prismatic = ["a", "b", "c"], [False] * 3
    plain = choose_cutoff([q], RATE, names, prismatic)
    assert plain.unheard == ()
    q[3000:, 1] += 0.2
    slipped = choose_cutoff([q], RATE, names, prismatic)
    assert slipped.unheard == ("b",)
    assert slipped.cutoff_hz > 0.5 * plain.cutoff_hz


def test_a_null_log_keeps_the_clock_of_the_log_it_stands_for() -> None:
    """Else what is known to happen at a time would be late there by the edge that filters cut off, and look like an effect."""
    step = make_effect("offset_step", joints="j1", t_0=9.0)
    stage, white = stage_of(9, [step], [step], [20.0])
    null = Null(stage.problem, white)
    for search in null.searches:
        power = np.sum(search.frame.residual**2, axis=1) / np.maximum(search.frame.problem.signals.valid.sum(axis=0), 1)
        assert np.all(power < 2.0)
        assert search.frame.problem.signals.origins == stage.problem.signals.origins


def test_a_finding_says_which_angle_its_order_counts() -> None:
    for angle in ("joint", "motor"):
        effect = make_effect("cogging", joints="j1", angle=angle)
        told = Finding(effect, ("j1",), (), 0.1, 50.0, 0.9, ())
        assert told.to_dict()["configuration"] == {"angle": angle}
    assert "configuration" not in Finding(make_effect("offset", joints="j1"), ("j1",), (), 0.1, 50.0, 0.9, ()).to_dict()
