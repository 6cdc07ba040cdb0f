"""What no score sees: positions that jump, joints of which no row can be used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from effect_robots import ROBOTS, declared
from recorded import RATE, recorded

from ident.auditing.columns import position_jumps
from ident.diagnosis.quality import jumps, lost
from ident.logs.log import LogSet
from ident.signals import ZeroPhase


def test_jumps_are_told_from_motion() -> None:
    t = np.arange(4000) / RATE
    rng = np.random.default_rng(1)
    x = np.sin(1.3 * t) + 0.3 * np.sin(7.0 * t) + 1e-5 * rng.normal(size=len(t))
    assert len(position_jumps(t, x)) == 0
    slipped = x + 0.2 * (t >= 11.0)
    assert abs(t[position_jumps(t, slipped)[0]] - 11.0) <= 1.5 / RATE
    glitch = x.copy()
    glitch[1234] += 0.05
    assert 1234 in position_jumps(t, glitch)
    # A hole in the log is no jump.
    keep = (t < 5.0) | (t > 6.0)
    assert len(position_jumps(t[keep], x[keep])) == 0


def test_a_position_that_jumps_is_said_where_rows_rest_on_it() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 3)
    slipped = log.q.copy()
    slipped[2500:, 1] += 0.3
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((replace(log, q=slipped),), robot=robot))
    (found,) = jumps(prepared)
    assert found.joint == "j2"
    assert "12.5 s" in found.evidence or "12.495 s" in found.evidence
    early = log.q.copy()
    early[:2, 1] += 0.3
    assert jumps(ZeroPhase(cutoff_hz=15.0)(LogSet((replace(log, q=early),), robot=robot))) == ()


def test_a_joint_that_moves_without_a_usable_row_is_said_and_one_that_stands_is_not() -> None:
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    log = recorded(robot, model, values, 8)
    prepared = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    assert lost(prepared) == ()
    valid = prepared.valid.copy()
    valid[:, 1] = False
    assert [u.joint for u in lost(replace(prepared, valid=valid))] == ["j2"]
    still = replace(prepared, valid=valid, q=np.where(np.arange(robot.n) == 1, 0.3, prepared.q))
    assert lost(still) == ()
