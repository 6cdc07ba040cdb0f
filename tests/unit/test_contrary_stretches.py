"""What happens to the arm in a part of a log, a contact or a brake, is told from what the rest of the log predicts; a model that lacks an
effect everywhere is not blamed on a part."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import ident

Array = np.ndarray
MODEL = ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
TOLD = "the torque contradicts the rest of the logs"


@cache
def recorded(seed: int, seconds: float = 30.0, load: float = 0.0, stribeck: float = 0.0) -> ident.Log:
    """A UR5 with the URDF's links, `load` kg at its flange, friction and rotors; torque with 1 % noise."""
    robot, rng, rate = ident.load_robot("ur5"), np.random.default_rng(seed), 200.0
    t = np.arange(round(seconds * rate)) / rate
    order = 2.0 * np.pi * 0.1 * np.arange(1, 6)
    size = rng.normal(size=(2, 5, robot.n)) * 0.5 / np.sqrt(5.0)
    wave = order * t[:, None]
    c, s = np.cos(wave), np.sin(wave)
    q = s @ size[0] + c @ size[1]
    dq = (c * order) @ size[0] - (s * order) @ size[1]
    ddq = -(s * order**2) @ size[0] - (c * order**2) @ size[1]
    assert robot.nominal is not None
    links = robot.nominal.copy()
    links[-10:] += load * np.array([1.0, 0.0, 0.1, 0.1, 0.02, 0.0, 0.01, 0.0, -0.01, 0.01])
    tau = robot.rigid_body().inverse_dynamics(q, dq, ddq, links) + 0.2 * ddq
    scale = np.linspace(3.0, 0.5, robot.n)
    tau = tau + scale * (dq + (1.0 + stribeck * np.exp(-((dq / 0.2) ** 2))) * np.sign(dq))
    tau += 0.01 * scale * rng.standard_normal(tau.shape)
    return ident.Log(f"log{seed}", t, q=q + 1e-5 * rng.standard_normal(q.shape), tau={"joint": tau})


def pushed(log: ident.Log, at: float, seconds: float = 0.3, force: float = 40.0) -> ident.Log:
    """Somebody pushes against the arm: torque that is not the drives' on every joint but the last."""
    inside = (log.t >= at) & (log.t < at + seconds)
    tau = log.tau["joint"].copy()
    tau[inside] += force * np.sin(np.pi * (log.t[inside, None] - at) / seconds) * np.array([1.0, -0.8, 0.5, 0.2, 0.1, 0.0])
    return replace(log, tau={"joint": tau})


def said(logs: ident.Log | ident.LogSet, method: str = "wls", model: object = MODEL) -> str:
    estimate = ident.fit(logs, "ur5", model=model, held=recorded(9), method=method)
    return next((w for w in estimate.warnings if w.startswith(TOLD)), "")


def place(told: str) -> tuple[float, float]:
    """When the first stretch begins, counted from the log's first sample, and how long it lasts."""
    found = re.search(r"at ([\d.]+) s(?: \(([\d.]+) s after the first\))?, for ([\d.]+) s", told)
    assert found, told
    return float(found[2] or found[1]), float(found[3])


@pytest.mark.parametrize("start", [0.0, 1.76e9])
def test_a_contact_is_located(start: float) -> None:
    """Errors of several per cent came with the status ok, and without a word."""
    log = pushed(recorded(1), 13.4)
    told = said(replace(log, t=log.t + start))
    at, lasts = place(told)
    assert 12.4 < at < 13.5 < 13.6 < at + lasts < 15.0
    assert "log log1" in told


def test_what_bends_the_fit_is_named_and_nothing_else() -> None:
    """Beside a contact, half seconds of reversals stand out of so good a fit; they were named as well."""
    assert said(pushed(recorded(1), 13.4)).count("times the usual error of") == 1
    both = said(pushed(pushed(recorded(1), 6.2), 18.6))
    assert both.count("times the usual error of") == 2
    assert "at 5." in both or "at 6." in both
    assert "at 18." in both


def test_a_robust_fit_is_not_bent() -> None:
    log = pushed(recorded(1), 13.4)
    assert said(log, method="irls") == ""
    plain, robust = (ident.fit(log, "ur5", model=MODEL, held=recorded(9), method=method).heldout_error for method in ("wls", "irls"))
    assert plain is not None
    assert robust is not None
    assert robust.relative_all < 0.5 * plain.relative_all


def test_a_brake_that_closes_while_the_torque_goes_on() -> None:
    log = recorded(2)
    inside = (log.t >= 11.0) & (log.t < 14.0)
    tau = log.tau["joint"].copy()
    tau[inside] = 0.3 * tau[np.flatnonzero(inside)[0]]
    at, lasts = place(said(replace(log, tau={"joint": tau})))
    assert 10.0 < at < 11.5
    assert 13.5 < at + lasts < 15.0


def test_logs_with_and_without_a_load() -> None:
    """A stretch may be a whole log: it hides itself from a fit of all of them."""
    told = said(ident.LogSet((recorded(3), recorded(4, 20.0, load=2.0))))
    assert "log log4" in told
    assert "do not determine which side" in told


@pytest.mark.parametrize("at", [5.0, 25.0])
def test_of_two_sides_of_a_step_neither_is_called_the_right_one(at: float) -> None:
    """The shorter one was to be cut out, though it was the sound one."""
    log = recorded(1)
    model = MODEL + ident.make_effect("offset")
    told = said(stepped(log, at), model=model)
    change = re.search(r"changed at ([\d.]+) s of log log1", told)
    assert change, told
    assert float(change[1]) == pytest.approx(at, abs=0.6)
    assert "cut it out" not in told
    # What is the same before and after it is the rule.
    assert "cut it out" in said(stepped(log, 12.0, 16.0), model=model)


def stepped(log: ident.Log, at: float, until: float = np.inf) -> ident.Log:
    """The torque of the second joint reads 10 N m more for a time."""
    tau = log.tau["joint"].copy()
    tau[(log.t >= at) & (log.t < until), 1] += 10.0
    return replace(log, tau={"joint": tau})


@pytest.mark.parametrize("seed", [5, 6])
def test_what_the_model_lacks_everywhere_is_in_no_stretch(seed: int) -> None:
    assert said(recorded(seed)) == ""
    assert said(recorded(seed, stribeck=0.5)) == ""
    assert said(recorded(seed), model=ident.friction.Viscous() + ident.friction.Coulomb()) == ""
    assert said(ident.LogSet((recorded(seed), recorded(7)))) == ""
