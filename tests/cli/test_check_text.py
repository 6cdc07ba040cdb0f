"""What `ident check` prints is read on a terminal, and notes are of what matters."""

from __future__ import annotations

from command_line import FRICTION

from ident.estimate.summary import WIDTH
from ident.robots import robot_folder


def test_lines_fit_a_wide_terminal(ident):
    folder = robot_folder("puma560") / "demo"
    ran = ident(
        "check", "--robot", "puma560", "--log", folder / "train.csv.gz", "--effects", "rotor_inertia", "viscous", "coulomb", "--quiet"
    )
    assert ran.code == 0
    assert max(map(len, ran.out.splitlines())) <= WIDTH


def test_how_many_digits_of_pi_were_written_is_not_worth_a_note(ident, arm, tmp_path):
    """1.5708 is said by nobody; 1.57 moves the joint, and is."""
    coarse = tmp_path / "coarse.urdf"
    coarse.write_text(arm.urdf.read_text().replace("1.5708", "1.57"))
    for urdf, said in ((arm.urdf, False), (coarse, True)):
        for command in ("check", "fit"):
            ran = ident(command, "--urdf", urdf, "--log", arm.train, *FRICTION, "--quiet")
            assert ("rpy of" in ran.out) == said, command
