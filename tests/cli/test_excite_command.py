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
    assert margins["shoulder"]["to_end"] == pytest.approx(2.0 - np.abs(t["q2"]).max(), abs=1e-4)
    assert margins["shoulder"]["to_end"] <= 2.0 - np.abs(t["q2"]).max() + 1e-12, "between the rows of the table, too"
    assert margins["elbow"]["largest_acceleration"] == pytest.approx(np.abs(t["ddq3"]).max(), rel=1e-3)
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
    (tmp_path / "m.csv").unlink(missing_ok=True)
    kept = ident("excite", "--urdf", arm.urdf, *QUICK, "--out", tmp_path / "kept", "--no-collision-check", "--ros")
    assert kept.code == 0, kept.err
    assert (tmp_path / "kept" / "excitation.yaml").read_bytes() == ros.read_bytes()
    assert "kept/excitation.yaml" in kept.out


def test_postures_jerk_obstacle_and_view(ident: Ident, arm: Arm, tmp_path: Path) -> None:
    start, here = (0.0, 0.5, -0.8, 0.2), (0.1, 0.3, -0.5, 0.0)
    box = tmp_path / "box.obj"
    corners = [(x, y, z) for x in (2, 3) for y in (2, 3) for z in (0, 1)]
    box.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 4\nf 1 4 3\nf 5 8 6\nf 5 7 8\nf 1 5 6\nf 3 4 8\n")
    file, view = tmp_path / "m.csv", tmp_path / "view.html"
    ran = ident(
        "excite", "--urdf", arm.urdf, *QUICK, "--trajectory", file, "--json", "--max-jerk", "40", "--obstacle", box, "--ground", "none",
        "--start-posture", *start, "--from-posture", *here, "--view", view,
    )  # fmt: skip
    assert ran.code == 0, ran.err
    t = np.genfromtxt(file, delimiter=",", names=True)
    q, ddq = (np.column_stack([t[f"{key}{j}"] for j in range(1, 5)]) for key in ("q", "ddq"))
    np.testing.assert_allclose(q[0], here, atol=1e-12)
    np.testing.assert_allclose(q[-1], start, atol=1e-9)
    first = int(np.ceil(ran.json["approach_s"] * 200))
    np.testing.assert_allclose(q[first], start, atol=1e-4)
    assert len(q) == pytest.approx(first + 801, abs=1)
    jerk = np.diff(ddq, axis=0) * 200
    assert np.abs(jerk).max() <= 40 + 1e-6
    assert "the way to the first posture" not in ran.err
    assert [entry["path"] for entry in ran.json["inputs"]][-1] == str(box)
    assert view.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("flags", "needle"),
    [
        (("--start-posture", "9", "0", "0", "0"), "joint slide at 9, outside the limits"),
        (("--start-posture", "0", "0"), "must be 4 numbers, one for each joint"),
        (("--from-posture", "0", "9", "0", "0"), "joint shoulder is at 9, outside its range"),
        (("--obstacle", "none.stl"), "there is no such file"),
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
