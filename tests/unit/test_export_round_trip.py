"""Twenty arms by name, out as URDF, MJCF and JSON, and in again by Pinocchio's own parsers: the same torque, everything else untouched."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from physical_models import random_links

from ident.effects import rigid_body
from ident.errors import UnsupportedError
from ident.exporting import Identified, export
from ident.exporting.urdf import source_text
from ident.model import Model
from ident.regressor.rigid import inverse_dynamics
from ident.robots import load_robot
from ident.robots.robot import Robot

Array = np.ndarray

ARMS = (
    "allegro_left_hand", "baxter", "double_pendulum", "finger_edu", "kinova", "panda", "so100", "so101", "talos_left_arm", "tiago",
    "tiago_dual", "tiago_no_hand", "tiago_pro", "ur3", "ur3_gripper", "ur5", "ur5_gripper", "ur10", "xarm7", "z1",
)  # fmt: skip


def torque(model: pin.Model, robot: Robot, q: Array, dq: Array, ddq: Array) -> Array:
    """Torque (N, n) of the tree joints in Pinocchio's own recursion; other joints stand where they were locked."""
    model.gravity.linear[:] = robot.tree.gravity
    data = model.createData()
    held = dict(robot.source["locked"] or {})
    index = [model.joints[model.getJointId(j.name)].idx_v for j in robot.tree_joints]
    out = []
    for x, v, a in zip(q, dq, ddq, strict=True):
        whole, rate, rise = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for name, value in (held | dict(zip([j.name for j in robot.tree_joints], x, strict=True))).items():
            if not model.existJointName(name):
                continue
            joint = model.joints[model.getJointId(name)]
            place = slice(joint.idx_q, joint.idx_q + joint.nq)
            whole[place] = (np.cos(value), np.sin(value)) if joint.nq == 2 else value
        rate[index], rise[index] = v, a
        out.append(pin.rnea(model, data, whole, rate, rise)[index])
    return np.array(out)


def rest(text: bytes) -> bytes:
    """A URDF without what an export may change: <inertial>, <dynamics>, and the digits of right angles."""
    root = etree.fromstring(text, etree.XMLParser(remove_blank_text=True))
    for tag in ("inertial", "dynamics"):
        for node in list(root.iter(tag)):
            for comment in list(node.iter(etree.Comment)):
                node.addprevious(comment)
            node.getparent().remove(node)
    for joint in root.findall("joint"):
        origin = joint.find("origin")
        if origin is not None and origin.get("rpy"):
            origin.set("rpy", " ".join(f"{round(float(x), 2) + 0.0:.2f}" for x in origin.get("rpy").split()))
    for node in root.iter():
        node.tail = None
        if node.text is not None and not node.text.strip():
            node.text = None
    return etree.tostring(root, method="c14n", with_comments=True)


@pytest.mark.parametrize("name", ARMS)
def test_round_trip(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    links = random_links(np.random.default_rng(len(name)), robot.tree.nb)
    found = Identified(Model(robot, (rigid_body.RigidBody(),)), links)
    rng = np.random.default_rng(0)
    q = rng.uniform(-0.5, 0.5, (8, robot.tree.nq))
    dq, ddq = rng.standard_normal((2, 8, robot.tree.nq)) * 3
    wanted = inverse_dynamics(robot.tree, links, q, dq, ddq)
    size = np.abs(wanted).max()

    export(found, tmp_path / "out.urdf")
    written = (tmp_path / "out.urdf").read_bytes()
    got = torque(pin.buildModelFromXML(written.decode()), robot, q, dq, ddq)
    assert np.abs(got - wanted).max() <= 1e-9 * size
    source, _ = source_text(robot, None)
    assert rest(written) == rest(source)
    assert written.count(b"<!--") == source.count(b"<!--")
    assert written.count(b"<transmission") == source.count(b"<transmission")

    try:
        export(found, tmp_path / "out.xml")
    except UnsupportedError:  # a joint that follows several others
        assert np.any(np.count_nonzero(robot.loop.W, axis=1) > 1)
    else:
        got = torque(pin.buildModelFromMJCF(str(tmp_path / "out.xml")), robot, q, dq, ddq)
        assert np.abs(got - wanted).max() <= 1e-9 * size

    export(found, tmp_path / "out.json")
    body = json.loads((tmp_path / "out.json").read_text())
    again = np.array([list(link["parameters"].values()) for link in body["links"]]).reshape(-1)
    assert np.array_equal(again, links)
