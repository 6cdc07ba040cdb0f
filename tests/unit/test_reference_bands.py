"""The bands in which the reference drives the motors: what a disturbance moves at every frequency is no motion to decide by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt, welch

import ident
from ident.instruments.prepared import prepared

Array = np.ndarray
MASSES = (8.0, 2.0)
RATE, SECONDS = 250.0, 60.0
GANTRY = f"""<robot name="gantry"><link name="base"/>
<link name="beam"><inertial><mass value="{MASSES[0] - MASSES[1]}"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="cart"><inertial><mass value="{MASSES[1]}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="beam"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" velocity="9" effort="900"/></joint>
<joint name="y" type="prismatic"><parent link="beam"/><child link="cart"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" velocity="9" effort="900"/></joint></robot>"""


def below(x: Array, hz: float) -> Array:
    return sosfiltfilt(butter(4, hz / (0.5 * RATE), output="sos"), x, axis=0)


def recorded(shares: tuple[float, float], top_hz: float = 5.0, seed: int = 3) -> tuple[ident.Robot, ident.Log]:
    """A log of two axes that do not act on each other. The reference drives both up to `top_hz`; the torque's reading lacks a force that
    drives `shares` of the acceleration's power at every frequency there."""
    robot = ident.Robot.from_urdf(GANTRY)
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    wanted, pushed = (below(rng.standard_normal((len(t), 2)), top_hz) for _ in range(2))
    frequencies = np.fft.rfftfreq(len(t), 1.0 / RATE)[:, None]
    twice = np.where(frequencies > 0.3, -1.0 / np.maximum(2 * np.pi * frequencies, 1e-9) ** 2, 0.0)
    acceleration = np.sqrt(1.0 - np.array(shares)) * wanted + np.sqrt(shares) * pushed
    q = np.fft.irfft(twice * np.fft.rfft(acceleration, axis=0), len(t), axis=0)
    moved = np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    force = np.array(MASSES) * (moved - np.sqrt(shares) * below(pushed, top_hz))
    q = q + 1e-8 * rng.standard_normal(q.shape)
    return robot, ident.Log("run", t=t, q=q, tau={ident.Side.JOINT: force + 1e-4 * rng.standard_normal(force.shape)})


def instrument(shares: tuple[float, float]) -> dict[str, object]:
    robot, log = recorded(shares)
    return ident.fit(log, robot, method="iv_band").trace


def test_a_motor_that_disturbances_move_at_every_frequency_keeps_to_the_bulk_of_its_motion() -> None:
    quiet, moved = instrument((1e-4, 1e-4)), instrument((1e-4, 0.2))
    assert quiet["narrower_hz"] == {}
    assert moved["band_hz"] == pytest.approx(quiet["band_hz"], rel=0.1), "the other motor's band is its own"
    assert set(moved["narrower_hz"]) == {"y"}
    assert moved["narrower_hz"]["y"] < 0.5 * moved["band_hz"]


def test_the_instrument_holds_of_each_motor_what_lies_below_its_own_frequency() -> None:
    robot, log = recorded((1e-4, 0.2))
    fit, told, _ = prepared(robot.rigid_body(), ident.ZeroPhase()(log, robot))
    (run,) = fit.runs
    rate = len(run.measured.t) / (run.measured.t[-1] - run.measured.t[0])
    f, measured = welch(run.measured.motor.dq, rate, nperseg=1024, axis=0)
    kept = welch(run.instrument.motor.dq, rate, nperseg=1024, axis=0)[1] / measured
    between = (f > 1.5 * told.narrower["y"]) & (f < 0.6 * told.band_hz)
    assert between.any()
    assert np.all(kept[between, 1] < 0.01)
    assert np.all(kept[between, 0] > 0.9)


def test_where_every_motor_is_moved_so_one_band_counts() -> None:
    trace = instrument((0.2, 0.2))
    assert trace["band_hz"] < 0.5 * instrument((1e-4, 1e-4))["band_hz"]
