"""A search of the diagnosis as it is with effects accepted, on logs of the benchmark's world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import ident
from benchmarks.diagnosis.feedback.world import Case
from ident.diagnosis.design.catalogue import Catalogue
from ident.diagnosis.inference.search import EffectSearch
from ident.instruments.prepared import prepared

Array = np.ndarray


def with_torque(case: Case, joint: int, extra: Array) -> Case:
    """The case with torque added to one reading of the log that is fitted."""
    ((side, tau),) = case.log.tau.items()
    added = np.array(tau)
    added[:, joint] += extra
    return replace(case, log=ident.Log(case.log.name, t=case.log.t, q=case.log.q, tau={side: added}))


def searched(case: Case, *effects: ident.Effect) -> EffectSearch:
    """The search's state with effects accepted."""
    signals = ident.fit(case.log, case.robot, model=case.model, held=0).problem.signals  # type: ignore[union-attr]
    fit, _, speeds = prepared(case.model, signals)
    fit.solved(1)
    state = EffectSearch(fit, Catalogue.of(fit, speeds), accepted=[(e, e.joints or ()) for e in effects])
    state.solve()
    state.calibrate()
    return state
