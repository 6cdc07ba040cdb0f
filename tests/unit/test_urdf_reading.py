"""Reading URDFs: what is settled, what is refused, and how the message reads."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ident import ConfigurationError, Robot
from ident.robots.urdf import exact_angle, prepare_urdf, read_urdf

INERTIAL = '<inertial><mass value="1"/><origin xyz="0.1 0 0"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'


def joint(name, parent, child, kind="revolute", inside=""):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def urdf(*joints, links=None, inertial=INERTIAL, attributes=""):
    names = links if links is not None else ["base", *(f"l{i}" for i in range(1, len(joints) + 1))]
    body = "".join(f'<link name="{n}">{inertial if n != names[0] else ""}</link>' for n in names)
    return f'<robot name="r"{attributes}>{body}{"".join(joints)}</robot>'


def chain(*insides, kinds=None):
    kinds = kinds or ["revolute"] * len(insides)
    names = ["base", *(f"l{i}" for i in range(1, len(insides) + 1))]
    return urdf(
        *(joint(f"j{i + 1}", names[i], names[i + 1], kind, inside) for i, (inside, kind) in enumerate(zip(insides, kinds, strict=True)))
    )


@pytest.mark.parametrize(
    ("written", "multiple"),
    [
        ("1.57", 2),
        ("1.571", 2),
        ("1.5708", 2),
        ("1.5707", 2),
        ("-1.570796", -2),
        ("1.570796325", 2),
        ("1.57079632679489661923", 2),
        ("1.5707963e0", 2),
        ("3.14", 4),
        ("3.1416", 4),
        ("3.1415", 4),
        ("-3.14159", -4),
        ("4.71239", 6),
        ("6.2832", 8),
        ("0.785", 1),
        ("0.7854", 1),
        ("-2.356", -3),
        ("0", 0),
        ("-0.0", 0),
        ("1e-17", 0),
        ("-4.76837e-07", 0),
    ],
)
def test_angles_taken_as_exact(written, multiple):
    assert exact_angle(written) == pytest.approx(multiple * math.pi / 4, abs=0)


@pytest.mark.parametrize(
    "written",
    [
        "1.5701",
        "1.5700",
        "1.5710",
        "0.7851",
        "0.79",
        "0.78",
        "2.36",
        "3.1",
        "1.6",
        "2",
        "3",
        "1.55",
        "0.3",
        "3.1406",
        "5.4949e-05",
        "inf",
        "nan",
        "x",
        "",
    ],
)
def test_angles_left_as_written(written):
    assert exact_angle(written) is None


def test_rounded_right_angles_are_exact_and_said():
    robot = Robot.from_urdf(chain("", '<origin rpy="1.57 0 0"/>', '<origin rpy="0 0.3 -1.5701"/>'))
    assert robot.tree.rotation[1] == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), abs=1e-15)
    assert robot.notes == ("rpy of j2 taken as exact multiples of pi/4 (moved by at most 8.0e-04 rad).",)
    calibrated = robot.tree.rotation[2]
    assert calibrated[0, 0] == pytest.approx(math.cos(0.3) * math.cos(-1.5701))


def test_axes_are_unit_and_exact():
    axes = ["0 0 2", "0 0 -1", "1 1 0", "1 0.0000001 0"]
    robot = Robot.from_urdf(chain(*(f'<axis xyz="{a}"/>' for a in axes)))
    half = math.sqrt(0.5)
    assert robot.tree.axis == pytest.approx(np.array([[0, 0, 1], [0, 0, -1], [half, half, 0], [1, 0, 0]]), abs=1e-15)


def test_axis_defaults_to_x():
    assert Robot.from_urdf(chain("")).tree.axis[0] == pytest.approx([1, 0, 0], abs=0)


def test_kinds_and_limits():
    inside = '<limit lower="-1" upper="2" velocity="3" effort="4"/>'
    text = chain(inside, inside, inside, '<limit upper="0.5"/>', "", kinds=["revolute", "continuous", "prismatic", "revolute", "revolute"])
    robot = Robot.from_urdf(text)
    assert [j.kind for j in robot.joints] == ["revolute", "continuous", "prismatic", "revolute", "revolute"]
    assert [(j.lower, j.upper) for j in robot.joints] == [(-1, 2), (-math.inf, math.inf), (-1, 2), (0, 0.5), (-math.inf, math.inf)]
    assert (robot.joints[0].velocity, robot.joints[0].effort) == (3, 4)
    assert (robot.joints[4].velocity, robot.joints[4].effort) == (math.inf, math.inf)
    assert robot.tree.prismatic.tolist() == [False, False, True, False, False]
    assert robot.model.nq == robot.model.nv == 5


def test_default_namespace_comments_and_declaration():
    text = '<?xml version="1.0"?>\n<!-- ${not xacro} -->\n' + urdf(joint("j1", "base", "l1"), attributes=' xmlns="http://www.ros.org"')
    assert Robot.from_urdf("\n  <!-- leading -->" + text[text.index("<robot") :]).n == 1
    assert prepare_urdf(text.encode()).kinds == {"j1": "revolute"}


def test_xacro_namespace_alone_is_no_xacro():
    assert Robot.from_urdf(urdf(joint("j1", "base", "l1"), attributes=' xmlns:xacro="http://wiki.ros.org/xacro"')).n == 1


XACRO = ' xmlns:xacro="http://wiki.ros.org/xacro"'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", "cannot be parsed"),
        ("<robot></robots>", "cannot be parsed"),
        ("<sdf><model/></sdf>", "root element is <sdf>, not <robot>"),
        (f'<robot{XACRO}><xacro:include filename="a.xacro"/></robot>', "xacro template"),
        (chain('<origin rpy="${pi/2} 0 0"/>'), "xacro template"),
        ('<robot name="r"/>', "there is no <link>"),
        (urdf(joint("j1", "base", "l1", "planar")), "joint 'j1' has type 'planar'; supported are continuous, fixed, prismatic, revolute"),
        (urdf(joint("j1", "base", "l1", "floating")), "floating_base=True"),
        (urdf(joint("j1", "base", "l1", "")), "joint 'j1' has type ''"),
        (urdf(joint("", "base", "l1")), "a <joint> has no name"),
        (urdf(joint("j1", "base", "l1"), joint("j1", "l1", "l2")), "two joints are named 'j1'"),
        (urdf(joint("j1", "base", "l1"), links=["base", "l1", "l1"]), "two links are named 'l1'"),
        (urdf(joint("j1", "base", "nowhere")), "joint 'j1': its child link 'nowhere' is not declared"),
        ('<robot name="r"><link name="a"/><joint name="j1" type="fixed"><parent link="a"/></joint></robot>', "joint 'j1' lacks <child"),
        (urdf(joint("j1", "base", "l1"), joint("j2", "l2", "l1")), "link 'l1' is the child of two joints"),
        (urdf(joint("j1", "base", "l1"), links=["base", "l1", "l2"]), "base, l2 have no parent"),
        (urdf(joint("j1", "l2", "l1"), joint("j2", "l1", "l2")), "l1, l2 form a loop"),
        (urdf(joint("j1", "a", "b"), joint("j2", "b", "a"), links=["a", "b"]), "a, b form a loop"),
        (chain('<axis xyz="0 0 0"/>'), "joint 'j1': its axis is the zero vector"),
        (chain('<axis xyz="0 z 0"/>'), "joint 'j1': 'z' is not a number"),
        (chain('<axis xyz="0 0"/>'), "axis xyz='0 0' does not hold three finite numbers"),
        (chain('<origin rpy="0 0"/>'), "rpy='0 0' does not hold three finite numbers"),
        (chain('<origin xyz="0 inf 0"/>'), "does not hold three finite numbers"),
        (chain('<limit lower="low"/>'), "joint 'j1': 'low' is not a number"),
        (chain('<limit lower="nan" upper="1"/>'), "joint 'j1': 'nan' is not a number"),
        (chain("", '<mimic joint="j2"/>'), "joint 'j2' mimics itself"),
        (chain('<mimic joint="j2"/>', '<mimic joint="j1"/>'), "mimics itself, through j1, j2"),
        (chain("", kinds=["fixed"]), "has no moving joint"),
    ],
)
def test_refusals(text, message):
    with pytest.raises(ConfigurationError) as error:
        Robot.from_urdf(text)
    assert message in str(error.value)
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ('value="1"', 'value="4kg"', "link 'l1': <mass value='4kg'>: '4kg' is not a finite number. Write only the number"),
        ('value="1"', 'value="4,5"', "'4,5' is not a finite number. Use a decimal point, not a comma"),
        ('value="1"', 'value="1_000"', "'1_000' is not"),
        ('xyz="0.1 0 0"', 'xyz="0.1 l 0"', "<origin xyz='0.1 l 0'>: 'l' is not"),
        ('ixx="0.1"', 'ixx="nan"', "<inertia ixx='nan'>: 'nan' is not"),
        ('iyz="0"', 'iyz=""', "<inertia iyz=''>: '' is not"),
    ],
)
def test_inertials_that_hold_no_numbers_are_refused(right, wrong, message):
    assert right in INERTIAL
    with pytest.raises(ConfigurationError) as error:
        Robot.from_urdf(urdf(joint("j1", "base", "l1"), inertial=INERTIAL.replace(right, wrong)))
    assert message in str(error.value)


def test_missing_and_unreadable_files(tmp_path):
    with pytest.raises(ConfigurationError, match=r"no\.urdf: no such file"):
        read_urdf(tmp_path / "no.urdf")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_urdf(tmp_path)
    empty = tmp_path / "empty.urdf"
    empty.write_text("")
    with pytest.raises(ConfigurationError, match=r"empty\.urdf: cannot be parsed"):
        Robot.from_urdf(empty)


def test_mimic_chain_is_bound_to_its_head():
    text = chain("", '<mimic joint="j1" multiplier="2" offset="0.1"/>', '<mimic joint="j2" multiplier="-3" offset="0.5"/>')
    robot = Robot.from_urdf(text)
    assert robot.joint_names == ("j1",)
    assert robot.loop.W == pytest.approx(np.array([[1], [2], [-6]]), abs=0)
    assert robot.loop.offset == pytest.approx([0, 0.1, 0.2])
    assert robot.notes == ("j2, j3 mimic j1: taken as rigidly coupled (dependent), not as joints of their own.",)


def test_mimic_of_what_is_not_there_is_a_joint_of_its_own():
    robot = Robot.from_urdf(chain("", '<mimic joint="gone"/>'))
    assert robot.joint_names == ("j1", "j2")
    assert "which is not in the file" in robot.notes[0]


def test_mimic_of_a_fixed_joint_is_locked():
    robot = Robot.from_urdf(chain("", "", '<mimic joint="j2" offset="0.4"/>', kinds=["revolute", "fixed", "prismatic"]))
    assert robot.joint_names == ("j1",)
    assert robot.loop.is_trivial
    assert robot.model.inertias[1].lever[0] == pytest.approx((0.1 + 0.1 + 0.5) / 3)
