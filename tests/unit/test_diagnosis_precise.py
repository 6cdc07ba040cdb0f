"""What makes findings exact: total derivatives, parameters that shapes bind, moments, noise that comes again, short delays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from test_diagnosis_parts import rebuilt, recorded, stage_of

from ident.diagnosis import diagnose, precision
from ident.diagnosis import stage as stage_module
from ident.diagnosis.bank import Bank
from ident.diagnosis.candidates import candidates
from ident.diagnosis.consistent import consistent, own_loss
from ident.diagnosis.doubtful import doubtful_rows
from ident.diagnosis.frame import Frame, raw_columns
from ident.diagnosis.moments import CLOSE, best_moment
from ident.diagnosis.motion_noise import less_noise
from ident.diagnosis.motion_spectrum import told_up_to
from ident.diagnosis.normal import Normal
from ident.diagnosis.precision import found_parameters, settled, unbound
from ident.diagnosis.repeated_noise import repeats
from ident.diagnosis.search import Search
from ident.diagnosis.stage import Stage, at_least, staged
from ident.diagnosis.total import totalled
from ident.diagnosis.whitening import plain_whitener, whitener
from ident.effects.base import make_effect
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log, LogSet
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase

Array = np.ndarray
TILT = (0.05, -0.04)


def tilted(seed: int) -> Stage:
    """A stage with a tilted base under a SCARA, on a log of one."""
    tilt = make_effect("base_tilt")
    extra = len(tilt.parameters(ROBOTS["scara"]())) - 2
    return stage_of(seed, [tilt], [tilt], [*TILT, *([0.0] * extra)])[0]


def test_the_total_derivative_is_that_of_the_models_own_prediction() -> None:
    stage = tilted(3)
    total = totalled(stage)
    problem, frame = total.problem, total.frame
    assert problem.reference is not None
    values = problem.base.base_values(problem.reference)
    rng = np.random.default_rng(0)

    def predicted(base: Array) -> Array:
        there = problem.with_reference(np.asarray(problem.base.expand(base)))
        return frame.whitened((raw_columns(there) @ base)[:, :, None])[:, :, 0]

    for _ in range(2):
        direction = frame.transform @ rng.normal(size=frame.transform.shape[1])
        slope = predicted(values + 0.5 * direction) - predicted(values - 0.5 * direction)
        linear = frame.columns @ (np.linalg.pinv(frame.transform) @ direction)
        assert np.sqrt(np.mean((slope - linear) ** 2)) < 0.02 * np.sqrt(np.mean(slope**2))
        # And it matters: the columns alone are something else.
        alone = stage.frame.columns @ (np.linalg.pinv(stage.frame.transform) @ direction)
        assert np.sqrt(np.mean((slope - alone) ** 2)) > 0.02 * np.sqrt(np.mean(slope**2))


def test_a_totalled_stage_is_no_worse_and_its_intervals_hold() -> None:
    scores = []
    for seed in range(8):
        stage = tilted(40 + seed)
        total = totalled(stage)
        assert own_loss(total.problem, total.frame) <= own_loss(stage.problem, stage.frame) + 1e-6 or np.isclose(
            np.sum(total.frame.residual**2), own_loss(stage.problem, stage.frame), rtol=1e-3
        )
        (own,) = found_parameters(total, [total.problem.model.effects[-1]])
        scores += [(p.value - truth) / p.std for p, truth in zip(own, TILT, strict=False)]
    z = np.abs(scores)
    # 16 scores: 95 % intervals that hold cover fewer than 12 of them once in a thousand tries.
    assert np.sum(z < 1.96) >= 12
    assert np.median(z) > 0.15


def test_a_stage_gets_to_the_least_of_its_loss_where_repetition_gets_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under some arms it swings about the values that it seeks. Here: from a fit that knows no tilt."""
    monkeypatch.setattr(
        stage_module, "consistent", lambda problem, white, most: (problem, Frame.build(problem, white, raw_columns(problem)))
    )
    tilt = make_effect("base_tilt")
    robot = ROBOTS["scara"]()
    model, _ = declared(robot)
    sizes = [0.1, -0.06, *([0.0] * (len(tilt.parameters(robot)) - 2))]
    for seed in range(2):
        there, white = stage_of(60 + seed, [], [tilt], sizes)
        begun = dict(zip(model.names, there.problem.base.expand(there.frame.base_values), strict=True))
        whole = model + tilt
        reference = np.array([begun.get(name, 0.0) for name in whole.names])
        problem = Problem(whole, there.problem.signals, reference=reference)
        frame = Frame.build(problem, white, raw_columns(problem))
        assert own_loss(problem, frame) > frame.loss + 200.0
        stage = at_least(staged(problem, white, Bank(), there.motions, ()))
        assert own_loss(stage.problem, stage.frame) == pytest.approx(stage.frame.loss, rel=1e-3)
        assert stage.frame.loss < 1.1 * problem.signals.valid.sum()
        assert stage.search.frame is stage.frame


def test_what_is_left_counts_as_noise_on_the_rows_of_its_joint() -> None:
    """Three times the noise on one joint: its cross-products count nine times; where less is left than noise, they count once."""
    rng = np.random.default_rng(3)
    n, M, k = 3, 4000, 5
    columns = rng.normal(size=(n, M, k))
    products = np.einsum("nmi,nmj->nij", columns, columns)
    residual = np.array([1.0, 3.0, 0.4])[:, None] * rng.normal(size=(n, M))
    found = precision._at_what_is_left(columns, residual, np.full(n, M), np.linalg.inv(products.sum(axis=0)))
    np.testing.assert_allclose(found, products[0] + 9.0 * products[1] + products[2], rtol=0.1, atol=0.1 * M)
    # Rows that a fit has as many of as it has parameters tell nothing of the noise.
    few = precision._at_what_is_left(columns[:1, :k], residual[:1, :k], np.array([k]), np.linalg.inv(columns[0, :k].T @ columns[0, :k]))
    assert np.all(np.isfinite(few))


def test_what_the_model_holds_is_no_candidate_beside_its_total_derivative() -> None:
    """A payload is its link's own parameters: their columns it has, and their total derivatives it has not."""
    bare = tilted(3)
    stage = replace(bare, search=Search(bare.frame, bare.motions, candidates(bare.problem.model, bare.motions)))
    total = at_least(stage)
    assert total is not stage
    of = {c.name: c for c in stage.search.candidates if not c.variants[0].shape()}
    assert stage.search.holds(of["payload"])
    assert not Search(total.frame, total.motions, ()).holds(of["payload"])
    left = {(c.name, c.joints) for c in total.search.candidates}
    assert of["payload"].name not in {name for name, _ in left}
    assert ("linear_spring", ("j2",)) in left
    assert all(stage.search.holds(c) for c in stage.search.candidates if (c.name, c.joints) not in left)


def test_a_stage_without_corrections_stays_as_it_is() -> None:
    spring = make_effect("linear_spring", joints="j2")
    stage, _ = stage_of(5, [spring], [spring], [2.0] * len(spring.parameters(ROBOTS["scara"]())))
    assert totalled(stage) is stage


def test_bonds_hold_and_are_solved_exactly() -> None:
    rng = np.random.default_rng(2)
    D, y = rng.normal(size=(60, 5)) * [1e-3, 1.0, 50.0, 1.0, 7.0], rng.normal(size=60)
    bonds, bound = np.array([[2.0, 0.0, 0.0, -1.0, 0.5]]), np.array([0.3])
    found, inverse = Normal(D.T @ D, D.T @ y, bonds, bound, 3).solved()
    assert bonds @ found == pytest.approx(bound, abs=1e-9)
    # The fourth is what the bond makes of the others: plain least squares for those.
    own = np.delete(D, 3, axis=1) + D[:, 3:4] * np.array([2.0, 0.0, 0.0, 0.5])
    plain = np.linalg.lstsq(own, y + 0.3 * D[:, 3], rcond=None)[0]
    assert np.delete(found, 3) == pytest.approx(plain, rel=1e-7)
    assert np.delete(np.delete(inverse, 3, axis=0), 3, axis=1) == pytest.approx(np.linalg.inv(own.T @ own), rel=1e-6)


def test_a_shape_that_binds_its_parameter_is_settled_with_it() -> None:
    true = make_effect("filter_lag", joints="j1", T=0.03)
    begun = true.with_shape(T=0.02)
    stage, white = stage_of(8, [begun], [true], [0.03])
    model, _ = declared(stage.problem.model.robot)
    best, (own,) = settled(stage, [begun], lambda effects: rebuilt(model, stage.problem.signals, white, list(effects)))
    ((lag, T),) = found_parameters(best, [own])
    assert lag.value == pytest.approx(T.value, rel=1e-6)
    assert T.value == pytest.approx(0.03, abs=4.0 * T.std)
    assert T.std < 0.005
    ((free, deviation),) = unbound(best, [own])
    assert deviation[0] > 0.0
    assert free[0] == pytest.approx(0.03, abs=5.0 * deviation[0])


@pytest.mark.parametrize("moment", [6.21, 19.04, 31.97])
def test_a_moment_is_found_wherever_it_is(moment: float) -> None:
    step = make_effect("offset_step", joints="j2", t_0=moment)
    stage, _ = stage_of(11, [], [step], [1.0])
    found = best_moment(stage.frame, stage.motions, step.with_shape(t_0=20.0), "t_0", (2.0, 36.0))
    assert abs(found - moment) <= 2.0 * CLOSE


def periodic(counts: float, noise: float) -> Signals:
    """Four periods of a motion, rounded to so many counts per rad, with noise of the positions."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 6, seconds=8.0)
    assert log.q is not None
    rng = np.random.default_rng(0)
    t = np.arange(6400) / 200.0
    whole = 2.0 * np.pi * t[:, None] / 8.0 * np.arange(1, 4)
    q = np.sin(whole) @ rng.normal(size=(3, robot.n)) * 0.3 + noise * rng.normal(size=(len(t), robot.n))
    q = np.round(q * counts) / counts if counts else q
    tau = rng.normal(size=q.shape)
    return ZeroPhase(cutoff_hz=20.0)(LogSet((replace(log, t=t, q=q, tau={robot.transmission.measured.value: tau}),), robot=robot))


def test_rounding_that_comes_again_with_the_motion_counts_again() -> None:
    signals = periodic(1e4, 0.0)
    noise = np.array([j.noise for j in signals.report.joints])
    assert repeats(signals, noise) == pytest.approx(np.full(signals.robot.n, 3.0), abs=0.1)
    prepared = less_noise(signals)
    assert all(j.repeats > 2.5 for j in prepared.report.joints)
    model, values = declared(signals.robot)
    rows = doubtful_rows(Problem(model, prepared, reference=values))
    assert rows.shape == prepared.tau.shape
    assert np.all(rows.std(axis=0) > 0.0)
    # It makes the noise count for more, and leaves what is reported as its level alone.
    few, many = (whitener(prepared.tau, prepared.valid, prepared.row_runs, more) for more in (None, rows))
    assert few.std == pytest.approx(many.std)
    ones = np.ones(len(prepared.tau))
    assert all(np.sum(many(ones, j) ** 2) < np.sum(few(ones, j) ** 2) for j in range(signals.robot.n))


def test_noise_of_its_own_in_every_period_does_not() -> None:
    signals = periodic(0.0, 1e-4)
    noise = np.array([j.noise for j in signals.report.joints])
    assert np.all(repeats(signals, noise) < 0.8)
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    never = ZeroPhase(cutoff_hz=15.0)(LogSet((recorded(robot, model, values, 4),), robot=robot))
    assert np.all(repeats(never, np.array([j.noise for j in never.report.joints])) == 0.0)
    # Then what is not told is little: of the noise of the positions what was taken out, and a share of the torque.
    once, four = (
        doubtful_rows(Problem(model, x, reference=values)).std(axis=0)
        for x in (less_noise(periodic(0.0, 1e-4)), less_noise(periodic(1e4, 0.0)))
    )
    assert np.all(once > 0.0)
    assert np.all(four > 0.0)


@pytest.mark.parametrize("delay", [-0.0006, 0.0008])
def test_a_short_delay_of_all_torques_is_one_thing(delay: float) -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model + make_effect("delay"), np.append(values, [delay] * robot.n), 21, noise=0.01)
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    white = plain_whitener(Problem(model, prepared), WeightedLeastSquares().solve(Problem(model, prepared)).residual(prepared))
    _, frame = consistent(Problem(model, prepared, reference=values), white)
    stage = rebuilt(model, prepared, white, ())
    found = [c for c in candidates(model, stage.motions) if c.name == "delay"]
    assert {c.joints for c in found} == {*((name,) for name in robot.joint_names), robot.joint_names}
    search = Search(frame, stage.motions, tuple(found), Bank())
    hits = {c.joints: search.refined(search.first(c)) for c in found}
    judged = search.judge(hits[robot.joint_names])
    assert judged.score.values == pytest.approx(np.full(robot.n, delay), abs=3e-4)
    assert max(hits.values(), key=lambda h: h.fit_gain).candidate.joints == robot.joint_names


def test_noise_in_lines_is_not_taken_for_less() -> None:
    signals = periodic(1e4, 0.0)
    usual = np.array([j.noise for j in signals.report.joints])
    known = np.array([j.noise for j in less_noise(signals).report.joints])
    assert np.all(known >= usual * (1.0 - 1e-12))
    # Rounding to steps of 1e-4 is uniform within a step.
    assert np.all(np.abs(np.log(known / (1e-4 / np.sqrt(12.0)))) < np.log(2.0))


def test_a_band_ends_where_noise_begins() -> None:
    robot = ROBOTS["scara"]()
    t = np.arange(8000) / 400.0
    rng = np.random.default_rng(2)
    upto = 12.0
    f = np.fft.rfftfreq(len(t), 1.0 / 400.0)
    size = np.where((f > 0.1) & (f < upto), 1.0 / np.maximum(f, 0.1) ** 2, 0.0)[:, None]
    wave = size * (rng.normal(size=(len(f), robot.n, 2)) @ np.array([1.0, 1.0j]))
    q = 20.0 * np.fft.irfft(wave, len(t), axis=0) * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    q = q + 1e-5 * rng.normal(size=q.shape)
    log = Log("run", t, q=q, tau={robot.transmission.measured.value: rng.normal(size=q.shape)})
    signals = ZeroPhase(cutoff_hz=60.0)(LogSet((log,), robot=robot))
    assert upto - 4.0 < told_up_to(signals, 0.2) < upto + 4.0


def test_a_log_without_noise_is_clean() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    signals = ZeroPhase(cutoff_hz=15.0)(LogSet((recorded(robot, model, values, 13, noise=0.0),), robot=robot))
    estimate = WeightedLeastSquares().solve(Problem(model, signals))
    assert diagnose(estimate, fit=signals).verdict == "clean"


def test_intervals_of_shapes_reach_the_longer_side_and_count_what_is_idealised() -> None:
    """A time constant that is known to a factor; a gap between flanks that are not as rigid as the law has them."""
    drift, gear = make_effect("temperature_drift_viscous", joints="j1", T=8.0), make_effect("backlash", joints="j2", gap=0.01)
    T, gap = (next(p for p in e.shape() if p.name == name) for e, name in ((drift, "T"), (gear, "gap")))
    assert precision._on_its_own_scale(T, 8.0, 0.01) == pytest.approx(0.08, rel=0.01)
    assert 8.0 + precision._on_its_own_scale(T, 8.0, 0.5) == pytest.approx(8.0 * np.exp(0.5))
    assert precision._on_its_own_scale(T, 8.0, np.inf) == np.inf
    assert np.isnan(precision._on_its_own_scale(T, 8.0, np.nan))
    assert precision._on_its_own_scale(gap, 0.01, 1e-4) == pytest.approx(0.002, rel=0.01)
    moment = make_effect("offset_step", joints="j1", t_0=3.0).shape()[0]
    assert precision._on_its_own_scale(moment, 3.0, 0.25) == 0.25
