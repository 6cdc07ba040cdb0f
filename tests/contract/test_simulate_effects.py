"""Every registered effect can be simulated forward, or says why not; what was simulated satisfies the effect's own columns."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import seven

from ident.effect import Nature, Need, effect_types
from ident.errors import ConfigurationError, UnsupportedError
from ident.friction import RotorInertia, Viscous
from ident.model import Model
from ident.motion import Motion
from ident.robot import Robot
from ident.simulate import Plant, simulate
from ident.simulation.forces import Simulated


@pytest.mark.parametrize("name", sorted(set(effect_types()) - {"rigid_body", "rotor_inertia"}))
def test_forward_and_inverse_dynamics_agree(name: str) -> None:
    robot = seven()
    effect = effect_types()[name]()
    base = robot.rigid_body() + RotorInertia() + (Viscous() if name != "viscous" else Model(robot, ()))
    model = base + effect
    rng = np.random.default_rng(0)
    own = len(effect.parameters(robot))
    k = np.abs(np.diag(robot.transmission.K))
    count = len(base.parameters) - 70
    drive = np.concatenate([0.3 * k**2, 0.5 * k**2])[:count]
    values = np.concatenate([robot.nominal, drive, np.full(own, 0.1)])
    if name.startswith("payload"):
        values[-10:] = [1.0, 0.02, 0.01, 0.05, 0.02, 0.0, 0.02, 0.0, 0.0, 0.02]
    elif not effect.needs & {Need.REFERENCE, Need.HISTORY, Need.NEIGHBOURS, Need.TIME}:
        # A tenth of the torque of a typical motion, whatever the unit.
        states = [rng.normal(size=(40, 7)) * 0.1 for _ in range(3)]
        typical = Motion.of(robot, *states, torque=rng.normal(size=(40, 7)) * 0.3)
        typical = typical.with_load(model.load(typical, values))
        size = np.abs(effect.columns(typical, robot)).max(axis=(0, 1))
        on_side = robot.transmission.torque(base.torque(typical, values[:-own]), robot.transmission.measured, effect.side)
        values[-own:] = 0.1 * np.sqrt(np.mean(on_side**2)) / np.maximum(size, 1e-12)
    plant = Plant(model, values)
    t = np.arange(61) / 200.0
    torque = 0.3 * np.sin(2 * np.pi * np.outer(t, rng.uniform(1, 3, 7)) + rng.uniform(0, 6, 7)) * k * 40
    start = rng.uniform(-1, 1, 7), rng.uniform(-1, 1, 7)
    memory = effect.needs & {Need.HISTORY, Need.NEIGHBOURS} and not isinstance(effect, Simulated)
    permanent = Need.REFERENCE in effect.needs and effect.nature != Nature.SENSOR
    try:
        run = simulate(plant, torque=torque, start=start, rate=200.0, hold="first_order")
    except (UnsupportedError, ConfigurationError) as error:
        assert memory or permanent
        assert name in str(error)
        return
    moving = ~run.held
    motion = Motion.of(robot, run.q, run.dq, run.ddq, run.t, torque=run.tau)
    if effect.nature == Nature.SENSOR:
        expected = base.torque(motion, values[:-own])
    elif permanent:
        other = effect.applied(robot, values[-own:])
        assert isinstance(other, Robot)
        expected = Model(other, base.effects).torque(Motion.of(other, run.q, run.dq, run.ddq, run.t), values[:-own])
    elif memory or isinstance(effect, Simulated):
        return
    else:
        motion = motion.with_load(model.load(motion, values))
        expected = model.torque(motion, values)
    assert moving.sum() > 60
    np.testing.assert_allclose(run.tau[moving], expected[moving], atol=1e-10)
