"""A robot with two arms: the load is found on the arm that carries it, and asked about where the logs do not say which that is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from effect_robots import two_arms

import ident
from ident.effects.registry import make_effect
from ident.friction import Coulomb, Viscous
from ident.physical.pseudo_inertia import from_centre_of_mass
from ident.simulation.trajectory import FourierTrajectory

MASS = 1.5
LOAD = from_centre_of_mass(MASS, np.array([0.03, -0.02, 0.1]), np.diag([0.004, 0.005, 0.003]))
ROBOT = two_arms()
MODEL = ROBOT.rigid_body() + Viscous() + Coulomb()


@cache
def fitted(seed: int, on: str = "", moving: int = 7) -> ident.Estimate:
    """A fit of the first `moving` joints' motion, with the load on a link."""
    return ident.fit(logged(seed, on, moving), ROBOT, model=MODEL, held=0)


def logged(seed: int, on: str = "", moving: int = 7) -> ident.Log:
    rng, t = np.random.default_rng(seed), np.arange(3000) / 150.0
    sine, cosine = rng.normal(size=(2, 5, ROBOT.n)) / np.arange(1, 6)[None, :, None] * (np.arange(ROBOT.n) < moving)
    c = FourierTrajectory(np.full(ROBOT.n, 0.2), 0.5 * sine, 0.5 * cosine, 0.05).sample(t)
    assert ROBOT.nominal is not None
    links = ROBOT.nominal.copy()
    if on:
        body = ROBOT.joint_names.index(f"j_{on}")
        links[10 * body : 10 * body + 10] += LOAD
    values = np.r_[links, np.full(ROBOT.n, 1.0), np.full(ROBOT.n, 0.8)]
    tau = MODEL.inverse_dynamics(c.q, c.dq, c.ddq, values) + 0.05 * rng.normal(size=c.q.shape)
    return ident.Log(f"log{seed}", t, q=c.q, tau={"joint": tau})


@pytest.mark.parametrize("on", ["left3", "right3"])
def test_a_load_on_either_arm(on: str) -> None:
    """On the arm that comes first in the tree it was 0.02 kg on the other."""
    found = ident.payload(fitted(1), fitted(2, on))
    assert found.link == on
    assert abs(found.mass - MASS) < 4.0 * found.mass_std < 0.02
    assert found.notes == ()


def test_no_load_on_any_arm() -> None:
    found = ident.payload(fitted(1), fitted(3))
    assert not found.significant
    assert any("left3" in note or "right3" in note for note in found.notes)


def test_a_load_on_no_end_names_the_ends_and_the_way_out() -> None:
    found = ident.payload(fitted(1), fitted(4, "left1"))
    assert all(any(word in note for note in found.notes) for word in ("left3", "right3", "--link"))
    assert ident.payload(fitted(1), fitted(4, "left1"), link="left1").notes == ()


def test_logs_that_do_not_say_which_arm() -> None:
    """Only the waist moves: its inertia grows by a load on either hand."""
    logs = fitted(5, "", 1), fitted(6, "left3", 1)
    with pytest.raises(ident.DataError, match="do not determine") as refused:
        ident.payload(*logs)
    assert all(word in str(refused.value) for word in ("left3", "right3", "--link"))
    assert ident.payload(*logs, link="left3").link == "left3"


def test_a_load_that_appeared_on_the_first_arm_is_a_payload_there() -> None:
    """It was told as springs, couplings and an encoder's scale, none of which there was."""
    found = ident.monitor(fitted(1), logged(7, "left3"))
    (change,) = found.changes
    assert (change.name, change.joints, found.verdict) == ("payload", ("j_left3",), "changed")
    assert change.parameters[0].value == pytest.approx(MASS, abs=0.02)


def test_where_payloads_are_sought() -> None:
    kind = type(make_effect("payload"))
    assert [one.joints for one in kind.placements(ROBOT)] == [("j_left3",), ("j_right3",)]
    assert [one.joints for one in kind.placements(ident.load_robot("puma560"))] == [None]
