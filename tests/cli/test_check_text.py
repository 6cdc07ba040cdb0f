"""What `ident check` prints is read on a terminal, and notes are of what matters."""

from __future__ import annotations

import numpy as np
from command_line import FRICTION, analytic_log, write_csv

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


def test_a_contact_in_the_log_is_told_before_any_fit(ident, arm, tmp_path):
    from ident import Robot
    from ident import friction as fr

    robot = Robot.from_urdf(arm.urdf)
    values = np.concatenate([robot.nominal, [20.0, 1.0, 0.5, 0.1], [10.0, 2.0, 1.0, 0.2]])
    log = analytic_log(robot.rigid_body() + fr.Viscous() + fr.Coulomb(), values, 3, seconds=16.0)
    pushed = dict(log)
    push = np.where((log["t"] > 6.0) & (log["t"] < 6.4), np.sin(np.pi * (log["t"] - 6.0) / 0.4), 0.0)
    for j, force in enumerate((40.0, 10.0, 10.0, 2.0)):
        pushed[f"tau{j + 1}"] = log[f"tau{j + 1}"] + force * push
    for table, said in ((pushed, True), (log, False)):
        path = write_csv(tmp_path / f"{said}.csv", table)
        ran = ident("check", "--urdf", arm.urdf, "--log", path, *FRICTION, "--quiet", "--json")
        assert any("contradicts the rest of the logs" in warning for warning in ran.json["warnings"]) == said
