"""Random kinematic structures as URDF text, and the sampled torque regressor from Pinocchio as an independent oracle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class JointSpec:
    """A joint of a tree: its frame at zero in the parent's frame, and its axis in its own frame."""

    parent: int
    prismatic: bool
    rotation: Array
    translation: Array
    axis: Array


def urdf_text(joints: list[JointSpec], name: str = "random") -> str:
    """URDF text of a tree; joint i is `joint<i+1>`, link i is `link<i+1>`, the base is `link0`."""
    parts = [f'<robot name="{name}"><link name="link0"/>']
    for i, joint in enumerate(joints, start=1):
        rpy = roll_pitch_yaw(joint.rotation)
        kind = "prismatic" if joint.prismatic else "revolute"
        words = [" ".join(repr(float(x)) for x in v) for v in (rpy, joint.translation, joint.axis)]
        parts.append(
            f'<link name="link{i}"/><joint name="joint{i}" type="{kind}"><parent link="link{joint.parent + 1}"/><child link="link{i}"/>'
            f'<origin rpy="{words[0]}" xyz="{words[1]}"/><axis xyz="{words[2]}"/>'
            '<limit lower="-3" upper="3" velocity="5" effort="5"/></joint>'
        )
    return "".join(parts) + "</robot>"


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """URDF angles; where the pitch is a right angle roll is taken as zero, which loses no digits."""
    level = float(np.hypot(R[0, 0], R[1, 0]))
    if level < 1e-8:
        return 0.0, float(np.arctan2(-R[2, 0], level)), float(np.arctan2(-R[0, 1], R[1, 1]))
    return float(np.arctan2(R[2, 1], R[2, 2])), float(np.arctan2(-R[2, 0], level)), float(np.arctan2(R[1, 0], R[0, 0]))


def rotation(axis: Array, angle: float) -> Array:
    return pin.AngleAxis(angle, np.asarray(axis, float)).toRotationMatrix()


def random_rotation(rng: np.random.Generator) -> Array:
    q = rng.normal(size=4)
    return pin.Quaternion(q / np.linalg.norm(q)).toRotationMatrix()


def from_frames(frames: list[Array], parents: list[int], prismatic: list[bool], rng: np.random.Generator) -> list[JointSpec]:
    """Joints whose axes are the z axes of `frames` (4 x 4, in the world at zero), in arbitrary link frames: turned at random,
    moved along the axis, z or another direction as axis."""
    own = []
    for frame in frames:
        turn, shift = np.eye(4), np.eye(4)
        style = rng.integers(4)
        if style == 1:
            turn[:3, :3] = random_rotation(rng)
        elif style == 2:
            turn[:3, :3] = rotation([1, 0, 0], np.pi) if rng.random() < 0.5 else rotation([0, 1, 0], np.pi / 2)
        if style >= 2:
            shift[2, 3] = rng.normal() * 0.3
        own.append(frame @ shift @ turn)
    joints = []
    for i, parent in enumerate(parents):
        before = own[parent] if parent >= 0 else np.eye(4)
        local = np.linalg.inv(before) @ own[i]
        axis = own[i][:3, :3].T @ frames[i][:3, 2]
        axis[np.abs(axis) < 1e-15] = 0.0
        joints.append(JointSpec(parent, prismatic[i], local[:3, :3], local[:3, 3], axis))
    return joints


def random_tree(rng: np.random.Generator, size: int, prismatic: float = 0.3, right: float = 0.6, branch: float = 0.2) -> list[JointSpec]:
    """Any tree: axes at right angles with probability `right`, else oblique; zero offsets are common."""
    joints = []
    for i in range(size):
        parent = -1 if i == 0 else (int(rng.integers(i)) if rng.random() < branch else i - 1)
        turn = rotation(np.eye(3)[rng.integers(3)], np.pi / 2 * rng.integers(4)) if rng.random() < right else random_rotation(rng)
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        joints.append(JointSpec(parent, bool(rng.random() < prismatic), turn, rng.normal(size=3) * 0.4 * (rng.random(3) < 0.6), axis))
    return joints


def sampled_regressor(robot: Robot, rotors: bool = False, seed: int = 0, samples: int | None = None) -> Array:
    """Stacked joint-side regressor (rows, 10 nb [+ n]) at random states, through the loop, with the motors' reflected inertias."""
    model, data, rng = robot.model, robot.model.createData(), np.random.default_rng(seed)
    free, n, nb = 6 * robot.floating_base, robot.n, robot.tree.nb
    samples = samples or max(3 * (10 * nb + n) // (n + free) + 20, 30)
    W, k = robot.loop.W, robot.transmission.K_inverse
    out = []
    for _ in range(samples):
        q, dq, ddq = rng.uniform(-np.pi, np.pi, n), rng.normal(size=n), 2.0 * rng.normal(size=n)
        position, velocity, acceleration = robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq)
        if free:
            quaternion = rng.normal(size=4)
            position = np.r_[0, 0, 0, quaternion / np.linalg.norm(quaternion), position]
            velocity, acceleration = np.r_[rng.normal(size=6), velocity], np.r_[rng.normal(size=6), acceleration]
        Y = pin.computeJointTorqueRegressor(model, data, position, velocity, acceleration).reshape(model.nv, -1)
        Y = np.vstack([Y[:free], W.T @ Y[free:]])
        if rotors:
            reflected = np.vstack([np.zeros((free, n)), k.T * (k @ ddq)])
            Y = np.hstack([Y, reflected])
        out.append(Y)
    return np.vstack(out)


@dataclass(frozen=True)
class Comparison:
    """Rank of the sampled regressor, and by how much (relative) either row space leaves the other."""

    rank: int
    form_outside: float
    sampled_outside: float
    gap: tuple[float, float]


def compare_row_spaces(form: Array, sampled: Array, tolerance: float = 1e-9) -> Comparison:
    """Row space of a base form (b, k) against that of a sampled regressor (rows, k), both directions, columns scaled alike."""
    scale = np.linalg.norm(sampled, axis=0)
    zero = scale <= 1e-12 * scale.max()
    scale = np.where(zero, 1.0, np.maximum(scale, 1e-4 * scale.max()))  # a faint column is not blown up to its rounding
    rows = np.linalg.qr(np.where(zero, 0.0, sampled / scale), mode="r")
    _, s, vt = np.linalg.svd(rows)
    rank = int((s > tolerance * s[0]).sum())
    space = vt[:rank]
    gap = (float(s[rank - 1] / s[0]), float(s[rank] / s[0]) if rank < len(s) else 0.0)
    if not len(form):
        return Comparison(rank, 0.0, float(rank > 0), gap)
    scaled = form / scale
    scaled = scaled / np.linalg.norm(scaled, axis=1)[:, None]
    ours = np.linalg.svd(scaled, full_matrices=False)[2]
    outside = float(np.abs(scaled - (scaled @ space.T) @ space).max())
    missing = float(np.abs(space - (space @ ours.T) @ ours).max())
    return Comparison(rank, outside, missing, gap)


def pose(turn: Array | None = None, at: Array | tuple[float, ...] = (0, 0, 0)) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = np.eye(3) if turn is None else turn, at
    return out


def successive_axes(rng: np.random.Generator, count: int, twists: Array, zero: float = 0.4) -> list[Array]:
    """World frames at zero of successive axes of rotation (their z): any angle about z, [Lx, 0, Lz], then a twist about x."""
    frames = [pose(random_rotation(rng), rng.normal(size=3))]
    for _ in range(count - 1):
        Lx, Lz = rng.normal(size=2) * 0.5 * (rng.random(2) > zero)
        turn, twist = pose(rotation([0, 0, 1], rng.uniform(-3, 3))), pose(rotation([1, 0, 0], rng.choice(twists)))
        frames.append(frames[-1] @ turn @ pose(None, (Lx, 0, Lz)) @ twist)
    return frames


def right_twists(rng: np.random.Generator) -> Array:
    """Twist angles to draw from: right angles of either sign and (anti)parallel axes, in various proportions."""
    half = np.pi / 2
    return np.array([[0.0, np.pi, half, -half], [0.0, 0.0, 0.0, half], [half, -half, half, 0.0], [0.0, np.pi, 0.0, np.pi]][rng.integers(4)])


def oblique_twists(rng: np.random.Generator, count: int) -> Array:
    """Twist angles well away from parallel."""
    return rng.uniform(0.1, 3.0, count) * rng.choice([-1.0, 1.0], count)


def gravity_for(rng: np.random.Generator, direction: Array) -> Array:
    """Gravity along an axis, against it, across it or anywhere."""
    kind = rng.integers(4)
    if kind == 3:
        g = rng.normal(size=3)
    elif kind == 2:
        g = np.cross(direction, rng.normal(size=3))
    else:
        g = direction * (-1.0) ** kind
    return 9.81 * g / np.linalg.norm(g)


def rotational_robot(rng: np.random.Generator, count: int, twists: Array | None = None, **keywords) -> Robot:
    """Open chain of revolute joints; successive axes parallel or perpendicular unless `twists` are given."""
    frames = successive_axes(rng, count, right_twists(rng) if twists is None else twists)
    joints = from_frames(frames, list(range(-1, count - 1)), [False] * count, rng)
    return Robot.from_urdf(urdf_text(joints), gravity=gravity_for(rng, frames[0][:3, 2]), **keywords)


def mixed_robot(rng: np.random.Generator, count: int, slides: float = 0.35, **keywords) -> Robot:
    """Open chain of revolute and prismatic joints; prismatic axes along, across or oblique to the axis of rotation before."""
    prismatic = [bool(rng.random() < slides) for _ in range(count)]
    turning = successive_axes(rng, max(prismatic.count(False), 1), right_twists(rng))
    last, frames, following = turning[0], [], iter(turning)
    for slide in prismatic:
        if not slide:
            last = next(following)
            frames.append(last)
            continue
        kind = rng.integers(4)
        turn = [np.eye(3), rotation([1, 0, 0], np.pi), rotation([np.cos(1.0), np.sin(1.0), 0], np.pi / 2), random_rotation(rng)][kind]
        frames.append(last @ pose(turn, rng.normal(size=3) * 0.3 * (rng.random(3) < 0.5)))
    joints = from_frames(frames, list(range(-1, count - 1)), prismatic, rng)
    return Robot.from_urdf(urdf_text(joints), gravity=gravity_for(rng, turning[0][:3, 2]), **keywords)


def parallelogram_robot(rng: np.random.Generator, count: int, oblique: bool = True, **keywords) -> Robot:
    """Chain of `count` revolute joints with a planar parallelogram at a random place; the loop declared in either of two ways."""
    xi = int(rng.integers(1, count))
    twists = np.array([0.0, np.pi / 2, -np.pi / 2, np.pi, *(oblique_twists(rng, 2) if oblique else ())])
    frames = successive_axes(rng, count, twists)

    # Joint xi + 1 is parallel to xi at a distance; what follows it is moved along.
    def flip() -> Array:
        return pose(rotation([1, 0, 0], rng.choice([0.0, np.pi])))

    def spin(*at: float) -> Array:
        return pose(rotation([0, 0, 1], rng.uniform(-3, 3)), at or (0, 0, 0))

    wanted = frames[xi - 1] @ spin() @ pose(None, (rng.uniform(0.2, 0.8), 0, rng.normal() * 0.2)) @ flip()
    move = wanted @ np.linalg.inv(frames[xi])
    main = frames[:xi] + [move @ f for f in frames[xi:]]
    crank = main[xi - 1] @ spin(0, 0, rng.normal() * 0.2) @ flip()
    coupler = crank @ pose(None, (rng.uniform(0.2, 0.6), 0, rng.normal() * 0.1)) @ flip()
    crank_first = bool(rng.random() < 0.5)
    order = [*range(xi), "zeta", "zeta+1", *range(xi, count)] if crank_first else [*range(count), "zeta", "zeta+1"]
    place = {label: i for i, label in enumerate(order)}
    world = [crank if o == "zeta" else coupler if o == "zeta+1" else main[o] for o in order]
    before = {label: label - 1 for label in range(count)} | {"zeta": xi - 2, "zeta+1": "zeta"}
    parents = [place.get(before[o], -1) for o in order]
    joints = from_frames(world, parents, [False] * len(order), rng)
    name = {label: f"joint{i + 1}" for label, i in place.items()}
    z = main[xi - 1][:3, 2]
    sense = {label: float(np.sign(z @ world[place[label]][:3, 2])) for label in (xi - 1, xi, "zeta", "zeta+1")}
    a, b, c, d = (sense[label] for label in (xi - 1, xi, "zeta", "zeta+1"))
    first, second, third, fourth = (name[label] for label in (xi - 1, xi, "zeta", "zeta+1"))
    offsets = rng.uniform(-2, 2, 2) * (rng.random(2) < 0.7)
    if rng.random() < 0.7:  # both cranks driven: a q_xi + b q_xi1 = c q_zeta, c q_zeta + d q_zeta1 = a q_xi, up to constants
        loop = {second: {third: c / b, first: -a / b, "offset": offsets[0]}, fourth: {first: a / d, third: -c / d, "offset": offsets[1]}}
    else:  # relative joints driven
        loop = {third: {first: a / c, second: b / c, "offset": offsets[0]}, fourth: {second: -b / d, "offset": offsets[1]}}
    return Robot.from_urdf(urdf_text(joints), gravity=gravity_for(rng, main[0][:3, 2]), loop=loop, **keywords)
