"""The essential model: against Wald tests worked out from the rows themselves, and on simulated robots whose parameters are known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import recorded

import ident
from ident.errors import ConfigurationError, UnsupportedError
from ident.robots import nominal_values

Array = np.ndarray
#: Friction of each kind that is there; everything else of the declared effects is zero.
TRUTH = {"Fv_joint1": 3.0, "Fc_joint2": 2.0, "Fc_joint1": 4.0, "offset_joint2": 0.6}


@dataclass(frozen=True)
class Case:
    estimate: ident.Estimate
    held: ident.Signals
    true: dict[str, float]


def case(seed: int, noise: float = 0.05, held_noise: float = 0.05) -> Case:
    """A SCARA with little friction, fitted with a model that declares much more of it."""
    robot = ident.load_robot("scara")
    names = ("viscous", "coulomb", "offset", "linear_spring")
    model = ident.Model(robot, (robot.rigid_body().effects[0], *(ident.make_effect(n) for n in names)))
    values = nominal_values(model)
    for i, p in enumerate(model.parameters):
        if p.effect != "rigid_body":
            values[i] = TRUTH.get(p.name, 0.0)
    logs = [recorded(robot, model, values, seed + k, 38.0, level) for k, level in enumerate((noise, held_noise))]
    train, test = (ident.LogSet((log,)) for log in logs)
    estimate = ident.fit(train, robot, model=model, held=0, preparation=ident.ZeroPhase(cutoff_hz=10.0))
    true = dict(zip(estimate.names, estimate.base.base_values(values).tolist(), strict=True))
    return Case(estimate, ident.ZeroPhase(cutoff_hz=10.0)(test, robot), true)


@pytest.fixture(scope="module")
def usual() -> Case:
    return case(11)


def by_hand(estimate: ident.Estimate, level: float) -> list[tuple[str, float, float, float, float, float]]:
    """Name, value, F and p alone, F and p together: least squares on the rows, explicit inverses, the definition of each test."""
    from scipy.stats import f

    assert estimate.problem is not None
    place = [estimate.problem.base.names.index(name) for name in estimate.names]
    root = np.sqrt(estimate.weights)
    X, y = [], []
    for rows in estimate.problem.rows():
        X.append((rows.columns * root[:, None])[rows.valid][:, place])
        y.append((rows.tau * root)[rows.valid])
    X, y = np.concatenate(X), np.concatenate(y)
    used = estimate.problem.valid.sum(axis=0)
    freedom = float(np.sum(used / estimate.noise.correlation_time)) - len(estimate.values)
    A = X.T @ X
    meat = A @ estimate.covariance @ A
    out, left, gone = [], list(range(len(estimate.values))), []
    while left:
        values = np.linalg.lstsq(X[:, left], y, rcond=None)[0]
        inverse = np.linalg.inv(A[np.ix_(left, left)])
        std = np.sqrt(np.diag(inverse @ meat[np.ix_(left, left)] @ inverse))
        worst = int(np.argmax(std / np.abs(values)))
        gone.append(left.pop(worst))
        alone = (values[worst] / std[worst]) ** 2
        theta = estimate.values[gone]
        together = float(theta @ np.linalg.inv(estimate.covariance[np.ix_(gone, gone)]) @ theta) / len(gone)
        p, p_all = float(f.sf(alone, 1, freedom)), float(f.sf(together, len(gone), freedom))
        if p < level or p_all < level:
            break
        out.append((estimate.names[gone[-1]], values[worst], alone, p, together, p_all))
    return out


def test_every_step_is_the_wald_test_of_a_regression_on_the_rows(usual: Case) -> None:
    found, expected = ident.essential(usual.estimate), by_hand(usual.estimate, 0.05)
    assert len(expected) > 5
    assert [r.name for r in found.removed] == [e[0] for e in expected]
    table = [(r.value, r.f, r.p, r.f_all, r.p_all) for r in found.removed]
    np.testing.assert_allclose(table, [e[1:] for e in expected], rtol=1e-5)


def test_many_that_are_hardly_significant_alone_are_so_together(usual: Case) -> None:
    """Independent values of 1.5 standard deviations: each alone may go (p = 0.13), 5 together may not (11.25 > 11.07, chi-squared)."""
    b, n = len(usual.estimate.values), usual.estimate.model.robot.n
    names = usual.estimate.names
    information = ident.Information(np.stack([np.eye(b + 1)] * n), np.full(n, 10**7), names)
    values = np.where(np.arange(b) < 10, 1.5, 40.0)
    estimate = replace(usual.estimate, values=values, covariance=np.eye(b), information=information, weights=np.full(n, 1.0 / n))
    found = ident.essential(estimate).removed
    assert [r.name for r in found] == list(names[:4])
    np.testing.assert_allclose([(r.f, r.f_all) for r in found], 2.25)


def test_kept_values_and_stds_are_those_of_a_fit_of_the_kept_columns(usual: Case) -> None:
    found = ident.essential(usual.estimate).reduced
    problem, estimate = usual.estimate.problem, usual.estimate
    assert problem is not None
    root = np.sqrt(estimate.weights)
    X = np.concatenate([(r.columns * root[:, None])[r.valid] for r in problem.rows()])
    y = np.concatenate([(r.tau * root)[r.valid] for r in problem.rows()])
    columns = [problem.base.names.index(name) for name in found.names]
    values, squares, *_ = np.linalg.lstsq(X[:, columns], y, rcond=None)
    np.testing.assert_allclose(found.values, values, rtol=1e-6, atol=1e-9)
    weighted = float(np.sum(estimate.weights * found.fit_error.rms**2 * found.fit_error.rows))
    assert weighted == pytest.approx(float(squares[0]), rel=1e-8)
    residual = found.residual(problem.signals)
    np.testing.assert_allclose(np.sqrt(np.nanmean(residual**2, axis=0)), found.fit_error.rms, rtol=1e-8)


@pytest.mark.parametrize("seed", [11, 21, 31, 41])
def test_what_is_zero_goes_what_is_not_stays_and_the_held_out_error_with_it(seed: int) -> None:
    one = case(seed)
    found = ident.essential(one.estimate, one.held)
    zero = {name for name, value in one.true.items() if abs(value) < 1e-9}
    clear = {n for n, s in zip(one.estimate.names, one.estimate.std, strict=True) if abs(one.true[n]) > 6 * s}
    gone = {r.name for r in found.removed}
    assert len(zero) >= 8
    assert set(TRUTH) <= clear
    assert not gone & clear
    assert len(zero - gone - set(found.restored)) <= 2
    comparison = found.comparison
    assert comparison is not None
    assert comparison.gain > -1.645 * comparison.gain_std - 1e-12
    assert comparison.error_after.relative_all < 1.01 * comparison.error_before.relative_all
    assert found.reduced.heldout_error is comparison.error_after
    for name, value, std in zip(found.reduced.names, found.reduced.values, found.reduced.std, strict=True):
        assert abs(value - one.true[name]) < 5 * std, name


def test_held_out_data_bring_back_what_they_show(usual: Case) -> None:
    """Held-out data made of the whole fit's own values, with hardly any noise: everything that is removed is missed there."""
    estimate = usual.estimate
    robot = estimate.model.robot
    log = recorded(robot, estimate.model, estimate.all_values, 77, 38.0, 1e-4)
    held = ident.ZeroPhase(cutoff_hz=10.0)(ident.LogSet((log,)), robot)
    order = [r.name for r in ident.essential(estimate).removed]
    found = ident.essential(estimate, held)
    assert order
    assert [*(r.name for r in found.removed), *found.restored] == order
    assert found.restored
    assert set(found.restored) <= set(found.reduced.names)
    assert found.comparison is not None
    assert found.comparison.gain >= -1.645 * found.comparison.gain_std
    assert "because the held-out error grows without" in " ".join(str(found).split())


def test_a_stricter_level_removes_the_first_of_the_same(usual: Case) -> None:
    lax, strict = (ident.essential(usual.estimate, level=level).removed for level in (0.01, 0.5))
    assert len(strict) < len(lax)
    assert lax[: len(strict)] == strict


def test_a_loaded_fit_gives_the_same_and_the_reduced_one_is_an_estimate(usual: Case, tmp_path: Path) -> None:
    found = ident.essential(usual.estimate, usual.held)
    again = ident.essential(ident.Estimate.load(usual.estimate.save(tmp_path / "fit.json")), usual.held)
    assert [r.name for r in again.removed] == [r.name for r in found.removed]
    reduced = ident.Estimate.load(found.reduced.save(tmp_path / "reduced.json"))
    np.testing.assert_allclose(reduced.predict(usual.held), found.reduced.predict(usual.held), rtol=1e-9, atol=1e-12)
    assert any("left out as zero" in w for w in reduced.warnings)


def test_it_shows_itself(usual: Case) -> None:
    found = ident.essential(usual.estimate, usual.held)
    assert len(repr(found).splitlines()) <= 10
    text = " ".join(str(found).split())
    assert "statistically zero in these data, not physically zero" in text
    assert f"{len(found.reduced.names)} of {len(usual.estimate.names)} parameters kept" in text
    table = found.to_frame()
    assert list(table.index) == [*found.reduced.names, *(r.name for r in found.removed)]
    assert table.loc[found.removed[2].name, "removed"] == 3
    assert table.loc[found.removed[2].name, "value"] == 0
    data: dict[str, Any] = found.to_dict()
    kept = {k["name"]: k for k in data["kept"]}
    half = 1.959964 * kept["Fv_joint1"]["std"]
    assert kept["Fv_joint1"]["high"] - kept["Fv_joint1"]["value"] == pytest.approx(half, rel=1e-6)
    assert "not checked" in str(ident.essential(usual.estimate))
    assert "<table>" in found._repr_html_()


def test_its_report_says_how_many_are_kept(usual: Case, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    found = ident.essential(usual.estimate, usual.held)
    page = ident.report(found, tmp_path / "essential.html").read_text(encoding="utf-8")
    assert f"Essential model: {len(found.reduced.names)} of {len(usual.estimate.names)} parameters kept" in page
    assert all(r.name in page for r in found.removed)


def test_what_cannot_be_tested_is_refused(usual: Case) -> None:
    for level in (0.0, 1.0):
        with pytest.raises(ConfigurationError, match="between 0 and 1"):
            ident.essential(usual.estimate, level=level)
    with pytest.raises(UnsupportedError, match="no covariance"):
        ident.essential(replace(usual.estimate, information=None))


@pytest.mark.parametrize("held_noise", [0.0, 0.05])
def test_held_out_data_bring_back_what_is_there_also_where_the_fit_has_no_noise(held_noise: float) -> None:
    """Standard deviations so large that the tests remove whatever there is: data held out decide alone, whatever the fit's own residual,
    which is rounding and differs a thousandfold from joint to joint."""
    one = case(61, noise=0.0, held_noise=held_noise)
    doubtful = replace(one.estimate, covariance=np.diag((1e4 * np.abs(one.estimate.values) + 1e4) ** 2))
    assert {r.name for r in ident.essential(doubtful).removed} == set(one.estimate.names)
    found = ident.essential(doubtful, one.held)
    assert set(TRUTH) <= set(found.reduced.names)
    assert found.comparison is not None
    assert found.comparison.error_after.relative_all < 1.001 * found.comparison.error_before.relative_all + 1e-6


def test_nothing_of_a_noise_free_fit_is_removed_that_is_there() -> None:
    one = case(61, noise=0.0, held_noise=0.0)
    found = ident.essential(one.estimate, one.held)
    there = {n for n, v in one.true.items() if abs(v) > 1e-3}
    assert there <= set(found.reduced.names)
