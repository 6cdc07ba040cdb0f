"""Jumps of positions: small ones in fast motion are found, and nothing is that moves, however hard."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.auditing.columns import position_jumps
from ident.auditing.torque import wild_samples
from ident.commands.simulate import random_motion
from ident.robots import nominal_values
from ident.robots.transmission import Side
from ident.simulation.plant import Plant
from ident.simulation.sensors import Quantisation, Sensors, TorqueNoise
from ident.simulation.simulate import simulate

Array = np.ndarray
RATES = (50.0, 100.0, 200.0, 500.0, 1000.0)


def waves(rate: float, seed: int, noise: float = 0.0, seconds: float = 20.0) -> tuple[Array, Array]:
    """Times and positions (N,) of a motion of many frequencies, speeds of a few rad/s."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    w = 2 * np.pi * rng.uniform(0.1, 1.0, 6)
    x = np.sum([a * np.sin(w_k * t + p) for a, w_k, p in zip(1.5 / w, w, rng.uniform(0, 6, 6), strict=True)], axis=0)
    return t, x + noise * rng.standard_normal(len(t))


def fast(x: Array, rng: np.random.Generator) -> int:
    """A sample where the joint is fast, away from the ends."""
    speed = np.abs(np.gradient(x))
    speed[:100] = speed[-100:] = 0.0
    return int(rng.choice(np.flatnonzero(speed > 0.6 * speed.max())))


def changed(x: Array, at: int, size: float, kind: str) -> Array:
    """With a step that stays, or one wrong sample, at a place."""
    out = x.copy()
    if kind == "step":
        out[at:] += size
    else:
        out[at] += size
    return out


@pytest.mark.parametrize("kind", ["step", "sample"])
@pytest.mark.parametrize("rate", RATES)
def test_small_jumps_in_fast_motion_are_found(rate: float, kind: str) -> None:
    """A hundredth of what the joint moves in a second or less: far below its largest acceleration at these rates."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        t, x = waves(rate, seed, noise=1e-5)
        at = fast(x, rng)
        size = 3e-2 * 50 / rate + 1e-3
        found = position_jumps(t, changed(x, at, size * rng.choice([-1, 1]), kind))
        assert 1 <= len(found) <= 4
        assert abs(int(found[0]) - at) <= 1


def test_what_was_missed_before() -> None:
    """5 mrad at 3 rad/s, 200 times a second: a third of what the joint moves in a sample, and a twentieth of the old threshold."""
    t, x = waves(200.0, 3)
    at = fast(x, np.random.default_rng(0))
    slipped = changed(x, at, 5e-3, "step")
    assert np.abs(np.diff(slipped, 2)).max() < 50 * np.percentile(np.abs(np.diff(slipped, 2)), 99)
    assert abs(int(position_jumps(t, slipped)[0]) - at) <= 1


def test_several_jumps_are_all_found() -> None:
    t, x = waves(500.0, 5, noise=2e-6)
    places = [1500, 4200, 7770]
    for at in places:
        x = changed(x, at, 4e-3, "step")
    found = position_jumps(t, x)
    assert {min(places, key=lambda p: abs(p - k)) for k in found} == set(places)
    assert all(min(abs(p - k) for p in places) <= 1 for k in found)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-4])
def test_smooth_motion_does_not_jump(rate: float, noise: float) -> None:
    for seed in range(10):
        t, x = waves(rate, seed, noise)
        for step in (0.0, 1e-5, 1e-3):
            q = np.round(x / step) * step if step else x
            assert len(position_jumps(t, q)) == 0, (seed, step)
            assert len(position_jumps(t, np.repeat(q[::5], 5)[: len(t)])) == 0, "a log faster than its source"


@pytest.mark.parametrize("rate", RATES)
def test_moves_between_rests_do_not_jump(rate: float) -> None:
    """Accelerations that reverse from one sample to the next, and moves within few samples."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        fine = np.zeros(30_000)
        i, place = 0, 0.0
        while i < len(fine):
            rest, n, d = int(rng.integers(100, 1500)), int(rng.integers(150, 1500)), rng.uniform(-1, 1)
            fine[i : i + rest] = place
            s = np.arange(n) / n
            way = np.where(s < 0.5, 2 * s**2, 1 - 2 * (1 - s) ** 2) if seed % 2 else 10 * s**3 - 15 * s**4 + 6 * s**5
            part = fine[i + rest : i + rest + n]
            part[:] = place + d * way[: len(part)]
            i, place = i + rest + n, place + d
        x = fine[:: round(1000 / rate)]
        for noise in (0.0, 1e-6, 1e-4):
            assert len(position_jumps(np.arange(len(x)) / rate, x + noise * rng.standard_normal(len(x)))) == 0


def test_a_blow_bends_the_motion_and_does_not_move_the_joint() -> None:
    """Speed that changes within a sample, smaller than the threshold of a jump by itself."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        t, x = waves(500.0, seed, noise=1e-6)
        at = float(t[fast(x, rng)]) + rng.uniform(0, 1) / 500
        blow = 0.05 * rng.choice([-1, 1]) * np.maximum(t - at, 0.0)
        assert len(position_jumps(t, x + blow)) == 0


@pytest.mark.parametrize("rate", [100.0, 200.0, 1000.0])
def test_time_stamps_make_no_jumps(rate: float) -> None:
    """Rows cut out, instants that scatter, and stamps that are wrong."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        t, x = waves(rate, seed, noise=1e-6)
        keep = rng.random(len(t)) > 0.03
        assert len(position_jumps(t[keep], x[keep])) == 0
        instants = t + rng.uniform(-0.3, 0.3, len(t)) / rate
        assert len(position_jumps(instants, np.interp(instants, t, x))) == 0
        assert len(position_jumps(instants, x)) == 0
        late = t.copy()
        late[fast(x, rng)] += 0.4 / rate
        assert len(position_jumps(late, x)) == 0, "one stamp that was taken late"


def test_short_and_still_logs() -> None:
    t = np.arange(40) / 100
    for n in (1, 2, 3, 4, 10, 40):
        assert len(position_jumps(t[:n], np.sin(t[:n]))) == 0
        assert len(position_jumps(t[:n], np.zeros(n))) == 0


@pytest.mark.parametrize("name", ["puma560", "scara", "ur5", "double_pendulum"])
@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_simulated_robots_do_not_jump_and_their_jumps_are_found(name: str, rate: float) -> None:
    """Closed loop with dry friction, encoders and noise, as `ident simulate` makes it; and with the position of a joint off from a
    moment on by a thousandth of its range."""
    robot = ident.load_robot(name)
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    sensors = Sensors((Quantisation.counts(4000.0 * 16), TorqueNoise((0.1,) * robot.n, 0.0)), Side.MOTOR, columns=("q", "tau"))
    wave = random_motion(model, 4, 10.0)
    made = simulate(Plant(model, nominal_values(model)), desired=wave, rate=rate, control_rate=1000.0, sensors=sensors, seed=4)
    log = made.log()
    rng = np.random.default_rng(4)
    for x in log.position(robot.transmission).T:
        assert len(position_jumps(log.t, x)) == 0
        at, size = fast(x, rng), 3e-3 * np.ptp(x)
        if size > 20 * np.median(np.abs(np.diff(np.unique(x)))):
            assert np.abs(position_jumps(log.t, changed(x, at, size, "step")) - at).min(initial=len(x)) <= 1


@pytest.mark.parametrize("seed", range(10))
def test_wild_torques_are_found_and_rare_ones_left(seed: int) -> None:
    """Up to three samples on end far outside of all others; heavy tails, a blow of ten samples and a log mostly at rest have none."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(200, 20000))
    motion = rng.uniform(0.1, 100) * (np.sin(np.arange(n) * rng.uniform(0.001, 0.1)) + 0.3 * rng.standard_t(4, n))
    assert len(wild_samples(motion)) == 0
    wild = motion.copy()
    at = int(rng.integers(n))
    wild[at] = rng.choice([-1, 1]) * rng.uniform(10, 1e6) * np.ptp(motion)
    wild[rng.integers(n, size=n // 50)] = np.nan
    assert wild_samples(wild).tolist() == ([] if np.isnan(wild[at]) else [at])
    blow = motion.copy()
    blow[50:60] = 30 * np.ptp(motion)
    assert len(wild_samples(blow)) == 0
    rest = np.where(np.abs(np.arange(n) - n // 2) < 20, motion, 0.01 * rng.standard_normal(n))
    assert len(wild_samples(rest)) == 0
    assert len(wild_samples(np.zeros(n))) == len(wild_samples(np.full(n, np.nan))) == 0
