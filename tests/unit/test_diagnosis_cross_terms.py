"""What ties one joint's torque to another's motion and is no coupling of gears."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from test_diagnosis_held_out import prepared
from test_diagnosis_parts import NOISE, rebuilt, recorded

from ident.diagnosis import Diagnosis, diagnose
from ident.diagnosis.acceptance import Found
from ident.diagnosis.candidates import Candidate
from ident.diagnosis.cross_terms import cross_terms
from ident.diagnosis.findings import _beyond
from ident.diagnosis.selection import Selection
from ident.diagnosis.whitening import plain_whitener
from ident.effects.base import make_effect
from ident.estimators import WeightedLeastSquares
from ident.logs.log import LogSet
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase

COUPLING = make_effect("gear_coupling", joints="j4", motors=("j1",))


def coupled(seed: int, size: float) -> Signals:
    """A log of a SCARA with a coupling that nobody declares."""
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model + COUPLING, np.append(values, size), seed)
    return ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))


def with_a_share_of_its_speed(signals: Signals, share: float) -> Signals:
    """The same where joint 4's torque takes up joint 1's speed."""
    problem = Problem(declared(signals.robot)[0], signals)
    speed = np.concatenate([block.reduce(problem.motion(block.samples).joint.dq) for block in signals.blocks(None)])
    return replace(signals, tau=signals.tau + share * speed[:, :1] * (np.arange(signals.robot.n) == 3))


def odds(signals: Signals) -> dict[tuple[str, str, str], float]:
    """Those against a coupling of joint 4 with the motor of joint 1."""
    model, _ = declared(signals.robot)
    white = plain_whitener(Problem(model, signals), NOISE * signals.tau)
    stage = rebuilt(model, signals, white, [])
    hit = stage.search.hit(Candidate("gear_coupling", ("j4",), (COUPLING,)), COUPLING)
    found = SimpleNamespace(effect=COUPLING, judged=SimpleNamespace(hit=hit))
    return cross_terms(cast(Found, found), cast(Selection, SimpleNamespace(declared=stage, final=stage, found=(found,))))


@pytest.mark.parametrize("seed", [51, 52, 53])
def test_another_joint_s_speed_is_likelier_than_a_coupling_where_it_is_there(seed: int) -> None:
    against = odds(with_a_share_of_its_speed(coupled(seed, 0.0), 0.3))
    likeliest = max(against, key=lambda key: against[key])
    assert likeliest == ("speed", "j4", "j1")
    assert against[likeliest] > 100.0
    (rival, *_) = _beyond(against, 1.0 / (1.0 + sum(against.values())))
    assert (rival.effect, rival.joints) == ("a share of j1's speed", ("j4",))
    assert rival.confidence > 0.9


@pytest.mark.parametrize("seed", [54, 55, 56])
def test_a_coupling_is_likelier_where_it_is_there(seed: int) -> None:
    signals = coupled(seed, 0.002)
    assert sum(odds(signals).values()) < 0.01
    found = diagnosed(signals)
    assert (found.verdict, [f.name for f in found.findings]) == ("explained", ["gear_coupling"])
    assert found.findings[0].confidence > 0.9


def test_what_takes_up_another_joint_s_speed_is_not_said_to_be_a_coupling() -> None:
    found = diagnosed(with_a_share_of_its_speed(coupled(57, 0.0), 0.3))
    assert found.verdict in ("ambiguous", "unexplained")
    assert any(f.name == "gear_coupling" for f in found.findings)
    assert all(f.confidence < 0.5 for f in found.findings)


def test_only_couplings_are_asked() -> None:
    found = diagnosed(prepared(55, [make_effect("asymmetric_viscous", joints="j1")], [3.0]))
    (one,) = found.selection.found
    assert cross_terms(one, found.selection) == {}


def diagnosed(signals: Signals) -> Diagnosis:
    return diagnose(WeightedLeastSquares().solve(Problem(declared(signals.robot)[0], signals)))
