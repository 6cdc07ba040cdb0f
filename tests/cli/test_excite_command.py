"""`ident excite` on the command line: room, limits, what is written, what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import Arm, Ran

Ident = Callable[..., Ran]
QUICK = ("--starts", "1", "--seconds", "4", "--quiet")


def test_limits_by_flags_hold(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    ran = ident(
        "excite", "--urdf", arm.urdf, *QUICK, "--trajectory", file, "--json", "--position-share", "0.5",
        "--max-velocity", "0.5", "1", "1", "2", "--max-acceleration", "3",
    )  # fmt: skip
    assert ran.code == 0, ran.err
    t = np.genfromtxt(file, delimiter=",", names=True)
    for j, speed in enumerate((0.5, 1.0, 1.0, 2.0), 1):
        assert np.abs(t[f"dq{j}"]).max() <= speed + 1e-9
        assert np.abs(t[f"ddq{j}"]).max() <= 3 + 1e-9
    assert np.abs(t["q1"]).max() <= 0.2 + 1e-9
    assert np.abs(t["q2"]).max() <= 1.0 + 1e-9
    margins = {m["joint"]: m for m in ran.json["margins"]}
    assert margins["shoulder"]["to_end"] == pytest.approx(2.0 - np.abs(t["q2"]).max(), abs=1e-9)
    assert margins["elbow"]["share_of_speed"] == pytest.approx(np.abs(t["dq3"]).max() / 6, rel=1e-3)
    assert margins["wrist"]["to_end"] is None
    assert ran.json["safety"]["clearance_m"] == 0.02
    assert "NOT checked" in ran.err


def test_a_ros_trajectory_beside_the_table(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    ros = tmp_path / "motion.yaml"
    call = ("excite", "--urdf", arm.urdf, *QUICK, "--trajectory", tmp_path / "m.csv", "--ros", ros, "--no-collision-check")
    ran = ident(*call)
    assert ran.code == 0, ran.err
    assert "NOT checked: collisions of any kind" in ran.out
    assert 'joint_names: ["slide", "shoulder", "elbow", "wrist"]' in ros.read_text()
    (tmp_path / "m.csv").unlink()
    again = ident(*call)
    assert again.code == 2
    assert "motion.yaml exists; nothing was designed" in again.err


@pytest.mark.parametrize(
    ("flags", "needle"),
    [
        (("--ground", "5"), "the ground"),
        (("--ground", "low"), "--ground must be a height"),
        (("--workspace", "0", "0.1", "0", "0.1", "0", "0.1"), "wall at"),
        (("--workspace", "1", "0", "0", "1", "0", "1"), "lower and an upper bound"),
        (("--limit-share", "1.5"), "at most 1"),
        (("--max-velocity", "1", "2"), "one per joint"),
    ],
)
def test_no_safe_motion_ends_with_a_reason(ident: Ident, arm: Arm, tmp_path: Path, flags: tuple[str, ...], needle: str) -> None:
    file = tmp_path / "m.csv"
    ran = ident("excite", "--urdf", arm.urdf, *QUICK, "--trajectory", file, *flags)
    assert ran.code == 2
    assert needle in ran.err
    assert not file.exists()
