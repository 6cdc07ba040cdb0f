"""Columns of effects on the motors: the short way for one joint's effect is the long way's, and spectra hold what rows do."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from benchmarks.diagnosis.feedback.world import Case, puma, simulated
from ident.diagnosis.design.places import placements
from ident.effects.kinds import Need
from ident.effects.registry import effect_types
from ident.errors import IdentError
from ident.instruments.columns import effect_columns, motor_columns
from ident.instruments.fit import Fit
from ident.instruments.prepared import prepared
from ident.instruments.spectra import Spectra

Array = np.ndarray
KINDS = [kind for name, kind in effect_types().items() if kind.cause and name != "rigid_body" and Need.HISTORY not in kind.needs]


@pytest.fixture(scope="module")
def fit() -> Fit:
    robot, drive = puma()  # a coupled wrist, and motors that turn the other way
    case: Case = simulated(robot, drive, [], [106], seconds=12.0, rate=250.0)[0]
    found = prepared(case.model, ident.ZeroPhase()(case.log, case.robot))[0]
    found.solved(1)
    return found


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_columns_on_motors_are_the_same_either_way(fit: Fit, kind: type[ident.Effect]) -> None:
    (motion,) = fit.motions(instrument=True)
    compared = 0
    for effect in placements(kind, fit.robot):
        try:
            long = effect_columns(effect, motion, fit.robot)
        except IdentError:
            continue
        short = motor_columns(effect, motion, fit.robot)
        for m in range(fit.robot.n):
            np.testing.assert_allclose(short.get(m, np.zeros_like(long[:, m])), long[:, m], rtol=1e-9, atol=1e-12)
        compared += 1
    if not compared:
        pytest.skip(f"{kind.name} has no place on this robot")


def test_spectra_behind_filters_are_the_rows_through_them(fit: Fit) -> None:
    (run,) = fit.runs
    (motion,) = fit.motions(instrument=True)
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(len(motion), fit.robot.n, 3))
    columns[:, 1, 2] = 0.0
    spectra, gains = Spectra.of(columns, run), rng.uniform(0.5, 2.0, (fit.robot.n, len(run.band.frequencies)))
    found = spectra.behind(gains)
    for m in range(fit.robot.n):
        rows = run.band.rows(columns[:, m], run.use[:, m])
        plain = np.fft.irfft(np.fft.rfft(rows, axis=0) * gains[m][:, None], run.band.count, axis=0)[run.band.inner]
        np.testing.assert_allclose(found[:, m], plain, atol=1e-12)
    theta = rng.normal(size=3)
    summed = run.band.of_spectra(spectra.summed(theta))
    np.testing.assert_allclose(summed[1], run.band.rows(columns[:, 1] @ theta[:, None], run.use[:, 1])[:, 0], atol=1e-12)
