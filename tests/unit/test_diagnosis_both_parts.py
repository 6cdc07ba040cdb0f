"""Faults in the part of the data that was held out, and nowhere else."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from effect_robots import declared
from test_diagnosis_held_out import prepared

from ident.diagnosis import diagnose
from ident.diagnosis.analysis import without_reversals
from ident.diagnosis.both_parts import SAID, halved, together
from ident.diagnosis.in_plain_sight import ELSEWHERE, above_floor, apart, hinted
from ident.effects.base import make_effect
from ident.estimators import WeightedLeastSquares
from ident.problem.problem import Problem
from ident.signals import Signals

LATE = 37.2


def parts(seed: int, late: float) -> tuple[Signals, Signals]:
    """Both parts of one log, in which an offset of joint 2 begins in the second part."""
    step = make_effect("offset_step", joints="j2", t_0=late)
    return prepared(seed, [step], [2.0]).split(by="fraction", held=0.25)


def louder(held: Signals, rms: float, times: float) -> Signals:
    """Held-out signals whose noise on joint 1 is so many times what it is."""
    noise = np.random.default_rng(1).normal(size=len(held.tau))
    more = noise / np.std(noise) * np.sqrt(times**2 - 1.0) * rms
    return replace(held, tau=held.tau + more[:, None] * (np.arange(held.robot.n) == 0))


def test_rows_of_both_parts_are_those_of_either() -> None:
    fit, held = parts(41, 33.0)
    both = together(fit, held)
    assert both is not None
    estimate = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    each = np.concatenate([estimate.residual(fit), estimate.residual(held)])
    np.testing.assert_array_equal(estimate.residual(both), each)
    assert both.run_names == (*fit.run_names, *held.run_names)
    assert both.origins == (*fit.origins, *held.origins)
    named = {"path": "a.csv", "sha256": "0"}
    again = together(replace(fit, inputs=(named,)), replace(held, inputs=(named, {**named, "path": "b.csv"})))
    assert again is not None
    assert [x["path"] for x in again.inputs] == ["a.csv", "b.csv"]
    assert [j.rows for j in both.report.joints] == [a.rows + b.rows for a, b in zip(fit.report.joints, held.report.joints, strict=True)]


def test_parts_that_were_not_prepared_alike_are_not_joined() -> None:
    fit, held = parts(41, 33.0)
    # The same rate, but for rounding: each part's is the median of its own steps.
    assert together(fit, replace(held, rate=held.rate * (1.0 - 1e-15))) is not None
    assert together(fit, replace(held, rate=0.5 * held.rate)) is None
    assert fit.row_filter is not None
    taps = fit.row_filter.taps
    other = replace(fit.row_filter, taps=np.ones_like(taps) / len(taps))
    assert together(fit, replace(held, row_filter=other)) is None


def test_half_of_the_data_held_out_is_searched_and_the_other_half_kept_apart() -> None:
    fit, held = parts(41, 33.0)
    both = halved(fit, held)
    assert both is not None
    searched, between = both
    moved = np.setdiff1d(searched.t, fit.t)
    assert len(np.intersect1d(moved, between.t)) == 0
    assert np.isin(moved, held.t).all()
    assert np.isin(between.t, held.t).all()
    # The rows on either side of a border are a filter's length apart.
    assert len(held.tau) / 4 < len(between.tau) <= len(held.tau) / 2
    assert halved(fit, held.select_rows([slice(0, 3)])) is None


def test_what_began_in_the_data_held_out_is_named_and_confirmed_by_blocks_that_were_not_searched() -> None:
    fit, held = parts(41, 33.0)
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), held)
    assert found.verdict == "explained"
    (finding,) = found.findings
    assert (finding.name, finding.joints) == ("offset_step", ("j2",))
    assert {p.name: p.value for p in finding.parameters}["t_0"] == pytest.approx(33.0, abs=0.05)
    assert finding.advice.startswith("Add offset_step on j2")
    (said,) = [w for w in found.warnings if w.startswith("the error on the data held out is larger")]
    before, after = map(float, re.findall(r"falls from (\S+) to (\S+) %", said)[0])
    # What the step leaves where it is not known of, and the noise: the same on the blocks between as on all that was held out.
    declared_there = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)).torque_error(held).relative_all
    assert before == pytest.approx(100.0 * declared_there, rel=0.5)
    # The search saw blocks before and after the step, not the one it is in: some of its time it has in that block wrong.
    assert after < 0.8 * before
    assert SAID not in found.warnings


def test_what_began_late_in_the_data_held_out_is_named_and_said_to_be_unconfirmed() -> None:
    """In the last of eight blocks, so that no other has it."""
    fit, held = parts(41, LATE)
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), held)
    assert found.verdict == "ambiguous"
    (finding,) = found.findings
    assert (finding.name, finding.joints) == ("offset_step", ("j2",))
    values = {p.name: p.value for p in finding.parameters}
    assert values["t_0"] == pytest.approx(LATE, abs=0.05)
    assert "no data are left" in finding.advice
    assert SAID in found.warnings
    assert "\nwarning: the error on the data held out" in str(found)
    told, (before, after) = found.to_dict(), found.every_row
    assert (told["before"]["relative_every_row"], told["after"]["relative_every_row"]) == (before, after)
    # Rows near reversals that no fit had: the text says what the errors are with them.
    assert after < before
    assert ("with rows near reversals" in str(found)) == bool(found.after.sticking)
    # No error is called held out that is of rows which were fitted.
    assert found.held is None
    assert found.to_dict()["heldout_gain"] is None


def test_what_nothing_accounts_for_stays_unexplained() -> None:
    fit, held = parts(42, 1e3)
    noise = np.random.default_rng(0).normal(size=len(held.tau)) * 20.0 * np.nanstd(held.tau[:, 0])
    bad = replace(held, tau=held.tau + noise[:, None] * (np.arange(held.robot.n) == 0))
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), bad)
    assert found.verdict == "unexplained"
    assert "j1" in {u.joint for u in found.beyond}
    assert found.findings == ()
    assert found.held is not None


def with_another(seed: int, late: float) -> tuple[Signals, Signals]:
    """Both parts of one log that has asymmetric friction on joint 1, and from a moment of the second part on an offset of joint 2."""
    effects = [make_effect("asymmetric_viscous", joints="j1"), make_effect("offset_step", joints="j2", t_0=late)]
    return prepared(seed, effects, [0.5, 2.0]).split(by="fraction", held=0.25)


def test_beside_a_finding_too_what_began_in_the_data_held_out_is_named() -> None:
    fit, held = with_another(41, 33.0)
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), held)
    assert sorted((f.name, f.joints) for f in found.findings) == [("asymmetric_viscous", ("j1",)), ("offset_step", ("j2",))]
    assert found.verdict == "explained"
    assert any("Without every other block" in w for w in found.warnings)


def test_beside_a_finding_what_no_data_confirm_is_said_and_changes_nothing() -> None:
    fit, held = with_another(41, LATE)
    found = diagnose(WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit)), held)
    assert [(f.name, f.joints) for f in found.findings] == [("asymmetric_viscous", ("j1",))]
    assert found.held is not None
    assert "j2" in {u.joint for u in found.beyond}
    (said,) = [w for w in found.warnings if "do not confirm that" in w]
    assert "on j2" in said
    assert "offset_step on j2" in said


def test_louder_noise_in_the_data_held_out_is_a_hint_that_leads_to_nothing() -> None:
    fit, held = parts(43, 1e3)
    before = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    noisy = louder(held, before.fit_error.rms[0], 1.5)
    assert [u.joint for u in hinted(before, fit, noisy)] == ["j1"]
    assert apart(before, fit, noisy) == ()
    found = diagnose(before, noisy)
    assert (found.verdict, found.findings) == ("clean", ())
    assert [u.joint for u in found.beyond] == ["j1"]


def knocked(held: Signals, floor: float, times: float) -> Signals:
    """Held-out signals with torque on joint 1 in every twentieth row, so that the error is so many times the noise."""
    more = np.where(np.arange(len(held.tau)) % 20 == 0, 1.0, 0.0) * np.sqrt(20.0 * (times**2 - 1.0)) * floor
    return replace(held, tau=held.tau + more[:, None] * (np.arange(held.robot.n) == 0))


def test_a_model_that_leaves_twice_the_noise_floor_on_data_held_out_is_not_called_whole() -> None:
    """With something found there, and with nothing found."""
    fault = make_effect("asymmetric_viscous", joints="j1")
    fit, held = prepared(45, [fault], [0.5]).split(by="fraction", held=0.25)
    before = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    plain = diagnose(before, held)
    assert plain.verdict == "explained"
    rows = knocked(held, plain.noise_floor[0], 2.0)
    assert apart(plain.after, plain.signals, rows) == ()
    found = diagnose(before, rows)
    assert found.verdict == "unexplained"
    (said,) = found.unexplained
    assert (said.joint, said.signature) == ("j1", ELSEWHERE)
    (times,) = re.findall(r"held-out data is (\S+) times the noise floor", said.evidence)
    assert float(times) == pytest.approx(2.0, rel=0.1)
    assert [f.name for f in found.findings] == ["asymmetric_viscous"]
    assert found.findings[0].confidence < 0.5 < plain.findings[0].confidence
    for weaker in (knocked(held, plain.noise_floor[0], 1.4), louder(held, plain.noise_floor[0], 2.0)):
        assert diagnose(before, weaker).verdict == "explained"

    fit, held = prepared(47, [], []).split(by="fraction", held=0.25)
    before = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    found = diagnose(before, knocked(held, before.fit_error.rms[0], 2.0))
    assert (found.verdict, found.findings, [u.joint for u in found.unexplained]) == ("unexplained", (), ["j1"])


def test_beside_a_law_that_remembers_the_motion_nothing_is_asked_of_the_noise_floor() -> None:
    fit, held = prepared(47, [], []).split(by="fraction", held=0.25)
    model = declared(fit.robot)[0]
    for more, asked in ((model, 1), (model + make_effect("presliding", joints="j3"), 0)):
        estimate = WeightedLeastSquares().solve(Problem(more, fit))
        rows = knocked(held, estimate.fit_error.rms[0], 2.0)
        assert len(above_floor(estimate, fit, rows, estimate.fit_error.rms)) == asked


def test_times_the_noise_floor_are_of_the_rows_that_are_used() -> None:
    """Where a joint sticks, an estimate leaves out rows that the signals have."""
    fit, held = prepared(47, [], []).split(by="fraction", held=0.25)
    estimate = WeightedLeastSquares().solve(Problem(declared(fit.robot)[0], fit))
    rms = estimate.fit_error.rms
    rows = without_reversals(knocked(held, rms[0], 2.0))
    used = np.isfinite(estimate.residual(rows)[:, 0]) & (np.arange(len(rows.tau)) % 3 > 0)
    masked = np.where(used[:, None], estimate.residual(rows), np.nan)
    few = replace(rows, tau=np.where(used[:, None], rows.tau, np.nan))
    assert few.valid[:, 0].sum() > 1.3 * used.sum()
    (said,) = above_floor(estimate, fit, few, rms)
    (times,) = re.findall(r"held-out data is (\S+) times the noise floor", said.evidence)
    assert float(times) == pytest.approx(np.sqrt(np.nanmean(masked[:, 0] ** 2)) / rms[0], rel=0.05)
