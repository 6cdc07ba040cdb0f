"""Where a motion starts, how the robot gets there, how hard its accelerations may change, and what it is shown as."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from ident.errors import ConfigurationError
from ident.excitation import BSplineFamily, Clearance, Family, FourierFamily, Limits, NoWay, Surroundings, excite
from ident.excitation.clearance import NearMemory
from ident.excitation.placements import ShapePlacements, segment_gap
from ident.robots import Robot, load_robot
from ident.robots.bodies import Bodies

LINK = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
#: A planar arm at 1 m, in the plane x z, with a ball of 5 cm at its end, 0.3 m beyond its second joint.
ARM = f"""<robot name="a"><link name="base"/><link name="one">{LINK}</link>
  <link name="two">{LINK}<collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="500"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="500"/></joint></robot>"""
OPEN = Surroundings(ground=None, clearance=0.01, link_radius=0.02)


def ball(q: np.ndarray) -> np.ndarray:
    """Centre of the ball (N, 3), in closed form."""
    x = 0.5 * np.cos(q[:, 0]) + 0.3 * np.cos(q.sum(axis=1))
    return np.column_stack([x, 0.0 * x, 1.0 - 0.5 * np.sin(q[:, 0]) - 0.3 * np.sin(q.sum(axis=1))])


def box_file(folder: Path, low: tuple[float, ...], high: tuple[float, ...], name: str = "box.obj", holes: int = 0) -> Path:
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    sides = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 7, 5),
        (4, 6, 7),
        (0, 5, 1),
        (0, 4, 5),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 7, 3),
        (1, 5, 7),
    ]
    faces = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in sides[holes:])
    file = folder / name
    file.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + faces)
    return file


def box_gap(points: np.ndarray, low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    """Distance of points outside a box from it."""
    return np.linalg.norm(np.maximum(np.maximum(np.array(low) - points, points - np.array(high)), 0.0), axis=1)


@pytest.mark.parametrize("family", [FourierFamily(4.0, 3), BSplineFamily(4.0, 9)])
@pytest.mark.parametrize("room", [None, OPEN])
def test_starts_and_ends_at_rest_at_the_posture_given(family: Family, room: Surroundings | None) -> None:
    robot = Robot.from_urdf(ARM)
    posture = [0.4, -1.1]
    found = excite(robot.rigid_body(), family=family, posture=posture, surroundings=room, starts=1, iterations=4)
    for t in (0.0, 4.0):
        motion = found.trajectory.sample(np.array([t]))
        np.testing.assert_allclose(motion.q[0], posture, atol=1e-9)
        np.testing.assert_allclose(motion.dq, 0.0, atol=1e-9)
        np.testing.assert_allclose(motion.ddq, 0.0, atol=1e-8)
    assert np.ptp(found.trajectory.sample(np.linspace(0, 4, 400)).q, axis=0).min() > 0.1


@pytest.mark.parametrize("family", [FourierFamily(4.0, 3), BSplineFamily(4.0, 9)])
def test_jerk_is_limited(family: Family) -> None:
    """By differences of accelerations, and it costs something."""
    robot = Robot.from_urdf(ARM)
    free = excite(robot.rigid_body(), family=family, starts=1, iterations=4)
    t = np.linspace(0.0, 4.0, 8001)

    def jerk(found: object) -> float:
        return float(np.abs(np.diff(found.trajectory.sample(t).ddq, axis=0) / t[1]).max())  # type: ignore[attr-defined]

    limit = 0.4 * jerk(free)
    found = excite(robot.rigid_body(), family=family, limits=Limits.of(robot, jerk=limit), starts=1, iterations=4)
    assert 0.5 * limit < jerk(found) <= limit + 1e-9
    assert found.shares["jerk"] <= 1.0
    assert max(m.jerk for m in found.margins) == pytest.approx(jerk(found), rel=1e-2)
    assert found.value > free.value


def test_approach_goes_round_what_is_in_the_way(tmp_path: Path) -> None:
    """From above a box to below it: a straight line in joint space would sweep the ball through it."""
    robot = Robot.from_urdf(ARM)
    low, high = (0.55, -0.2, 0.9), (1.0, 0.2, 1.1)
    room = Surroundings(ground=None, clearance=0.02, link_radius=0.02, obstacles=[box_file(tmp_path, low, high)])
    start, here = np.array([0.9, 0.2]), np.array([-0.9, -0.2])
    straight = here + np.linspace(0, 1, 200)[:, None] * (start - here)
    assert box_gap(ball(straight), low, high).min() < 0.05
    found = excite(robot.rigid_body(), posture=start, present=here, surroundings=room, starts=1, iterations=3)
    assert found.approach is not None
    whole = found.whole
    t = np.arange(0.0, whole.duration, 1e-3)
    motion = whole.sample(t)
    assert box_gap(ball(motion.q), low, high).min() >= 0.05 + 0.02 - 1e-4
    np.testing.assert_allclose(motion.q[0], here, atol=1e-12)
    np.testing.assert_allclose(whole.sample(np.array([found.approach.duration])).q[0], start, atol=1e-9)
    before = t <= found.approach.duration
    assert np.abs(motion.dq[before]).max() <= 0.3 * 0.9 * 2 + 1e-9, "slowly"
    assert np.abs(np.diff(motion.q, axis=0)).max() < 2 * 1e-3, "without a jump"
    assert "the way to the first posture" not in str(found)
    assert "before it, an approach" in str(found)
    assert found.to_frame()["t"].iloc[-1] >= whole.duration - 1e-9


def test_postures_that_cannot_be_are_refused_with_the_reason(tmp_path: Path) -> None:
    robot = Robot.from_urdf(ARM)
    model, quick = robot.rigid_body(), {"starts": 1, "iterations": 1}
    cage = [box_file(tmp_path, (0.6, -0.2, z), (1.2, 0.2, z + 0.1), f"{z}.obj") for z in (0.72, 1.18)]
    room = Surroundings(ground=None, clearance=0.02, link_radius=0.02, obstacles=cage)
    with pytest.raises(NoWay, match=r"in the present posture two and obstacle 1.18.obj .*mm"):
        excite(model, present=[-0.3, 0.0], surroundings=room, **quick)
    with pytest.raises(ConfigurationError, match=r"in the start posture two and obstacle 0.72.obj"):
        excite(model, posture=[0.3, 0.0], surroundings=room, **quick)
    with pytest.raises(ConfigurationError, match="outside its range"):
        excite(model, present=[4.0, 0.0], **quick)
    walled = Surroundings(
        ground=None, clearance=0.02, link_radius=0.02, obstacles=[box_file(tmp_path, (-2, -1, 0.9), (2, 1, 1.1), "floor.obj")]
    )
    with pytest.raises(ConfigurationError, match=r"in every posture .* obstacle floor.obj are nearer"):
        excite(model, surroundings=walled, **quick)


def test_a_way_keeps_to_what_the_motors_can_hold() -> None:
    """From hanging down to pointing up no motor goes that cannot hold the arm level; a present posture that it cannot hold is refused; and
    where the outer link can be folded on the way, it is."""
    robot = Robot.from_urdf(ARM)
    model, quick = robot.rigid_body(), {"starts": 1, "iterations": 1}
    level = 9.81 * 0.5  # N m at joint a, the mass of link two at joint b
    weak = Limits.of(robot, torque=[0.5 * level, 50.0])
    with pytest.raises(NoWay, match=r"3000 tries found no way .* joint a would need .* % of its torque limit"):
        excite(model, posture=[1.5, 0.0], present=[-1.5, 0.0], limits=weak, **quick)
    with pytest.raises(NoWay, match=r"in the present posture joint a takes 200 % of its torque limit merely to hold still"):
        excite(model, posture=[1.5, 0.0], present=[0.0, 0.0], limits=weak, **quick)
    with pytest.raises(
        ConfigurationError, match=r"in the posture given for the start joint a takes 200 % of its limit merely to hold still"
    ):
        excite(model, posture=[0.0, 0.0], limits=weak, **quick)


def test_distance_of_an_obstacle_is_that_of_geometry(tmp_path: Path) -> None:
    robot = Robot.from_urdf(ARM)
    low, high = (0.9, -0.3, 1.2), (1.4, 0.3, 1.6)
    scaled = box_file(tmp_path, *(tuple(1000 * x for x in corner) for corner in (low, high)))
    clearance = Clearance(robot, Surroundings(ground=None, clearance=0.0, obstacles=[scaled], mesh_scale=1e-3), Limits.of(robot))
    (column,) = [k for k, c in enumerate(clearance.constraints) if c.what == "two and obstacle box.obj"]
    q = np.random.default_rng(0).uniform(-2, 2, (50, 2))
    gap = box_gap(ball(q), low, high) - 0.05
    near = gap > 0
    np.testing.assert_allclose(clearance.distances(q)[near, column], gap[near], atol=1e-5)


def test_a_workspace_mesh_is_its_walls(tmp_path: Path) -> None:
    robot = Robot.from_urdf(ARM)
    low, high = (-1.0, -1.0, 0.4), (0.7, 1.0, 1.9)
    mesh = Surroundings(ground=None, workspace=box_file(tmp_path, low, high))
    walls = Surroundings(ground=None, box=tuple(zip(low, high, strict=True)))
    q = np.random.default_rng(1).uniform(-2, 2, (30, 2))
    a, b = (Clearance(robot, room, Limits.of(robot)).distances(q).min(axis=1) for room in (mesh, walls))
    np.testing.assert_allclose(a, b, atol=1e-9)
    with pytest.raises(ConfigurationError, match="is not closed"):
        Clearance(robot, Surroundings(workspace=box_file(tmp_path, low, high, "open.obj", holes=1)), Limits.of(robot))
    dented = box_file(tmp_path, low, high, "dent.obj")
    more = box_file(tmp_path, (5, 5, 5), (6, 6, 6), "more.obj").read_text().replace("f ", "F ")
    faces = [line for line in more.splitlines() if line.startswith("F")]
    shifted = "\n".join("f " + " ".join(str(int(x) + 8) for x in line.split()[1:]) for line in faces)
    vertices = "\n".join(line for line in more.splitlines() if line.startswith("v"))
    dented.write_text(dented.read_text() + vertices + "\n" + shifted + "\n")
    with pytest.raises(ConfigurationError, match="is not convex"):
        Clearance(robot, Surroundings(workspace=dented), Limits.of(robot))


@pytest.mark.parametrize("name", ["puma560", "palletiser", "ur5"])
def test_placements_are_those_of_pinocchio(name: str) -> None:
    import pinocchio as pin

    try:
        robot = load_robot(name)
    except ConfigurationError as error:
        pytest.skip(str(error))
    bodies = Bodies.of(robot)
    placements = ShapePlacements(bodies)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (20, placements.tree.nb))
    placed = placements.at(q)
    data, geometry = bodies.model.createData(), bodies.shapes.createData()
    for i, x in enumerate(q):
        pin.updateGeometryPlacements(bodies.model, data, bodies.shapes, geometry, x)
        np.testing.assert_allclose(placed.R[i], [m.rotation for m in geometry.oMg], atol=1e-12)
        np.testing.assert_allclose(placed.p[i], [m.translation for m in geometry.oMg], atol=1e-12)
    # No point of a shape is outside its capsule.
    for s, shape in enumerate(bodies.shapes.geometryObjects):
        direction = rng.normal(size=(200, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        _, points = placements.supports[s](direction)
        ends = np.repeat(placements.ends[s][None], 200, axis=0)
        assert np.all(segment_gap(points, points, ends[:, 0], ends[:, 1]) <= placements.radius[s] + 1e-9), shape.name


def test_gap_of_segments_against_a_search() -> None:
    rng = np.random.default_rng(3)
    a0, a1, b0, b1 = rng.normal(size=(4, 40, 3))
    b1[:5], a1[5:10] = b0[:5] + 1e-14, a0[5:10]
    b1[10:15] = b0[10:15] + 2.0 * (a1[10:15] - a0[10:15])
    s, t = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    found = segment_gap(a0, a1, b0, b1)
    for i in range(40):
        p = a0[i] + s[..., None] * (a1[i] - a0[i])
        r = b0[i] + t[..., None] * (b1[i] - b0[i])
        searched = float(np.linalg.norm(p - r, axis=-1).min())
        assert found[i] <= searched + 1e-12
        assert found[i] >= searched - 0.02


@pytest.mark.parametrize("name", ["ur5", "palletiser"])
def test_what_is_remembered_never_exceeds_a_distance(name: str) -> None:
    try:
        robot = load_robot(name)
    except ConfigurationError as error:
        pytest.skip(str(error))
    limits = Limits.of(robot)
    clearance = Clearance(robot, Surroundings(ground=-0.5), limits)
    rng = np.random.default_rng(0)
    q = rng.uniform(limits.lower, limits.upper, (40, robot.n))
    memory = NearMemory()
    for size in (0.0, 0.02, 0.2, 1.0, 0.05):
        moved = q + size * rng.normal(size=q.shape)
        exact = clearance.distances(moved)
        bound = memory.bound(robot.tree_position(moved), clearance._rates)
        inside = exact > 0  # depths of penetration are not distances
        assert np.all((bound <= exact + 1e-6)[inside])
        memory.keep(robot.tree_position(moved), exact)
        with_memory, _ = clearance.barrier(moved, True, memory)
        assert with_memory == pytest.approx(clearance.barrier(moved)[0], rel=1e-9)


def test_the_page_shows_the_robot_where_it_is(tmp_path: Path) -> None:
    robot = Robot.from_urdf(ARM)
    found = excite(robot.rigid_body(), surroundings=Surroundings(ground=0.0, clearance=0.01), starts=1, iterations=1)
    page = found.to_view(tmp_path / "view.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r"^const data = (.*);$", page, re.MULTILINE)[1])
    assert "{data}" not in page
    assert "{title}" not in page
    frames = np.array(data["frames"]).reshape(len(data["frames"]), -1, 12)
    t = np.linspace(0.0, data["duration"], len(frames))
    names = list(Bodies.of(robot).labels)
    at = frames[:, names.index("two"), 9:]
    np.testing.assert_allclose(at, ball(found.trajectory.sample(t).q), atol=1e-4)
    assert data["ground"] == 0.0
    assert [s["moves"] for s in data["shapes"]] == [name != "base" for name in names]
    np.testing.assert_allclose(data["path"], at, atol=1e-4)
    swept = found.swept()
    assert [p.title for p in swept.panels] == ["from the side", "from the front", "from above"]
    (way,) = [layer for layer in swept.panels[0].layers if layer.label == "path of the last shape"]
    along = ball(found.trajectory.sample(np.linspace(0.0, data["duration"], len(way.x))).q)
    np.testing.assert_allclose(np.column_stack([way.x, way.y]), along[:, [0, 2]], atol=1e-4)


def test_what_torque_is_predicted_from_is_said() -> None:
    from ident.friction import Coulomb

    robot = Robot.from_urdf(ARM)
    model = robot.rigid_body() + Coulomb()
    text = str(excite(model, starts=1, iterations=1))
    assert "torque as predicted from: rigid_body; NOT in it, no value is known: coulomb" in text
    values = np.ones(len(model.parameters))
    assert excite(model, values=values, starts=1, iterations=1).torque_of == ("rigid_body", "coulomb")


def test_torque_beside_a_reversal_is_within_its_limit() -> None:
    """Dry friction jumps between samples: torque with either direction is looked at, against a hundred times finer samples."""
    from ident.excitation.information import MotionInformation
    from ident.friction import Coulomb

    robot = Robot.from_urdf(ARM)
    model = robot.rigid_body() + Coulomb()
    values = np.zeros(len(model.parameters))
    values[0], values[10], values[-2:] = 1.0, 1.0, (4.0, 3.0)
    trajectory = excite(model, starts=1, iterations=1).trajectory
    info = MotionInformation(model, values, np.ones(2))
    t, fine = np.linspace(0.0, 10.0, 101), np.linspace(0.0, 10.0, 100_001)
    true = np.abs(info.torque(fine, trajectory.sample(fine)))
    sampled = np.abs(info.torque(t, trajectory.sample(t)))
    beside = np.abs(info.torque_at_reversals(t, trajectory.sample(t)))
    near = [np.flatnonzero(np.diff(np.sign(trajectory.sample(t).dq[:, j]))) for j in range(2)]
    for j, intervals in enumerate(near):
        assert len(intervals) > 2
        for i in intervals.tolist():
            inside = true[1000 * i : 1000 * (i + 1), j].max()
            assert inside <= max(sampled[:, j].max(), beside[:, j].max()) + 0.05
    assert beside.max() > 4.0
