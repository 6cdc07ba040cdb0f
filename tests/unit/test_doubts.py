"""What a glance at a fit doubts: wrong signs, held-out data of another kind, data that were not held out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.effects.motion import Motion
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.evaluation.doubts import _bounds, _taken_up, doubts, fitted_as_well
from ident.evaluation.negative_inertia import negative_inertia
from ident.logs.log import Log
from ident.physical.structure import InertiaStructure
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory


def prepared(seed: int, sign: float = 1.0) -> Signals:
    """A log of an arm behind a coupled wrist, its torque recorded with a sign."""
    rng = np.random.default_rng(seed)
    robot = ROBOTS["wrist"]()
    model, values = declared(robot)
    motion = FourierTrajectory(np.zeros(robot.n), *0.6 * rng.normal(size=(2, 5, robot.n)) / np.arange(1, 6)[:, None], 0.1)
    t = np.arange(2000) / 200.0
    c = motion.sample(t)
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=200.0), values)
    tau = sign * tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return ZeroPhase(cutoff_hz=10.0)(Log(f"log{seed}", t, q=c.q, tau={robot.transmission.measured.value: tau}), robot)


def fitted(signals: Signals) -> Estimate:
    model, _ = declared(signals.robot)
    return WeightedLeastSquares().solve(Problem(model, signals))


def test_a_good_fit_raises_none() -> None:
    good = fitted(prepared(1))
    assert doubts(good) == ()
    assert doubts(good.with_heldout(good.torque_error(prepared(2)))) == ()


def test_a_torque_of_the_opposite_sign_is_seen() -> None:
    (said,) = doubts(fitted(prepared(1, -1.0)))
    assert said.startswith("every torque seems to have the opposite sign")
    assert "torque_sign = -1" in said


def test_a_poor_fit_alone_is_no_opposite_sign() -> None:
    signals = prepared(2)
    rng = np.random.default_rng(0)
    noise = 0.3 * np.sqrt(np.mean(signals.tau**2, axis=0)) * rng.standard_normal(signals.tau.shape)
    poor = fitted(replace(signals, tau=signals.tau + noise, source=None))
    assert np.all(poor.fit_error.relative > 0.1)
    assert not any("opposite sign:" in said for said in doubts(poor))
    unlike = replace(signals, tau=signals.tau + 0.5 * np.abs(signals.tau), source=None)
    assert not any("opposite sign:" in said for said in doubts(fitted(unlike)))


def test_scatter_about_zero_is_no_wrong_sign() -> None:
    good = fitted(prepared(1))
    i = good.index("Fv_j2")
    below = good.values.copy()
    below[i] = -3.0 * good.std[i]
    assert doubts(replace(good, values=below)) == ()
    below[i] = -6.0 * good.std[i]
    (said,) = doubts(replace(good, values=below))
    assert said.startswith("Fv_j2 = ")


def test_held_out_data_of_another_kind_are_seen() -> None:
    good = fitted(prepared(1))
    (said,) = doubts(good.with_heldout(good.torque_error(prepared(2, -1.0))))
    assert all(f"j{k} (2" in said or f"j{k} (1" in said for k in (1, 2, 3))
    assert "on held-out data is far larger" in said


@pytest.mark.parametrize(("sha", "again"), [("a", True), ("b", False), ("", False)])
def test_logs_that_are_fitted_and_held_out_are_named(sha: str, again: bool) -> None:
    said = fitted_as_well([{"path": "one.csv", "sha256": "a"}], [{"path": "copy.csv", "sha256": sha}])
    assert said.startswith("copy.csv is used for the fit") == again
    assert bool(said) == again


def test_a_joint_with_hardly_a_row_is_named() -> None:
    """Of few rows the fit takes up nearly all: what is left tells nothing of the noise."""
    whole = prepared(1)
    valid = whole.valid.copy()
    valid[np.flatnonzero(valid[:, 1])[6:], 1] = False
    estimate = fitted(replace(whole, valid=valid))
    (said,) = [one for one in doubts(estimate) if one.startswith("few rows")]
    assert "j2 (6; the fit absorbs" in said
    assert "j1" not in said
    assert estimate.problem is not None
    own = estimate.model.base.regroup[:, list(estimate.base.independent)]
    columns = np.zeros((*valid.shape, len(estimate.names)))
    for rows in estimate.problem.rows():
        columns[rows.place] = rows.columns @ own * rows.valid[:, :, None]
    inverse = np.linalg.inv(np.einsum("mjk,j,mjl->kl", columns, estimate.weights, columns))
    leverage = np.einsum("mjk,kl,mjl,j->j", columns, inverse, columns, estimate.weights)
    np.testing.assert_allclose(_taken_up(estimate), leverage, rtol=1e-6)
    assert leverage.sum() == pytest.approx(len(estimate.names))


def test_the_bounds_of_a_sum_are_those_of_its_parts() -> None:
    good = fitted(prepared(1))
    low, high = _bounds(good)
    own = np.abs(good.base.regroup) > 1e-9
    lower = np.array([p.lower for p in good.base.parameters])
    told = 0
    for i, share in enumerate(good.base.regroup):
        if np.all((share[own[i]] > 0.0) & np.isfinite(lower[own[i]])):
            assert low[i] == pytest.approx(share[own[i]] @ lower[own[i]])
            told += 1
        assert high[i] >= low[i]
    assert told


def test_what_next_to_nothing_explains_is_a_poor_fit_before_it_is_poorly_excited() -> None:
    signals = prepared(1)
    swapped = replace(signals, tau=signals.tau[:, ::-1].copy(), source=None)
    status = fitted(swapped).status
    assert status.code.value == "poor_fit"
    assert "Poorly excited:" in status.text
    assert "prediction" not in status.text


def test_a_negative_inertia_is_told_in_units_of_its_scatter() -> None:
    good = fitted(prepared(1))
    assert good.covariance is not None
    assert negative_inertia(good, 5.0) == ""
    structure = InertiaStructure.from_model(good.model, good.base)
    q = np.zeros((1, structure.n))
    row = structure.quadratic_rows(q, np.eye(structure.nv)[:1])[0]
    # One base parameter is changed that has no bound of its own, until the first joint's inertia is six deviations negative there.
    free = np.isneginf(_bounds(good)[0]) & (np.abs(row) > 0.5)
    k = int(np.flatnonzero(free)[0])
    off = np.zeros(len(row))
    off[k] = (row @ good.values + 6.0 * np.sqrt(row @ good.covariance @ row)) / row[k]
    wrong = replace(good, values=good.values - off)
    assert structure.joint_names[0] in negative_inertia(wrong, 5.0)
    assert negative_inertia(wrong, 5.0) in doubts(wrong)  # which no bound of a single base parameter shows
    assert negative_inertia(replace(wrong, covariance=1e6 * good.covariance), 5.0) == ""
