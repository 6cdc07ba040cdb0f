"""Saved fits that were damaged or changed: refused with the field's name, or told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident
from ident import ConfigurationError, Estimate
from tests.fuzz import seeds


@pytest.fixture(scope="module")
def saved() -> dict[str, Any]:
    return seeds.saved_fits()["rich.json"]


def write(folder: Path, data: Any) -> Path:
    path = folder / "fit.json"
    path.write_text(json.dumps(data))
    return path


def changed(data: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """A copy with another value at a place such as `state.base.gap`; the checksum is left out, as of a file of an older version."""
    copy = json.loads(json.dumps(data))
    del copy["checksum"]
    at: Any = copy
    *way, last = [int(p) if p.isdecimal() else p for p in place.split(".")]
    for part in way:
        at = at[part]
    if value is MISSING:
        del at[last]
    else:
        at[last] = value
    return copy


MISSING = object()


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("covariance", [[1.0]]),
        ("covariance.0.0", -1.0),
        ("parameters.1.value", "1.5"),
        ("parameters.0.value", True),
        ("parameters.0.value", None),
        ("parameters.0.value", 10**120),
        ("parameters.0", MISSING),
        ("samples", -3),
        ("samples", 2.5),
        ("status.code", "fine"),
        ("state.base.independent", [0, 0]),
        ("state.base.independent.0", 4000),
        ("state.base.regroup.0.0", "x"),
        ("state.base.gap", MISSING),
        ("state.noise.ar", 3),
        ("state.noise.variance", ["a", "b"]),
        ("state.weights.0", -1.0),
        ("state.information.triangles.0", []),
        ("state.information.form", "square"),
        ("state.rows.fit", None),
        ("state.reference", [1.0]),
        ("state.model.robot.gravity", [0, 0]),
        ("state.model.robot.urdf_text", "<robot/>"),
        ("state.model.drive.K", [[1.0]]),
        ("state.model.drive.measured", "elbow"),
        ("state.model.effects.0.name", 7),
        ("state.model.effects.0.name", "no_such"),
        ("not_determined", "j1"),
        ("rows_near_reversals_left_out", [{"joint": "j9", "rows": 1, "usable": 2}]),
        ("trace", []),
        ("inputs", [{"path": 3}]),
        ("torque_error.fit.rms", [1.0]),
    ],
)  # fmt: skip
def test_a_damaged_field_is_refused(saved: dict[str, Any], place: str, value: Any, tmp_path: Path) -> None:
    path = write(tmp_path, changed(saved, place, value))
    with pytest.raises(ConfigurationError) as error:
        Estimate.load(path)
    told = str(error.value)
    assert told.startswith(f"fit {path}: ")
    assert "\n" not in told
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    "place", ["covariance", "parameters", "state.base.regroup", "state.weights", "torque_error.fit.rms", "status.code"]
)
def test_the_field_is_named(saved: dict[str, Any], place: str, tmp_path: Path) -> None:
    for value in ({"a": 1}, MISSING):
        with pytest.raises(ConfigurationError, match=place.replace(".", r"\.")):
            Estimate.load(write(tmp_path, changed(saved, place, value)))


def test_what_was_not_changed_is_not_told(saved: dict[str, Any], tmp_path: Path) -> None:
    assert not any("changed" in w for w in Estimate.load(write(tmp_path, saved)).warnings)
    reordered = dict(reversed(list(saved.items())))
    assert not any("changed" in w for w in Estimate.load(write(tmp_path, reordered)).warnings)


def test_a_changed_number_is_told(saved: dict[str, Any], tmp_path: Path) -> None:
    other = json.loads(json.dumps(saved))
    other["parameters"][0]["value"] += 1.0
    with pytest.warns(UserWarning, match="changed after ident wrote it"):  # every command shows it on standard error
        found = Estimate.load(write(tmp_path, other))
    assert any("changed after ident wrote it" in w for w in found.warnings)
    assert "changed after ident wrote it" in str(found)


def test_a_fit_without_a_checksum_is_read(saved: dict[str, Any], tmp_path: Path) -> None:
    old = {k: v for k, v in saved.items() if k != "checksum"}
    found = Estimate.load(write(tmp_path, old))
    np.testing.assert_array_equal(found.values, [p["value"] for p in saved["parameters"]])
    assert not any("changed" in w for w in found.warnings)


def test_rows_near_reversals_of_a_fit_of_version_0_2(saved: dict[str, Any], tmp_path: Path) -> None:
    """It names the joints alone; a fit of today also counts their rows."""
    left = {"joint": "j1", "rows": 12, "usable": 80}
    new = changed(saved, "rows_near_reversals_left_out", [left])
    assert str(Estimate.load(write(tmp_path, new)).reversals_left_out[0]) == "j1 12 (15 %)"
    old = changed(changed(saved, "rows_near_reversals_left_out", MISSING) | {"checksum": 0}, "sticking_joints", ["j1"])
    found = Estimate.load(write(tmp_path, old))
    assert [(r.joint, r.rows) for r in found.reversals_left_out] == [("j1", None)]
    assert "rows near reversals of j1; " in str(found)


@pytest.mark.parametrize("limit", ['lower="4" upper="1e9"', 'lower="-1e300" upper="-4"', 'lower="4"', 'upper="-4"'])
def test_limits_of_one_side_are_used_as_such(limit: str) -> None:
    """A range that lies whole beyond half a turn on one side once ended in NumPy's own error."""
    text = seeds.URDF.replace('lower="-2.5" upper="2.5"', limit)
    robot = ident.Robot.from_urdf(text)
    assert ident.base(robot).count == ident.base(ident.Robot.from_urdf(seeds.URDF)).count
    assert ident.base(robot).agreement


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('xyz="0.4 0 0"', 'xyz="1e308 0 0"', "j2"),
        ('xyz="0.4 0 0"', 'xyz="0.4 0"', "j2"),
        ('xyz="0.4 0 0"', 'xyz=""', "j2"),
        ('xyz="0.4 0 0"', 'xyz="1_0 0 0"', "j2"),
        ('<mass value="0.8"', '<mass value="1e300"', "b"),
        ('<mass value="0.8"', '<mass value="１"', "b"),
    ],
)
def test_numbers_that_no_robot_has_are_refused(old: str, new: str, named: str) -> None:
    assert seeds.URDF.count(old) == 1
    with pytest.raises(ConfigurationError, match=f"'{named}'"):
        ident.Robot.from_urdf(seeds.URDF.replace(old, new))


@pytest.mark.parametrize("size", ["1e-200", "1e200"])
def test_of_an_axis_only_the_direction_counts(size: str) -> None:
    text = seeds.URDF.replace('<axis xyz="0 0 1"/></joint>', f'<axis xyz="0 0 {size}"/></joint>')
    assert text != seeds.URDF
    np.testing.assert_array_equal(ident.Robot.from_urdf(text).tree.axis, ident.Robot.from_urdf(seeds.URDF).tree.axis)


def test_numbers_that_are_nearly_nothing_are_zero(capfd: pytest.CaptureFixture[str]) -> None:
    """The parser behind Pinocchio takes them for an error, and the link for one without mass."""
    small = seeds.URDF.replace('ixz="0"', 'ixz="1e-320"').replace('xyz="0.4 0 0"', 'xyz="0.4 0 4e-321"')
    robot, usual = ident.Robot.from_urdf(small), ident.Robot.from_urdf(seeds.URDF)
    np.testing.assert_array_equal(robot.nominal, usual.nominal)
    np.testing.assert_array_equal(robot.tree.translation, usual.tree.translation)
    assert capfd.readouterr().err == ""


def test_an_inertial_that_says_nothing_is_none(capfd: pytest.CaptureFixture[str]) -> None:
    text = seeds.URDF.replace('<link name="tool"/>', '<link name="tool"><inertial><origin xyz="0 0 1"/></inertial></link>')
    np.testing.assert_array_equal(ident.Robot.from_urdf(text).nominal, ident.Robot.from_urdf(seeds.URDF).nominal)
    assert capfd.readouterr().err == ""


def test_two_marks_of_byte_order_are_none() -> None:
    assert ident.Robot.from_urdf("<robot" + seeds.URDF.split("<robot", 1)[1]).n == 2
    from ident.robots.urdf import prepare_urdf

    assert prepare_urdf(b"\xef\xbb\xbf\xef\xbb\xbf" + seeds.URDF.encode()).text.startswith("<robot")
