"""Least squares against instruments: a loop in which disturbances move the joint, simulated here, beside the product."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ident
from ident.errors import ConfigurationError, UnsupportedError
from ident.friction import Coulomb, Viscous

INERTIA, WEIGHT, VISCOUS, COULOMB = 0.5, 4.0, 0.6, 1.5
TEXT = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2.0"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.42" iyz="0" izz="0.42"/></inertial></link>
<joint name="j1" type="revolute"><origin rpy="1.5708 0 0"/><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="50" velocity="9"/></joint></robot>"""


def robot() -> ident.Robot:
    return ident.Robot.from_urdf(TEXT)


def logs(count: int, *, restless: float, seconds: float = 40.0, stiffness: float = 40.0, first: int = 0) -> list[ident.Log]:
    """Position loops at 1 kHz, logged at 200 Hz. `restless`: standard deviation of the dry friction's fluctuation, as a share."""
    h = 1e-3
    t = np.arange(0.0, seconds, h)
    w = 2 * np.pi * np.array([0.15, 0.35, 0.55, 0.8])
    size = np.array([0.5, 0.3, 0.15, 0.08])
    drawn = [np.random.default_rng(first + k) for k in range(count)]
    angle = np.outer(t, w)[:, None] + np.array([rng.uniform(0, 2 * np.pi, 4) for rng in drawn])
    wanted, speed = np.sin(angle) @ size, np.cos(angle) @ (size * w)
    keep = np.exp(-h / 0.06)
    noise = np.array([rng.normal(size=len(t)) for rng in drawn]).T * np.sqrt(1 - keep**2)
    q, dq, wander = wanted[0], speed[0], np.zeros(count)
    out = np.zeros((len(t), 2, count))
    for k in range(len(t)):
        wander = keep * wander + noise[k]
        torque = stiffness * (wanted[k] - q) + 0.5 * np.sqrt(stiffness) * (speed[k] - dq)
        friction = VISCOUS * dq + COULOMB * (1.0 + restless * wander) * np.sign(dq)
        out[k] = q, torque
        dq = dq + h * (torque - friction - 9.81 * 0.4 * np.cos(q)) / INERTIA
        q = q + h * dq
    at = slice(None, None, 5)
    return [
        ident.Log("loop", t[at], q=out[at, :1, k], tau={"joint": out[at, 1:, k]}, extra={"q_ref1": wanted[at, k]}) for k in range(count)
    ]


def fitted(made: ident.Log, method: object = "wls") -> ident.Estimate:
    own = robot()
    return ident.fit(made, own, model=own.rigid_body() + Viscous() + Coulomb(), method=method, held=0)


def errors(estimate: ident.Estimate) -> np.ndarray:
    """Errors of inertia, viscous and Coulomb friction in standard deviations."""
    values = dict(zip(estimate.names, zip(estimate.values, estimate.std, strict=True), strict=True))
    true = {"Izz_j1": INERTIA, "Fv_j1": VISCOUS, "Fc_j1": COULOMB}
    return np.array([(values[k][0] - v) / values[k][1] for k, v in true.items()])


@pytest.fixture(scope="module")
def restless() -> list[ident.Log]:
    return logs(8, restless=0.3)


def test_intervals_by_instruments_hold_where_those_of_least_squares_do_not(restless: list[ident.Log]) -> None:
    plain, by_instruments = (np.array([errors(fitted(x, m)) for x in restless]) for m in ("wls", "iv_band"))
    assert np.sqrt(np.mean(by_instruments**2)) < 1.5
    assert np.sqrt(np.mean(plain[:, 0] ** 2)) > 3.0


def test_desired_motion_is_the_instrument_where_the_joints_follow_it() -> None:
    stiff = logs(4, restless=0.3, stiffness=900.0)
    found = [fitted(x, "iv_band") for x in stiff]
    assert {e.trace["instrument"] for e in found} == {"q_ref"}
    assert np.sqrt(np.mean([errors(e) ** 2 for e in found])) < 1.5


def test_what_feedback_moves_is_named_with_both_values(restless: list[ident.Log]) -> None:
    biases = [ident.feedback_bias(fitted(x)) for x in restless]
    assert sum("Izz_j1" in bias.significant for bias in biases) >= 4
    named = next(bias for bias in biases if bias.significant)
    assert named.significant[0] in named.warning()
    assert "iv_band" in str(named)
    row = named.to_frame().set_index("name").loc["Izz_j1"]
    assert abs(row.by_instruments - INERTIA) < abs(row.value - INERTIA)
    told = {p["name"]: p for p in named.to_dict()["parameters"]}
    assert told["Izz_j1"]["moved"] == pytest.approx(row.value - row.by_instruments)


def test_nothing_is_named_where_nothing_disturbs_the_motion() -> None:
    rng = np.random.default_rng(7)
    for made in logs(4, restless=0.0):
        noisy = ident.Log("loop", made.t, q=made.q, tau={"joint": made.tau["joint"] + 0.3 * rng.normal(size=(len(made.t), 1))})
        for one in (made, noisy):
            bias = ident.feedback_bias(fitted(one))
            assert bias.significant == ()
            assert bias.warning() == ""


def test_chance_is_told_by_its_standard_deviation() -> None:
    rng = np.random.default_rng(8)
    (made,) = logs(1, restless=0.0, first=3)
    z = []
    for _ in range(30):
        noise = 0.3 * rng.normal(size=(len(made.t), 1))
        bias = ident.feedback_bias(fitted(ident.Log("loop", made.t, q=made.q, tau={"joint": made.tau["joint"] + noise})))
        z.append(bias.moved / bias.moved_std)
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_what_cannot_be_compared_is_refused() -> None:
    (made,) = logs(1, restless=0.1, seconds=20.0, first=1)
    with pytest.raises(ConfigurationError):
        ident.feedback_bias(replace(fitted(made), problem=None))
    with pytest.raises(UnsupportedError):
        ident.feedback_bias(fitted(made, "iv_band"))
