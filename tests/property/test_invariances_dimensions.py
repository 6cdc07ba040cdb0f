"""Physics has no units of its own, and a fit is least squares: what follows of both, for three robots."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import ident
from ident import LogSet, Robot
from ident._utils.toml import to_toml
from tests.invariances import EFFECTS, ROBOTS, Case, case, same, usual, write

Array = np.ndarray
CUTOFF = 8.0
#: Of what is computed from the same numbers, and of what rounds otherwise on the way.
SAME, NEAR = 1e-9, 1e-6


def smooth(factor: float = 1.0) -> ident.ZeroPhase:
    return ident.ZeroPhase(cutoff_hz=CUTOFF / factor)


def described(c: Case, change: Callable[[etree._Element], None] | None = None, gravity: Array | None = None) -> Robot:
    """The robot behind the same drive, of a changed description."""
    root = etree.fromstring(c.robot.source["urdf_text"].encode())
    if change is not None:
        change(root)
    told = c.robot.source["gravity"] if gravity is None else gravity
    return Robot.from_urdf(etree.tostring(root, encoding="unicode"), gravity=told).with_transmission(c.robot.transmission)


def kind_of(parameter: str) -> str:
    """ "m", "mx" (first moments), "I" or "Fv", "Fc"."""
    head = parameter.split("_", maxsplit=1)[0]
    return "mx" if head in ("mx", "my", "mz") else "I" if head.startswith("I") else head


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("factor", [4.0, 0.125])
def test_a_slower_clock_with_less_gravity(name: str, factor: float) -> None:
    """The same torque along the same path, `factor` times as slowly: inertia counts by the square of it, viscous friction once."""
    c = case(name)
    gravity = np.array(c.robot.source["gravity"]) / factor**2
    two = c.fit(replace(c.log, t=factor * c.log.t), robot=described(c, gravity=gravity), preparation=smooth(factor))
    one = c.fit(preparation=smooth())
    power = {"Fv": 1, "Fc": 0}
    same(one, two, NEAR, scale={n: factor ** -power.get(kind_of(n), 2) for n in one.names})


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("factor", [8.0, 0.25])
def test_a_larger_robot_with_more_gravity(name: str, factor: float) -> None:
    """Every length `factor` times, torques as they were: masses go by its square, first moments once, moments of inertia stay."""
    c = case(name)

    def larger(root: etree._Element) -> None:
        for origin in root.iter("origin"):
            if origin.get("xyz"):
                origin.set("xyz", " ".join(repr(factor * float(v)) for v in origin.get("xyz").split()))
        for joint in root.findall("joint"):
            for limit in joint.findall("limit") if joint.get("type") == "prismatic" else ():
                joint.remove(limit)
                joint.append(etree.Element("limit", lower="-9", upper="9", velocity="9", effort="9"))

    slides = np.array([j.prismatic for j in c.robot.joints])
    size = np.where(slides, factor, 1.0)
    gravity = np.array(c.robot.source["gravity"]) * factor
    # A force over a longer way is the less; the drive is told in the joints' units.
    drive = c.robot.transmission
    robot = described(c, larger, gravity).with_transmission(replace(drive, K=size[:, None] * drive.K, zero=size * drive.zero))
    tau = {side: v if side == "motor" else v / size for side, v in c.log.tau.items()}
    assert c.log.q is not None
    two = c.fit(replace(c.log, q=c.log.q * size, tau=tau), robot=robot, preparation=smooth())
    one = c.fit(preparation=smooth())
    power = {"m": 2, "mx": 1}  # friction is the drive's, which is as it was
    scale = {n: factor ** power.get(kind_of(n), 0) for n in one.names}
    same(one, two, NEAR, scale=scale)


# --- one body, described in two ways ------------------------------------------------------------------------------------------


def in_two_parts(root: etree._Element) -> None:
    """The last link is two, fixed to each other."""
    root.append(etree.Element("link", name="glued"))
    last = root.findall("joint")[-1].find("child").get("link")
    joint = etree.SubElement(root, "joint", name="glue", type="fixed")
    etree.SubElement(joint, "parent", link=last)
    etree.SubElement(joint, "child", link="glued")
    etree.SubElement(joint, "origin", xyz="0.1 0.2 0.3", rpy="0.4 0.5 0.6")
    part = etree.SubElement(root.findall("link")[-1], "inertial")
    etree.SubElement(part, "mass", value="0.7")
    etree.SubElement(part, "inertia", ixx="0.01", ixy="0", ixz="0", iyy="0.01", iyz="0", izz="0.01")


def whole_turns(root: etree._Element) -> None:
    for origin in root.iter("origin"):
        if origin.get("rpy"):
            a, b, c = origin.get("rpy").split()
            origin.set("rpy", f"{a} {b} {float(c) + 2 * np.pi!r}" if float(c) else f"{a} {b} {c}")


def blanks(root: etree._Element) -> None:
    for element in root.iter():
        for key in ("xyz", "rpy"):
            if isinstance(element.tag, str) and element.get(key):
                element.set(key, f"  {'   '.join(element.get(key).split())} ")


def transmissions(root: etree._Element) -> None:
    for joint in root.findall("joint"):
        part = etree.SubElement(root, "transmission", name=f"drive of {joint.get('name')}")
        etree.SubElement(part, "joint", name=joint.get("name"))
        etree.SubElement(part, "mechanicalReduction").text = "50"


def damped(root: etree._Element) -> None:
    """Friction as the description tells it is no part of a fit."""
    for joint in root.findall("joint"):
        if joint.get("type") != "fixed":
            for old in joint.findall("dynamics"):
                joint.remove(old)
            etree.SubElement(joint, "dynamics", damping="3.5", friction="0.7")


def without_limits(root: etree._Element) -> None:
    for joint in root.findall("joint"):
        for limit in joint.findall("limit"):
            limit.set("lower", "-1.7976931348623157e+308")
            limit.set("upper", "1.7976931348623157e+308")


DESCRIBED: dict[str, Callable[[etree._Element], None]] = {
    "a link of two parts": in_two_parts, "whole turns of frames": whole_turns, "blanks in attributes": blanks,
    "transmissions": transmissions, "damping in the description": damped, "limits that are none": without_limits,
}  # fmt: skip


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("way", [*DESCRIBED])
def test_described_in_another_way_it_is_the_same(name: str, way: str) -> None:
    c = case(name)
    same(usual(name), c.fit(robot=described(c, DESCRIBED[way])), NEAR if way == "whole turns of frames" else SAME)


@pytest.mark.parametrize("name", ROBOTS)
def test_inertia_in_turned_axes_is_the_same_body(name: str) -> None:
    """R diag(a, b, c) Rᵀ as nine numbers, or as three in a frame that is turned by R."""
    c = case(name)
    link = next(
        x.get("name") for x in etree.fromstring(c.robot.source["urdf_text"].encode()).findall("link") if x.find("inertial") is not None
    )
    x, y, z = 0.3, -0.7, 1.1
    Rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    Ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    Rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    own = np.diag([0.02, 0.03, 0.04])
    turned = Rz @ Ry @ Rx @ own @ (Rz @ Ry @ Rx).T

    def body(tensor: Array, rpy: str) -> Callable[[etree._Element], None]:
        def change(root: etree._Element) -> None:
            part = next(x for x in root.findall("link") if x.get("name") == link).find("inertial")
            for child in list(part):
                part.remove(child)
            etree.SubElement(part, "origin", xyz="0.1 0.2 0.3", rpy=rpy)
            etree.SubElement(part, "mass", value="2")
            keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
            etree.SubElement(part, "inertia", **{k: repr(float(tensor[at])) for k, at in keys.items()})

        return change

    one, two = (described(c, body(*told)).nominal for told in ((own, f"{x} {y} {z}"), (turned, "0 0 0")))
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-12)
    assert not np.allclose(one, described(c, body(own, "0 0 0")).nominal, atol=1e-4)


# --- one estimate, reached in several ways ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_least_squares_are_those_of_numpy(name: str) -> None:
    """The rows of the equation, stacked and handed to `numpy.linalg.lstsq`."""
    c = case(name)
    estimate = c.fit(method="ls", preparation=smooth())
    signals = smooth()(LogSet((c.log,), c.robot))
    problem = ident.Problem(estimate.model, signals)
    k = len(estimate.values)
    columns = np.stack([problem.predict(e) for e in np.eye(k)], axis=-1)[problem.valid]
    size = np.linalg.norm(columns, axis=0)
    found, *_ = np.linalg.lstsq(columns / size, problem.tau[problem.valid], rcond=None)
    np.testing.assert_allclose(found / size, estimate.values, rtol=0, atol=1e-6 * float(np.max(estimate.std)))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_log_given_twice_tells_the_same_values(name: str) -> None:
    c = case(name)
    again = replace(c.log, name="again")
    one, two = (c.fit(LogSet(logs, c.robot), method="ls", preparation=smooth()) for logs in ((c.log,), (c.log, again)))
    assert two.samples == 2 * one.samples
    np.testing.assert_allclose(two.values, one.values, rtol=0, atol=float(1e-6 * np.max(one.std)))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("way", ["pickled", "copied", "bytes of its text", "file", "a Path", "model handed in"])
def test_a_robot_that_came_another_way(name: str, way: str, tmp_path: Path) -> None:
    c = case(name)
    path = tmp_path / "a.urdf"
    path.write_text(c.robot.source["urdf_text"])
    if way == "pickled":
        found = c.fit(robot=pickle.loads(pickle.dumps(c.robot)))
    elif way == "copied":
        found = c.fit(robot=copy.deepcopy(c.robot))
    elif way == "model handed in":
        found = ident.fit(c.log, c.robot, model=ident.Model(c.robot, [ident.make_effect(e) for e in ("rigid_body", *EFFECTS)]), held=0)
    else:
        given = {"file": str(path), "a Path": path, "bytes of its text": c.robot.source["urdf_text"].encode().decode()}[way]
        found = c.fit(robot=Robot.from_urdf(given).with_transmission(c.robot.transmission))
    same(usual(name), found, 0.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_study_says_what_arguments_say(name: str, tmp_path: Path) -> None:
    c = case(name)
    (tmp_path / "a.urdf").write_text(c.robot.source["urdf_text"])
    write(tmp_path / "a.csv", c.columns())
    drive = {
        "K": c.robot.transmission.K.tolist(),
        "zero": c.robot.transmission.zero.tolist(),
        "measured": str(c.robot.transmission.measured.value),
    }
    study = {
        "robot": {"urdf": "a.urdf"},
        "drive": {**drive, "effects": [*EFFECTS]},
        "logs": {"fit": ["a.csv"]},
        "estimator": {"method": "wls"},
    }
    (tmp_path / "study.toml").write_text(to_toml(study))
    told = ident.read_study(tmp_path / "study.toml")
    by_arguments = ident.fit(c.log, c.robot, model=[ident.make_effect(e) for e in EFFECTS])
    by_study = ident.fit(told)
    same(by_arguments, by_study, SAME)
    assert by_study.heldout_error is not None
    assert by_arguments.heldout_error is not None
    assert by_study.heldout_error.relative_all == pytest.approx(by_arguments.heldout_error.relative_all, rel=SAME)
    for given in ({"held": 0}, {"method": "ls"}, {"iterations": 3}):
        with pytest.raises(ident.ConfigurationError, match="change the study"):
            ident.fit(told, **given)


@pytest.mark.parametrize("name", ROBOTS)
def test_motors_with_another_zero_turn_the_same_joints(name: str) -> None:
    c = case(name)
    drive = replace(c.robot.transmission, zero=np.linspace(-0.5, 0.8, c.robot.n))
    robot = c.robot.with_transmission(drive)
    assert c.log.q is not None
    motors = np.linalg.solve(drive.K, (c.log.q - drive.zero).T).T
    same(usual(name), c.fit(replace(c.log, q=None, q_motor=motors), robot=robot), NEAR)
