"""The signals that the diagnosis' oracle looks at: noise in the motion taken out, motion left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS

from ident.logs.log import Log, LogSet
from ident.signals import Signals, ZeroPhase

wide_band = pytest.importorskip("benchmarks.diagnosis.wide_band")
RATE = 200.0


def signals(seed: int, seconds: float = 20.0) -> Signals:
    rng = np.random.default_rng(seed)
    robot = ROBOTS["scara"]()
    t = np.arange(round(seconds * RATE)) / RATE
    q = 0.2 * np.sin(np.multiply.outer(t, rng.uniform(1.0, 4.0, robot.n)))
    return ZeroPhase(cutoff_hz=15.0)(LogSet((Log("run", t, q=q, tau={robot.transmission.measured.value: q}),), robot=robot))


@pytest.mark.parametrize("seed", [5, 6])
def test_motion_less_its_noise_does_not_shrink_parameters(seed: int) -> None:
    """Least squares on noisy accelerations shrinks; where each frequency is weighed by its share of motion, it does not."""
    rng = np.random.default_rng(seed)
    prepared = signals(seed)
    t = prepared.t
    # A broad motion whose upper part drowns in noise.
    tones = rng.uniform(0.3, 12.0, 60)
    exact = np.sum(np.sin(2 * np.pi * np.multiply.outer(t, tones) + rng.uniform(0, 6, 60)) / tones, axis=1)
    a = np.gradient(np.gradient(exact, t), t)
    sigma = 0.2 * np.std(exact)
    noisy = exact + sigma * rng.normal(size=len(t))
    b = np.gradient(np.gradient(noisy, t), t)
    # Differences flatten the noise of the highest frequencies; the share is that of a low-pass there.
    band = np.fft.rfftfreq(len(t), 1 / RATE) < 15.0
    b = np.fft.irfft(np.fft.rfft(b) * band, len(t))
    a = np.fft.irfft(np.fft.rfft(a) * band, len(t))
    n = prepared.robot.n
    joints = tuple(replace(j, noise=float(sigma)) for j in prepared.report.joints)
    q, ddq = np.tile(noisy[:, None], n), np.tile(b[:, None], n)
    whole = replace(prepared, q=q, dq=q, ddq=ddq, report=replace(prepared.report, joints=joints))
    better = wide_band.less_noise(whole).ddq[:, 0]
    inside = slice(200, -200)
    raw = float(b[inside] @ a[inside] / (b[inside] @ b[inside]))
    mended = float(better[inside] @ a[inside] / (better[inside] @ better[inside]))
    assert raw < 0.93
    assert abs(mended - 1.0) < 0.25 * (1.0 - raw)
    assert np.std((better - a)[inside]) < np.std((b - a)[inside])


def test_exact_motion_is_left_alone() -> None:
    prepared = signals(7)
    joints = tuple(replace(j, noise=0.0) for j in prepared.report.joints)
    same = wide_band.less_noise(replace(prepared, report=replace(prepared.report, joints=joints)))
    np.testing.assert_allclose(same.ddq, prepared.ddq, atol=1e-9 * np.abs(prepared.ddq).max())
    assert not wide_band.noise_share(prepared.ddq, prepared.rate, np.zeros(prepared.robot.n)).any()
