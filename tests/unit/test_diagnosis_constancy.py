"""Friction is never quite constant along the travel, half a per cent of it in all is nothing to find; and a shape is
sought by all that the residual says, its slow part too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ident
from ident.diagnosis import Verdict
from tests.pendulum_logs import COULOMB, diagnosed, motion, needed, of

Array = np.ndarray
#: N m of white noise, a thousandth of the torque's size.
QUIET = 0.02


def varying(seed: int, share: float, waves: int = 0, noise: float = QUIET) -> ident.LogSet:
    """A quiet log of friction that varies along the travel by a share of itself, in so many waves a radian, or of half a turn and of a
    quarter."""
    t, q, v, acceleration = motion(seed)
    rng = np.random.default_rng([seed, 3])
    wave = np.sin(waves * q + 0.4) if waves else np.sin(2.0 * q + 0.4) + 0.5 * np.sin(4.0 * q)
    more = share * COULOMB * np.sign(v) * wave
    return of(seed, t, q + 2e-6 * rng.normal(size=t.size), needed(q, v, acceleration) + more + noise * rng.normal(size=t.size))


@pytest.mark.parametrize(("share", "verdict"), [(0.0, Verdict.CLEAN), (0.006, Verdict.CLEAN), (0.2, Verdict.EXPLAINED)])
def test_friction_may_vary_a_little_along_the_travel(share: float, verdict: Verdict) -> None:
    found = diagnosed(varying(5, share), varying(6, share))
    named = {f.effect.name for f in found.findings}
    assert (found.verdict == Verdict.CLEAN) == (verdict == Verdict.CLEAN)
    assert named == (set() if verdict == Verdict.CLEAN else {"position_dependent_friction"})


@pytest.mark.parametrize("waves", [20, 30])
def test_friction_may_vary_in_short_waves(waves: int) -> None:
    """As teeth and rollers make it: up to a 32nd of the travel, here of two thirds of a turn."""
    found = diagnosed(*(varying(seed, 0.006, waves, QUIET / 2) for seed in (5, 6)))
    assert found.verdict == Verdict.CLEAN


def test_what_is_constant_to_a_share_scores_less_and_never_more() -> None:
    """In units of noise alone friction that varies along the travel stands out."""
    scores = diagnosed(varying(5, 0.006), varying(6, 0.006)).decision.scores
    alone = scores.of_noise_alone
    assert np.all(scores.plain <= alone.plain + 1e-9)
    kinds = [scores.group(k) for k in range(len(scores.kept))]
    friction = np.array([g.name == "position and direction of motion" for g in kinds])
    assert alone.plain[friction].max() > 1.3 * scores.plain[friction].max()


def test_a_residual_with_a_slow_drift_is_less_likely() -> None:
    """Slower than any spectrum of eight seconds resolves."""
    fit = diagnosed(varying(5, 0.0), varying(6, 0.0)).decision.fit
    frame = fit.solved(1)
    slow = np.cos(np.linspace(0.0, 2.0 * np.pi, frame.rows))[:, None] * frame.residual.std(axis=0)
    assert fit.likelihood(replace(frame, residual=frame.residual + slow)) < fit.likelihood(frame) - 0.1 * frame.rows


def warming(seed: int, T: float) -> ident.LogSet:
    """A log of dry friction that fades with a time constant, and fluctuates by a hundredth with 60 ms."""
    t, q, v, acceleration = motion(seed)
    rng = np.random.default_rng([seed, 4])
    keep = np.exp(-np.median(np.diff(t)) / 0.06)
    restless = np.zeros(t.size)
    for k, x in enumerate(rng.normal(size=t.size)):
        restless[k] = keep * restless[k - 1] + np.sqrt(1.0 - keep**2) * x if k else x
    more = COULOMB * np.sign(v) * (0.6 * np.exp(-t / T) + 0.01 * restless)
    return of(seed, t, q + 2e-6 * rng.normal(size=t.size), needed(q, v, acceleration) + more + QUIET * rng.normal(size=t.size))


@pytest.mark.parametrize("T", [12.0, 20.0])
def test_a_time_constant_is_found_beside_friction_that_fluctuates(T: float) -> None:
    found = diagnosed(warming(7, T), warming(8, T))
    assert [f.effect.name for f in found.findings] == ["temperature_drift_coulomb"]
    shape = next(p for p in found.findings[0].parameters if p.name == "T")
    assert abs(shape.value - T) < 3.0 * shape.std
    assert shape.std < 0.1 * T
