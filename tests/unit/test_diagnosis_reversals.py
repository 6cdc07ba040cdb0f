"""Reversals: rows near them are asked for friction at low speed alone; what a delay carries out of them misleads nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.diagnosis import carried, contest, diagnose, low_speed
from ident.diagnosis.acceptance import Found
from ident.diagnosis.analysis import without_reversals, without_turning
from ident.diagnosis.bank import Bank
from ident.diagnosis.contest import contenders, contested
from ident.diagnosis.low_speed import near_reversals
from ident.diagnosis.stage import Stage
from ident.effects.base import Effect, make_effect
from ident.effects.motion import Motion
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log, LogSet
from ident.problem.problem import Problem
from ident.robots.transmission import Side
from ident.signals import Signals, ZeroPhase

Array = np.ndarray
RATE = 200.0
#: The joint that has the friction, and the Stribeck velocity: two hundredths of its usual top speed, on the motor side.
JOINT, SLOW = 1, 5.0


def slow_motion(
    seed: int, effects: list[Effect], sizes: list[float], hold: float = 0.0, noise: float = 1e-3, late: float = 0.0
) -> tuple[Signals, Signals]:
    """Fit and held-out signals of a SCARA along sines below 1 Hz. `hold`: seconds about each reversal of the joint in which its friction
    passes from one side to the other, as where a contact holds; `late`: seconds by which the joint's torque is read late."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi * np.array([0.11, 0.23, 0.41, 0.67, 0.93])
    size = rng.uniform(0.1, 0.4, size=(5, robot.n)) * np.where([j.prismatic for j in robot.joints], 0.2, 1.0)
    t = np.arange(round(60.0 * RATE)) / RATE
    angle = w * t[:, None]
    phase = rng.uniform(0.0, 2.0 * np.pi, size=(5, robot.n))
    q, dq, ddq = (
        np.stack([f(angle + phase[:, j]) @ (size[:, j] * w**k) for j in range(robot.n)], axis=1)
        for k, f in enumerate((np.sin, np.cos, lambda x: -np.sin(x)))
    )
    exact = Motion.of(robot, q, dq, ddq, t, rate=RATE)
    tau = model.torque(exact, values)
    whole = model
    for effect in effects:
        whole = whole + effect
    tau = tau + whole.torque(exact, np.append(0.0 * values, sizes))
    if hold:
        friction = values[list(model.names).index(f"Fc_{robot.joint_names[JOINT]}")] * np.sign(dq[:, JOINT])
        tau[:, JOINT] += held_back(friction, hold)
    tau[:, JOINT] = np.interp(t - late, t, tau[:, JOINT])
    tau = tau + noise * np.std(tau, axis=0) * rng.normal(size=tau.shape)
    q = q + 1e-6 * rng.normal(size=q.shape)
    cut = round(45.0 * RATE)
    logs = (
        Log(name, t[s], q=q[s], tau={robot.transmission.measured.value: tau[s]})
        for name, s in (("a", slice(0, cut)), ("b", slice(cut, None)))
    )
    first, second = (ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot)) for log in logs)
    return first, second


def held_back(force: np.ndarray, seconds: float) -> np.ndarray:
    """What is to be added to friction (N,) that changes sign at once for it to do so over so many seconds."""
    width = 2 * round(0.5 * seconds * RATE) + 1
    return np.asarray(np.convolve(force, np.ones(width) / width, "same") - force)


def stribeck(size: float) -> tuple[list[Effect], list[float]]:
    return [make_effect("stribeck", joints=ROBOTS["scara"]().joint_names[JOINT : JOINT + 1], v_s=SLOW, label="true")], [size]


def size() -> float:
    """As much again as the joint's Coulomb friction."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    return float(values[list(model.names).index(f"Fc_{robot.joint_names[JOINT]}")])


@pytest.mark.parametrize("seed", [3, 4])
def test_friction_that_rises_towards_standstill_is_found_where_only_rows_near_reversals_hold_it(seed: int) -> None:
    fit, held = slow_motion(seed, *stribeck(size()))
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert [(f.name, f.joints) for f in found.findings] == [("stribeck", fit.robot.joint_names[JOINT : JOINT + 1])]
    # Few reversals are held out; where they show it no more clearly than chance might, that is said, and nothing else stands against it.
    faint = any("no more clearly than chance might" in w for w in found.warnings)
    assert found.verdict == ("ambiguous" if faint else "explained")
    assert not any(m.likely for m in found.findings[0].imitators)
    inside = [abs(p.value - true) < 4.0 * p.std for p, true in zip(found.findings[0].parameters, (size(), SLOW), strict=True)]
    assert all(inside)
    assert found.selection.final.turning == fit.robot.joint_names[JOINT : JOINT + 1]


def test_a_contact_that_holds_at_reversals_is_not_called_friction() -> None:
    fit, held = slow_motion(5, [], [], hold=0.08, noise=5e-4)
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    joint = fit.robot.joint_names[JOINT]
    # More is left there than elsewhere; whatever it is called, it is not what it is the reverse of.
    residual = before.residual(fit)[:, JOINT]
    near = near_reversals(fit, joint)
    elsewhere = without_reversals(fit).valid[:, JOINT]
    assert np.sqrt(np.mean(residual[near] ** 2)) > 1.3 * np.sqrt(np.mean(residual[elsewhere] ** 2))
    found = diagnose(before, held)
    assert "stribeck" not in [f.name for f in found.findings]
    assert found.selection.final.turning == ()


@pytest.mark.parametrize("seed", [9, 19])
def test_where_friction_of_a_coupled_joint_reverses_it_holds_too(seed: int) -> None:
    """The slide's guides hold it for some milliseconds while its motor, which turns the spindle that the last joint sits on, goes on."""
    force = 30.0
    fit, held = slow_motion(seed, [make_effect("joint_side_friction", joints=("j3",), label="true")], [force, 0.0], noise=5e-4)
    drive, j = fit.robot.transmission, fit.robot.joint_index("j3")

    def holding(signals: Signals) -> Signals:
        (log,) = signals.source.logs
        torque = np.zeros_like(log.q)
        torque[:, j] = held_back(force * np.sign(np.gradient(log.q[:, j])), 0.1)
        tau = {key: x + drive.torque(torque, Side.JOINT, Side.MOTOR) for key, x in log.tau.items()}
        return ZeroPhase(cutoff_hz=15.0)(LogSet((Log(log.name, log.t, q=log.q, tau=tau),), robot=signals.robot))

    fit, held = holding(fit), holding(held)
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert [(f.name, f.joints) for f in found.findings] == [("joint_side_friction", ("j3",))]
    assert found.verdict == "explained"
    (size, _) = found.findings[0].parameters
    assert abs(size.value - force) < 4.0 * size.std


def test_rows_near_reversals_say_nothing_where_there_is_nothing() -> None:
    fit, held = slow_motion(6, [], [])
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert found.verdict == "clean"
    assert found.selection.final.turning == ()


def test_a_delay_is_not_that_of_the_contact_that_it_carries_out_of_reversals() -> None:
    late = 0.03
    fit, held = slow_motion(7, [], [], hold=0.03, late=late)
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert [f.name for f in found.findings] == ["delay"]
    p = found.findings[0].parameters[-1]
    assert abs(p.value - late) < 3.0 * p.std
    assert p.std < 0.1 * late
    assert any("a reversal is carried into" in line for line in found.trail)


def test_rows_are_left_out_for_as_long_as_a_reversal_is_in_them() -> None:
    fit, _ = slow_motion(8, [], [])
    j = JOINT
    memory = np.zeros(fit.robot.n)
    rows = {}
    for seconds in (0.0, 0.1, -0.1):
        memory[j] = seconds
        rows[seconds] = without_reversals(fit, (), memory).valid
    assert np.array_equal(rows[0.0], without_reversals(fit).valid)
    for seconds in (0.1, -0.1):
        assert np.array_equal(np.delete(rows[seconds], j, axis=1), np.delete(rows[0.0], j, axis=1))
        gone = rows[0.0][:, j] & ~rows[seconds][:, j]
        assert gone.sum() > 20
        assert not (rows[seconds][:, j] & ~rows[0.0][:, j]).any()
        # Each lies next to rows that were left out already, on the side to which it is carried.
        behind = fit.valid[:, j] & ~rows[0.0][:, j]
        near = [behind[max(0, i - 3) : i].any() if seconds > 0 else behind[i + 1 : i + 4].any() for i in np.flatnonzero(gone)]
        assert np.mean(near) > 0.95


def test_rivals_are_compared_without_rows_near_reversals_of_their_joints() -> None:
    """Where a contact holds neither one's law says what happens there, and both would come out at wrong values."""
    fit, held = slow_motion(2, [], [], hold=0.03, noise=0.02, late=0.016)
    model, _ = declared(fit.robot)
    estimator = WeightedLeastSquares()
    found = diagnose(estimator.solve(Problem(model, fit)), held)
    (one,) = found.selection.found
    assert contenders(one)
    asked = []

    def refit(stage: Stage, turning: tuple[str, ...]) -> Estimate:
        asked.append(turning)
        return estimator.solve(Problem(stage.problem.model, without_turning(fit, turning), reference=stage.problem.reference))

    contested(found.selection, Bank(), without_reversals(held), refit)
    joint = fit.robot.joint_names[JOINT]
    assert all(joint in turning for turning in asked[:-1])
    assert len(asked) > 2
    # What is found in the end is of all rows.
    assert asked[-1] == ()


def test_a_lag_and_a_delay_are_weighed_by_rows_that_hold_no_reversal() -> None:
    fit, held = slow_motion(2, [], [], hold=0.03, noise=0.02, late=0.016)
    model, _ = declared(fit.robot)
    selection = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held).selection
    (one,) = selection.found
    names = [j.hit.candidate.name for j in (one.judged, *one.rivals)]
    assert {"delay", "filter_lag"} <= set(names[:2])

    def again(first: float) -> Array:
        weights = np.zeros(len(names))
        weights[:2] = first, 1.0 - first
        return carried._weighed_again(replace(one, weights=weights), [], selection.declared, selection.final, Bank()).weights

    # Whatever they were on rows that reversals reach.
    assert again(0.99) == pytest.approx(again(0.05))
    assert again(0.5).sum() == pytest.approx(1.0)
    kept = again(1.0)
    assert kept[:2].tolist() == [1.0, 0.0]


def test_rows_near_reversals_do_not_move_what_a_delay_is_elsewhere() -> None:
    fit, held = slow_motion(2, [], [], hold=0.0, noise=0.02, late=0.016)
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    (one,) = found.selection.found
    (shape,) = one.effect.shape()
    at, joint = getattr(one.effect, shape.name), fit.robot.joint_names[JOINT]

    def there(share: float) -> Found:
        effect = one.effect.with_shape(**{shape.name: share * at})
        return replace(one, judged=replace(one.judged, hit=replace(one.judged.hit, effect=effect)))

    assert low_speed._moved(found.selection, [there(1.1)], joint) is None
    assert low_speed._moved(found.selection, [there(0.4)], joint) is one
    # What sits on another joint says nothing of this one.
    assert low_speed._moved(found.selection, [there(0.4)], fit.robot.joint_names[JOINT - 1]) is None


def test_a_shape_that_only_held_out_data_tell_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, held = slow_motion(2, [], [], hold=0.0, noise=0.02, late=0.016)
    model, _ = declared(fit.robot)
    estimator = WeightedLeastSquares()
    found = diagnose(estimator.solve(Problem(model, fit)), held)
    (one,) = found.selection.found
    (shape, *_) = one.effect.shape()
    other = one.effect.with_shape(**{shape.name: 1.1 * getattr(one.effect, shape.name)})

    def refit(stage: Stage, turning: tuple[str, ...]) -> Estimate:
        return estimator.solve(Problem(stage.problem.model, fit, reference=stage.problem.reference))

    # As if any shape of its grid did as well in the data fitted, and this one better in those held out.
    monkeypatch.setattr(contest.Arena, "_as_likely", lambda self, hit: [other])
    monkeypatch.setattr(contest.Arena, "_error", lambda self, entry: 0.0 if other in entry.effects else 1.0)
    contested_ = contested(found.selection, Bank(), without_reversals(held), refit)
    assert contested_.selection.found[0].effect == other
    assert other in contested_.after.model.effects
    assert any("hardly tell its shape" in line for line in contested_.said)


@pytest.mark.parametrize("std", [0.3, 0.4])
def test_what_blocks_of_time_do_not_agree_on_is_taken_back(std: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three standard deviations are asked for, whatever the evidence; that of a shape counts for nothing."""
    fit, held = slow_motion(3, *stribeck(size()))
    model, _ = declared(fit.robot)
    joint = fit.robot.joint_names[JOINT]
    parameters = (SimpleNamespace(name=f"Fs+_{joint}", value=-1.0, std=std), SimpleNamespace(name="v_s", value=9.0, std=0.1))
    monkeypatch.setattr(low_speed, "found_parameters", lambda stage, effects: [parameters for _ in effects])
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert [f.name for f in found.findings] == (["stribeck"] if std < 1.0 / 3.0 else [])
    assert any("blocks of time do not agree" in line for line in found.trail) == (not found.findings)
