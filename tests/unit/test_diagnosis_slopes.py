"""Shapes of accepted effects end where the residual is uncorrelated with the instrument's slope over them."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from benchmarks.diagnosis.feedback.world import geared, simulated
from ident.diagnosis.inference.slopes import balanced

Array = np.ndarray


@pytest.fixture(scope="module")
def found() -> ident.Diagnosis:
    """Friction of a SCARA's joint that builds up over 1.5 rad of its motor, under feedback."""
    robot, drive = geared("scara", 50.0)
    lacking = ident.make_effect("presliding", joints=[robot.joint_names[1]], label="+", z_s=1.5)
    (case,) = simulated(robot, drive, [(lacking, np.array([drive["Fc"][1]]))], [920], seconds=24.0, rate=250.0)
    before = ident.fit(case.log, case.robot, model=case.model, held=0)
    return ident.diagnose(before, ident.ZeroPhase()(case.held, case.robot))


def test_a_residual_is_uncorrelated_with_the_slope_over_a_shape(found: ident.Diagnosis) -> None:
    """The product of both changes its sign within a hundredth of the shape (differences of columns, solved at one noise)."""
    fit, gains = found.decision.fit, found.decision.frame.gains
    (effect,) = fit.effects

    def product(z_s: float) -> float:
        frames = [fit.with_effects((effect.with_shape(z_s=x),)).behind(gains) for x in (0.995 * z_s, z_s, 1.005 * z_s)]
        slope = frames[2].Z[:, :, -1] - frames[0].Z[:, :, -1]
        return float(np.sum(slope * frames[1].residual))

    assert product(0.99 * effect.z_s) * product(1.01 * effect.z_s) < 0.0


@pytest.mark.parametrize("start", [0.9, 1.1])
def test_a_shape_beside_goes_to_the_same(found: ident.Diagnosis, start: float) -> None:
    fit, gains = found.decision.fit, found.decision.frame.gains
    (effect,) = fit.effects
    (moved,) = balanced((effect.with_shape(z_s=start * effect.z_s),), fit.with_effects(()), gains)
    assert moved.z_s == pytest.approx(effect.z_s, rel=0.02)
