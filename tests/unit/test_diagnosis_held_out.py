"""What data that nothing was chosen on do to a diagnosis: rivals are told apart, what does harm is taken back; intervals by jackknife."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from scipy.linalg import block_diag
from scipy.signal import lfilter

from ident.diagnosis import Finding, diagnose
from ident.diagnosis import confirmed as confirmed_module
from ident.diagnosis import diagnosis as diagnosis_module
from ident.diagnosis import withdrawn as withdrawn_module
from ident.diagnosis.acceptance import Found, elsewhere
from ident.diagnosis.analysis import without_reversals
from ident.diagnosis.bank import Bank
from ident.diagnosis.change import Change, by_signs
from ident.diagnosis.confirmed import LastWord
from ident.diagnosis.consistent import consistent
from ident.diagnosis.contest import Arena
from ident.diagnosis.diagnosis import _share
from ident.diagnosis.findings import HELD_OUT
from ident.diagnosis.foretelling import Foretelling
from ident.diagnosis.in_plain_sight import above_floor, apart
from ident.diagnosis.leftover import Leftover
from ident.diagnosis.motions import Motions
from ident.diagnosis.nominated import _found
from ident.diagnosis.precision import found_parameters
from ident.diagnosis.search import Search
from ident.diagnosis.selection import Selection
from ident.diagnosis.stage import Stage, with_effects
from ident.diagnosis.stand_in import stand_in
from ident.diagnosis.whitening import plain_whitener, whitener
from ident.diagnosis.withdrawn import withdrawal, withdrawn, without_guesses
from ident.effects.base import Effect, make_effect
from ident.effects.motion import Motion
from ident.effects.springs import Counterbalance
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.logs.log import Log, LogSet
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
RATE = 200.0


def prepared(seed: int, effects: list[Effect], sizes: list[float], width: float = 1.0, noise: float = 0.03, colour: float = 0.0) -> Signals:
    """A log of a SCARA along sines of a width, with effects of these sizes that nobody declares, and noise of a colour."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    rng = np.random.default_rng(seed)
    order = np.arange(1, 25)
    weight = width * (1.0 / (4.0 + order))[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), rng.normal(size=(24, robot.n)) * weight, rng.normal(size=(24, robot.n)) * weight, 0.025)
    t = np.arange(round(38.0 * RATE)) / RATE
    c = motion.sample(t)
    exact = Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE)
    tau = model.torque(exact, values)
    white = rng.normal(size=tau.shape)
    tau = tau + noise * np.std(tau, axis=0) / width * np.sqrt(1.0 - colour**2) * lfilter([1.0], [1.0, -colour], white, axis=0)
    whole = model
    for effect in effects:
        whole = whole + effect
    tau = tau + whole.torque(exact, np.append(0.0 * values, sizes))
    logs = LogSet((Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau}),), robot=robot)
    return ZeroPhase(cutoff_hz=15.0)(logs)


def test_what_does_harm_on_held_out_data_is_taken_back_and_said() -> None:
    """A step in one log only: the next log, on its own clock, has none."""
    step = make_effect("offset_step", joints="j2", t_0=17.0)
    fit, held = prepared(1, [step], [1.0]), prepared(2, [], [])
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert found.verdict == "unexplained"
    assert not [f for f in found.findings if f.name == "offset_step"]
    (said,) = [u for u in found.unexplained if u.signature == HELD_OUT]
    assert said.joint == "j2"
    assert "offset_step" in said.evidence
    assert any("taken back" in w and "offset_step on j2" in w for w in found.warnings)
    assert found.comparison.gain >= 0.0
    # The same step in both logs is what it is.
    kept = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), prepared(2, [step], [1.0]))
    assert [(f.name, f.joints) for f in kept.findings] == [("offset_step", ("j2",))]
    assert kept.verdict == "explained"


def test_what_is_taken_back_and_leaves_little_is_not_decided() -> None:
    """The same step, no larger than the noise."""
    step = make_effect("offset_step", joints="j2", t_0=17.0)
    fit, held = prepared(1, [step], [0.3]), prepared(2, [], [])
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), held)
    assert (found.verdict, found.findings) == ("ambiguous", ())
    assert any(u.signature == HELD_OUT and "offset_step lowers" in u.evidence for u in found.unexplained)
    assert str(found).startswith("verdict: ambiguous: something is there, and what it looks like")
    assert found.comparison.gain == 0.0


def left(rms: float, evidence: float) -> Leftover:
    return Leftover(0, "time", evidence, 1.0, np.inf, rms)


@pytest.mark.parametrize(
    ("taken_back", "leftovers", "is_open"),
    [
        ([300.0], [], True),
        ([("backlash", 300.0)], [left(1.8, 500.0)], True),  # knocks are foretold too roughly to be denied
        ([("backlash", 300.0), 3000.0], [left(1.8, 900.0)], False),  # and drew a small part of what is left
        ([300.0], [left(1.2, 500.0)], True),
        ([300.0], [left(1.2, 350.0), left(1.1, 350.0)], False),  # most of what is left was drawn by nothing
        ([300.0, 100.0], [left(1.2, 350.0), left(1.1, 350.0)], True),
        ([3000.0], [left(1.8, 500.0)], False),  # more than slight
        ([300.0], [left(1.2, 500.0), left(0.3, 90.0)], True),  # the second is too little to count
        ([], [left(1.2, 500.0)], False),  # nothing was found, and something is there
        ([], [], False),
    ],
)
def test_what_may_be_there_after_all(taken_back: list[float | tuple[str, float]], leftovers: list[Leftover], is_open: bool) -> None:
    named = [x if isinstance(x, tuple) else ("offset_step", x) for x in taken_back]
    refused = [SimpleNamespace(effect=make_effect(name, joints="j1"), judged=SimpleNamespace(evidence=gain)) for name, gain in named]
    assert confirmed_module.undecided(refused, leftovers) is is_open


def test_what_an_estimate_foretells_as_far_as_its_parameters_are_known() -> None:
    """Against the density of held-out torque itself: normal, of covariance σ² I + Φ P Φᵀ on the rows of all joints."""
    fit, held = prepared(5, [], [], width=0.3, noise=0.3), prepared(6, [], [], noise=0.3)
    model, _ = declared(fit.robot)
    estimate = WeightedLeastSquares().solve(Problem(model, fit))
    scale = estimate.fit_error.rms
    own = estimate.problem_on(held)
    usable = np.flatnonzero(held.valid.all(axis=1))
    chosen = usable[np.linspace(0, len(usable) - 1, 60).astype(int)]
    few = replace(held, valid=held.valid & np.isin(np.arange(len(held.tau)), chosen)[:, None])
    columns = np.concatenate([r.columns for r in own.rows()]) @ model.base.regroup[:, list(estimate.base.independent)]
    phi = (columns[chosen] / scale[:, None]).reshape(-1, columns.shape[2])
    r = (estimate.residual(held)[chosen] / scale).ravel()
    spread = np.eye(len(r)) + phi @ estimate.covariance @ phi.T
    exact = r @ np.linalg.solve(spread, r) + np.linalg.slogdet(spread)[1]
    left, price = Foretelling(estimate, few).allowing(1.0 / scale**2)
    assert np.nansum((left / scale) ** 2) + price == pytest.approx(exact, rel=1e-9)
    assert price > 1.0
    assert Foretelling(estimate, few).misfit(1.0 / scale**2) == pytest.approx(r @ np.linalg.solve(spread, r), rel=1e-9)


def test_what_an_estimate_foretells_under_noise_of_a_colour() -> None:
    """The same of coloured noise, of which no row tells as much as it would alone: against the density itself, up to a constant."""
    fit, held = prepared(5, [], [], width=0.3, noise=0.3), prepared(6, [], [], noise=0.3)
    model, _ = declared(fit.robot)
    colour, few = np.array([1.0, -0.6, 0.2]), replace(held, valid=held.valid & (np.arange(len(held.tau)) < 40)[:, None])
    white = whitener(lfilter([1.0], colour, np.random.default_rng(1).normal(size=fit.tau.shape), axis=0), fit.valid, fit.row_runs)
    there, differences = white.on(few.valid, few.row_runs), []
    for own in (model, model + make_effect("asymmetric_viscous")):
        estimate = WeightedLeastSquares().solve(Problem(own, fit))
        rows = np.concatenate([r.columns for r in estimate.problem_on(few).rows()]) @ own.base.regroup[:, list(estimate.base.independent)]
        exact = []
        for j in range(fit.robot.n):
            used = np.flatnonzero(few.valid[:, j])
            W = there.matrices[j].toarray()[np.ix_(used, used)]
            exact.append((estimate.residual(few)[used, j], rows[used, j], np.linalg.inv(W.T @ W)))
        r, phi = np.concatenate([x[0] for x in exact]), np.concatenate([x[1] for x in exact])
        spread = block_diag(*(x[2] for x in exact)) + phi @ estimate.covariance @ phi.T
        differences.append(Foretelling(estimate, few).surprise(white) - r @ np.linalg.solve(spread, r) - np.linalg.slogdet(spread)[1])
    assert differences[0] == pytest.approx(differences[1], abs=1e-6)


def test_held_out_data_confirm_what_the_fitted_ones_suggest_with_too_little_evidence() -> None:
    """A fault of which a narrow motion shows next to nothing, a wider one more; where that one does not have it, nothing is said."""
    fault = make_effect("asymmetric_viscous", joints="j2")
    fit = prepared(31, [fault], [0.003], width=0.2)
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    found = diagnose(before, prepared(32, [fault], [0.003], width=0.4, noise=0.01))
    assert [(f.name, f.joints) for f in found.findings] == [("asymmetric_viscous", ("j2",))]
    assert any("asymmetric_viscous on j2" in w and "too little evidence" in w and "had a part" in w for w in found.warnings)
    # What was named beforehand gains there more than the best of all that were asked about would by chance.
    assert found.verdict == "explained"
    assert found.findings[0].parameters[0].value == pytest.approx(0.003, abs=3.0 * found.findings[0].parameters[0].std)
    selection = found.selection
    one = _found(selection.nearest[0], selection.nearest, selection.declared)
    assert len(one.rivals) == len(selection.nearest) - 1
    assert np.all(np.diff(one.weights[1:]) <= 0.0), "held-out data look at the likeliest rivals first"
    without = diagnose(before, prepared(32, [], [], width=0.4, noise=0.01))
    assert without.findings == ()
    assert not any("too little evidence" in w for w in without.warnings)


def test_held_out_data_confirm_it_beside_a_finding_on_another_joint() -> None:
    faults, sizes = [make_effect("linear_spring", joints="j4"), make_effect("asymmetric_viscous", joints="j2")], [30.0, 0.0, 0.003]
    fit = prepared(31, faults, sizes, width=0.2)
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    found = diagnose(before, prepared(32, faults, sizes, width=0.4, noise=0.01))
    assert [(f.name, f.joints) for f in found.findings] == [("linear_spring", ("j4",)), ("asymmetric_viscous", ("j2",))]
    assert any("asymmetric_viscous on j2" in w and "had a part" in w for w in found.warnings)
    assert found.findings[1].parameters[0].value == pytest.approx(0.003, abs=3.0 * found.findings[1].parameters[0].std)
    without = diagnose(before, prepared(32, faults[:1], sizes[:2], width=0.4, noise=0.01))
    assert [f.name for f in without.findings] == ["linear_spring"]


def test_only_what_acts_on_other_rows_is_nominated_beside_findings() -> None:
    weak, strong = a_finding(1, 20.0).judged, a_finding(0, 1e4)
    assert elsewhere(weak, [])
    assert elsewhere(weak, [strong])
    assert not elsewhere(weak, [strong, a_finding(1, 1e4)])
    near, far = a_finding(1, 9e3).judged, a_finding(1, 7e3).judged
    assert not elsewhere(weak, [cast(Found, SimpleNamespace(judged=strong.judged, effect=strong.effect, rivals=(near,)))])
    assert elsewhere(weak, [cast(Found, SimpleNamespace(judged=strong.judged, effect=strong.effect, rivals=(far,)))])
    # A finding that weighs little on those rows, and may yet leave as much there.
    strong.judged.hit.columns[1] = np.sqrt(0.12)
    assert not elsewhere(weak, [strong])


def test_a_rival_that_helps_stands_in_for_what_does_harm() -> None:
    """A spring that was taken for one of its rivals; and held-out data in which there is none, where nothing may stand in."""
    spring = make_effect("nonlinear_spring", joints="j1")
    fit, held, without = (
        prepared(3, [spring], [0.0, 0.0, 60.0, 0.0], width=0.2),
        prepared(4, [spring], [0.0, 0.0, 60.0, 0.0]),
        prepared(4, [], []),
    )
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    selection = diagnose(before, held).selection
    (right,) = selection.found
    assert right.effect.name == "nonlinear_spring"
    wrong = next(k for k, rival in enumerate(right.rivals) if rival.hit.place[0] not in ("nonlinear_spring", "payload_step"))
    mistaken = Found(
        right.rivals[wrong], (right.judged, *(r for k, r in enumerate(right.rivals) if k != wrong)), np.full(len(right.weights), 0.1)
    )

    def tried(rows: Signals) -> Any:
        bank = Bank()
        own = with_effects(selection.declared, [mistaken.effect], selection.final, bank)
        arena = Arena(selection, bank, rows, lambda s, _: WeightedLeastSquares().solve(s.problem), own, (mistaken.effect,), 0, before)
        return stand_in(arena, before, [mistaken])

    (other,), stage, said = tried(held)
    assert other.effect.name == "nonlinear_spring"
    assert other.effect in stage.problem.model.effects
    assert "nonlinear_spring on j1 takes the place of" in said
    assert other.weights.sum() == pytest.approx(1.0)
    assert tried(without) is None


@pytest.mark.parametrize("seed", [61, 71, 81])
def test_what_a_short_narrow_motion_tells_little_of_is_no_change_in_a_wide_one(seed: int) -> None:
    fit, held = prepared(seed, [], [], width=0.2, noise=0.1).select_rows([slice(0, 150)]), prepared(seed + 1, [], [], width=0.6, noise=0.06)
    model, _ = declared(fit.robot)
    estimate = WeightedLeastSquares().solve(Problem(model, fit))
    inside, outside = (estimate.torque_error(without_reversals(s)).rms for s in (fit, held))
    assert np.max(outside / inside) > 10.0
    assert apart(estimate, fit, held) == ()
    # What no parameters account for is one.
    shaken = held.tau + 5.0 * inside * np.outer(np.sin(9.0 * held.row_time), [1.0, 0.0, 0.0, 0.0])
    assert [u.joint for u in apart(estimate, fit, replace(held, tau=shaken))] == ["j1"]
    # Beside the noise floor, of which less is asked, neither is one.
    assert above_floor(estimate, fit, held, inside) == ()


def test_a_name_that_held_out_data_do_not_bear_out_is_ambiguous(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a step that is in one log alone nobody can tell whether its name is right."""
    step = make_effect("offset_step", joints="j2", t_0=17.0)
    fit, held = prepared(1, [step], [1.0]), prepared(2, [step], [1.0])
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    left = [Leftover(1, "position of j2", 5000.0, 10.0, 1.0, 2.0)]
    monkeypatch.setattr(diagnosis_module, "leftovers", lambda stage, found: left)
    assert diagnose(before, held).verdict == "unexplained"
    asked = diagnosis_module.last_word
    monkeypatch.setattr(diagnosis_module, "last_word", lambda *args: replace(asked(*args), shown=False, fell_beyond_chance=False))
    found = diagnose(before, held)
    assert (found.verdict, [f.name for f in found.findings]) == ("ambiguous", ["offset_step"])
    assert "only a part of the data bears out the name" in str(found)


def test_what_held_out_data_are_too_few_to_show_is_ambiguous_and_said() -> None:
    fault = make_effect("asymmetric_viscous", joints="j2")
    fit, held = (prepared(seed, [fault], [0.002], width=0.5) for seed in (31, 32))
    model, _ = declared(fit.robot)
    before = WeightedLeastSquares().solve(Problem(model, fit))
    found = diagnose(before, held.select_rows([slice(300, 312)]))
    assert [(f.name, f.joints) for f in found.findings] == [("asymmetric_viscous", ("j2",))]
    assert found.verdict == "ambiguous"
    assert "validate on that" in found.findings[0].advice
    assert any("asymmetric_viscous on j2 is in the data fitted" in w and "another motion" in w for w in found.warnings)
    enough = diagnose(before, held.select_rows([slice(0, 100)]))
    assert enough.verdict == "explained"
    assert not any("another motion" in w for w in enough.warnings)


def a_guess(confidence: float) -> Finding:
    return Finding(make_effect("torque_ripple", joints="j2", order=3.0), ("j2",), (), 0.1, 300.0, confidence, ())


def test_guesses_that_held_out_data_do_not_bear_out_are_withdrawn() -> None:
    """Only where something else is there that nothing explains, and none of them is likely."""
    guesses = [a_guess(0.2), a_guess(0.05)]
    assert withdrawn("unexplained", guesses, shown=False)
    assert not withdrawn("unexplained", guesses, shown=True)
    assert not withdrawn("unexplained", [*guesses, a_guess(0.9)], shown=False)
    assert not withdrawn("ambiguous", guesses, shown=False)
    assert not withdrawn("unexplained", guesses[:1], shown=False), "what stands alone is no drawing"
    assert not withdrawn("unexplained", [], shown=False)
    nothing = withdrawal(guesses, cast(Selection, SimpleNamespace(found=())))
    assert (nothing.joint, nothing.gain) == ("j2", 600.0)
    assert "torque_ripple on j2" in nothing.evidence
    assert "so none is taken" in nothing.evidence


@pytest.mark.parametrize("almost_all", [0.8, 1.0])
def test_what_is_withdrawn_leaves_nearly_all_of_it_or_nothing(monkeypatch: pytest.MonkeyPatch, almost_all: float) -> None:
    late = make_effect("asymmetric_viscous", joints="j1")
    fit, held = prepared(31, [late], [3.0]), prepared(32, [late], [3.0])
    before = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    shown = list[bool]()

    def withdraw(verdict: str, findings: Sequence[Finding], is_shown: bool) -> bool:
        assert len(findings) == 1
        shown.append(is_shown)
        return True

    monkeypatch.setattr(diagnosis_module, "withdrawn", withdraw)
    monkeypatch.setattr(withdrawn_module, "_ALMOST_ALL", almost_all)
    found = diagnose(before, held)
    assert shown == [True]
    assert found.verdict == "unexplained"
    (nothing,) = (u for u in found.unexplained if u.signature == HELD_OUT)
    if almost_all < 1.0:
        assert [f.name for f in found.findings] == ["asymmetric_viscous"]
        assert found.comparison.gain > 0.5
        assert "so only asymmetric_viscous, which is nearly all of it, is taken" in nothing.evidence
        return
    assert found.findings == ()
    assert any(u.signature != HELD_OUT and u.joint == "j1" for u in found.unexplained)
    assert found.model.names == before.model.names
    assert found.comparison.gain == 0.0
    assert found.to_dict()["findings"] == []


def test_one_that_is_nearly_all_of_it_goes_as_well_where_the_error_held_out_grows() -> None:
    late = make_effect("asymmetric_viscous", joints="j1")
    fit, held = prepared(31, [late], [3.0]), prepared(32, [late], [-3.0])
    declared_fit = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    selection = diagnose(declared_fit).selection
    assert len(selection.found) == 1

    def refit(stage: Stage) -> Estimate:
        return WeightedLeastSquares().solve(Problem(stage.problem.model, fit))

    bank = selection.final.search.bank
    assert without_guesses(selection, bank, declared_fit, None, refit)[0].found == selection.found
    left, after = without_guesses(selection, bank, declared_fit, held, refit)
    assert left.found == ()
    assert after is declared_fit


@pytest.mark.parametrize("name", ["linear_spring", "nonlinear_spring"])
def test_held_out_motion_decides_between_rivals(name: str) -> None:
    """Springs that a narrow motion can hardly tell from each other, or from a tilted base; a wide one can."""
    true = make_effect(name, joints="j1")
    sizes = [3.0, 0.0] if name == "linear_spring" else [0.0, 0.0, 60.0, 0.0]
    fit, held = prepared(3, [true], sizes, width=0.2), prepared(4, [true], sizes)
    model, _ = declared(fit.robot)
    found = diagnose(WeightedLeastSquares().solve(Problem(model, fit)), held)
    assert found.findings
    assert (found.findings[0].name, found.findings[0].joints) == (name, ("j1",))
    if name == "nonlinear_spring":
        assert any("nonlinear_spring on j1 takes the place of" in w for w in found.warnings)


def test_a_counterbalance_half_a_turn_away_differs_in_odd_harmonics_alone() -> None:
    one = Counterbalance(joints=("j1",), angle=0.7, ratio=0.4)
    (other,) = one.twins()
    assert other.twins()[0].angle == pytest.approx(0.7)
    assert replace(other, angle=0.7) == one
    robot = ROBOTS["scara"]()
    q = np.zeros((64, robot.n))
    q[:, 0] = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    motion = Motion.of(robot, q, 0.0 * q, 0.0 * q, np.arange(64) / RATE, rate=RATE)
    harmonics = [np.fft.rfft(effect.columns(motion, robot)[:, 0, 1]) for effect in (one, other)]
    for k in range(1, 6):
        np.testing.assert_allclose(harmonics[1][k], (-1.0) ** k * harmonics[0][k], atol=1e-9)


def test_deviations_hold_where_the_noise_is_not_what_it_is_taken_for() -> None:
    """Coloured noise under a floor that takes it for white: the scatter of the blocks tells, less what each block pulled the fit by."""
    scores: list[float] = []
    for seed in range(8):
        signals = prepared(20 + seed, [], [], colour=0.97)
        model, _ = declared(signals.robot)
        asked = Problem(model + make_effect("linear_spring"), signals)
        white = plain_whitener(asked, WeightedLeastSquares().solve(asked).residual(signals))
        problem, frame = consistent(asked, white)
        motions = Motions(problem)
        stage = Stage(problem, white, frame, motions, Search(frame, motions, (), Bank()))
        (own,) = found_parameters(stage, [problem.model.effects[-1]])
        scores += [p.value / p.std for p in own if np.isfinite(p.std) and p.std > 0]
    assert len(scores) >= 30
    rms = float(np.sqrt(np.mean(np.square(scores))))
    assert 0.7 < rms < 1.3, rms


def a_finding(joint: int, evidence: float) -> Found:
    """A finding on one of three joints, as far as held-out data look at it."""
    columns = np.zeros((3, 5, 1))
    columns[joint] = 1.0
    return cast(
        Found,
        SimpleNamespace(
            judged=SimpleNamespace(hit=SimpleNamespace(columns=columns), score=SimpleNamespace(values=np.ones(1)), evidence=evidence),
            effect=make_effect("offset", joints="j1"),
            rivals=(),
        ),
    )


def test_only_growth_beyond_chance_is_harm() -> None:
    rng = np.random.default_rng(3)
    noise, before = np.array([1.0, 1.0, np.nan]), np.array([1e4, 1e4, 0.0])
    chance = rng.normal(size=20)
    chance -= chance.mean() - 0.01  # grows a little, far below its scatter
    grows = np.stack([np.full(20, -100.0), chance, np.zeros(20)], axis=1)
    good, other = a_finding(0, 500.0), a_finding(1, 500.0)
    change = Change(grows, before, noise)
    assert change.harms([good, other]) == []
    assert change.doubtful([good, other]) == [other]
    weak = a_finding(0, 50.0)  # gains on its own joint, and is looked at all the same
    assert change.doubtful([weak, good]) == [weak]
    # Beyond chance, and by much: whatever acts there is to blame, and nothing else.
    assert Change(grows + [0.0, 400.0, 0.0], before, noise).harms([good, other]) == [other]
    assert Change(grows + [0.0, 400.0, 0.0], before, noise).harms([good]) == []
    # No joint by itself, but all together.
    assert Change(grows + [101.0, 0.0, 0.0], before, noise).harms([good, other]) == [good]
    assert change.on(np.array([False, False, True])) == (0.0, 0.0)
    assert change.on(np.array([True, False, False])) == pytest.approx((-2000.0, np.sqrt(20.0) * 100.0))


def of_blocks(grows: np.ndarray) -> Change:
    """A change of one joint's error by so much in each block of time."""
    return Change(grows[:, None], np.array([1e4]), np.ones(1))


def test_a_fall_of_the_error_is_shown_only_beyond_chance() -> None:
    rng = np.random.default_rng(11)

    def shown(blocks: np.ndarray) -> bool:
        return of_blocks(blocks).shown

    # Gains of either sign alike, as where nothing is: at most 10 of 4096 patterns come to as much; three standard errors of 8000 draws.
    most = 10 / 4096
    assert 0.0 < np.mean([shown(rng.normal(scale=5.0, size=24)) for _ in range(8000)]) < most + 3.0 * np.sqrt(most / 8000)
    assert shown(np.full(24, -3.0))
    assert not shown(np.full(24, -0.4)), "however steady, no more than one parameter gains by chance"
    assert not shown(np.full(24, 3.0))
    seldom = np.zeros(24)
    seldom[[3, 11]] = -90.0
    assert shown(seldom), "seldom, and by more than any colour of the noise explains"
    assert not shown(0.8 * seldom)
    # Eight pairs of neighbours that all fall: of blocks that nothing is behind, one in 256 does; of nine, one in 512.
    assert not shown(np.full(16, -8.0))
    assert shown(np.full(18, -8.0))
    # Of twelve pairs two may grow by a third of what others fall by (4 of 4096 patterns come to as much), none by all of it (13).
    assert shown(np.array([*np.full(4, 2.0), *np.full(20, -6.0)]))
    assert not shown(np.array([5.0, 5.0, *np.full(22, -5.0)]))
    assert not shown(np.array([2.0, 2.0, *np.full(22, -2.0)])), "what gains little must be steady"
    assert shown(np.full(24, -2.0))


def test_a_hint_is_less_than_what_is_shown_and_more_than_chance_mostly_gives() -> None:
    rng = np.random.default_rng(12)

    noise = [of_blocks(rng.normal(scale=5.0, size=24)) for _ in range(2000)]
    assert 0.0 < np.mean([change.hinted for change in noise]) < 0.03
    assert of_blocks(np.full(14, -8.0)).hinted
    assert not of_blocks(np.full(8, -8.0)).hinted
    assert not of_blocks(np.full(14, -0.5)).hinted
    # Of less gain if it is steadier: what is shown is hinted at, too.
    assert of_blocks(np.full(24, -2.0)).hinted
    assert of_blocks(np.full(24, -2.0)).shown
    assert not of_blocks(np.full(20, -2.0)).shown, "ten pairs that all fall by little: chance does that once in 1024"
    assert not of_blocks(np.full(14, -2.0)).hinted


def test_signs_are_tried_exactly_where_they_are_few() -> None:
    assert by_signs(np.ones(10)) == 2.0**-10
    assert by_signs(np.array([3.0, 1.0, 1.0])) == 0.125
    assert by_signs(np.array([1.0, -1.0])) == 0.75
    assert by_signs(np.ones(40)) == 0.0
    assert by_signs(np.array([5.0, *np.zeros(30)])) == pytest.approx(0.5, abs=0.02)


def test_growth_as_a_share_needs_no_noise() -> None:
    grows = np.stack([np.full(20, -5.0), np.full(20, 1.0), np.zeros(20)], axis=1)
    change = Change(grows, np.array([1000.0, 10.0, 0.0]), np.array([1e-30, 1.0, np.nan]))
    assert change.shares == pytest.approx(-0.1 + 2.0)


def test_of_several_the_one_without_which_least_harm_is_left_is_to_blame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the one with the least evidence: that may be the only one that is there."""
    first, second, third = (a_finding(0, evidence) for evidence in (100.0, 500.0, 900.0))
    for one, name in ((first, "a"), (second, "b"), (third, "c")):
        cast(SimpleNamespace, one).effect = name
    left = {"a": 3.0, "b": -2.0, "c": 1.0}
    monkeypatch.setattr(confirmed_module.Change, "of", lambda before, after, rows: SimpleNamespace(shares=left[after]))
    anything = cast(Any, None)
    assert confirmed_module._to_blame([first, second, third], lambda one: cast(Any, one.effect), anything, anything) is second


@pytest.mark.parametrize(
    ("evidence", "shown", "hinted", "kept"),
    [(39.0, False, False, False), (41.0, False, False, True), (39.0, True, True, True), (39.0, False, True, True)],
)
def test_what_is_barely_over_the_threshold_is_there_only_if_held_out_data_hint_at_it(
    evidence: float, shown: bool, hinted: bool, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, anything = a_finding(0, evidence), cast(Any, SimpleNamespace(robot=SimpleNamespace(n=1)))
    change = SimpleNamespace(on=lambda joints: (-5.0, 4.0), shown=shown, hinted=hinted)
    monkeypatch.setattr(confirmed_module.Change, "of", lambda before, after, rows: change)
    monkeypatch.setattr(confirmed_module, "threshold", lambda hit, number: 20.0)
    refused, unseen, faint = confirmed_module._borne_out([one], [one], 300, lambda one: anything, anything, anything, lambda _: False)
    assert refused == ([] if kept else [one])
    assert unseen == []
    assert faint == ([one] if kept and not shown else [])
    # What the held-out data were asked about has less on the data fitted, and is not taken back for that.
    refused, unseen, faint = confirmed_module._borne_out([one], [one], 300, lambda one: anything, anything, anything, lambda _: True)
    assert (refused, unseen) == ([], [])
    assert faint == ([] if shown else [one])


def test_confidence_falls_with_what_held_out_data_do_not_show() -> None:
    seen, faint, unseen, owed = (make_effect(name, joints="j1") for name in ("offset", "stribeck", "viscous", "cogging"))
    last = cast(Any, SimpleNamespace(unseen=(unseen,), faint=(faint,), owed=(owed,)))

    def share(effect: Effect, bad: set[str], slow: Sequence[Effect] = ()) -> float:
        return _share(cast(Any, SimpleNamespace(effect=effect, joints=("j1",))), last, bad, slow)

    assert share(seen, set()) == 1.0
    assert share(unseen, set()) < share(faint, set()) < 1.0
    assert share(seen, {"j1"}) == share(faint, {"j1"}) == share(unseen, set())
    assert share(seen, {"j2"}) == 1.0
    assert share(seen, set(), [seen]) == 0.5
    assert share(faint, set(), [faint]) < share(faint, set())


def the_last_word(monkeypatch: pytest.MonkeyPatch, blocks: np.ndarray, confirms: str = "") -> LastWord:
    """Of one finding with which the error on held-out data grows by so much in each block of time. `confirms`: what is said if they helped
    to find it."""
    hit = SimpleNamespace(place=("offset", ("j1",), ()))
    one = SimpleNamespace(effect=make_effect("offset", joints="j1"), judged=SimpleNamespace(hit=hit), rivals=())
    selection = SimpleNamespace(found=(one,), declared=None, final=SimpleNamespace(turning=()))
    kept = confirmed_module.Confirmed(cast(Any, selection), cast(Any, "after"))
    fitted = SimpleNamespace(found=() if confirms else (one,), final=selection.final)
    rows = SimpleNamespace(robot=SimpleNamespace(n=1))
    monkeypatch.setattr(confirmed_module, "without_reversals", lambda held, turning: rows)
    monkeypatch.setattr(confirmed_module, "nominated", lambda *a: (selection, confirms))
    monkeypatch.setattr(confirmed_module, "contested", lambda *a: SimpleNamespace(selection=selection, after="after", said=()))
    monkeypatch.setattr(confirmed_module, "confirmed", lambda *a, **settings: kept)
    monkeypatch.setattr(confirmed_module, "refusals", lambda kept: ((), ""))
    monkeypatch.setattr(confirmed_module.Change, "of", lambda before, after, rows: of_blocks(blocks))
    anything = cast(Any, None)
    return confirmed_module.last_word(cast(Any, fitted), anything, anything, cast(Any, "held"), lambda stage, names: anything)


def test_a_fall_in_every_block_is_shown_though_few_hold_most_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Knocks: the standard error of the sum is nearly the sum."""
    grows = np.array([*np.full(22, -1.0), -60.0, -40.0])
    total, error = of_blocks(grows).on(np.ones(1, bool))
    assert -total < 2.0 * error
    assert the_last_word(monkeypatch, grows).fell_beyond_chance
    mixed = np.where(np.arange(24) % 2 == 0, 3.0, grows)
    assert not the_last_word(monkeypatch, mixed).fell_beyond_chance, "half of the blocks grow"


def test_what_held_out_data_helped_to_find_is_owed_to_them_unless_they_show_it_beyond_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere = np.full(24, -3.0)
    assert not the_last_word(monkeypatch, everywhere).owed
    assert not the_last_word(monkeypatch, everywhere, "confirmed").owed
    assert the_last_word(monkeypatch, everywhere / 2.0, "confirmed").owed, "too little"
    # In two of twelve pairs of blocks the error grows: four of 4096 patterns of signs come to as much or more.
    mostly = np.where(np.arange(24) < 4, 2.0, -6.0)
    assert of_blocks(mostly).shown
    assert the_last_word(monkeypatch, mostly, "confirmed").owed, "of one hypothesis it would be shown, of eight it is not"
    assert not the_last_word(monkeypatch, mostly).owed
