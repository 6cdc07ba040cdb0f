"""Payloads: from a pair of logs, a log on a saved fit, and two fits; real bodies, honest intervals, and silence without a load."""

from __future__ import annotations

import json

import numpy as np
import pytest
from physical_models import puma_model, puma_truth, random_structure

from ident.effects.motion import Motion
from ident.errors import ConfigurationError, DataError
from ident.physical import InertiaStructure, payload_from_fit, payload_from_fits, payload_from_logs
from ident.physical.payload import _consistent, _log_cholesky, _scale, payload_columns
from ident.physical.pseudo_inertia import from_centre_of_mass, smallest_eigenvalues

Array = np.ndarray
NOISE = 0.05
LOAD = from_centre_of_mass(1.6, np.array([-0.07, 0.07, 0.11]), np.diag([0.0075, 0.0075, 0.013]))


def block(load: Array, samples: int, seed: int, body: int = 5) -> tuple[Array, Array]:
    """Whitened information (R, z) of a log of the PUMA with a load on a link."""
    model = puma_model()
    structure, values, _ = puma_truth()
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (samples, 6))
    motion = Motion.of(model.robot, q, rng.standard_normal((samples, 6)), 4 * rng.standard_normal((samples, 6)))
    Y = model.columns(motion)[:, :, model.base.independent].reshape(-1, structure.b)
    with_load = values + structure.regroup[:, structure.inertial[10 * body : 10 * body + 10]] @ load
    y = Y @ with_load + NOISE * rng.standard_normal(len(Y))
    R = np.linalg.qr(np.concatenate([Y, y[:, None]], axis=1) / NOISE, mode="r")
    return R[:-1, :-1], R[:-1, -1]


def covariance(R: Array) -> Array:
    return np.linalg.inv(R.T @ R)


def test_pair_of_logs() -> None:
    structure, _, _ = puma_truth()
    found = payload_from_logs(structure, block(np.zeros(10), 800, 1), block(LOAD, 800, 2))
    assert found.link == "link6"
    assert found.significant
    assert found.identifiable == 10
    assert smallest_eigenvalues(found.values)[0] > 0
    assert np.all(np.abs(found.unconstrained - LOAD) < 4.5 * found.std)
    assert abs(found.mass - 1.6) < 4.5 * found.mass_std
    assert np.allclose(found.centre_of_mass, [-0.07, 0.07, 0.11], atol=0.02)
    assert "payload on link6" in found.text()
    body = json.loads(json.dumps(found.to_dict()))
    assert body["parameters"][0]["unit"] == "kg"


def test_the_three_ways_agree() -> None:
    """With information kept whole, a saved fit (values and covariance) says the same as its log."""
    structure, _, _ = puma_truth()
    before, after = block(np.zeros(10), 150, 1), block(LOAD, 150, 2)
    pair = payload_from_logs(structure, before, after)
    fit = np.linalg.solve(*before), covariance(before[0])
    saved = payload_from_fit(structure, *fit, after)
    both = payload_from_fits(structure, fit, (np.linalg.solve(*after), covariance(after[0])))
    assert np.allclose(saved.values, pair.values, rtol=1e-5, atol=1e-7)
    assert np.allclose(both.values, pair.values, rtol=1e-4, atol=1e-6)
    assert np.allclose(saved.std, pair.std, rtol=1e-5)


def test_intervals_cover() -> None:
    """Errors of the unconstrained values in standard deviations have unit size over 40 pairs; the consistent ones no more."""
    structure, _, _ = puma_truth()
    plain, real = [], []
    for k in range(40):
        found = payload_from_logs(structure, block(np.zeros(10), 60, 100 + 2 * k), block(LOAD, 60, 101 + 2 * k))
        plain.append((found.unconstrained - LOAD) / found.std)
        real.append((found.values - LOAD) / found.std)
    squares = np.mean(np.square(plain), axis=0)
    assert 0.75 < squares.mean() < 1.25
    assert np.all(squares < 2.0)
    assert np.mean(np.square(real)) <= squares.mean() * 1.02


def test_no_payload_is_not_reported() -> None:
    structure, _, _ = puma_truth()
    claims = [
        payload_from_logs(structure, block(np.zeros(10), 60, 300 + 2 * k), block(np.zeros(10), 60, 301 + 2 * k)).significant
        for k in range(20)
    ]
    assert sum(claims) <= 1


def test_what_is_no_load_on_that_link_is_said() -> None:
    structure, _, _ = puma_truth()
    bare, loaded = block(np.zeros(10), 800, 1), block(LOAD, 800, 2)
    assert payload_from_logs(structure, bare, loaded).notes == ()
    assert payload_from_logs(structure, bare, block(np.zeros(10), 800, 3)).notes == ()
    elsewhere = payload_from_logs(structure, bare, loaded, link="link5").notes
    assert "the load is on another link" in " ".join(elsewhere)
    # Friction of a joint that has grown: next to nothing of it passes for a body.
    R, z = block(np.zeros(10), 800, 3)
    grown = np.linalg.solve(R, z)
    grown[next(i for i, name in enumerate(structure.base_names) if name.startswith("Fv"))] *= 1.5
    changed = payload_from_logs(structure, bare, (R, R @ grown))
    assert any("something else has changed, such as friction" in note for note in changed.notes)


def test_another_link() -> None:
    structure, _, _ = puma_truth()
    found = payload_from_logs(structure, block(np.zeros(10), 200, 1), block(LOAD, 200, 2, body=1), link="link2")
    # The mass of the upper arm itself acts on no torque, nor do its moments along the axis of joint 2.
    assert found.identifiable < 10
    assert np.isnan(found.std).any()
    assert smallest_eigenvalues(found.values)[0] > 0
    A = payload_columns(structure, "link2")
    assert found.link == "link2"
    # What is seen is right, whatever the split over the ten.
    change = A @ found.values - A @ LOAD
    C = covariance(block(np.zeros(10), 200, 1)[0]) + covariance(block(LOAD, 200, 2, body=1)[0])
    assert np.all(np.abs(change) < 5 * np.sqrt(np.diag(C)) + 1e-3)
    assert str(found.identifiable) in found.text()


def test_planar_arm_sees_part_of_a_load() -> None:
    structure, _full = random_structure(np.random.default_rng(4), 2, prismatic=0.0, rotors=False)
    assert isinstance(structure, InertiaStructure)
    A = payload_columns(structure, "link2")
    assert np.linalg.matrix_rank(A) < 10


def test_errors() -> None:
    structure, _, _ = puma_truth()
    before = block(np.zeros(10), 60, 1)
    with pytest.raises(ConfigurationError, match="link9"):
        payload_from_logs(structure, before, before, link="link9")
    with pytest.raises(ConfigurationError, match="shape"):
        payload_from_logs(structure, before, (before[0][:, :-1], before[1]))
    with pytest.raises(DataError, match="not finite"):
        payload_from_logs(structure, before, (before[0] * np.nan, before[1]))
    with pytest.raises(DataError, match="not visible"):
        payload_from_logs(structure, before, (np.zeros((1, structure.b)), np.zeros(1)))


def test_fallback_without_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    structure, _, _ = puma_truth()
    before, after = block(np.zeros(10), 150, 1), block(LOAD, 150, 2)
    best = payload_from_logs(structure, before, after)
    monkeypatch.setattr("ident.physical.payload.solver_available", lambda: False)
    found = payload_from_logs(structure, before, after)
    assert "fallback" in found.method
    assert np.all(np.abs(found.values - best.values) < 0.2 * best.std)
    rng = np.random.default_rng(0)
    R = rng.standard_normal((30, 10)) / _scale(structure)
    z = R @ np.where(np.arange(10) == 4, -1.0, 0.5) * _scale(structure)[4]
    lmi, factors = _consistent(R, z, _scale(structure)), _log_cholesky(R, z, _scale(structure))
    cost = [float(np.sum((R @ x - z) ** 2)) for x in (lmi, factors)]
    assert cost[0] <= cost[1] * 1.001 + 1e-6
