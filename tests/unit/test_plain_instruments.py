"""Plain and recursive instrumental variables against the printed formula, and what is said of instruments made of a commanded torque."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ident.effects.motion import Motion
from ident.errors import ConfigurationError
from ident.estimate.estimate import Estimate
from ident.estimators import Capability, estimator_types, make_estimator
from ident.planning import default_model
from ident.problem.problem import Problem
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.signals import CentralDifference, Recorded
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.result import Simulation
from ident.simulation.sensors import Quantisation, Sensors, TorqueNoise, TorqueWindow
from ident.simulation.simulate import simulate
from ident.simulation.trajectory import FourierTrajectory

RATE, SECONDS = 200.0, 15.0
OPEN = {"loop": "open", "weighting": "none"}


@cache
def motion() -> tuple[object, np.ndarray, Simulation, np.ndarray]:
    """SCARA whose torque does not depend on what its encoders read: model, true base values, the run, torque level (n,)."""
    robot = load_robot("scara")
    model = default_model(robot)
    values = nominal_values(model)
    sine, cosine = 0.35 * np.random.default_rng(5).normal(size=(2, 5, robot.n))
    way = FourierTrajectory(np.full(robot.n, 0.2), sine, cosine, 1 / SECONDS)
    controller = PDFeedforward.tuned(model, values)
    made = simulate(
        Plant(model, values), desired=way, controller=controller, rate=RATE, control_rate=1000.0, sensors=Sensors((), Side.MOTOR)
    )
    return model, model.base.base_values(values), made, np.sqrt(np.mean(made.tau**2, axis=0))


@cache
def problem(noise: float = 0.02, seed: int = 0) -> Problem:
    model, _, made, level = motion()
    sensors = (Quantisation.counts(500.0), TorqueWindow(1 / RATE), *((TorqueNoise(tuple(noise * level)),) if noise else ()))
    log = made.reread(Sensors(sensors, Side.MOTOR, columns=("q", "tau")), seed).log("run")
    return Problem(model, CentralDifference()([log], model.robot))  # type: ignore[attr-defined]


@cache
def solved(method: str, *options: tuple[str, object]) -> Estimate:
    return make_estimator(method, **dict(options)).solve(problem())


def test_plain_estimate_solves_the_printed_equations() -> None:
    """A pass is p = (Ωᵀ Ψ)⁻¹ Ωᵀ τ, Ω by accelerations of the model before it: H column by column, solved by NumPy alone."""
    first, second = (solved("iv", *OPEN.items(), ("iterations", i)) for i in (1, 2))
    assert second.trace["repaired"][1] == 0.0
    p, found = problem(), first.all_values
    s, model = p.signals, p.model
    robot, n = model.robot, model.robot.n

    def torque(ddq: np.ndarray) -> np.ndarray:
        return model.torque(Motion.of(robot, s.q, s.dq, ddq, s.t), found)

    still = torque(np.zeros_like(s.q))
    H = np.stack([torque(np.tile(e, (len(s.q), 1))) - still for e in np.eye(n)], axis=2)
    ddq = np.linalg.solve(H, (s.torque - still)[:, :, None])[:, :, 0]
    base = p.base.independent
    instruments = model.columns(Motion.of(robot, s.q, s.dq, ddq, s.t))[:, :, base]
    columns = model.columns(Motion.of(robot, s.q, s.dq, s.ddq, s.t))[:, :, base]
    use = p.valid
    Z, Phi, tau = instruments[use], columns[use], s.torque[use]
    again = np.linalg.solve(Z.T @ Phi, Z.T @ tau)
    assert np.abs((again - second.values) / second.std).max() < 1e-8
    assert np.abs((first.values - second.values) / second.std).max() > 1e-3


def test_plain_start_is_ordinary_least_squares() -> None:
    once = make_estimator("iv", **OPEN, iterations=1).solve(problem())
    assert len(once.trace["steps"]) == 1
    least = make_estimator("ls").solve(problem())
    truth = motion()[1]
    converged = solved("iv", *OPEN.items())
    start, end = (np.linalg.norm((e.values - truth) / converged.std) for e in (least, converged))
    assert end < 0.1 * start


def test_recursion_ends_at_the_batch() -> None:
    riv = make_estimator("riv", loop="open", passes=3, follow=("Izz_joint1",)).solve(problem())
    batch = make_estimator("iv", **OPEN, iterations=3).solve(problem())
    assert riv.values == pytest.approx(batch.values, rel=1e-8)
    assert riv.std == pytest.approx(batch.std, rel=1e-6)
    assert riv.trace["samples"][-1] == len(problem().valid)
    assert riv.trace["values"][-1][0] == pytest.approx(dict(zip(batch.names, batch.values, strict=True))["Izz_joint1"], rel=1e-8)
    # Bands of white noise shrink, whatever the samples say.
    std = np.array(riv.trace["std"])[:, 0]
    known = std[np.isfinite(std)]
    assert known[-1] < known[len(known) // 4]


def test_one_sample_at_a_time_or_in_blocks() -> None:
    p = problem()
    prior = solved("iv", *OPEN.items())
    estimator = make_estimator("riv", prior=prior)
    assert Capability.RECURSIVE in estimator_types()["riv"].capabilities
    s = p.signals
    part = slice(200, 700)
    whole = estimator.start(p.model, p.base).observe(s.q[part], s.dq[part], s.ddq[part], s.torque[part])
    state = estimator.start(p.model, p.base)
    assert np.isnan(state.values).all()
    for i in range(part.start, part.stop):
        state = state.observe(s.q[i], s.dq[i], s.ddq[i], s.torque[i])
    assert state.seen == whole.seen == 500
    assert state.values == pytest.approx(whole.values, rel=1e-7)
    assert state.std == pytest.approx(whole.std, rel=1e-7)
    with pytest.raises(ConfigurationError, match="prior"):
        make_estimator("riv").start(p.model, p.base).observe(s.q[0], s.dq[0], s.ddq[0], s.torque[0])


def test_forgetting_weighs_samples_by_age() -> None:
    p = problem()
    rng = np.random.default_rng(0)
    m, n, b = 400, p.model.robot.n, p.base.count
    Z, Phi, tau = rng.normal(size=(m, n, b)), rng.normal(size=(m, n, b)), rng.normal(size=(m, n))
    Phi += 3 * Z
    state = make_estimator("riv", forgetting=0.99).start(p.model, p.base)
    for first in range(0, m, 40):
        part = slice(first, first + 40)
        state = state.update(Phi[part], tau[part], instruments=Z[part])
    weight = 0.99 ** np.arange(m - 1, -1, -1.0)
    cross = np.einsum("m,mnb,mnc->bc", weight, Z, Phi)
    wanted = np.linalg.solve(cross, np.einsum("m,mnb,mn->b", weight, Z, tau))
    assert state.values == pytest.approx(wanted, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("weighting", ["none", "noise"])
def test_commanded_torque_is_no_feedback_loop(weighting: str) -> None:
    """Instruments made of a noisy commanded torque share its noise: told with the size of the bias, not refused."""
    told = make_estimator("iv", loop="open", weighting=weighting).solve(problem(0.1))
    untold = make_estimator("iv", weighting=weighting).solve(problem(0.1))
    assert told.values == pytest.approx(untold.values, rel=1e-12)
    assert untold.status.code == "invalid_instruments"
    assert told.status.code != "invalid_instruments"
    said = [w for w in told.warnings if "correlated with the noise" in w]
    assert len(said) == 1
    assert "feedback" not in told.status.text + said[0]
    assert told.trace["validity"]["bias"]["largest"] > 1.0


def test_estimated_bias_is_the_bias() -> None:
    """Mean torque error of six seeds against what one log says of it, and none where the torque is read exactly."""
    truth = motion()[1]
    found = [make_estimator("iv", **OPEN).solve(problem(0.1, seed)) for seed in range(6)]
    mean = np.mean([e.values for e in found], axis=0) - truth
    model, _, made, _ = motion()
    log = made.reread(Sensors((TorqueWindow(1 / RATE),), Side.MOTOR, columns=("q", "dq", "ddq", "tau")), 0).log("run")
    exact_motion = Problem(model, Recorded()([log], model.robot))
    bias = float(np.linalg.norm(exact_motion.predict(mean)) / np.linalg.norm(exact_motion.tau))
    told = np.median([e.trace["validity"].get("bias", {"torque": 0.0})["torque"] for e in found])
    assert 0.4 * bias < told < 2.5 * bias
    exact = make_estimator("iv", **OPEN).solve(problem(0.0))
    assert "bias" not in exact.trace["validity"]


def test_unknown_weighting() -> None:
    with pytest.raises(ConfigurationError, match="noise"):
        make_estimator("iv", weighting="nose")
