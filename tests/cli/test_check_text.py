"""What `ident check` prints is read on a terminal, and what it says once is not said again by every fit."""

from __future__ import annotations

from command_line import FRICTION

from ident.robots import robot_folder
from ident.summary import WIDTH


def test_lines_fit_a_wide_terminal(ident):
    folder = robot_folder("puma560") / "demo"
    ran = ident(
        "check", "--robot", "puma560", "--log", folder / "train.csv.gz", "--effects", "rotor_inertia", "viscous", "coulomb", "--quiet"
    )
    assert ran.code == 0
    assert max(map(len, ran.out.splitlines())) <= WIDTH


def test_notes_on_the_robot_are_said_by_check_alone(ident, arm):
    flags = ("--urdf", arm.urdf, "--log", arm.train, *FRICTION, "--quiet")
    note = "rpy of shoulder"
    assert note in ident("check", *flags).out
    assert note not in ident("fit", *flags).out
