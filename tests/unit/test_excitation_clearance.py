"""Designed motions are safe to run: checked by another program path, with the meshes themselves, a thousand times a second."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from ident.effects.motion import Coordinates
from ident.errors import ConfigurationError
from ident.excitation import BSplineFamily, Excitation, FourierFamily, Limits, Surroundings, excite, random_excitation
from ident.excitation.certificate import certify
from ident.excitation.clearance import Clearance
from ident.excitation.surroundings import Safety
from ident.friction import RotorInertia, Viscous
from ident.robots import Robot, load_robot
from ident.simulation.trajectory import Trajectory

PANDA = [f"panda_joint{i}" for i in range(1, 8)]
SRDF = {"ur5": "ur5.srdf", "panda": "panda.srdf"}


def robot_of(name: str) -> Robot:
    try:
        return load_robot(name, joints=PANDA if name == "panda" else None)
    except ConfigurationError as error:
        pytest.skip(f"robot {name} is not installed: {error}")


class Oracle:
    """Collisions by Pinocchio on the URDF file as it is, with its meshes (not hulls) and the pairs that its SRDF leaves."""

    def __init__(self, robot: Robot, srdf: str) -> None:
        import pinocchio as pin

        urdf = Path(robot.source["urdf"])
        self.robot, self.pin = robot, pin
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.shapes = pin.buildGeomFromUrdf(self.model, str(urdf), pin.COLLISION, package_dirs=[str(p) for p in urdf.parents])
        self.shapes.addAllCollisionPairs()
        pin.removeCollisionPairs(self.model, self.shapes, str(urdf.parents[1] / "srdf" / srdf))
        self.data, self.geometry = self.model.createData(), self.shapes.createData()

    def position(self, q: np.ndarray) -> np.ndarray:
        full = self.pin.neutral(self.model)
        for name, value in zip(self.robot.joint_names, q, strict=True):
            full[self.model.joints[self.model.getJointId(name)].idx_q] = value
        return full

    def collisions(self, motion: np.ndarray) -> int:
        """Rows of motion (N, n) in which meshes touch."""
        return sum(self.pin.computeCollisions(self.model, self.data, self.shapes, self.geometry, self.position(q), True) for q in motion)

    def lowest(self, motion: np.ndarray, above: int) -> float:
        """Lowest vertex of any mesh on joints from number `above` on, over rows of motion."""
        least = np.inf
        for q in motion:
            self.pin.updateGeometryPlacements(self.model, self.data, self.shapes, self.geometry, self.position(q))
            for shape, placed in zip(self.shapes.geometryObjects, self.geometry.oMg, strict=True):
                if shape.parentJoint >= above and hasattr(shape.geometry, "vertices"):
                    heights = np.asarray(shape.geometry.vertices()) @ placed.rotation[2] + placed.translation[2]
                    least = min(least, float(heights.min()))
        return least


def every_millisecond(found: Excitation) -> np.ndarray:
    return found.trajectory.sample(np.arange(0.0, found.trajectory.duration, 1e-3)).q


def design(name: str, seed: int, room: Surroundings) -> Excitation:
    model = robot_of(name).rigid_body() + RotorInertia() + Viscous()
    return excite(model, family=FourierFamily(6.0, 4), starts=1, iterations=4, seed=seed, surroundings=room)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_no_collision_and_above_ground_every_millisecond(name: str) -> None:
    found = design(name, 3, Surroundings(ground=0.0, clearance=0.02))
    oracle = Oracle(found.model.robot, SRDF[name])
    motion = every_millisecond(found)
    assert oracle.collisions(motion) == 0
    assert oracle.lowest(motion[::5], above=2) >= 0.02 - 1e-4
    assert found.safety is not None
    assert found.safety.certified
    assert not found.safety.invented
    limits = found.limits
    assert np.all(np.abs(found.trajectory.sample(np.linspace(0, 6, 6001)).dq) <= limits.velocity + 1e-9)
    for t in (0.0, 6.0):
        still = found.trajectory.sample(np.array([t]))
        np.testing.assert_allclose(still.dq, 0.0, atol=1e-9)
        np.testing.assert_allclose(still.ddq, 0.0, atol=1e-8)


def test_the_oracle_sees_what_an_unchecked_motion_does() -> None:
    robot = robot_of("ur5")
    oracle = Oracle(robot, SRDF["ur5"])
    chance = [random_excitation(robot.rigid_body(), family=FourierFamily(6.0, 4), seed=s) for s in range(3)]
    rows = np.concatenate([every_millisecond(c)[::20] for c in chance])
    assert oracle.collisions(rows) > 0
    assert oracle.lowest(rows, above=2) < 0.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_many_problems(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    room = Surroundings(ground=float(rng.uniform(-0.1, 0.0)), clearance=float(rng.uniform(0.01, 0.05)))
    found = design(name, seed, room)
    oracle = Oracle(found.model.robot, SRDF[name])
    motion = every_millisecond(found)
    assert oracle.collisions(motion) == 0
    assert room.ground is not None
    assert oracle.lowest(motion[::5], above=3) >= room.ground + room.clearance - 1e-4


ARM = """<robot name="a"><link name="base"/>
  <link name="one"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="two"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.3 0 0"/><geometry>{shape}</geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="50"/></joint></robot>"""
BALL = '<sphere radius="0.05"/>'


@pytest.mark.parametrize(
    ("shape", "below"),
    [
        (BALL, lambda angle: 0.05),
        ('<box size="0.2 0.1 0.04"/>', lambda angle: 0.1 * abs(np.sin(angle)) + 0.02 * abs(np.cos(angle))),
    ],
)
def test_height_above_ground_is_that_of_geometry(shape: str, below: Callable[[float], float]) -> None:
    """A planar arm at 1 m: height of the shape at its end, in closed form."""
    robot = Robot.from_urdf(ARM.format(shape=shape))
    clearance = Clearance(robot, Surroundings(ground=-0.2, clearance=0.0), Limits.of(robot))
    (column,) = [k for k, c in enumerate(clearance.constraints) if c.what == "two and the ground"]
    for q in np.random.default_rng(0).uniform(-2, 2, (20, 2)):
        angle = q.sum()
        height = 1.0 - 0.5 * np.sin(q[0]) - 0.3 * np.sin(angle) - below(angle)
        assert clearance.distances(q[None])[0, column] == pytest.approx(height + 0.2, abs=1e-9)


@pytest.mark.parametrize(("name", "ground"), [("panda", 0.0), ("puma560", -0.67), ("palletiser", 0.0)])
def test_gradient_of_the_barrier(name: str, ground: float) -> None:
    """Against central differences, closed loops (palletiser) and capsules included; but where the nearest points jump within a step."""
    robot = robot_of(name)
    limits = Limits.of(robot)
    clearance = Clearance(robot, Surroundings(ground=ground), limits)
    rng = np.random.default_rng(1)
    q = rng.uniform(limits.lower, limits.upper, (2000, robot.n))
    room = (clearance.slack(q, 1.0) - clearance.margin).min(axis=1)
    q = q[np.argsort(np.where(room > 0.002, room, np.inf))[:30]]
    h, off = 1e-5, []
    for row in q:
        _, gradient = clearance.barrier(row[None])
        assert np.abs(gradient).max() > 0
        d = rng.normal(size=robot.n)
        slope = (clearance.barrier((row + h * d)[None])[0] - clearance.barrier((row - h * d)[None])[0]) / (2 * h)
        off.append(abs(gradient[0] @ d - slope) / (abs(slope) + 0.01 * np.linalg.norm(gradient)))
    assert np.mean(np.array(off) < 1e-3) > 0.8
    assert np.median(off) < 1e-4


@dataclass(frozen=True)
class Dip(Trajectory):
    """Standing still but for a dip of 6 ms between two samples of a coarse look."""

    depth: float

    @property
    def duration(self) -> float:
        return 1.0

    @property
    def n(self) -> int:
        return 2

    def _sample(self, t: np.ndarray) -> Coordinates:
        def dip(t: np.ndarray) -> np.ndarray:
            s = np.clip((t - 0.507) / 0.006, 0.0, 1.0)
            return self.depth * 64 * (s * (1 - s)) ** 3

        q, dq = np.zeros((2, len(t), 2))
        q[:, 0], dq[:, 0] = dip(t), (dip(t + 1e-7) - dip(t - 1e-7)) / 2e-7
        return Coordinates(q, dq, np.zeros_like(q))


def test_what_happens_between_samples_is_seen() -> None:
    robot = Robot.from_urdf(ARM.format(shape=BALL))
    limits = Limits.of(robot, acceleration=2e5)
    clearance = Clearance(robot, Surroundings(ground=0.6, clearance=0.0), limits)
    assert certify(clearance, Dip(0.0), limits).holds
    assert certify(clearance, Dip(0.2), limits).holds
    assert not certify(clearance, Dip(0.6), limits).holds


def test_no_safe_motion_is_refused_with_what_is_in_the_way() -> None:
    model, planar = robot_of("puma560").rigid_body(), Robot.from_urdf(ARM.format(shape=BALL)).rigid_body()
    with pytest.raises(ConfigurationError, match=r"every posture overlap: .*link4 and the ground"):
        excite(model, surroundings=Surroundings(ground=1.2), starts=1, iterations=1)
    with pytest.raises(ConfigurationError, match=r"none of 2000 random postures .*the wall at"):
        excite(planar, surroundings=Surroundings.within([-0.3, 0.3, -1, 1, 0.9, 1.1], ground=None), starts=1, iterations=1)
    with pytest.raises(ConfigurationError, match="lower and an upper bound"):
        Surroundings.within([1, 0, 0, 1, 0, 1])


def test_walls_hold() -> None:
    """A workspace: the ball at the end of the arm stays inside, by plane geometry."""
    robot = Robot.from_urdf(ARM.format(shape=BALL))
    room = Surroundings.within([-1, 0.7, -1, 1, 0.4, 1.9], ground=None, clearance=0.01)
    found = excite(robot.rigid_body(), family=BSplineFamily(4.0, 8), surroundings=room, starts=1, iterations=5)
    q = found.trajectory.sample(np.linspace(0, 4, 4001)).q
    x = 0.5 * np.cos(q[:, 0]) + 0.3 * np.cos(q.sum(axis=1)) + 0.05
    z = 1.0 - 0.5 * np.sin(q[:, 0]) - 0.3 * np.sin(q.sum(axis=1))
    assert x.max() <= 0.7 - 0.01 + 1e-4
    assert z.min() - 0.05 >= 0.4 + 0.01 - 1e-4
    assert np.ptp(q, axis=0).min() > 0.05, "and it still moves"


def test_what_was_not_looked_at_is_said(tmp_path: Path) -> None:
    model = robot_of("scara").rigid_body()
    assert "NOT checked: collisions of any kind" in str(excite(model, starts=1, iterations=1))
    found = excite(model, starts=1, iterations=1, surroundings=Surroundings(ground=None))
    text = str(found)
    assert "NOT checked: cables" in text
    assert "taken as a capsule" in text
    assert "margins against the limits" in text
    assert found.to_dict()["safety"]["capsules"]["links"]
    file = found.to_ros(tmp_path / "motion.yaml")
    text = file.read_text()
    assert json.loads(re.search(r"^joint_names: (.*)$", text, re.MULTILINE)[1]) == list(model.robot.joint_names)
    stamps = re.findall(r"^  time_from_start: {sec: (\d+), nanosec: (\d+)}$", text, re.MULTILINE)
    times = np.array([int(s) + 1e-9 * int(ns) for s, ns in stamps])
    assert times[-1] == pytest.approx(found.trajectory.duration)
    expected = found.trajectory.sample(times)
    for key, values in (("- positions", expected.q), ("  velocities", expected.dq), ("  accelerations", expected.ddq)):
        rows = [json.loads(row) for row in re.findall(rf"^{key}: (.*)$", text, re.MULTILINE)]
        np.testing.assert_allclose(rows, values, atol=1e-6)


def test_a_missing_mesh_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text(ARM.format(shape='<mesh filename="package://nowhere/m.stl"/>'))
    robot = Robot.from_urdf(tmp_path / "a.urdf")
    if "ROS_PACKAGE_PATH" in os.environ:
        pytest.skip("ROS is set up here")
    clearance = Clearance(robot, Surroundings(), Limits.of(robot))
    assert "package://nowhere/m.stl" in " ".join(clearance.bodies.notes)
    assert "two" in clearance.bodies.invented


def test_a_base_frame_that_is_not_on_the_ground_is_told() -> None:
    """The frame of the PUMA is at its shoulder: nobody knows where its ground is, until it is said."""
    model = robot_of("puma560").rigid_body()
    found = excite(model, surroundings=Surroundings(), starts=1, iterations=1)
    assert "NOT checked: the ground" in str(found)
    found = excite(model, surroundings=Surroundings(ground=-0.67), starts=1, iterations=1)
    assert "NOT checked: the ground" not in str(found)
    assert any("the ground" in what for what, _, _ in found.safety.nearest)


def test_a_mesh_without_a_hull_is_a_box(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where coal cannot hold a hull, the box about the mesh stands for it: it reaches at least as far."""
    import coal

    robot = robot_of("ur5")
    hulls = Clearance(robot, Surroundings(), Limits.of(robot))

    def refuse(*_: object) -> None:
        raise RuntimeError("Too many neighbor")

    monkeypatch.setattr(coal.BVHModelBase, "buildConvexHull", refuse)
    boxes = Clearance(robot, Surroundings(), Limits.of(robot))
    assert "forearm_link" in " ".join(boxes.notes)
    columns = {c.what: k for k, c in enumerate(hulls.constraints)}
    q = np.random.default_rng(0).uniform(-2, 2, (20, 6))
    near, far = boxes.distances(q), hulls.distances(q)
    common = [(k, columns[c.what]) for k, c in enumerate(boxes.constraints) if c.what in columns and c.plane >= 0]
    assert common
    for k, other in common:
        assert np.all(near[:, k] <= far[:, other] + 1e-9)


def test_one_link_without_ground_or_walls_meets_nothing_and_the_text_says_so() -> None:
    fields = {field.name: () for field in dataclasses.fields(Safety)} | {"clearance": 0.02, "certified": True, "radius": 0.05}
    said = Safety(**fields).lines()
    assert said[0].startswith("nothing to keep clear of")
    assert not any("nearest" in line for line in said)
