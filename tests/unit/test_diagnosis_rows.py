"""Rows of a diagnosis: nothing that is faster than they are comes down among them, and friction is looked at where a direction is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

import ident
from benchmarks.diagnosis.feedback.world import Case, geared, simulated
from ident.diagnosis.inference.described import describing
from ident.effects.motion import Motion
from ident.instruments.fit import Fit
from ident.instruments.prepared import prepared
from ident.instruments.rows import speed_noise

Array = np.ndarray
RATE = 500.0


@pytest.fixture(scope="module")
def case() -> Case:
    """An arm under feedback that lacks nothing, logged faster than the rows of a diagnosis are."""
    robot, drive = geared("scara", 50.0)
    (only,) = simulated(robot, drive, [], [104], seconds=20.0, rate=RATE)
    return only


def test_what_a_controller_asks_above_the_band_of_the_rows_is_not_among_them(case: Case) -> None:
    # Half the rate but 0.4 Hz: every other sample of it is a tone of 0.4 Hz.
    fast = np.sin(2.0 * np.pi * (RATE / 2.0 - 0.4) * case.log.t)
    ((side, torque),) = case.log.tau.items()
    loud = replace(case.log, tau={side: torque + np.std(torque, axis=0) * fast[:, None]})
    fits = [prepared(case.model, ident.ZeroPhase()(log, case.robot))[0] for log in (case.log, loud)]
    for quiet, other in zip(*(fit.torque for fit in fits), strict=True):
        assert np.abs(other - quiet).max() < 2e-3 * np.std(quiet, axis=0).max()


def test_speeds_have_the_noise_that_white_noise_of_positions_makes() -> None:
    rng, rate, cutoff = np.random.default_rng(5), 1000.0, 40.0
    q = 1e-4 * rng.normal(size=400_000)
    smooth = sosfiltfilt(butter(8, cutoff / (0.5 * rate), output="sos"), q)
    found = float(np.std(np.gradient(smooth, 1.0 / rate)))
    assert speed_noise(np.array([2.0 * 1e-8 / rate]), cutoff)[0] == pytest.approx(found, rel=0.1)


def test_no_row_counts_in_which_noise_may_turn_the_direction(case: Case) -> None:
    size = 2.0 * np.pi / 500.0  # a coarse encoder, on the joint
    log = replace(case.log, q=np.round(case.log.q / size) * size)
    signals = ident.ZeroPhase()(log, case.robot)
    fit, _, _ = prepared(case.model, signals)
    (run,) = fit.runs
    noise = size / np.sqrt(12.0) * np.abs(np.diag(case.robot.transmission.K_inverse))
    least = speed_noise(2.0 * noise**2 / RATE, run.measured.cutoff_hz or 40.0)
    for m in range(case.robot.n):
        used = np.abs(run.measured.motor.dq[run.use[:, m] > 0, m])
        assert len(used) == 0 or used.min() > least[m]


def test_a_joint_at_rest_but_for_rounding_is_followed_by_nothing(case: Case) -> None:
    """A position that changes in its last digits alone leaves no room for knots."""
    fit, _, _ = prepared(case.model, ident.ZeroPhase()(case.log, case.robot))
    runs = []
    for run in fit.runs:
        motion = run.instrument
        q, dq, ddq = (x.copy() for x in (motion.joint.q, motion.joint.dq, motion.joint.ddq))
        q[:, 2], dq[:, 2], ddq[:, 2] = 1.67 + np.spacing(1.67) * np.round(np.sin(motion.t)), 0.0, 0.0
        runs.append(replace(run, instrument=Motion.of(case.robot, q, dq, ddq, motion.t, rate=motion.rate, cutoff_hz=motion.cutoff_hz)))
    fit = Fit(runs, fit.declared, (), fit.values)
    laws = describing(fit, fit.solved(1), (case.robot.joint_names[0],), lambda _: None)
    assert all(law.by != case.robot.joint_names[2] for law in laws)
