"""What counts as noise in excess of what a residual shows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .motion_spectrum import position_noise, taken_out

if TYPE_CHECKING:
    from ...problem.problem import Problem

Array = np.ndarray
#: No reading of torque tells anything below this share of it (rms): drives are not linear to 80 dB.
_READABLE = 1e-4


def doubtful_rows(problem: Problem) -> Array:
    """Rows (M, n) of what counts as noise in excess of what the residual shows.

    Torque that errors of the positions would make: as often as the same noise comes again; and of what was taken out of the motion as
    noise, which may have been motion. And the share of the torque below which no reading tells anything."""
    signals = problem.signals
    rng = np.random.default_rng(0)
    noise, again = position_noise(signals), np.array([j.repeats for j in signals.report.joints])
    power = np.sum(np.where(signals.valid, signals.tau, 0.0) ** 2, axis=0) / np.maximum(signals.valid.sum(axis=0), 1)
    out = _READABLE * np.sqrt(power) * rng.normal(size=signals.tau.shape)
    if not noise.any():
        return np.asarray(out)
    values = np.zeros(len(problem.model.names)) if problem.reference is None else problem.reference
    for block in signals.blocks(None):
        motion = problem.motion(block.samples)
        f = np.fft.rfftfreq(len(motion), 1.0 / signals.rate)[:, None]
        size = noise * np.sqrt(again + taken_out(motion.joint.ddq, signals.rate, noise))
        wave = size * np.fft.rfft(rng.normal(size=motion.joint.ddq.shape), axis=0) * (2.0 * np.pi * f) ** 2
        ddq = np.fft.irfft(np.where(f <= (signals.report.cutoff_hz or np.inf), wave, 0.0), len(motion), axis=0)
        shaken = replace(motion, joint=replace(motion.joint, ddq=motion.joint.ddq + ddq))
        motor = replace(motion.motor, ddq=signals.robot.transmission.motor_rate(shaken.joint.ddq))
        shaken = replace(shaken, motor=motor)
        out[block.rows] += block.reduce(problem.model.torque(shaken, values) - problem.model.torque(motion, values))
    return np.asarray(out)
