"""Compiled simulation against the general one: the same plants, torques, controllers and events, the same numbers."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from rigid_models import kernels, using

import ident
from ident import friction as fr
from ident.effects.force import ForceModel
from ident.effects.kinds import Axis
from ident.effects.motion import Coordinates, Motion
from ident.effects.offset import Offset
from ident.effects.registry import effect_types
from ident.effects.springs import LinearSpring
from ident.errors import DataError
from ident.regressor import rigid
from ident.regressor.kernel_choice import kernel as kernel_here
from ident.robots.robot import Robot
from ident.robots.transmission import Side
from ident.simulation.command import Feedback
from ident.simulation.controller import CascadedPPI, PDFeedforward
from ident.simulation.plant import Plant, Schedule
from ident.simulation.simulate import Hold, simulate, simulate_batch

pytestmark = pytest.mark.skipif(not kernel_here().compiled, reason="the compiled kernel is not built, or not asked for")
COMPILED = pytest.mark.parametrize("kernel", [k for k in kernels() if k != "numpy"])


@pytest.fixture(scope="module")
def puma() -> Robot:
    return ident.load_robot("puma560")


def plant_of(robot: Robot, dry: float = 0.1, **more: object) -> Plant:
    """Rigid body, rotors, viscous and dry friction, an offset and a spring, with values of everyday size."""
    effects = (fr.RotorInertia(), fr.Viscous(), fr.Coulomb(), Offset(), LinearSpring())
    model = robot.rigid_body()
    for effect in effects:
        model = model + effect
    n = robot.n
    size = np.array([1.0, 1.2, 0.8, 0.2, 0.2, 0.15])[:n]
    spring = np.stack([np.linspace(0.5, 2.0, n), np.linspace(-1.0, 1.0, n)], axis=1).reshape(-1)
    parts = [robot.nominal, np.full(n, 2e-4), 1e-3 * size, dry * size, 0.02 * size, spring]
    return Plant(model, np.concatenate(parts), **more)


def wave(n: int, count: int, rate: float, seed: int = 0, size: float = 0.6) -> Coordinates:
    """A motion that starts and pauses at rest: contacts stick, slide, turn and stick again."""
    rng = np.random.default_rng(seed)
    t = np.arange(count)[:, None] / rate
    w, phase, beat = 2 * np.pi * rng.uniform(2, 5, n), rng.uniform(0, np.pi, n), 2 * np.pi * rng.uniform(6, 12, n)
    # Time runs on for half of each beat and stands still for the other half.
    pace = np.maximum(np.sin(beat * t), 0.0) ** 2
    clock, change = np.cumsum(pace, axis=0) / rate, np.gradient(pace, 1.0 / rate, axis=0)
    q, slope, bend = np.cos(w * clock + phase), -w * np.sin(w * clock + phase), -(w**2) * np.cos(w * clock + phase)
    return Coordinates(size * q, size * slope * pace, size * (bend * pace**2 + slope * change))


def same(one, other, tolerance: float = 1e-10) -> None:
    """All of two simulations' truth."""
    for name in ("link", "motor"):
        for part in ("q", "dq", "ddq"):
            a, b = getattr(getattr(one, name), part), getattr(getattr(other, name), part)
            assert np.abs(a - b).max() <= tolerance * (1 + np.abs(b).max()), (name, part)
    for name in ("tau", "applied", "friction"):
        a, b = getattr(one, name), getattr(other, name)
        assert np.abs(a - b).max() <= tolerance * (1 + np.abs(b).max()), name
    np.testing.assert_array_equal(one.held, other.held)
    assert one.states.shape == other.states.shape


def both(monkeypatch, make, **arguments):
    """The runs of a plant by compiled code and by the general way."""
    plant = make()
    assert plant.compiled() is not None
    fast = simulate_batch(plant, **arguments)
    with monkeypatch.context() as patch:
        patch.setenv("IDENT_KERNEL", "numpy")
        plant = make()
        assert plant.compiled() is None
        return fast, simulate_batch(plant, **arguments)


@COMPILED
def test_tracking_with_sticking_joints(kernel, puma, monkeypatch):
    """Five runs (not a multiple of any number of lanes) under a PD controller with feedforward, held by strong friction now and then."""
    desired = [wave(6, 120, 500.0, seed) for seed in range(5)]
    with using(kernel):
        fast, slow = both(monkeypatch, lambda: plant_of(puma, dry=0.3), desired=desired, rate=250.0, control_rate=500.0, step=1e-3)
    held = np.concatenate([s.held for s in slow])
    assert 0.02 < held.mean() < 0.9, "the motion does not test what it should"
    for a, b in zip(fast, slow, strict=True):
        same(a, b)


@pytest.mark.parametrize("hold", list(Hold))
def test_given_torque(hold, puma, monkeypatch):
    rng = np.random.default_rng(3)
    t = np.arange(100)[:, None, None] / 500.0
    torque = 0.8 * np.array([1.0, 1.0, 0.6, 0.3, 0.3, 0.2]) * np.sin(2 * np.pi * rng.uniform(1, 6, (2, 6)) * t)
    start = rng.uniform(-1, 1, (2, 6)), np.zeros((2, 6))
    fast, slow = both(monkeypatch, lambda: plant_of(puma), torque=torque, hold=hold, start=start, rate=500.0, step=1e-3)
    for a, b in zip(fast, slow, strict=True):
        same(a, b)
    assert any(s.held.any() for s in slow)


def test_other_controllers_and_feedback(puma, monkeypatch):
    """Controllers that compiled code does not know, and encoders in the loop: a call a period, the steps compiled."""
    plant = plant_of(puma)
    part = puma.rigid_body() + fr.RotorInertia()
    values = np.concatenate([puma.nominal, np.full(6, 2e-4)])
    cascade = CascadedPPI.tuned(part, values)
    common = {"desired": [wave(6, 80, 500.0)], "rate": 500.0, "control_rate": 500.0, "step": 1e-3}
    for arguments in ({"controller": cascade}, {"feedback": Feedback(counts=4000.0)}):
        fast, slow = both(monkeypatch, lambda: plant_of(puma), **common, **arguments)
        same(fast[0], slow[0], 1e-9)
    assert plant.compiled() is not None


def test_saturation_and_joint_side_law(puma, monkeypatch):
    gains = {"kp": 400.0, "kd": 40.0, "limit": (60.0, 60.0, 30.0, 3.0, 3.0, 3.0), "side": Side.JOINT}
    arguments = {"desired": [wave(6, 80, 500.0)], "controller": PDFeedforward(**gains), "rate": 500.0, "control_rate": 500.0, "step": 1e-3}
    fast, slow = both(monkeypatch, lambda: plant_of(puma), **arguments)
    same(fast[0], slow[0], 1e-9)


def test_values_that_change(puma, monkeypatch):
    """A schedule: a payload's worth of offset is dropped half way."""

    def make() -> Plant:
        plant = plant_of(puma)
        other = np.array(plant.values)
        other[-18:-12] += 0.1
        return Plant(plant.model, Schedule(np.array([0.1]), np.stack([plant.values, other])))

    fast, slow = both(monkeypatch, make, desired=[wave(6, 100, 500.0)], rate=500.0, control_rate=500.0, step=1e-3)
    same(fast[0], slow[0])


@pytest.mark.parametrize("seed", range(3))
def test_other_robots(seed, monkeypatch):
    """Chains of a few joints, prismatic ones too, with a full coupling matrix."""
    from effect_robots import ROBOTS

    names = [name for name in ROBOTS if ROBOTS[name]().loop.is_trivial and ROBOTS[name]().n <= 6]
    robot = ROBOTS[names[seed % len(names)]]()
    desired = [wave(robot.n, 80, 500.0, seed, 0.2)]
    fast, slow = both(monkeypatch, lambda: plant_of(robot, dry=0.2), desired=desired, rate=500.0, control_rate=500.0, step=1e-3)
    same(fast[0], slow[0], 1e-9)


def test_threads_give_the_same_runs(puma, monkeypatch):
    """Every run is computed by itself: any number of threads gives the same numbers, bit for bit."""
    plant, desired = plant_of(puma), [wave(6, 60, 500.0, seed) for seed in range(20)]
    found = []
    for threads in ("1", "2", "3"):
        monkeypatch.setenv("IDENT_NUM_THREADS", threads)
        found.append(simulate_batch(plant, desired=desired, rate=500.0, control_rate=500.0))
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            np.testing.assert_array_equal(a.link.q, b.link.q)
            np.testing.assert_array_equal(a.link.ddq, b.link.ddq)


def test_what_is_not_known_goes_the_general_way(puma):
    """A force of the user's own, an effect without declared columns, a subclass that only inherits the declaration."""

    @dataclass(frozen=True)
    class Drag(ForceModel):
        side: Side = Side.JOINT

        def torque(self, motion: Motion, state: np.ndarray, robot: Robot) -> np.ndarray:
            return motion.joint.dq * np.abs(motion.joint.dq)

    @dataclass(frozen=True, kw_only=True)
    class Cubic(fr.Viscous):
        name: ClassVar[str] = "cubic_for_this_test"
        axis: ClassVar[Axis] = Axis.VELOCITY

        def basis(self, own, motion, at):
            yield own.dq**3

    drag = plant_of(puma, extra=(Drag(),))
    assert drag.compiled() is None
    stribeck = Plant(
        puma.rigid_body() + fr.Stribeck(), np.concatenate([puma.nominal, np.ones(len((puma.rigid_body() + fr.Stribeck()).parameters) - 60)])
    )
    assert stribeck.compiled() is None
    assert Plant(puma.rigid_body() + Cubic(), np.concatenate([puma.nominal, np.ones(6)])).compiled() is None
    # Friction that feeds power in holds nothing: not for compiled code either.
    model = puma.rigid_body() + fr.RotorInertia() + fr.Coulomb()
    assert Plant(model, np.concatenate([puma.nominal, np.full(6, 1e-4), -np.ones(6)])).compiled() is None


def test_declared_columns_are_what_the_basis_gives(puma):
    """Every effect that says what its columns are says the truth."""
    rng = np.random.default_rng(0)
    motion = Motion.of(puma, *rng.normal(size=(3, 50, 6)))
    seen = 0
    for name, kind in effect_types().items():
        if not getattr(kind, "factors", ()):
            continue
        seen += 1
        effect = kind()
        own = motion.on(effect.side)
        wanted = {"one": np.ones_like(own.q), "position": own.q, "speed": own.dq, "direction": np.sign(own.dq), "acceleration": own.ddq}
        found = list(effect.basis(own, motion, list(range(6))))
        assert len(found) == len(effect.factors) == len(effect.symbols), name
        for factor, column in zip(effect.factors, found, strict=True):
            np.testing.assert_array_equal(column, wanted[factor], err_msg=name)
    assert seen >= 5


def test_motion_that_diverges_is_refused(puma):
    plant = plant_of(puma)
    unstable = PDFeedforward(kp=1e9, kd=0.0)
    with pytest.raises(DataError, match="grows without bound at t = "):
        simulate(plant, desired=wave(6, 400, 500.0), controller=unstable, rate=500.0, control_rate=500.0)


def test_singular_inertia_is_named():
    robot = ident.load_robot("puma560")
    plant = Plant(robot.rigid_body() + fr.Viscous(), np.concatenate([np.zeros(60), np.ones(6)]))
    assert plant.compiled() is not None
    with pytest.raises(DataError, match="inertia matrix is singular"):
        simulate(plant, torque=np.ones((5, 6)), start=(np.zeros(6), np.zeros(6)))


def test_other_threads_run_meanwhile(puma):
    """The GIL is released: a counter in another thread goes on during a long simulation."""
    plant = plant_of(puma)
    torque = np.zeros((4000, 6))
    ticks, done = 0, threading.Event()

    def count() -> None:
        nonlocal ticks
        while not done.wait(0.0005):
            ticks += 1

    interval = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # nobody is made to let go
    worker = threading.Thread(target=count)
    try:
        worker.start()
        from ident.simulation.script import Script

        compiled = plant.compiled()
        assert compiled is not None
        state = plant.dynamics().start(np.zeros(1), np.zeros((1, 6)), np.zeros((1, 6)))
        before = ticks
        compiled.run(Script(Side.MOTOR, torque[:, None]), state, None, period=1e-3, substeps=20)
        assert ticks > before + 5
    finally:
        done.set()
        worker.join()
        sys.setswitchinterval(interval)


def test_single_state_agrees_with_the_batch(puma):
    """One state through lanes of columns, many through lanes of samples."""
    rng = np.random.default_rng(1)
    q, dq, tau = rng.normal(size=(3, 40, 6))
    fixed = rigid.dynamics(puma.tree, puma.nominal, np.eye(6))
    together = fixed.forward(q, dq, tau)
    for i in range(40):
        np.testing.assert_allclose(fixed.forward(q[i], dq[i], tau[i]), together[i], rtol=1e-11, atol=1e-11)
