"""Export: the URDF predicts the identified torque and keeps everything else; MJCF and JSON say the same; nothing is overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from physical_models import puma_model, random_links

from ident import friction as fr
from ident.errors import ConfigurationError, UnsupportedError
from ident.exporting import Identified, export, export_urdf
from ident.exporting.mjcf import mjcf_text
from ident.exporting.urdf import patch_urdf, source_text
from ident.physical.pseudo_inertia import smallest_eigenvalues
from ident.regressor.rigid import inverse_dynamics, mass_matrix
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Transmission

Array = np.ndarray

#: Two moving joints, a locked one, fixed children with inertials of their own, a short right angle, comments, extensions.
URDF = """<?xml version="1.0" encoding="utf-8"?>
<!-- head: kept -->
<robot name="bench" xmlns:x="http://example.org/x">
  <!-- a comment with <tags> in it -->
  <link name="base"/>
  <link name="upper">
    <visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual>
    <inertial>
      <!-- inside -->
      <origin xyz="0.1 0 0.02" rpy="0 0.3 0"/>
      <mass   value="3.0"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/>
    </inertial>
  </link>
  <link name="plate"><inertial><origin xyz="0 0 0.01"/><mass value="0.2"/><inertia
      ixx='1e-3' ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3" /></inertial></link>
  <link name="fore"/>
  <link name="gripper">
    <inertial><origin xyz="0 0.02 0.05"/><mass value="0.4"/><inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>
  </link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <origin xyz="0 0 0.3" rpy="1.5708 0 0"/><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <joint name="bolt" type="fixed"><origin xyz="0.2 0.1 0" rpy="0.1 0.2 0.3"/><parent link="upper"/><child link="plate"/></joint>
  <joint name="elbow" type="continuous"><origin xyz="0.4 0 0" rpy="0 0 0"/><parent link="upper"/><child link="fore"/>
    <axis xyz="0 1 0"/></joint>
  <joint name="wrist" type="revolute">
    <origin xyz="0.3 0 0" rpy="0 0.4 0"/><parent link="fore"/><child link="gripper"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="3"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="gripper"/><child link="tool"/></joint>
  <transmission name="t1"><type>SimpleTransmission</type><joint name="shoulder"/></transmission>
  <x:extension kind="kept">text</x:extension>
</robot>
"""


def bench(tmp_path: Path, **options: object) -> Robot:
    file = tmp_path / "bench.urdf"
    file.write_bytes(URDF.encode())
    return Robot.from_urdf(file, locked={"wrist": 0.35}, **options)  # type: ignore[arg-type]


def torque_in_pinocchio(urdf: bytes, robot: Robot, q: Array, dq: Array, ddq: Array, held: dict[str, float]) -> Array:
    """Torque of an exported URDF loaded by Pinocchio itself, without any of our reading."""
    model = pin.buildModelFromXML(urdf.decode())
    model.gravity.linear[:] = robot.tree.gravity
    data = model.createData()
    out = []
    for x, v, a in zip(q, dq, ddq, strict=True):
        whole, rate, rise = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        positions = dict(zip([j.name for j in robot.tree_joints], x, strict=True)) | held
        for name, value in positions.items():
            joint = model.joints[model.getJointId(name)]
            if joint.nq == 2:
                whole[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                whole[joint.idx_q] = value
        index = [model.joints[model.getJointId(j.name)].idx_v for j in robot.tree_joints]
        rate[index], rise[index] = v, a
        out.append(pin.rnea(model, data, whole, rate, rise)[index])
    return np.array(out)


def states(robot: Robot, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    shape = (20, len(robot.tree_joints))
    return rng.uniform(-0.5, 0.5, shape), rng.standard_normal(shape), 3 * rng.standard_normal(shape)


@pytest.mark.parametrize("attached", ["keep", "move"])
def test_round_trip_through_pinocchio(tmp_path: Path, attached: str) -> None:
    """Loaded by Pinocchio the file gives the identified torque to 1e-9, links behind fixed and locked joints included."""
    robot = bench(tmp_path)
    links = random_links(np.random.default_rng(1), 2)
    links[:10] += robot.nominal[:10] * 2  # type: ignore[index]
    data, where = source_text(robot, None)
    found = patch_urdf(data, where, robot, links, attached=attached)
    q, dq, ddq = states(robot)
    wanted = inverse_dynamics(robot.tree, links, q, dq, ddq)
    got = torque_in_pinocchio(found.data, robot, q, dq, ddq, {"wrist": 0.35})
    assert np.abs(got - wanted).max() < 1e-9
    again = Robot.from_urdf(found.data.decode(), locked={"wrist": 0.35})
    assert np.abs(again.nominal - links).max() < 1e-12
    assert [b.link for b in found.bodies] == ["upper", "fore"]
    assert found.bodies[0].attached == ("plate",)
    assert found.bodies[1].attached == ("gripper", "tool")
    assert any("plate" in note for note in found.notes)
    kept = [b.kept for b in found.bodies]
    assert kept[0] == (attached == "keep")


def test_everything_else_stays(tmp_path: Path) -> None:
    """Byte by byte only the inertials and the rounded angle differ: comments, extensions, quotes and line breaks inside tags stay."""
    robot = bench(tmp_path)
    links = random_links(np.random.default_rng(1), 2)
    links += 2 * robot.nominal  # type: ignore[operator]
    text = patch_urdf(URDF.encode(), "x", robot, links, attached="keep").data.decode()
    before, after = URDF.splitlines(), text.splitlines()
    gone = [line.strip() for line in before if line not in after]
    # The upper link's origin, mass and inertia; the fore link, which gets an <inertial>; the shoulder's angle.
    assert [line.split()[0] for line in gone[:3]] == ["<origin", "<mass", "<inertia"]
    assert gone[3:5] == ['<link name="fore"/>', next(line.strip() for line in before if "1.5708" in line)][: len(gone) - 3]
    assert len(gone) == 5
    assert "<mass   value=" in text
    assert repr(np.pi / 2) in text
    start = text.index('  <link name="fore">')
    assert text[start:].splitlines()[1:6:4] == ["    <inertial>", "    </inertial>"]
    etree.fromstring(text.encode())


def test_line_ends_and_declaration_stay(tmp_path: Path) -> None:
    robot = bench(tmp_path)
    for data in (URDF.replace("\n", "\r\n").encode(), URDF.split("\n", 1)[1].encode()):
        text = patch_urdf(data, "x", robot, robot.nominal).data  # type: ignore[arg-type]
        assert (b"\r\n" in text) == (b"\r\n" in data)
        assert text[:20] == data[:20]
        assert b"\r\r" not in text
        etree.fromstring(text)


def test_keep_becomes_move_where_nothing_real_is_left(tmp_path: Path) -> None:
    """Identified lighter than its nominal attachment: the attachment gives up its inertial, and that is said."""
    robot = bench(tmp_path)
    links = random_links(np.random.default_rng(1), 2)
    links[10:] *= 0.01 / links[10]
    data, where = source_text(robot, None)
    found = patch_urdf(data, where, robot, links, attached="keep")
    assert not found.bodies[1].kept
    assert any("would leave no physical body" in note for note in found.notes)
    again = Robot.from_urdf(found.data.decode(), locked={"wrist": 0.35})
    assert np.abs(again.nominal - links).max() < 1e-12
    gripper = next(link for link in etree.fromstring(found.data).findall("link") if link.get("name") == "gripper")
    assert gripper.find("inertial") is None


def test_dynamics_are_written_on_the_joint_side(tmp_path: Path) -> None:
    robot = bench(tmp_path, transmission=np.array([-50.0, 100.0]), measured="motor")
    model = robot.rigid_body() + fr.RotorInertia() + fr.Viscous() + fr.Coulomb() + fr.Stribeck()
    values = nominal_values(model)
    links = random_links(np.random.default_rng(0), 2)
    values[:20] = links
    values[20:26] = [1e-4, 2e-4, 1e-3, 2e-3, 0.01, 0.02]
    target = tmp_path / "out.urdf"
    found = export(Identified(model, values), target)
    root = etree.fromstring(target.read_bytes())
    nodes = {j.get("name"): j.find("dynamics") for j in root.findall("joint")}
    assert float(nodes["shoulder"].get("damping")) == pytest.approx(1e-3 * 50**2)
    assert float(nodes["elbow"].get("friction")) == pytest.approx(0.02 * 100)
    assert nodes["wrist"] is None
    assert any("rotor inertia" in note for note in found.notes)
    assert any("stribeck" in note for note in found.notes)
    assert json.dumps(found.to_dict())
    assert "out.urdf" in found.text()
    # Read again, they are nominal values on either side; what a URDF has no place for is not known.
    again = Robot.from_urdf(target, transmission=np.array([-50.0, 100.0]), measured="motor", locked={"wrist": 0.0})
    declared = again.rigid_body() + fr.RotorInertia() + fr.Viscous() + fr.Coulomb()
    assert nominal_values(declared)[20:] == pytest.approx([0, 0, *values[22:26]])
    beside = again.rigid_body() + fr.Viscous(side="joint") + fr.Coulomb(joints=("elbow",), side="joint")
    assert nominal_values(beside)[20:] == pytest.approx([1e-3 * 50**2, 2e-3 * 100**2, 0.02 * 100])
    coupled = again.with_transmission(Transmission(np.array([[0.02, 0.0], [0.01, 0.01]]), np.zeros(2), "motor"))
    assert not np.any(nominal_values(coupled.rigid_body() + fr.Viscous())[20:])


@pytest.mark.parametrize("name", ["puma560", "panda", "ur5", "tiago", "kinova", "palletiser", "scara"])
def test_robots_by_name(name: str) -> None:
    """Mimic joints, loops, many links: the reloaded file has the identified bodies, whichever way attachments are treated."""
    robot = load_robot(name)
    source = robot.source
    for seed, attached in enumerate(("keep", "move")):
        links = random_links(np.random.default_rng(seed), robot.tree.nb)
        found = patch_urdf(*source_text(robot, None), robot, links, attached=attached)
        again = Robot.from_urdf(found.data.decode(), locked=source["locked"], joints=source["joints"], loop=source["loop"])
        assert np.abs(again.nominal - links).max() < 1e-12 * np.abs(links).max()


def test_floating_base() -> None:
    robot = load_robot("ur5", floating_base=True)
    links = random_links(np.random.default_rng(0), robot.tree.nb)
    found = patch_urdf(*source_text(robot, None), robot, links, attached="move")
    again = Robot.from_urdf(found.data.decode(), floating_base=True)
    assert found.bodies[0].joint == "floating base"
    assert np.abs(again.nominal - links).max() < 1e-12


def test_refusals(tmp_path: Path) -> None:
    robot = bench(tmp_path)
    data, where = source_text(robot, None)
    links = random_links(np.random.default_rng(0), 2)
    unreal = links.copy()
    unreal[4] = -1.0
    with pytest.raises(ConfigurationError, match="upper are physically inconsistent"):
        patch_urdf(data, where, robot, unreal)
    allowed = patch_urdf(data, where, robot, unreal, allow_inconsistent=True)
    assert np.abs(Robot.from_urdf(allowed.data.decode(), locked={"wrist": 0.35}).nominal - unreal).max() < 1e-12
    massless = links.copy()
    massless[0] = 0.0
    with pytest.raises(ConfigurationError, match="no mass"):
        patch_urdf(data, where, robot, massless, allow_inconsistent=True, attached="move")
    with pytest.raises(ConfigurationError, match="has no joint 'shoulder'"):
        patch_urdf(data.replace(b'"shoulder"', b'"other"'), where, robot, links)
    with pytest.raises(ConfigurationError, match="cannot be parsed"):
        patch_urdf(b"<robot", where, robot, links)
    extra = b'<link name="more"/><joint name="new" type="revolute"><parent link="tool"/><child link="more"/></joint></robot>'
    with pytest.raises(ConfigurationError, match="'new' moves"):
        patch_urdf(data.replace(b"</robot>", extra), where, robot, links)
    with pytest.raises(ConfigurationError, match="sets of inertial parameters"):
        patch_urdf(data, where, robot, links[:10])
    broken = data.replace(b'<mass value="0.2"/>', b"")
    with pytest.raises(ConfigurationError, match="plate"):
        patch_urdf(broken, where, robot, links)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        source_text(robot, tmp_path / "nowhere.urdf")


def puma() -> Identified:
    model = puma_model()
    return Identified(model, nominal_values(model))


def test_files_are_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "robot.json"
    target.write_text("mine")
    with pytest.raises(ConfigurationError, match="exists; nothing was written"):
        export(puma(), target)
    assert target.read_text() == "mine"
    export(puma(), target, force=True)
    assert json.loads(target.read_text())["schema"] == "ident.parameters/1"
    with pytest.raises(ConfigurationError, match="export format"):
        export(puma(), tmp_path / "robot.step")
    with pytest.raises(ConfigurationError, match="not a folder"):
        export(puma(), tmp_path / "nowhere" / "robot.json")
    assert [p.name for p in tmp_path.iterdir()] == ["robot.json"]


def test_json_holds_everything(tmp_path: Path) -> None:
    found = puma()
    export(found, tmp_path / "robot.json")
    body = json.loads((tmp_path / "robot.json").read_text())
    assert len(body["links"]) == 6
    assert len(body["parameters"]) == 78
    assert body["links"][5]["parameters"]["m"] == pytest.approx(2.9729, abs=1e-4)
    assert body["drive"]["armature"][2] == pytest.approx(3.12e-4, rel=1e-3)
    assert np.shape(body["transmission"]["K"]) == (6, 6)
    assert np.allclose([p["value"] for p in body["parameters"]], found.values)


def test_puma_urdf_and_friction_of_coupled_motors(tmp_path: Path) -> None:
    """Motors that share joints: <dynamics> stays as it is, and the reason is said."""
    found = export_urdf(puma(), None, tmp_path / "robot.urdf")
    assert any("share joints" in note for note in found.notes)
    assert b"<dynamics" not in (tmp_path / "robot.urdf").read_bytes()
    again = Robot.from_urdf(tmp_path / "robot.urdf")
    assert np.abs(again.nominal - puma().inertial).max() < 1e-12


def test_mjcf_is_the_same_robot() -> None:
    """Every body, joint and motor tendon is in the file with the right numbers (compared with MuJoCo itself where it is installed)."""
    found = puma()
    text, notes = mjcf_text(found.robot, found.inertial, found.drive())
    root = etree.fromstring(text)
    assert [b.get("name") for b in root.iter("body")] == [f"link{i}" for i in range(1, 7)]
    assert [float(b.find("inertial").get("mass")) for b in root.iter("body")] == pytest.approx(found.inertial[::10].tolist())
    tendons = root.findall("tendon/fixed")
    inverse = found.robot.transmission.K_inverse
    assert len(tendons) == 6
    rows = [{j.get("joint"): float(j.get("coef")) for j in t} for t in tendons]
    assert rows[5] == {f"joint{j + 1}": inverse[5, j] for j in range(6) if inverse[5, j]}
    assert float(tendons[2].get("armature")) == pytest.approx(found.drive()["armature"][2])
    assert any("tendon" in note for note in notes)


def test_mjcf_in_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    found = puma()
    text, _ = mjcf_text(found.robot, found.inertial, found.drive())
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    q, dq, _ = states(found.robot)
    inverse = found.robot.transmission.K_inverse
    rotors = inverse.T @ np.diag(found.drive()["armature"]) @ inverse
    for x, v in zip(q, dq, strict=True):
        data.qpos[:], data.qvel[:] = x, v
        mujoco.mj_forward(model, data)
        full = np.zeros((6, 6))
        mujoco.mj_fullM(model, data, full)
        assert np.allclose(full, mass_matrix(found.robot.tree, found.inertial, x[None])[0] + rotors, atol=1e-9)


def test_mjcf_diagonal_gears_loops_and_refusals() -> None:
    robot = load_robot("ur5", transmission=np.array([101.0, -101, 101, 54, 54, 54]))
    links = random_links(np.random.default_rng(0), 6)
    drive = {"armature": np.full(6, 1e-4), "damping": np.full(6, 1e-3), "frictionloss": np.full(6, 0.02)}
    text, _ = mjcf_text(robot, links, drive)
    joint = next(iter(etree.fromstring(text).iter("joint")))
    assert float(joint.get("armature")) == pytest.approx(1e-4 * 101**2)
    assert float(joint.get("frictionloss")) == pytest.approx(0.02 * 101)
    unreal = links.copy()
    unreal[4] = -1.0
    with pytest.raises(ConfigurationError, match="MuJoCo rejects"):
        mjcf_text(robot, unreal, drive)
    panda = load_robot("panda")
    text, notes = mjcf_text(panda, random_links(np.random.default_rng(0), panda.tree.nb), {})
    assert etree.fromstring(text).find("equality/joint") is not None
    assert any("soft in MuJoCo" in note for note in notes)
    palletiser = load_robot("palletiser")
    with pytest.raises(UnsupportedError, match="at once"):
        mjcf_text(palletiser, random_links(np.random.default_rng(0), palletiser.tree.nb), {})


def test_quaternions() -> None:
    from ident.exporting.mjcf import quaternion as _quaternion

    rng = np.random.default_rng(0)
    for _ in range(50):
        R = pin.Quaternion(*(x := rng.standard_normal(4)) / np.linalg.norm(x)).matrix()
        w, x, y, z = _quaternion(R)
        assert np.allclose(pin.Quaternion(w, x, y, z).matrix(), R, atol=1e-12)
    assert np.allclose(np.abs(_quaternion(np.diag([1.0, -1.0, -1.0]))), [0, 1, 0, 0])


def test_links_of_the_round_trip_are_real() -> None:
    assert np.all(smallest_eigenvalues(puma().inertial) > 0)
