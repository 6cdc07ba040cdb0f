"""Effects with memory or load in forward simulation: what is simulated is what the columns describe."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.effects.motion import Motion
from ident.effects.reference import Reference
from ident.effects.registry import make_effect
from ident.simulation.plant import Plant
from ident.simulation.simulate import Hold, simulate


@pytest.mark.parametrize(
    ("name", "shape", "size"),
    [
        ("presliding", {"z_s": 0.3}, 0.05),
        ("load_dependent_friction", {}, 0.15),
        ("stribeck", {"v_s": 5.0}, 0.05),
        ("linear_spring", {}, 2.0),
        ("gear_coupling", {"joints": ["j1"], "motors": ["j2"]}, 0.001),
        ("base_tilt", {}, 0.05),
    ],
)
def test_simulated_torque_is_that_of_the_columns(name: str, shape: dict, size: float) -> None:
    robot = ROBOTS["wrist"]()
    model, values = declared(robot, make_effect(name, **shape))
    values[model.slices[-1]] = size
    rate, zero = 1000.0, np.zeros((1, 3))
    t = np.arange(700) / rate
    holding = model.inverse_dynamics(zero, zero, zero, values)
    push = 0.6 * np.sin(np.multiply.outer(t, [9.0, 7.0, 8.0]))
    run = simulate(Plant(model, values), torque=holding + push, start=(zero[0], zero[0]), rate=rate, hold=Hold.FIRST_ORDER, step=5e-4)
    truth = model
    if name in ("gear_coupling", "base_tilt"):  # corrections of first order: simulated as the robot that they mean
        other = model.effects[-1].applied(robot, values[model.slices[-1]])
        truth, values = type(model)(other, model.effects[:-1]), values[: model.slices[-1].start]
    motion = Motion.of(truth.robot, run.q, run.dq, run.ddq, t, rate=rate).with_reference(Reference(truth, values))
    sliding = ~run.held.any(axis=1) & (np.abs(motion.motor.dq).min(axis=1) > 1e-6)
    assert sliding.mean() > 0.6
    np.testing.assert_allclose(truth.torque(motion, values)[sliding], run.tau[sliding], atol=1e-3 * np.abs(run.tau).max())
