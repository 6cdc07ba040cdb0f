"""`ident simulate --with`: an effect with values, in the simulated log and found again by a fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import Arm, Ran

import ident as package
from ident import friction as fr

Ident = Callable[..., Ran]


def simulate(ident: Ident, arm: Arm, file: Path, *more: str) -> Ran:
    return ident("simulate", "--urdf", arm.urdf, "--log", file, "--noise", "0", "--seconds", "8", "--quiet", *more)


def test_what_was_put_in_is_found_again(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    """The log is made by the simulator, and read by an estimator: the value comes back, and on the other joints there is none."""
    file = tmp_path / "log.csv"
    ran = simulate(ident, arm, file, "--with", "stribeck:elbow:Fs=3,v_s=0.3", "--with", "coulomb:shoulder,wrist:Fc=1.5", "--json")
    assert ran.code == 0, ran.err
    assert "with stribeck: Fs_elbow = 3 N m" in ran.err
    assert ran.json["parameters"]["Fs_elbow"] == 3.0
    assert ran.json["parameters"]["Fc_wrist"] == 1.5
    assert ran.json["parameters"]["Fc_slide"] == 0.0
    estimate = package.fit(file, arm.urdf, model=fr.Viscous() + fr.Coulomb() + fr.Stribeck(joints=("elbow", "shoulder"), v_s=0.3), held=0)
    assert estimate.value("Fs_elbow") == pytest.approx(3.0, rel=0.1)
    assert abs(estimate.value("Fs_shoulder")) < 0.2
    assert estimate.value("Fc_wrist") == pytest.approx(1.5, rel=0.05)


@pytest.mark.parametrize(
    ("text", "needle"),
    [
        ("stribec:elbow:Fs=1", "stribeck"),
        ("stribeck:elbo:Fs=1", "elbow"),
        ("stribeck:elbow", "give 'stribeck' a value: Fs"),
        ("stribeck:elbow:Fz=1", "Fs"),
        ("stribeck:elbow:Fs=much", "not a finite number"),
        ("stribeck:elbow:Fs", "give 'stribeck' a value"),
        ("stribeck:elbow:Fs=1:v_s=1", "not of the form"),
        ("stribeck:elbow:Fs=", "not KEY=VALUE"),
        ("stribeck:elbow:v_s=-1,Fs=1", "v_s must be a number from"),
        ("encoder_offset:elbow:eoff=0.1", "in the sensors"),
    ],
)
def test_what_cannot_be_read_is_refused(ident: Ident, arm: Arm, tmp_path: Path, text: str, needle: str) -> None:
    ran = simulate(ident, arm, tmp_path / "log.csv", "--with", text)
    assert ran.code == 2
    assert needle in ran.err
    assert not (tmp_path / "log.csv").exists()


@pytest.mark.parametrize(
    "text",
    ["payload::m=1", "base_tilt::tiltx=0.02", "gear_coupling:wrist:motors=elbow,K=0.1", "external_force:wrist:fz=5,point=0.1+0+0"],
)
def test_effects_of_other_kinds(ident: Ident, arm: Arm, tmp_path: Path, text: str) -> None:
    ran = simulate(ident, arm, tmp_path / "log.csv", "--with", text)
    assert ran.code == 0, ran.err
    assert "with " in ran.err
