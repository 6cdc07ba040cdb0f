"""What cannot be: shapes with impossible parameters, declared parameters driven out of their bounds, robots without inertia; and what
counts as a rival, or as part of a law."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pinocchio as pin
import pytest
from effect_robots import ROBOTS, declared
from scipy.signal import lfilter
from test_diagnosis_parts import NOISE, rebuilt, recorded, stage_of

from ident.diagnosis.acceptance import Found
from ident.diagnosis.analysis import without_turning
from ident.diagnosis.candidates import Candidate
from ident.diagnosis.contest import Entry, _decided, contenders
from ident.diagnosis.denied import denied
from ident.diagnosis.findings import Unexplained, _finding, _inexact
from ident.diagnosis.foretelling import Foretelling
from ident.diagnosis.frame import Frame
from ident.diagnosis.irregular import _bursts, _smooth_bursts
from ident.diagnosis.leftover import Leftover
from ident.diagnosis.light import too_light
from ident.diagnosis.motions import Motions
from ident.diagnosis.plausible import driven_out, driven_out_on, implausible, too_small_at_its_best
from ident.diagnosis.precision import unbound
from ident.diagnosis.refit import Refit
from ident.diagnosis.search import Hit, Search
from ident.diagnosis.selection import Selection
from ident.diagnosis.stage import Stage
from ident.diagnosis.turning import contradicted, left_out, sticking
from ident.diagnosis.whitening import plain_whitener, unwhitened_rows, whitener
from ident.effects.base import Effect, make_effect
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.logs.log import LogSet
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase

Array = np.ndarray


def grid(effect: Effect, **shapes: list[float]) -> Candidate:
    """A candidate with a grid of its shapes."""
    variants = [effect]
    for name, values in shapes.items():
        variants = [v.with_shape(**{name: x}) for v in variants for x in values]
    return Candidate(effect.name, tuple(effect.joints or ()), tuple(variants))


def test_a_refit_is_that_of_all_columns_together() -> None:
    stage, _ = stage_of(2, [], [], [])
    frame = stage.frame
    Z = np.concatenate([stage.search.whitened(make_effect(name, joints="j2")) for name in ("offset_drift", "asymmetric_viscous")], axis=2)
    refit = Refit.of(frame, Z)
    X = np.concatenate([frame.columns, Z], axis=2).reshape(-1, frame.columns.shape[2] + 2)
    found, *_ = np.linalg.lstsq(X, frame.torque.reshape(-1), rcond=None)
    np.testing.assert_allclose(np.append(refit.model, refit.values), found, rtol=1e-6, atol=1e-8)
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(refit.covariance, inverse, rtol=1e-5, atol=1e-7 * np.abs(inverse).max())
    np.testing.assert_allclose(refit.std, np.sqrt(np.diag(inverse)[-2:]), rtol=1e-6)


def test_a_candidate_that_needs_negative_friction_of_the_model_is_not_there() -> None:
    stage, _ = stage_of(3, [], [], [])
    frame = stage.frame
    base = list(frame.problem.base.names)
    i = base.index("Fv_j1")
    known = Refit.of(frame, stage.search.whitened(make_effect("offset_drift", joints="j1")))
    assert driven_out(frame, known) == ""
    value = float(frame.transform[i] @ frame.coefficients)
    # Along the one direction of the coefficients that moves this parameter and no other.
    along = np.linalg.pinv(frame.transform)[:, i]
    out = replace(known, model=frame.coefficients - 3.0 * value * along)
    assert driven_out(frame, out).startswith("with it Fv_j1 = -")
    unsure = replace(out, covariance=out.covariance + 1e4 * value**2 * np.pad(np.outer(along, along), (0, 1)))
    assert driven_out(frame, unsure) == ""
    kept = replace(known, model=frame.coefficients - 1.5 * value * along)
    assert driven_out(frame, kept) == ""
    # Of all findings together: the same parameter in the last fit.
    last = replace(frame, torque=frame.torque - 3.0 * value * (frame.columns @ along))
    assert driven_out_on(frame, last, ("j1",)).startswith("with it Fv_j1 = -")
    assert driven_out_on(frame, last, ("j2",)) == ""
    assert driven_out_on(frame, frame, ("j1", "j2")) == ""


def test_a_spring_is_sought_where_it_pulls() -> None:
    """Its best fit on a short way may be one that pushes; the truth is another shape."""
    spring = make_effect("counterbalance", joints="j2", angle=0.9, ratio=0.45)
    stage, _ = stage_of(4, [], [spring], [0.0, 30.0])
    candidate = grid(make_effect("counterbalance", joints="j2"), angle=[-2.0, -1.0, 0.0, 1.0, 2.0], ratio=[0.1, 0.4, 0.8])
    hit = stage.search.possible(candidate)
    assert hit is not None
    refit = Refit.of(stage.frame, hit.columns)
    assert implausible(hit.effect, refit.values, refit.std, stage.search.robot) == ""
    assert hit.fit_gain > 0.999 * stage.search.hit(candidate, spring).fit_gain
    # One that always pushes is at no shape possible, and it is a law of its own whether another one gains as much.
    stage, _ = stage_of(4, [], [spring], [0.0, -30.0])
    hit = stage.search.possible(candidate)
    assert hit is None or hit.fit_gain < 0.99 * stage.search.hit(candidate, spring).fit_gain


def test_an_exponent_next_to_one_is_viscous_friction() -> None:
    robot, one = ROBOTS["scara"](), np.ones(1)
    assert "cannot be told from viscous" in implausible(make_effect("nonlinear_viscous", joints="j1", a=1.03), one, one, robot)
    assert implausible(make_effect("nonlinear_viscous", joints="j1", a=0.7), one, one, robot) == ""


def test_a_gear_does_not_lose_most_of_its_load() -> None:
    robot, gear = ROBOTS["scara"](), make_effect("load_dependent_friction", joints="j1")
    assert "next to locks" in implausible(gear, np.array([0.98]), np.array([0.03]), robot)
    assert implausible(gear, np.array([0.98]), np.array([0.2]), robot) == ""
    assert implausible(gear, np.array([0.3]), np.array([0.01]), robot) == ""


def test_a_payload_is_one_that_a_body_can_be() -> None:
    robot, step, rng = ROBOTS["seven"](), make_effect("payload_step"), np.random.default_rng(61)
    exact, refused, impossible = np.zeros(10), 0, 0
    for _ in range(200):
        # Masses at points: as far from a sphere as a body can be.
        masses, points = rng.uniform(0.01, 2.0, 3), rng.normal(size=(3, 3))
        body = sum((pin.Inertia(m, p, np.zeros((3, 3))).toDynamicParameters() for m, p in zip(masses, points, strict=True)), exact)
        assert implausible(step, body, exact + 1e-12, robot) == ""
        assert implausible(step, -body, exact + 1e-12, robot) == "", "put down"
        lever = body * np.where((np.arange(10) > 0) & (np.arange(10) < 4), 3.0, 1.0)
        beyond = sum(lever[1:4] ** 2) > body[0] * 0.5 * (body[4] + body[6] + body[9])
        refused += bool(implausible(step, lever, exact + 1e-12, robot))
        impossible += bool(beyond)
        assert not beyond or implausible(step, lever, exact + 1e-12, robot)
    assert refused >= impossible > 50
    # What a dead zone of a SCARA's last drive was taken for: next to no mass, and a long lever.
    values = np.array([-0.013, -0.0647, -0.0219, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.0071])
    std = np.array([0.038, 0.0012, 0.0025, *np.full(6, np.inf), 0.0007])
    assert "mx and my are beyond" in implausible(step, values, std, robot)
    assert implausible(step, values, np.where(np.arange(10) == 0, np.inf, std), robot) == ""
    assert implausible(step, values, 100.0 * std, robot) == ""
    opposite = np.array([1.0, *np.zeros(8), -0.2])
    assert "is that of no body" in implausible(step, opposite, np.full(10, 0.01), robot)


def test_parameters_that_the_motion_tells_nothing_of_are_not_known_at_all() -> None:
    """A SCARA turns about vertical axes alone."""
    step = make_effect("payload_step", t_0=19.0)
    body = pin.Inertia(1.0, np.array([0.1, 0.05, 0.1]), 0.01 * np.eye(3)).toDynamicParameters()
    stage, _ = stage_of(9, [step], [step], [*body])
    ((values, std),) = unbound(stage, [step])
    known = np.isfinite(std)
    assert known.tolist() == [True, True, True, *[False] * 6, True]
    assert np.all(np.abs(values - body)[known] < 5.0 * std[known])
    assert implausible(step, values, std, stage.search.robot) == ""


def test_what_exceeds_a_limit_does_so_one_to_one() -> None:
    """What drives the torque up for a while goes with the reading's excess over some level, too, but not by just as much."""
    robot, std = ROBOTS["scara"](), np.full(1, 0.005)
    limit, late = make_effect("saturation", joints="j2", limit=2.0), make_effect("delay", joints="j2", late=-0.003)
    assert "the response is 1.12" in implausible(limit, np.array([1.12]), std, robot)
    assert implausible(limit, np.array([1.12]), 10.0 * std, robot) == ""
    assert implausible(limit, np.array([1.04]), std, robot) == ""
    # Of first order in what it depends on: there a value need not be met as well.
    assert implausible(late, np.array([-0.003 * 1.12]), 1e-3 * std, robot) == ""


def test_one_delay_on_all_joints_need_not_suit_each() -> None:
    robot = ROBOTS["scara"]()
    late = make_effect("delay", joints=tuple(robot.joint_names), late=-0.003)
    # Joint 2 would rather have twice as much.
    wanted, std = -0.003 * np.array([1.0, 2.0, *np.ones(robot.n - 2)]), np.full(robot.n, 1e-5)
    assert implausible(late, wanted, std, robot, 0.95) == ""
    assert "the response is 2" in implausible(late, wanted, std, robot, 0.4)
    single = make_effect("delay", joints="j2", late=-0.003)
    assert "the response is 2" in implausible(single, wanted[1:2], std[:1], robot, 0.95)


def test_one_thing_on_all_joints_counts_for_what_it_gains_as_one() -> None:
    late = make_effect("delay", joints=("j1", "j2", "j3", "j4"), late=0.004)
    stage, _ = stage_of(5, [], [], [])
    hit = stage.search.hit(Candidate("delay", ("j1", "j2", "j3", "j4"), (late,)), late)
    judged = stage.search.judge(hit)
    assert judged.held == hit.fit_gain
    assert judged.evidence <= hit.fit_gain <= judged.score.fit_gain


def links_alone(seed: int, body: list[float]) -> Stage:
    """Links without drives, that carry a body from the middle of the log on."""
    robot = ROBOTS["seven"]()
    model, values = robot.rigid_body(), declared(robot)[1][: 10 * robot.n]
    log = recorded(robot, model + make_effect("payload_step", t_0=19.0), np.append(values, body), seed)
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    return rebuilt(model, prepared, plain_whitener(Problem(model, prepared), NOISE * prepared.tau), [])


def switched_off(stage: Stage) -> Stage:
    """The same motion, but the second half of the log without any torque."""
    torque = stage.frame.torque.copy()
    torque[:, torque.shape[1] // 2 :] = 0.0
    frame = replace(stage.frame, torque=torque)
    return replace(stage, frame=frame, search=Search(frame, stage.motions, (), stage.search.bank))


def payload_step(stage: Stage, t_0: float) -> Hit:
    effect = make_effect("payload_step", t_0=t_0)
    return stage.search.hit(Candidate("payload_step", (), (effect,)), effect)


def test_no_payload_leaves_a_robot_without_inertia() -> None:
    nobody = [0.0] * 10
    off = switched_off(links_alone(6, nobody))
    nothing = off.search.judge(payload_step(off, 19.0))
    assert nothing.evidence > 100.0
    assert too_light(off, nothing) != ""
    # A payload that is one, and what has nothing to do with inertia.
    loaded = links_alone(6, [1.5, 0.1, 0.02, 0.05, 0.03, 0.0, 0.03, 0.0, 0.0, 0.02])
    picked = loaded.search.judge(payload_step(loaded, 19.0))
    assert picked.evidence > 100.0
    assert too_light(loaded, picked) == ""
    drift = make_effect("offset_drift", joints="j1")
    assert too_light(off, off.search.judge(off.search.hit(Candidate("offset_drift", ("j1",), (drift,)), drift))) == ""


def test_inertia_that_something_else_bends_is_held_against_nothing() -> None:
    """A thousand times the noise on all rows moves light links' inertia below zero, by many deviations of the noise."""
    stage = links_alone(6, [0.0] * 10)
    speaks_against = 0
    for seed in range(12):
        loud = 1e3 * np.random.default_rng(seed).normal(size=stage.frame.torque.shape)
        torque = stage.frame.torque + np.where(stage.problem.signals.valid.T, loud, 0.0)
        frame = replace(stage.frame, torque=torque)
        bent = replace(stage, frame=frame, search=Search(frame, stage.motions, (), stage.search.bank))
        speaks_against += too_light(bent, bent.search.judge(payload_step(bent, 19.0))) != ""
    assert speaks_against == 0


def test_inertia_is_not_held_against_what_is_found_first_where_much_is_left_elsewhere() -> None:
    """A spring on the first joint beside which its inertia is negative: refused, but not while another joint's rows hold something else."""
    stage = links_alone(6, [0.0] * 10)
    frame, robot = stage.frame, stage.problem.model.robot
    spring = make_effect("linear_spring", joints="j1")
    hit = stage.search.hit(Candidate("linear_spring", ("j1",), (spring,)), spring)
    base = list(stage.problem.base.names)
    inertia = frame.columns @ np.linalg.pinv(frame.transform)[:, base.index("Izz_j1")]
    less, stiff = -20.0 * inertia, hit.columns @ np.array([-20.0] + [0.0] * (hit.columns.shape[2] - 1))

    def refused(more: Array) -> bool:
        changed = replace(frame, torque=frame.torque + less + stiff + more)
        bent = replace(stage, frame=changed, search=Search(changed, stage.motions, (), stage.search.bank))
        return too_light(bent, bent.search.judge(bent.search.hit(hit.candidate, spring))) != ""

    elsewhere = np.zeros_like(frame.torque)
    elsewhere[robot.joint_index("j4")] = 300.0 * np.sin(np.arange(frame.torque.shape[1])) * stage.problem.signals.valid[:, -1]
    assert refused(np.zeros_like(frame.torque))
    assert not refused(elsewhere)


def found(effect: Effect, evidence: float, rivals: tuple[Found, ...] = (), weights: tuple[float, ...] = (1.0,)) -> Found:
    """A finding, as far as its confidence looks at it. On joints that the robot does not have it has one column."""
    robot = ROBOTS["scara"]()
    columns = np.zeros((2, 5, len(effect.parameters(robot)) if set(effect.joints or ()) <= set(robot.joint_names) else 1))
    columns[0, :, 0] = 1.0
    place = (effect.name, tuple(effect.joints or ()), ())
    hit = SimpleNamespace(place=place, columns=columns, effect=effect, candidate=SimpleNamespace(joints=place[1], name=effect.name))
    judged = SimpleNamespace(hit=hit, evidence=evidence, score=SimpleNamespace(heldout=evidence, values=np.ones(columns.shape[2])))
    own = SimpleNamespace(
        judged=judged, effect=effect, rivals=tuple(r.judged for r in rivals), weights=np.array(weights), weight=weights[0]
    )
    return cast(Found, own)


@pytest.mark.parametrize(
    ("first", "second", "evidence", "part"),
    [
        (make_effect("nonlinear_spring", joints="j1"), make_effect("cogging", joints="j1", angle="joint", order=1.0), 800.0, True),
        (make_effect("nonlinear_spring", joints="j1"), make_effect("cogging", joints="j1", angle="joint", order=1.0), 8000.0, False),
        (make_effect("nonlinear_spring", joints="j1"), make_effect("cogging", joints="j1", angle="joint", order=60.0), 800.0, False),
        # Two curves that were sought draw any other, whatever each explains.
        (make_effect("counterbalance", joints="j1"), make_effect("cogging", joints="j1", angle="joint", order=1.0), 80_000.0, True),
        # Once a turn of a motor behind a gear.
        (make_effect("nonlinear_spring", joints="j1"), make_effect("cogging", joints="j1", order=1.0), 800.0, False),
        (make_effect("coulomb", joints="j1"), make_effect("cogging", joints="j1", order=1.0), 800.0, False),
        (make_effect("coulomb", joints="j1"), make_effect("viscous", joints="j1"), 800.0, False),
        # A share and a power draw a dead zone; a limit is something else.
        (make_effect("torque_constant", joints="j1"), make_effect("torque_nonlinearity", joints="j1"), 80_000.0, True),
        (make_effect("torque_constant", joints="j1"), make_effect("saturation", joints="j1"), 80_000.0, False),
    ],
)
def test_something_small_that_follows_the_position_too_is_part_of_the_law(
    first: Effect, second: Effect, evidence: float, part: bool
) -> None:
    here = [found(first, 100_000.0), found(second, evidence)]
    assert any(_inexact(f, here, ROBOTS["scara"]()) for f in here) is part


def test_what_is_there_as_well_is_no_rival() -> None:
    second = found(make_effect("cogging", joints="j2", order=9.0), 900.0)
    third = found(make_effect("stribeck", joints="j1"), 300.0)
    first = found(make_effect("offset", joints="j1"), 1000.0, (second, third), (0.5, 0.4, 0.1))
    declared_stage = SimpleNamespace(frame=SimpleNamespace(heldout_loss=np.ones(4)))
    final = SimpleNamespace(problem=SimpleNamespace(model=SimpleNamespace(robot=ROBOTS["scara"]())))
    alone = cast(Selection, SimpleNamespace(found=(first,), declared=declared_stage, final=final))
    both = cast(Selection, SimpleNamespace(found=(first, second), declared=declared_stage, final=final))
    assert _finding(first, (), alone, []).confidence == pytest.approx(0.5, abs=0.01)
    with_it = _finding(first, (), both, [])
    assert with_it.confidence == pytest.approx(5.0 / 6.0, abs=0.01)
    assert [i.effect for i in with_it.imitators] == ["stribeck"]


@pytest.mark.parametrize(
    ("response", "support", "refused"),
    [
        (1.42, 69.0, True),  # an encoder's rounding in columns and residual alike, a rotor at the edge of what can be
        (0.7, 69.0, False),
        (1.42, 10.0, False),  # 1.42 ± 0.45
        (1.1, 1e5, False),  # laws are never exact
        (1.42, np.inf, False),  # tied to other parameters: nothing is known of it
    ],
)
def test_a_spring_that_gives_too_little_at_its_best_is_none(response: float, support: float, refused: bool) -> None:
    robot = ROBOTS["scara"]()
    spring = make_effect("joint_elasticity", joints="j2", stiffness=300.0)
    why = too_small_at_its_best(spring, np.array([response]), support, robot)
    assert bool(why) == refused
    assert not refused or f"{response:.3g} times" in why
    assert too_small_at_its_best(make_effect("viscous", joints="j2"), np.array([response]), support, robot) == ""


def test_what_little_is_left_takes_no_more_than_a_part_of_the_confidence() -> None:
    first = found(make_effect("offset", joints="j1"), 334.0)
    stage = SimpleNamespace(problem=SimpleNamespace(model=SimpleNamespace(robot=ROBOTS["scara"]())))
    selection = SimpleNamespace(found=(first,), declared=SimpleNamespace(frame=SimpleNamespace(heldout_loss=np.ones(4))), final=stage)

    def confidence(evidence: float) -> float:
        left = Leftover(0, "load", evidence, 13.0, 0.1, 0.2)
        return _finding(first, (), cast(Selection, selection), [left]).confidence

    assert confidence(31.0) == pytest.approx(0.4)
    assert confidence(310.0) == pytest.approx(1.0 / 26.0)


def test_what_would_take_up_much_is_told_though_it_is_improbable() -> None:
    """Of those the simplest; one that takes up more is told for what it takes up beyond."""
    spring = found(make_effect("nonlinear_spring", joints="j1"), 850.0)  # four parameters, no more than an offset takes up
    curved = found(make_effect("asymmetric_coulomb", joints="j1"), 820.0)
    offset = found(make_effect("offset", joints="j1"), 800.0)
    little = found(make_effect("linear_spring", joints="j1"), 100.0)
    payload = found(make_effect("payload_step"), 950.0)
    first = found(make_effect("asymmetric_viscous", joints="j1"), 1000.0, (spring, curved, offset, little, payload), (1.0, *[1e-9] * 5))
    stage = SimpleNamespace(problem=SimpleNamespace(model=SimpleNamespace(robot=ROBOTS["scara"]())))
    selection = SimpleNamespace(found=(first,), declared=SimpleNamespace(frame=SimpleNamespace(heldout_loss=np.ones(4))), final=stage)
    told = _finding(first, (), cast(Selection, selection), []).imitators
    assert {(i.effect, round(i.share, 2)) for i in told} == {("payload_step", 0.95), ("asymmetric_coulomb", 0.82), ("offset", 0.8)}
    assert not any(i.likely for i in told)
    assert next(i for i in told if i.effect == "offset").values == (("offset_j1", 1.0, "N m"),)


def test_rows_near_reversals_that_say_otherwise_are_left_out() -> None:
    late = make_effect("delay", joints="j2", late=0.01)
    stage, _ = stage_of(7, [late], [late], [0.01])
    names, values = list(stage.problem.model.names), np.asarray(stage.problem.base.expand(stage.frame.base_values))

    def estimate(share: float) -> Estimate:
        changed = values.copy()
        changed[names.index(late.parameters(stage.problem.model.robot)[0].name)] *= share
        return cast(Estimate, SimpleNamespace(all_values=changed))

    signals = stage.problem.signals
    assert contradicted(estimate(1.0), stage, [late], signals) == ()
    assert contradicted(estimate(0.3), stage, [late], signals) == ("j2",)
    assert contradicted(estimate(0.97), stage, [late], signals) == ()
    assert contradicted(estimate(0.3), stage, [], signals) == ()
    # A joint that hardly does anything else than turn keeps its rows.
    always = replace(signals, turning=np.ones_like(signals.valid))
    assert contradicted(estimate(0.3), stage, [late], always) == ()


def test_rows_near_reversals_that_scatter_are_seen_by_a_fit_without_them() -> None:
    """Few rows, and far off: a fit that has them follows them, and finds the others off as well."""
    stage, _ = stage_of(8, [], [], [])
    signals, n = stage.problem.signals, stage.problem.model.robot.n
    turning = np.zeros_like(signals.valid)
    turning[::20, 1] = True
    turning[::70, 0] = True  # of another joint, and nothing the matter there
    noise = np.nanstd(WeightedLeastSquares().solve(stage.problem).residual(signals)[:, 1])
    off = np.where(turning[:, 1], 12.0 * noise, 0.0)
    tau = signals.tau + off[:, None] * (np.arange(n) == 1)

    def stuck(rows: Signals, at: Stage = stage) -> tuple[str, ...]:
        def fitted(joints: tuple[str, ...]) -> Estimate:
            return WeightedLeastSquares().solve(replace(at.problem, signals=without_turning(rows, joints)))

        return sticking(at, rows, fitted)

    disturbed = replace(signals, tau=tau, turning=turning)
    assert stuck(disturbed) == ("j2",)
    share = (turning & signals.valid)[:, 1].sum() / signals.valid[:, 1].sum()
    assert f"j2 ({100 * share:.2g} %)" in left_out(("j2",), disturbed)
    assert stuck(replace(signals, turning=turning)) == ()
    # Friction at low speed was found in them: then they are not what is left over.
    assert stuck(disturbed, replace(stage, turning=("j2",))) == ()
    # A joint that hardly does anything else than turn keeps its rows.
    assert stuck(replace(disturbed, turning=np.ones_like(turning))) == ()


def test_rows_that_bend_a_fit_of_all_hide_in_it_and_not_in_one_without_them() -> None:
    """A third of the rows, off along the model's own columns: a fit of all of them is as far off elsewhere as there."""
    stage, _ = stage_of(8, [], [], [])
    signals = stage.problem.signals
    estimate = WeightedLeastSquares().solve(stage.problem)
    predicted = signals.tau - np.nan_to_num(estimate.residual(signals))
    near = np.zeros_like(signals.valid)
    near[:, 1] = np.abs(predicted[:, 1]) > np.quantile(np.abs(predicted[:, 1]), 0.65)
    off = np.where(near, 0.5 * predicted, 0.0)
    disturbed = replace(signals, tau=signals.tau + off, turning=near)

    def fitted(joints: tuple[str, ...]) -> Estimate:
        return WeightedLeastSquares().solve(replace(stage.problem, signals=without_turning(disturbed, joints)))

    whole = np.nan_to_num(fitted(()).residual(disturbed))[:, 1] ** 2
    assert whole[near[:, 1]].mean() < 4.0 * whole[~near[:, 1] & signals.valid[:, 1]].mean()
    assert sticking(stage, disturbed, fitted) == ("j2",)


def test_what_held_out_data_say_is_told_of_the_winner() -> None:
    """The finding, a rival that is far better, one a little better, one that did not enter: each against the best."""
    one = found(
        make_effect("offset", joints="j1"), 100.0, tuple(found(make_effect("stribeck", joints=j), 90.0) for j in ("j1", "j2", "j3"))
    )
    cast(SimpleNamespace, one).weights = np.array([0.7, 0.1, 0.15, 0.05])
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2000, 1))

    def entry(place: int, error: float) -> Entry:
        extra = error * np.sin(np.arange(2000.0))[:, None]
        fake = SimpleNamespace(estimate=SimpleNamespace(fit_error=SimpleNamespace(rms=np.ones(1))), residual=noise + extra, signals=held)
        fake.allowing = lambda _: (fake.residual, 0.0)
        return Entry(place, (), cast(Foretelling, fake))

    held = SimpleNamespace(row_runs=(slice(0, 2000),))
    winner, logs, lines = _decided(one, [entry(0, 1.0), entry(1, 0.7), entry(2, 0.1)])
    assert winner.place == 2
    assert int(np.argmax(logs)) == 2
    assert logs[1] < logs[2] - 5.0
    assert logs[0] < logs[2] - 5.0
    assert logs[3] == pytest.approx(np.log(0.05))
    assert len(lines) == 2
    alone, logs, lines = _decided(one, [entry(0, 0.1), entry(1, 0.1)])
    assert alone.place == 0
    assert lines == []
    np.testing.assert_allclose(logs, np.log(one.weights))


def test_a_rival_that_was_judged_twice_loses_twice() -> None:
    """A tilted base that stood in the model, and the same of a new scan: one of them enters, and what is said of it holds for both."""
    rivals = tuple(found(make_effect("stribeck", joints=j), 90.0) for j in ("j2", "j2", "j3"))
    one = found(make_effect("offset", joints="j1"), 100.0, rivals)
    cast(SimpleNamespace, one).weights = np.array([0.4, 0.25, 0.25, 0.1])
    assert contenders(one) == [0, 2]
    noise = np.random.default_rng(0).normal(size=(2000, 1))
    held = SimpleNamespace(row_runs=(slice(0, 2000),))

    def entry(place: int, error: float) -> Entry:
        extra = error * np.sin(np.arange(2000.0))[:, None]
        fake = SimpleNamespace(estimate=SimpleNamespace(fit_error=SimpleNamespace(rms=np.ones(1))), residual=noise + extra, signals=held)
        fake.allowing = lambda _: (fake.residual, 0.0)
        return Entry(place, (), cast(Foretelling, fake))

    _, logs, _ = _decided(one, [entry(0, 0.1), entry(1, 1.0), entry(3, 0.1)])
    assert logs[1] < logs[0] - 5.0
    assert logs[2] == logs[1]
    assert logs[3] == pytest.approx(np.log(0.1))
    # Where it wins, its double goes with it.
    winner, logs, _ = _decided(one, [entry(0, 1.0), entry(1, 0.1), entry(3, 1.0)])
    assert winner.place == 1
    assert logs[2] == pytest.approx(logs[1])
    assert logs[0] < logs[1] - 5.0


def test_a_little_that_is_even_over_time_decides_no_more_than_its_likelihood() -> None:
    """A rival that leaves 1.2 % less, everywhere: far beyond the scatter of blocks of time, and worth next to nothing, the less as no law
    is exact to 1 %."""
    one = found(make_effect("delay", joints="j1"), 100.0, (found(make_effect("filter_lag", joints="j1"), 95.0),))
    cast(SimpleNamespace, one).weights = np.array([0.9, 0.1])
    noise = np.random.default_rng(0).choice([-1.0, 1.0], size=(100, 1)) * np.linspace(0.95, 1.05, 100)[:, None]

    def entry(place: int, residual: Array) -> Entry:
        fake = SimpleNamespace(estimate=SimpleNamespace(fit_error=SimpleNamespace(rms=np.ones(1))), residual=residual)
        fake.signals, fake.allowing = SimpleNamespace(row_runs=(slice(0, 100),)), lambda _: (residual, 0.0)
        return Entry(place, (), cast(Foretelling, fake))

    winner, logs, _ = _decided(one, [entry(0, noise), entry(1, np.sqrt(0.988) * noise)])
    assert winner.place == 0
    assert logs[0] - logs[1] == pytest.approx(np.log(9.0) - 0.5 * (0.012 - 0.01 * 0.988) * np.sum(noise**2), rel=1e-6)


def test_what_differs_from_block_to_block_decides_as_far_as_its_scatter_lets_it() -> None:
    """The same gain, in all blocks of time alike, in some, and in one alone: never nothing, and never more than under white noise."""
    one = found(make_effect("delay", joints="j1"), 100.0, (found(make_effect("filter_lag", joints="j1"), 95.0),))
    cast(SimpleNamespace, one).weights = np.array([0.5, 0.5])

    def odds(gains: Array) -> float:
        """Of a rival with these gains (24,) in 24 blocks of 50 rows."""

        def entry(place: int, squares: Array) -> Entry:
            residual = np.sqrt(np.repeat(squares / 50.0, 50))[:, None]
            fake = SimpleNamespace(estimate=SimpleNamespace(fit_error=SimpleNamespace(rms=np.ones(1))), residual=residual)
            fake.signals, fake.allowing = SimpleNamespace(row_runs=(slice(0, 1200),)), lambda _: (residual, 0.0)
            return Entry(place, (), cast(Foretelling, fake))

        _, logs, _ = _decided(one, [entry(0, 50.0 + 0.0 * gains), entry(1, 50.0 - gains)])
        return float(logs[1] - logs[0])

    even, some, single = np.full(24, 2.0), np.tile([5.0, -1.0], 12), np.r_[48.0, np.zeros(23)]
    assert odds(even + np.tile([1e-6, -1e-6], 12)) == pytest.approx(0.5 * (48.0 - 0.01 * 24.0 * 48.0), rel=1e-3)
    for gains in (some, single):
        beyond = 48.0 - 0.01 * np.minimum(50.0, 50.0 - gains).sum()
        z = beyond / (np.sqrt(24.0) * np.std(gains, ddof=1))
        assert odds(gains) == pytest.approx(12.0 * np.log(1.0 + 2.0 * z**2 / 23.0), rel=1e-9)
        assert odds(-gains) < 0.0
    assert 0.0 < odds(single) < odds(some) < odds(even + np.tile([1e-6, -1e-6], 12))


def test_as_many_rivals_are_looked_at_as_weigh_anything() -> None:
    """Six, and more where those left out would weigh more than 2 % together; never more than 24; one of each place."""
    rivals = tuple(found(make_effect("stribeck", joints=f"j{i}"), 30.0) for i in range(40))
    one = found(make_effect("offset", joints="j"), 100.0, rivals)

    def looked_at(weights: Array) -> list[int]:
        cast(SimpleNamespace, one).weights = np.append(1.0 - weights.sum(), weights)
        return contenders(one)

    assert looked_at(np.where(np.arange(40) < 8, 0.002, 1e-4)) == [0, 1, 2, 3, 4, 5]
    assert looked_at(np.where(np.arange(40) < 10, 0.02, 1e-4)) == list(range(9))
    assert looked_at(np.full(40, 0.02)) == list(range(24))
    assert looked_at(np.full(40, 1e-4)) == []


def test_a_few_rows_far_beyond_the_noise_are_bursts() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(size=900)
    assert _bursts(noise) is None
    few = noise.copy()
    few[[100, 500]] = 9.0
    assert _bursts(few) is None, "one bad sample spreads over a row or two"
    knocks = noise.copy()
    knocks[[100, 101, 400, 401, 700]] = (8.0, -7.0, 9.0, -6.0, 7.0)
    found = _bursts(knocks)
    assert found is not None
    assert "bursts" in found.name
    assert found.evidence == pytest.approx(64 + 49 + 81 + 36 + 49, rel=0.2)
    assert found.evidence > 3.0 * found.standard_error / np.sqrt(5.0)
    # Noise of any level is none, and what swells for a while is.
    assert _bursts(1e-6 * noise) is None
    swelling = noise * np.where(np.arange(900) < 100, 6.0, 1.0)
    assert _bursts(swelling) is not None


def test_smooth_bursts_do_not_pass_for_the_colour_of_the_noise() -> None:
    """A rough spot of a gear that a slow joint passes twice: a filter of the noise follows its course, and its error is the level then."""
    rows, caught = 300, 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        at, passed = np.arange(rows), rng.uniform(30.0, rows - 30.0, 2)
        spot = sum(rng.uniform(15.0, 60.0) * np.exp(-(((at - x) / rng.uniform(2.5, 5.0)) ** 2)) for x in passed)
        residual = (rng.normal(size=rows) + spot)[:, None]
        valid = np.ones((rows, 1), bool)
        white = whitener(residual, valid, [slice(0, rows)])
        left = white(residual[:, 0], 0)
        found = _smooth_bursts(unwhitened_rows(white, left, 0, valid[:, 0]))
        assert found is not None
        assert found.evidence > 100.0
        caught += _bursts(left) is not None
        # Noise of a strong colour is none, nor is one bad sample.
        coloured = lfilter([1.0], [1.0, -0.95], rng.normal(size=rows + 300))[300:]
        assert _smooth_bursts(coloured) is None
        coloured[100:102] = 60.0
        assert _smooth_bursts(coloured) is None
    assert caught < 20, "whitened rows tell all of them, then this is not needed"


@pytest.mark.parametrize("clipped", ["drive", "log"])
def test_a_limit_beyond_which_the_torque_goes_on_changing_is_none(clipped: str) -> None:
    stage, _ = stage_of(5, [], [], [])
    model, reference = stage.problem.model, stage.problem.base.expand(stage.frame.base_values)
    torque = np.abs(stage.problem.signals.torque[:, 1])
    limit = make_effect("saturation", joints="j2", limit=float(np.quantile(torque, 0.9)), clipped=clipped)
    problem = Problem(model + limit, stage.problem.signals).with_reference(np.append(reference, 1.0))
    frame = Frame.build(problem, stage.white)
    search = Search(frame, Motions(problem), (), stage.search.bank)
    rng = np.random.default_rng(3)
    noise = np.where(problem.signals.valid.T, rng.normal(size=frame.torque.shape), 0.0)
    exact = frame.columns @ frame.coefficients + noise
    other = limit.denied_by()
    assert other is not None
    shift = search.whitened(other)[:, :, 1]

    def said(torque: Array, evidence: float) -> tuple[Unexplained, ...]:
        final = SimpleNamespace(frame=replace(frame, torque=torque), search=search)
        return denied(cast(Selection, SimpleNamespace(final=final, found=(found(limit, evidence),))))

    assert said(exact, 1000.0) == ()
    more = exact + 40.0 * shift / np.linalg.norm(shift)
    (told,) = said(more, 1000.0)
    assert told.joint == "j2"
    assert 100.0 < told.gain < 1600.0
    assert "saturation on j2" in told.evidence
    # Beside what the limit explains it is the inexactness of any law.
    assert said(more, 1e6) == ()
    assert said(exact, 0.0) == ()
