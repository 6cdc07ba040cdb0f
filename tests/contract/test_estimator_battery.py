"""One battery that every registered estimator passes, found by discovery; a meta-test so that none escapes."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import ident
import ident.estimators
from ident.effects.motion import Motion
from ident.errors import ConfigurationError, IdentError
from ident.estimate.status import StatusCode
from ident.estimators import Estimator, estimator_types, make_estimator
from ident.friction import Coulomb, Viscous
from ident.logs.log import Log, LogSet
from ident.robots import nominal_values
from ident.signals import Recorded

TYPES = sorted(estimator_types())


@pytest.fixture(scope="module")
def truth():
    robot = ident.load_robot("scara")
    model = robot.rigid_body() + Viscous() + Coulomb()
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 10.0, 0.01)
    q, dq, ddq = (np.zeros((len(t), robot.n)) for _ in range(3))
    middle = np.array([(j.lower + j.upper) / 2 for j in robot.joints])
    half = np.array([min((j.upper - j.lower) / 2, 1.0) for j in robot.joints])
    for h in range(1, 6):
        w = 2 * np.pi * 0.2 * h
        a, b = rng.normal(size=(2, robot.n)) * 0.2 * half
        q += a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None]
        dq += w * (a * np.cos(w * t)[:, None] - b * np.sin(w * t)[:, None])
        ddq -= w * w * (a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None])
    values = nominal_values(model)
    tau = model.torque(Motion.of(robot, q + middle, dq, ddq, t), values)
    noise = 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)

    def problem(torque: np.ndarray) -> ident.Problem:
        log = Log("run", t, q + middle, dq=dq, ddq=ddq, tau={robot.transmission.measured.value: torque})
        return ident.Problem(model, Recorded()(LogSet((log,), robot)))

    return model.base.base_values(values), problem(tau), problem(tau + noise)


def solved(name: str, problem: ident.Problem) -> ident.Estimate:
    """The estimate, or a skip where the estimator refuses this kind of problem with the name of one that can."""
    try:
        return make_estimator(name).solve(problem)
    except ConfigurationError as refusal:
        if "method" not in str(refusal):  # a refusal names one that can
            raise
        pytest.skip(f"refuses: {refusal}")


def test_none_escapes() -> None:
    found = set()
    for module in pkgutil.iter_modules(ident.estimators.__path__):
        for value in vars(importlib.import_module(f"ident.estimators.{module.name}")).values():
            concrete = isinstance(value, type) and issubclass(value, Estimator) and not getattr(value, "__abstractmethods__", None)
            if concrete and not value.__name__.startswith("_"):
                found.add(value)
    assert {t.__qualname__ for t in found} == {t.__qualname__ for t in estimator_types().values()}


@pytest.mark.parametrize("name", TYPES)
def test_is_a_frozen_documented_configuration(name: str) -> None:
    kind = estimator_types()[name]
    assert dataclasses.is_dataclass(kind)
    assert kind.__dataclass_params__.frozen
    assert kind.name == name
    assert kind.title
    assert kind.__doc__
    first, second = make_estimator(name), make_estimator(name)
    assert first == second


@pytest.mark.parametrize("name", TYPES)
def test_unknown_key_names_the_nearest(name: str) -> None:
    with pytest.raises(IdentError, match="no_such_key"):
        make_estimator(name, no_such_key=1)


@pytest.mark.parametrize("name", TYPES)
def test_recovers_the_truth_without_noise(name: str, truth) -> None:
    values, clean, _ = truth
    estimate = solved(name, clean)
    scale = np.maximum(np.abs(values), 1e-3 * np.abs(values).max())
    assert estimate.names == clean.base.names
    assert np.abs(estimate.values - values).max() < 1e-3 * scale.max()
    # One that prepares rows of its own takes derivatives of positions, where the log's own are exact.
    assert estimate.fit_error.relative_all < (1e-3 if estimator_types()[name].own_rows else 1e-4)


@pytest.mark.parametrize("name", TYPES)
def test_noise_stays_within_the_covariance_and_repeats_exactly(name: str, truth, tmp_path) -> None:
    values, _, noisy = truth
    estimate = solved(name, noisy)
    again = make_estimator(name).solve(noisy)
    assert np.array_equal(estimate.values, again.values)
    assert np.all(np.isfinite(estimate.std))
    assert np.all(np.linalg.eigvalsh(estimate.covariance / np.outer(estimate.std, estimate.std)) > -1e-8)
    # An estimate whose intervals do not hold must say so: instruments made with noisy torque correlate with its noise.
    said = estimate.status.code == StatusCode.INVALID_INSTRUMENTS
    assert said or np.mean(np.abs(estimate.values - values) < 4 * estimate.std) > 0.9
    path = estimate.save(tmp_path / "fit.json")
    loaded = ident.Estimate.load(path)
    assert loaded.values == pytest.approx(estimate.values, rel=1e-15)
    assert np.array_equal(nominal_values(loaded.model), nominal_values(estimate.model))
    assert loaded.covariance == pytest.approx(estimate.covariance, rel=1e-12)
    assert loaded.torque_error(noisy.signals).relative_all == pytest.approx(estimate.torque_error(noisy.signals).relative_all, rel=1e-9)
