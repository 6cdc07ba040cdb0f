"""Every registered effect can be simulated forward, or says why not; what was simulated satisfies the effect's own columns."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import seven

from ident.effects.kinds import Nature, Need
from ident.effects.motion import Motion
from ident.effects.registry import effect_types
from ident.errors import UnsupportedError
from ident.friction import RotorInertia, Viscous
from ident.model import Model
from ident.robots.robot import Robot
from ident.simulation.forces import Simulated
from ident.simulation.plant import Plant
from ident.simulation.simulate import simulate


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
    elif not effect.needs & {Need.REFERENCE, Need.HISTORY, Need.NEIGHBOURS}:
        # A tenth of the torque of a typical motion, whatever the unit.
        states = [rng.normal(size=(40, 7)) * 0.1 for _ in range(3)]
        typical = Motion.of(robot, *states, torque=rng.normal(size=(40, 7)) * 0.3)
        typical = typical.with_load(model.load(typical, values))
        size = np.abs(effect.columns(typical, robot)).max(axis=(0, 1))
        on_side = robot.transmission.torque(base.torque(typical, values[:-own]), robot.transmission.measured, effect.side)
        values[-own:] = 0.1 * np.sqrt(np.mean(on_side**2)) / np.where(size > 1e-9, size, 1.0)
    plant = Plant(model, values)
    t = np.arange(61) / 200.0
    torque = 0.3 * np.sin(2 * np.pi * np.outer(t, rng.uniform(1, 3, 7)) + rng.uniform(0, 6, 7)) * k * 40
    start = rng.uniform(-1, 1, 7), rng.uniform(-1, 1, 7)
    sensor = effect.nature == Nature.SENSOR
    memory = effect.needs & {Need.HISTORY, Need.NEIGHBOURS} and not isinstance(effect, Simulated) and not sensor
    permanent = Need.REFERENCE in effect.needs and not sensor
    changed = effect.applied(robot, values[-own:]) if permanent else None
    if memory or (permanent and not isinstance(changed, Robot)):
        with pytest.raises(UnsupportedError, match=name):
            simulate(plant, torque=torque, start=start, rate=200.0)
        return
    run = simulate(plant, torque=torque, start=start, rate=200.0, hold="first_order", step=5e-3)
    moving = ~run.held
    motion = Motion.of(robot, run.q, run.dq, run.ddq, run.t, torque=run.tau)
    if sensor:
        expected = base.torque(motion, values[:-own])
    elif permanent:
        assert isinstance(changed, Robot)
        expected = Model(changed, base.effects).torque(Motion.of(changed, run.q, run.dq, run.ddq, run.t), values[:-own])
    elif isinstance(effect, Simulated):
        assert run.states.shape[1] > 0
        return
    else:
        motion = motion.with_load(model.load(motion, values))
        expected = model.torque(motion, values)
    assert moving.sum() > 60
    np.testing.assert_allclose(run.tau[moving], expected[moving], atol=1e-10)
