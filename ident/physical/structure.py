"""What base values mean for the inertia matrix: H(q; beta), linear in beta, with reflected rotor inertia, as plain arrays.

H depends on base parameters only, so any full parameter vector that reproduces the base values gives the right matrix; here the
grouped parameters are set to zero (a rotor inertia merged into an Izz is then carried by that Izz)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import matrix_rank, svd
from ..effects.motion import Motion
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError
from ..regressor.rigid import mass_matrix, regressor
from ..robots.transmission import Side
from ..robots.tree import link_names
from .energy import energy_gradient, energy_rows

if TYPE_CHECKING:
    from ..model import Model
    from ..regressor.base_parameters.reduction import BaseReduction
    from ..robots.tree import RigidBodyTree

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class InertiaStructure(ShortRepr):
    """A robot as the judge of its base parameters sees it: n joints, nv velocities, nb bodies, k parameters, b base parameters.

    `tree`: the kinematic tree; `projection` (nv_tree, nv) and `offset` (n_tree,): its motion from the independent one (loop closures; the
    identity and zero without). `regroup` (b, k): base = regroup @ all; `lift` (k, b): a right inverse of it; `null_space` (k, k - b):
    what no base parameter sees. `inertial` (10 nb,): where the links' parameters are among all, in Pinocchio's order; `drive` (r,):
    where parameters of constant inertia are, `reflected` (r, nv, nv): their matrices on the joint side, K^-T e e^T K^-1. `nonnegative`:
    further indices that may not be negative (friction). `lower`, `upper` (n,): joint limits (rad, m; infinite where unknown);
    `prismatic` (n,) bool."""

    tree: RigidBodyTree
    projection: Array
    offset: Array
    regroup: Array
    lift: Array
    null_space: Array
    inertial: Array
    drive: Array
    reflected: Array
    nonnegative: Array
    lower: Array
    upper: Array
    prismatic: Array
    joint_names: tuple[str, ...]
    body_names: tuple[str, ...]
    names: tuple[str, ...]
    base_names: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        tree: RigidBodyTree,
        regroup: Array,
        *,
        inertial: Array | None = None,
        drive: Array | None = None,
        reflected: Array | None = None,
        nonnegative: Array | None = None,
        projection: Array | None = None,
        offset: Array | None = None,
        limits: tuple[Array, Array] | None = None,
        joint_names: tuple[str, ...] | None = None,
        body_names: tuple[str, ...] | None = None,
        names: tuple[str, ...] | None = None,
        base_names: tuple[str, ...] | None = None,
        notes: tuple[str, ...] = (),
    ) -> InertiaStructure:
        """From plain arrays; see the class for their meaning. Raises ConfigurationError where the shapes do not fit together."""
        regroup = np.asarray(regroup, float)
        b, k = regroup.shape
        inertial = np.arange(10 * tree.nb) if inertial is None else np.asarray(inertial, int)
        drive = np.zeros(0, int) if drive is None else np.asarray(drive, int)
        floating = 6 * tree.floating
        n_tree = tree.nq - (7 if tree.floating else 0)
        offset = np.zeros(n_tree) if offset is None else np.asarray(offset, float)
        projection = np.eye(tree.nv) if projection is None else np.asarray(projection, float)
        nv = projection.shape[1]
        n = nv - floating
        reflected = np.zeros((0, nv, nv)) if reflected is None else np.asarray(reflected, float)
        if inertial.shape != (10 * tree.nb,) or reflected.shape != (len(drive), nv, nv) or projection.shape[0] != tree.nv:
            raise ConfigurationError(
                f"the base parameterisation does not fit the robot: {len(inertial)} inertial parameters for {tree.nb} bodies,"
                f" {len(drive)} drive inertias with matrices of shape {reflected.shape}, projection {projection.shape}."
            )
        if matrix_rank(regroup) < b:
            raise ConfigurationError("regroup: its rows are dependent, so it does not define base parameters; reduce the model first.")
        stay = _identity_columns(regroup)
        lift, null_space = _inverse(regroup, _sizes(tree, inertial, drive, reflected, k), stay)
        lower, upper = (np.full(n, -np.inf), np.full(n, np.inf)) if limits is None else (np.asarray(x, float) for x in limits)
        moving = tree.prismatic[int(tree.floating) :]
        # An independent coordinate is a length where every tree joint it moves slides.
        own = projection[floating:, floating:] != 0
        prismatic = np.array([bool(moving[own[:, j]].all()) if own[:, j].any() else False for j in range(n)], bool)
        joint_names = tuple(f"joint{i + 1}" for i in range(n)) if joint_names is None else joint_names
        body_names = tuple(f"link{i + 1}" for i in range(tree.nb)) if body_names is None else body_names
        if names is None:
            names = tuple(f"p{i}" for i in range(k))
        base_names = (
            tuple(names[i] for i in stay) if base_names is None and stay is not None else base_names or tuple(f"base{i}" for i in range(b))
        )
        return cls(
            tree, projection, offset, regroup, lift, null_space, inertial, drive, reflected,
            np.zeros(0, int) if nonnegative is None else np.asarray(nonnegative, int),
            lower, upper, prismatic, joint_names, body_names, names, base_names, notes,
        )  # fmt: skip

    @classmethod
    def from_model(cls, model: Model, base: BaseReduction) -> InertiaStructure:
        """From a model and its base reduction. Effects whose torque is a constant matrix times acceleration count as inertia."""
        robot = model.robot
        rigid = [s for e, s in zip(model.effects, model.slices, strict=True) if isinstance(e, RigidBody)]
        if len(rigid) != 1:
            raise ConfigurationError(
                "the model holds no rigid body, so there is no inertia matrix to judge; start from robot.rigid_body()."
            )
        drive, reflected, notes = _constant_inertia(model)
        taken = {*drive.tolist(), *range(rigid[0].start, rigid[0].stop)}
        nonnegative = [i for i, p in enumerate(model.parameters) if i not in taken and p.lower >= 0.0]
        floating = 6 * robot.floating_base
        W = np.eye(robot.tree.nv)
        if not robot.loop.is_trivial:
            W = np.zeros((robot.tree.nv, robot.n + floating))
            W[:floating, :floating] = np.eye(floating)
            W[floating:, floating:] = robot.loop.W
        limits = (np.array([j.lower for j in robot.joints]), np.array([j.upper for j in robot.joints]))
        return cls.from_arrays(
            robot.tree,
            base.regroup,
            inertial=np.arange(rigid[0].start, rigid[0].stop),
            drive=drive,
            reflected=reflected,
            nonnegative=np.array(nonnegative, int),
            projection=W,
            offset=robot.loop.offset,
            limits=limits,
            joint_names=robot.joint_names,
            body_names=link_names(robot.model),
            names=model.names,
            base_names=tuple(base.names),
            notes=notes,
        )

    @property
    def n(self) -> int:
        """Number of independent joints."""
        return len(self.joint_names)

    @property
    def nv(self) -> int:
        """Number of velocities: the size of H."""
        return self.projection.shape[1]

    @property
    def b(self) -> int:
        return self.regroup.shape[0]

    @property
    def k(self) -> int:
        return self.regroup.shape[1]

    @property
    def has_loop(self) -> bool:
        """Whether the tree's motion is tied by a loop closure."""
        W = self.projection
        return W.shape[0] != W.shape[1] or not np.array_equal(W, np.eye(len(W)))

    @cached_property
    def relevant(self) -> Array:
        """Joints (n,) bool on whose position H depends at all: not the first of a chain on a fixed base."""
        roots = self.tree.parent < 0
        moves = self.projection[6 * self.tree.floating :, 6 * self.tree.floating :] != 0
        return np.array([bool(np.any(~roots[int(self.tree.floating) :][moves[:, j]])) for j in range(self.n)], bool)

    @cached_property
    def without_rotors(self) -> InertiaStructure:
        """The same robot for H alone, without reflected rotor inertia; what base parameters hold merged with a link's stays in."""
        # A rotor whose column the links' columns give is merged with them: its parameter may even be the one that stands for both.
        links = self.regroup[:, self.inertial]
        alone = [r for r, i in enumerate(self.drive) if matrix_rank(np.c_[links, self.regroup[:, i]]) > matrix_rank(links)]
        reflected = self.reflected.copy()
        reflected[alone] = 0.0
        return replace(self, reflected=reflected)

    def ranges(self, limits: bool) -> tuple[Array, Array, tuple[str, ...]]:
        """Positions to be judged (lower (n,), upper (n,), notes): whole turns, or within the joint limits.

        A prismatic joint always keeps to its limits; one without any is judged over +-1 m, and a note says so."""
        lower, upper = np.full(self.n, -np.pi), np.full(self.n, np.pi)
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper)
        use = bounded & (self.prismatic | limits)
        lower[use], upper[use] = self.lower[use], self.upper[use]
        free = self.prismatic & ~bounded
        lower[free], upper[free] = -1.0, 1.0
        whole = ~self.prismatic & (upper - lower >= 2 * np.pi)
        lower[whole], upper[whole] = -np.pi, np.pi
        names = ", ".join(self.joint_names[i] for i in np.flatnonzero(free & self.relevant))
        return lower, upper, (f"no limits are known for prismatic {names}: judged over -1 to 1 m.",) if names else ()

    def check_values(self, values: Any) -> Array:
        """Base values (b,) as floats. Raises ConfigurationError."""
        array = np.asarray(values, float).reshape(-1)
        if array.shape != (self.b,) or not np.all(np.isfinite(array)):
            raise ConfigurationError(f"expected {self.b} finite base parameters ({self.base_names[0]} ...), but {array.size} were given.")
        return array

    def tree_position(self, q: Array) -> Array:
        """Positions of the tree (N, nq) for joint positions (N, n); a free-flyer stands at the origin, for H does not see it."""
        floating = 6 * self.tree.floating
        out = q @ self.projection[floating:, floating:].T + self.offset
        if not self.tree.floating:
            return out
        pose = np.zeros((len(q), 7))
        pose[:, 6] = 1.0
        return np.concatenate([pose, out], axis=1)

    def added(self, values: Array) -> Array:
        """The constant part of H (nv, nv): reflected rotor inertia that base values (b,) hold on their own."""
        return np.tensordot(self.lift[self.drive] @ values, self.reflected, 1)

    def inertia_matrix(self, values: Array, q: Array) -> Array:
        """H (N, nv, nv) on the joint side, reflected rotor inertia included, for joint positions (N, n)."""
        M = mass_matrix(self.tree, self.lift[self.inertial] @ values, self.tree_position(q))
        if self.has_loop:
            M = np.matmul(np.matmul(self.projection.T, M), self.projection)
        return M + self.added(values)

    def parameter_matrices(self, q: Array) -> Array:
        """H per unit base parameter at one position (n,): (b, nv, nv)."""
        state = np.repeat(self.tree_position(np.asarray(q, float)[None]), self.nv, axis=0)
        # Unit accelerations; what is left at rest is gravity, which is taken out.
        Y = regressor(self.tree, state, np.zeros((self.nv, self.tree.nv)), self.projection.T)
        Y = Y - regressor(self.tree, state[:1], np.zeros((1, self.tree.nv)), np.zeros((1, self.tree.nv)))
        H = np.einsum("ti,jtp,pb->bij", self.projection, Y, self.lift[self.inertial])
        return H + np.einsum("rb,rij->bij", self.lift[self.drive], self.reflected)

    def quadratic_rows(self, q: Array, v: Array) -> Array:
        """v' H(q) v per unit base parameter: (N, b), for positions (N, n) and rates (N, nv)."""
        rows = energy_rows(self.tree, self.tree_position(q), v @ self.projection.T) @ self.lift[self.inertial]
        # (N, r): v' A_r v for every drive inertia, then to base parameters.
        turned = np.tensordot(v, self.reflected, ([1], [1]))
        return rows + np.einsum("Nri,Ni->Nr", turned, v) @ self.lift[self.drive]

    def position_gradient(self, values: Array, q: Array, v: Array) -> Array:
        """d(v' H(q) v)/dq: (N, n), at fixed rates (N, nv)."""
        slope = energy_gradient(self.tree, self.lift[self.inertial] @ values, self.tree_position(q), v @ self.projection.T)
        return slope @ self.projection[6 * self.tree.floating :, 6 * self.tree.floating :]


def _identity_columns(regroup: Array) -> list[int] | None:
    """For each row a column that is that row's unit vector, or None if some row has none."""
    unit = (np.count_nonzero(regroup, axis=0) == 1) & (regroup.sum(axis=0) == 1.0)
    stay = []
    for row in regroup:
        found = np.flatnonzero(unit & (row == 1.0))
        if not len(found):
            return None
        stay.append(int(found[0]))
    return stay


#: Regrouping coefficients (in ordinary units) above which setting the grouped parameters to zero would cost digits.
_STEEP = 1e3


def _sizes(tree: RigidBodyTree, inertial: Array, drive: Array, reflected: Array, k: int) -> Array:
    """Ordinary size (k,) of each parameter: a kilogram, at the robot's own lengths; a rotor that reflects a hundredth of that inertia."""
    distance = np.linalg.norm(tree.translation, axis=1)
    length = float(distance[distance > 1e-6].mean()) if np.any(distance > 1e-6) else 0.1
    out = np.ones(k)
    out[inertial] = np.tile([1.0] + [length] * 3 + [length**2] * 6, tree.nb)
    if len(drive):
        out[drive] = 0.01 * length**2 / np.maximum(np.abs(reflected).max(axis=(1, 2)), 1e-300)
    return out


def _inverse(regroup: Array, size: Array, stay: list[int] | None) -> tuple[Array, Array]:
    """(right inverse (k, b), null space (k, k - b)) of regroup: the grouped parameters zero, where their coefficients are moderate;

    else the ones of least size, since steep coefficients (joint axes that are nearly parallel) would cancel digits."""
    b, k = regroup.shape
    if stay is not None:
        moved = [i for i in range(k) if i not in set(stay)]
        if np.abs(regroup * size / size[stay][:, None]).max(initial=0.0) < _STEEP:
            lift, null_space = np.zeros((k, b)), np.zeros((k, k - b))
            lift[stay, np.arange(b)] = 1.0
            null_space[moved, np.arange(k - b)] = 1.0
            null_space[stay] = -regroup[:, moved]
            return lift, null_space
    rows = 1.0 / np.linalg.norm(regroup * size, axis=1)
    U, S, Vt = svd(rows[:, None] * regroup * size)
    lift = size[:, None] * (Vt[:b].T / S) @ (U.T * rows)
    null_space = size[:, None] * Vt[b:].T
    # What no regrouping touches is exactly what it is.
    alone = (np.count_nonzero(regroup, axis=1) == 1) & (regroup.sum(axis=1) == 1.0)
    for row in np.flatnonzero(alone):
        i = int(np.argmax(regroup[row]))
        lift[i], lift[:, row], null_space[i] = 0.0, 0.0, 0.0
        lift[i, row] = 1.0
    return lift, null_space


def _constant_inertia(model: Model) -> tuple[Array, Array, tuple[str, ...]]:
    """Parameters outside the rigid body whose torque is a constant symmetric matrix times acceleration: (indices, matrices, notes)."""
    robot = model.robot
    n = robot.n
    rng = np.random.default_rng(0)
    states = [np.repeat(rng.uniform(-1.0, 1.0, (1, n)), n + 1, axis=0) for _ in range(2)]
    accelerations = np.concatenate([np.zeros((1, n)), np.eye(n)])
    indices: list[int] = []
    matrices: list[Array] = []
    left: list[str] = []
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, RigidBody) or effect.needs or part.start == part.stop:
            continue
        found = []
        for q in states:
            columns = effect.columns(Motion.of(robot, q, np.zeros_like(q), accelerations), robot)
            found.append(robot.transmission.torque_map(effect.side, Side.JOINT) @ (columns[1:] - columns[:1]))
        # [acceleration, torque row, parameter] -> per parameter a matrix of torque rows by accelerations.
        first, second = (np.transpose(f, (2, 1, 0)) for f in found)
        for i in range(part.stop - part.start):
            A, size = first[i], float(np.abs(first[i]).max(initial=0.0))
            if size == 0.0:
                continue
            if np.allclose(A, second[i], atol=1e-10 * size) and np.allclose(A, A.T, atol=1e-10 * size):
                indices.append(part.start + i)
                matrices.append(0.5 * (A + A.T))
            elif effect.name not in left:
                left.append(effect.name)
    floating = 6 * robot.floating_base
    out = np.zeros((len(indices), n + floating, n + floating))
    if matrices:
        out[:, floating:, floating:] = matrices
    notes = tuple(f"{name}: its torque depends on acceleration through position; it is left out of the inertia matrix." for name in left)
    return np.array(indices, int), out, notes
