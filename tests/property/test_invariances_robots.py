"""The same robot described otherwise is the same: three robots, each way with the tolerance that it deserves."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import ident
from ident import Estimate, Robot, Transmission
from ident.regressor import kernel_choice
from tests.invariances import EFFECTS, ROBOTS, Case, case, same, same_prediction, usual
from tests.rigid_models import kernels, using

Array = np.ndarray
#: Of a description that holds the same numbers; of one in which they are computed otherwise.
SAME, NEAR = 1e-9, 1e-6


def again(c: Case, text: str, **options: object) -> Robot:
    """The robot behind the same drive, from another text."""
    source = c.robot.source
    loaded = Robot.from_urdf(text, **{"gravity": source["gravity"], "locked": source["locked"], "loop": source["loop"], **options})  # type: ignore[arg-type]
    return loaded.with_transmission(c.robot.transmission)


def root_of(c: Case) -> etree._Element:
    return etree.fromstring(c.robot.source["urdf_text"])


def text_of(root: etree._Element) -> str:
    return etree.tostring(root, encoding="unicode")


def reordered(c: Case) -> str:
    """Links and joints in another order in the file; of the joints of one link, the order stays."""
    root = root_of(c)
    links, joints = root.findall("link"), root.findall("joint")
    for child in [*links, *joints]:
        root.remove(child)
    root.extend([*joints, *reversed(links)])
    return text_of(root)


def renamed_links(c: Case) -> str:
    root = root_of(c)
    for element in [*root.findall("link"), *root.iter("parent"), *root.iter("child")]:
        key = "name" if element.tag == "link" else "link"
        element.set(key, f"part of {element.get(key)}")
    return text_of(root)


def without_visuals(c: Case) -> str:
    root = root_of(c)
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for part in link.findall(tag):
                link.remove(part)
    return text_of(root)


def other_inertials(c: Case) -> str:
    """No fit needs the URDF's own values."""
    root = root_of(c)
    for mass in root.iter("mass"):
        mass.set("value", str(2.0 + float(mass.get("value"))))
    return text_of(root)


def other_limits(c: Case) -> str:
    root = root_of(c)
    for limit in root.iter("limit"):
        limit.set("effort", "1e6")
    return text_of(root)


def with_a_base_in_between(c: Case) -> str:
    """Two fixed joints that are nothing, between the base and the rest."""
    root = root_of(c)
    children = {j.find("child").get("link") for j in root.findall("joint")}
    base = next(link.get("name") for link in root.findall("link") if link.get("name") not in children)
    for i, (parent, child) in enumerate((("world", "stand"), ("stand", base))):
        if i == 0:
            root.append(etree.Element("link", name="world"))
        root.append(etree.Element("link", name="stand")) if child == "stand" else None
        joint = etree.SubElement(root, "joint", name=f"fixed{i}", type="fixed")
        etree.SubElement(joint, "parent", link=parent)
        etree.SubElement(joint, "child", link=child)
    return text_of(root)


def axes_longer(c: Case) -> str:
    root = root_of(c)
    for axis in root.iter("axis"):
        axis.set("xyz", " ".join(str(7.0 * float(v)) for v in axis.get("xyz").split()))
    return text_of(root)


def digits_as_exponents(c: Case) -> str:
    """1.5708 as 1570.8e-3: the digits that were written stay, by which a right angle is known."""

    def written(match: re.Match[str]) -> str:
        words = (f"{Decimal(v).scaleb(3):f}e-3" for v in match[2].split())
        return f'{match[1]}="{" ".join(words)}"'

    return re.sub(r'(xyz|rpy)="([^"]*)"', written, c.robot.source["urdf_text"])


def continuous(c: Case) -> str:
    return c.robot.source["urdf_text"].replace('type="revolute"', 'type="continuous"')


TEXTS: dict[str, Callable[[Case], str]] = {
    "order in the file": reordered, "names of links": renamed_links, "no visuals": without_visuals, "other inertials": other_inertials,
    "other limits of torque": other_limits, "fixed joints before the base": with_a_base_in_between, "axes of another length": axes_longer,
    "numbers with exponents": digits_as_exponents, "continuous": continuous,
    "comments": lambda c: c.robot.source["urdf_text"].replace("<joint", "<!-- <joint/> --><joint"),
    "a namespace": lambda c: c.robot.source["urdf_text"].replace("<robot", '<robot xmlns="http://www.ros.org"', 1),
    "what is stored": lambda c: again(c, c.robot.source["urdf_text"]).source["urdf_text"],
}  # fmt: skip


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("way", [*TEXTS])
def test_described_otherwise_it_is_the_same(name: str, way: str) -> None:
    c = case(name)
    same(usual(name), c.fit(robot=again(c, TEXTS[way](c))), SAME)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "iso-8859-1", "cp1252", "utf-16-be"])
def test_in_another_encoding_it_is_the_same(name: str, encoding: str, tmp_path: Path) -> None:
    c = case(name)
    text = re.sub(r"^\s*<\?xml.*?\?>", "", c.robot.source["urdf_text"]).replace(f'name="{c.robot.joint_names[0]}"', 'name="jé"')
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    declared = encoding.removesuffix("-sig").removesuffix("-be")
    (tmp_path / "a.urdf").write_bytes(f'{mark}<?xml version="1.0" encoding="{declared}"?>{text}'.encode(encoding))
    robot = Robot.from_urdf(tmp_path / "a.urdf").with_transmission(c.robot.transmission)
    same(usual(name), c.fit(robot=robot), SAME, names={c.robot.joint_names[0]: "jé"})
    assert Robot.from_urdf(robot.source["urdf_text"]).joint_names == robot.joint_names


@pytest.mark.parametrize("name", ROBOTS)
def test_other_names_of_joints(name: str) -> None:
    c = case(name)
    names = {old: f"axis_{i}" for i, old in enumerate(c.robot.joint_names)}
    root = root_of(c)
    for joint in root.findall("joint"):
        joint.set("name", names.get(joint.get("name"), joint.get("name")))
    same(usual(name), c.fit(robot=again(c, text_of(root))), SAME, names=names)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_joint_that_counts_the_other_way(name: str, joint: int) -> None:
    """Axis, position and torque turned: the same robot, and of it the same torque with the other sign."""
    c = case(name)
    sign = np.ones(c.robot.n)
    sign[joint] = -1.0
    root = root_of(c)
    element = next(j for j in root.findall("joint") if j.get("name") == c.robot.joint_names[joint])
    axis = element.find("axis")
    if axis is None:
        axis = etree.SubElement(element, "axis", xyz="1 0 0")
    axis.set("xyz", " ".join(str(-float(v)) for v in axis.get("xyz").split()))
    for limit in element.findall("limit"):
        element.remove(limit)
    flipped = np.diag(sign)
    drive = c.robot.transmission
    # θ = K θ_m on both sides of the sign: the motors stay as they are.
    robot = again(c, text_of(root)).with_transmission(replace(drive, K=flipped @ drive.K, zero=sign * drive.zero))
    tau = {side: (v if side == "motor" else sign * v) for side, v in c.log.tau.items()}
    log = replace(c.log, q=c.log.q * sign, tau=tau)
    two = c.fit(log, robot=robot)
    one = usual(name)
    assert len(one.values) == len(two.values)
    a = one.predict(ident.ZeroPhase(cutoff_hz=8.0)(ident.LogSet((c.log,), c.robot)))
    b = two.predict(ident.ZeroPhase(cutoff_hz=8.0)(ident.LogSet((log,), robot)))
    b = b if c.torque_name == "tau_m" else sign * b
    np.testing.assert_allclose(a, b, rtol=0, atol=NEAR * float(np.nanmax(np.abs(a))))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("rpy", ["0.7 0 0", "0 -1.1 0.4", "3.141592653589793 0 0"])
def test_a_base_that_stands_otherwise_with_gravity_turned_likewise(name: str, rpy: str) -> None:
    """The world's axes are of no account. Which parameters stay in the base may change with them; the torque may not."""
    c = case(name)
    root = root_of(c)
    children = {j.find("child").get("link") for j in root.findall("joint")}
    base = next(link.get("name") for link in root.findall("link") if link.get("name") not in children)
    root.append(etree.Element("link", name="world"))
    joint = etree.SubElement(root, "joint", name="stand", type="fixed")
    etree.SubElement(joint, "parent", link="world")
    etree.SubElement(joint, "child", link=base)
    etree.SubElement(joint, "origin", rpy=rpy)
    r, p, y = (float(v) for v in rpy.split())
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    gravity = Rz @ Ry @ Rx @ np.array(c.robot.source["gravity"])
    two = c.fit(robot=again(c, text_of(root), gravity=gravity))
    assert len(two.values) == len(usual(name).values)
    same_prediction(usual(name), two, c.log, c.log, NEAR)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_frame_of_a_link_that_lies_elsewhere(name: str) -> None:
    """The first link's frame moved along and about its axis: its zero moves, the motion and the torque do not."""
    c = case(name)
    root = root_of(c)
    first = next(j for j in root.findall("joint") if j.get("name") == c.robot.joint_names[0])
    link = first.find("child").get("link")
    axis = first.find("axis")
    assert axis is None or [float(v) for v in axis.get("xyz").split()][:2] == [0.0, 0.0]
    for joint in root.findall("joint"):
        if joint.find("parent").get("link") == link:
            origin = joint.find("origin")
            origin = etree.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0") if origin is None else origin
            x, y, z = (float(v) for v in (origin.get("xyz") or "0 0 0").split())
            origin.set("xyz", f"{x!r} {y!r} {z - 0.25!r}")
    origin = first.find("origin")
    origin = etree.SubElement(first, "origin", xyz="0 0 0") if origin is None else origin
    assert not any(float(v) for v in (origin.get("rpy") or "0 0 0").split())
    x, y, z = (float(v) for v in (origin.get("xyz") or "0 0 0").split())
    origin.set("xyz", f"{x!r} {y!r} {z + 0.25!r}")
    two = c.fit(robot=again(c, text_of(root)))
    assert len(two.values) == len(usual(name).values)
    same_prediction(usual(name), two, c.log, c.log, NEAR)


# --- drives ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_motors_in_another_order(name: str) -> None:
    """Columns of K, and the motors' torques, permuted: base parameters of the links are the same."""
    c = case(name)
    order = np.random.default_rng(2).permutation(c.robot.n)
    drive = Transmission(np.diag(np.linspace(0.01, 0.02, c.robot.n)), np.zeros(c.robot.n), ident.Side.MOTOR)
    rates = drive.K
    plain = c.robot.with_transmission(drive)
    joint = c.tau if c.torque_name == "tau" else c.tau @ np.linalg.inv(c.robot.transmission.K)
    motor = joint @ rates
    one = ident.fit(replace(c.log, tau={"motor": motor}), plain, model=[ident.make_effect("viscous")], held=0)
    moved = c.robot.with_transmission(replace(drive, K=rates[:, order]))
    two = ident.fit(replace(c.log, tau={"motor": motor[:, order]}), moved, model=[ident.make_effect("viscous")], held=0)
    a = one.predict(ident.ZeroPhase(cutoff_hz=8.0)(ident.LogSet((replace(c.log, tau={"motor": motor}),), plain)))
    b = two.predict(ident.ZeroPhase(cutoff_hz=8.0)(ident.LogSet((replace(c.log, tau={"motor": motor[:, order]}),), moved)))
    assert len(one.values) == len(two.values)
    np.testing.assert_allclose(a[:, order], b, rtol=0, atol=1e-3 * float(np.nanmax(np.abs(a))))


@pytest.mark.parametrize("name", ROBOTS)
def test_a_ratio_is_a_diagonal_matrix(name: str) -> None:
    c = case(name)
    ratio = np.linspace(-50.0, 80.0, c.robot.n)
    log = replace(c.log, tau={"motor": c.log.q * 0 + c.tau})
    by_ratio = c.fit(log, robot=c.robot.with_transmission(Transmission.from_ratio(ratio, ident.Side.MOTOR)))
    by_matrix = c.fit(log, robot=c.robot.with_transmission(Transmission(np.diag(1 / ratio), np.zeros(c.robot.n), ident.Side.MOTOR)))
    same(by_ratio, by_matrix, 0.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_positions_of_the_motors_are_those_of_the_joints(name: str) -> None:
    c = case(name)
    motors = c.robot.transmission.motor_position(c.log.q)
    same(usual(name), c.fit(replace(c.log, q=None, q_motor=motors)), NEAR)


@pytest.mark.parametrize("name", ROBOTS)
def test_currents_with_constants_are_torques(name: str) -> None:
    c = case(name)
    constants = np.linspace(0.05, 0.3, c.robot.n)
    drive = replace(c.robot.transmission, measured=ident.Side.MOTOR)
    torque = c.fit(replace(c.log, tau={"motor": c.tau}), robot=c.robot.with_transmission(drive))
    currents = replace(c.log, tau={"current": c.tau / constants})
    same(torque, c.fit(currents, robot=c.robot.with_transmission(replace(drive, torque_constants=constants))), NEAR)


# --- joints that do not move by themselves -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("at", [0.0, 0.4])
def test_a_locked_joint_is_a_fixed_one(name: str, at: float) -> None:
    c = case(name)
    last = c.robot.joint_names[-1]
    locked = Robot.from_urdf(c.robot.source["urdf_text"], locked={last: at})
    root = root_of(c)
    joint = next(j for j in root.findall("joint") if j.get("name") == last)
    axis = joint.find("axis")
    xyz = np.array([1.0, 0, 0] if axis is None else [float(v) for v in axis.get("xyz").split()])
    child = joint.find("child")
    joint.remove(child)
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic"):
        for part in joint.findall(tag):
            joint.remove(part)
    etree.SubElement(joint, "child", link="turned")
    root.append(etree.Element("link", name="turned"))
    second = etree.SubElement(root, "joint", name="turn", type="fixed")
    etree.SubElement(second, "parent", link="turned")
    second.append(child)
    where = at * xyz / np.linalg.norm(xyz)
    slides = c.robot.joints[-1].prismatic
    assert slides or np.count_nonzero(xyz) == 1
    etree.SubElement(second, "origin", **{"xyz" if slides else "rpy": " ".join(map(repr, where.tolist()))})
    fixed = Robot.from_urdf(text_of(root))
    assert fixed.joint_names == locked.joint_names == c.robot.joint_names[:-1]
    log = replace(c.log, q=c.log.q[:, :-1], tau={"joint": c.tau[:, :-1]})
    one, two = (c.fit(log, robot=r) for r in (locked, fixed))
    same(one, two, NEAR)
    kept = Robot.from_urdf(c.robot.source["urdf_text"], joints=c.robot.joint_names[:-1], locked={last: at})
    same(one, c.fit(log, robot=kept), SAME)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_mimic_is_a_loop(name: str) -> None:
    c = case(name)
    first, last = c.robot.joint_names[0], c.robot.joint_names[-1]
    root = root_of(c)
    joint = next(j for j in root.findall("joint") if j.get("name") == last)
    etree.SubElement(joint, "mimic", joint=first, multiplier="0.3", offset="0.05")
    mimic = Robot.from_urdf(text_of(root))
    loop = Robot.from_urdf(c.robot.source["urdf_text"], loop={last: {first: 0.3, "offset": 0.05}})
    assert mimic.joint_names == loop.joint_names == c.robot.joint_names[:-1]
    log = replace(c.log, q=c.log.q[:, :-1], tau={"joint": c.tau[:, :-1]})
    same(c.fit(log, robot=mimic), c.fit(log, robot=loop), SAME)


# --- ways of computing ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kernel", kernels())
def test_every_kernel_finds_the_same(name: str, kernel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    c = case(name)
    monkeypatch.setenv("IDENT_KERNEL", "numpy" if kernel == "numpy" else "native")
    with using(kernel):
        assert kernel_choice.kernel().compiled == (kernel != "numpy")
        same(usual(name), c.fit(robot=again(c, c.robot.source["urdf_text"])), NEAR)


@pytest.mark.parametrize("name", ROBOTS)
def test_effects_named_for_every_joint_are_those_for_all(name: str) -> None:
    c = case(name)
    one = usual(name)
    two = ident.fit(c.log, c.robot, model=[ident.make_effect(e, joints=c.robot.joint_names) for e in EFFECTS], held=0)
    same(one, two, SAME)


@pytest.mark.parametrize("name", ROBOTS)
def test_rigid_torque_does_not_know_the_direction_of_time(name: str) -> None:
    """q(-t) has the same accelerations: without friction the same torque, backwards. Two filters' ends apart, the same values."""
    c = case(name)
    smooth = ident.ZeroPhase(cutoff_hz=8.0)
    backwards = replace(c.log, q=c.log.q[::-1].copy(), tau={k: v[::-1].copy() for k, v in c.log.tau.items()})
    rows = [e.samples for e in (c.fit(effects=(), preparation=smooth), c.fit(backwards, effects=(), preparation=smooth))]
    assert abs(rows[0] - rows[1]) <= 0.01 * rows[0]
    one, two = c.fit(effects=(), preparation=smooth), c.fit(backwards, effects=(), preparation=smooth)
    assert isinstance(one, Estimate)
    assert one.names == two.names
    np.testing.assert_allclose(one.values, two.values, rtol=0, atol=float(3 * np.max(one.std)))
