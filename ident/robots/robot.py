"""Robot: the kinematic tree, joints by name, the transmission and linear loop closures, all as data."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.text import counted
from ..errors import ConfigurationError, unknown_name
from .joints import Joint, Loop, closure_of, held_joints
from .transmission import Side, Transmission
from .tree import RigidBodyTree
from .urdf import UrdfText, prepare_urdf, read_urdf, some

if TYPE_CHECKING:
    import pinocchio as pin

    from ..model import Model

Array = np.ndarray
STANDARD_GRAVITY = (0.0, 0.0, -9.81)
#: m/s²: beyond it, a number is no gravity, and sums of it overflow.
_MOST_GRAVITY = 1e6


@dataclass(frozen=True, eq=False, repr=False)
class Robot(ShortRepr):
    """A robot as identification sees it. Build it with `from_urdf` or `ident.load_robot`.

    `joints`: the n independent, measured joints in order (the order of `q1 … qn` in logs). `tree_joints`: all moving
    joints of the tree, which differ from `joints` only under a `loop`. `model`: a private Pinocchio model with one
    coordinate a joint, armature zero and gravity set. `nominal` (10 n_tree,): inertial parameters of the URDF in
    Pinocchio's order, or None where the URDF gives none. `source`: what is needed to load it again (JSON-able).
    `faults`: links that move whose inertial is that of no body, and why ("link 'upper': its mass is -4 kg").
    `oddities`: links whose moments of inertia no distribution of mass has, though each is positive.
    `whole`: the independent joints in order before any was locked.

    Examples
    --------
    >>> import ident
    >>> robot = ident.load_robot("scara")
    >>> robot.n, robot.joint_names[0]
    (4, 'joint1')
    """

    name: str
    model: pin.Model = field(repr=False)
    joints: tuple[Joint, ...]
    tree_joints: tuple[Joint, ...]
    transmission: Transmission
    loop: Loop
    nominal: Array | None = field(repr=False)
    floating_base: bool = False
    notes: tuple[str, ...] = ()
    source: Mapping[str, Any] = field(default_factory=dict, repr=False)
    faults: tuple[str, ...] = ()
    whole: tuple[str, ...] = ()
    oddities: tuple[str, ...] = field(default=(), repr=False)

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        *,
        transmission: Transmission | Array | None = None,
        measured: Side | str = Side.JOINT,
        gravity: Sequence[float] = STANDARD_GRAVITY,
        locked: Mapping[str, float] | None = None,
        joints: Sequence[str] | None = None,
        loop: Mapping[str, Mapping[str, float]] | None = None,
        floating_base: bool = False,
        name: str | None = None,
    ) -> Robot:
        """Load a URDF file (or URDF text that starts with "<").

        Joints are in the order of the tree, parents first, whatever the order in `joints`.
        `transmission`: a `Transmission`, or an array: (n,) signed gear ratios, (n, n) the matrix K of θ = K θ_m.
        `measured`: side of the logged torque where `transmission` is an array. `locked`: joint → position of joints
        that are not identified. `joints`: the moving joints to keep; all others are locked (at `locked`, else at zero).
        `loop`: dependent joint → {independent joint: factor, …, "offset": constant}.
        Raises ConfigurationError."""
        text = str(urdf)
        origin: dict[str, Any] = {}
        if text.lstrip().startswith("<"):
            prepared = prepare_urdf(text)
            text = prepared.text
        else:
            prepared = read_urdf(Path(urdf))
            origin["urdf"] = text
            text = prepared.text
        # The text itself is kept: a saved fit can be taken up again where the file has moved.
        origin |= {"urdf_text": text, "urdf_sha256": hashlib.sha256(text.encode()).hexdigest()}
        source = {
            **origin,
            "gravity": [float(g) for g in gravity],
            "locked": dict(locked or {}),
            "joints": None if joints is None else list(joints),
            "loop": {k: dict(v) for k, v in (loop or {}).items()},
            "floating_base": floating_base,
        }
        return _build(
            cls,
            prepared,
            name or prepared.name,
            transmission,
            Side(measured),
            gravity,
            locked or {},
            joints,
            loop or {},
            floating_base,
            source,
        )

    def __str__(self) -> str:
        kinds = ", ".join(j.name + (" (prismatic)" if j.prismatic else "") for j in self.joints)
        drive = (
            "direct" if np.array_equal(self.transmission.K, np.eye(self.n)) else "geared" if self.transmission.is_diagonal else "coupled"
        )
        side = self.transmission.measured
        lines = [f"robot {self.name}: {counted(self.n, 'joint')}: {kinds}; {drive} drive, torque measured on the {side} side"]
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    @property
    def doubts(self) -> tuple[str, ...]:
        """What to warn of where the URDF's inertials are not needed."""
        odd = (
            ()
            if not self.oddities
            else (f"no body has these inertials of the URDF: {some(self.oddities)}. Do not rely on its nominal values there.",)
        )
        if not self.faults:
            return odd
        impossible = f"no body has these inertials of the URDF: {some(self.faults)}."
        return (f"{impossible} A fit does not use them; do not compare with them.", *odd)

    @property
    def n(self) -> int:
        """Number of independent joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(j.name for j in self.joints)

    @cached_property
    def tree(self) -> RigidBodyTree:
        """The kinematic tree as arrays, for the rigid-body kernels."""
        return RigidBodyTree.from_pinocchio(self.model)

    def joint_index(self, name: str) -> int:
        """Position of a joint in `joints`. Raises ConfigurationError with the nearest names."""
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise unknown_name("joint", name, self.joint_names) from None

    def position_unit(self, j: int, side: Side) -> str:
        """Unit ("rad" or "m") of joint j's or motor j's position. A motor that is geared to its joint turns in rad."""
        return "m" if self.joints[j].prismatic and (side == Side.JOINT or self.is_direct(j)) else "rad"

    def force_unit(self, j: int, side: Side) -> str:
        """Unit ("N m" or "N") of the generalised force that goes with `position_unit`."""
        return "N" if self.position_unit(j, side) == "m" else "N m"

    def is_direct(self, j: int) -> bool:
        """Whether motor j moves joint j, and nothing else does, one to one."""
        return bool(np.all(self.transmission.K[j] == np.eye(self.n)[j]))

    def tree_position(self, q: Array) -> Array:
        """Positions (..., n_tree) of all tree joints from those of the independent ones (..., n)."""
        return q if self.loop.is_trivial else q @ self.loop.W.T + self.loop.offset

    def tree_rate(self, dq: Array) -> Array:
        """Velocities or accelerations (..., n_tree) of all tree joints."""
        return dq if self.loop.is_trivial else dq @ self.loop.W.T

    def with_transmission(self, transmission: Transmission) -> Robot:
        """The same robot behind another drive train."""
        if transmission.n != self.n:
            raise ConfigurationError(
                f"[drive] describes {counted(transmission.n, 'joint')}, but robot {self.name!r} has"
                f" {self.n}: {', '.join(self.joint_names)}."
            )
        return replace(self, transmission=transmission)

    def with_gravity(self, gravity: Sequence[float]) -> Robot:
        """The same robot mounted otherwise. `gravity` (3,) in m/s², in the base frame."""
        model = self.model.copy()
        model.gravity.linear[:] = _gravity(gravity)
        return replace(self, model=model, source={**self.source, "gravity": [float(g) for g in gravity]})

    def rigid_body(self) -> Model:
        """The model that holds the rigid body alone; add effects to it with `+`."""
        from ..model import Model

        return Model.of_links(self)


def require_robot(given: object) -> None:
    """Refuse what is given as a robot, and is none: a name, a path, a model (ConfigurationError)."""
    if given is not None and not isinstance(given, Robot):
        raise ConfigurationError(
            f"a robot is needed, not {given!r:.60} ({type(given).__name__}): ident.load_robot(NAME), or ident.Robot.from_urdf(FILE)."
        )


def _gravity(gravity: Sequence[float]) -> Array:
    g = np.asarray(gravity, float).reshape(-1)
    if g.shape != (3,) or not np.all(np.abs(g) <= _MOST_GRAVITY):
        raise ConfigurationError(
            f"gravity must be three finite numbers (m/s^2 in the base frame, at most {_MOST_GRAVITY:g}), not {list(gravity)}."
        )
    return g


def _build(
    cls: type[Robot],
    urdf: UrdfText,
    name: str,
    transmission: Transmission | Array | None,
    measured: Side,
    gravity: Sequence[float],
    locked: Mapping[str, float],
    keep: Sequence[str] | None,
    loop: Mapping[str, Mapping[str, float]],
    floating_base: bool,
    source: dict[str, Any],
) -> Robot:
    import pinocchio as pin

    try:
        model = pin.buildModelFromXML(urdf.xml, pin.JointModelFreeFlyer()) if floating_base else pin.buildModelFromXML(urdf.xml)
    except (ValueError, RuntimeError, IndexError) as error:  # what Pinocchio raises for something wrong in a URDF
        raise ConfigurationError(f"URDF of {name!r} is rejected by Pinocchio: {str(error).strip().splitlines()[0]}") from None
    first = 2 if floating_base else 1
    moving = list(model.names)[first:]
    dependent = {*loop, *(m.joint for m in urdf.mimics)}
    held = held_joints(urdf, moving, locked, keep, loop)
    if held:
        at = pin.neutral(model)
        for joint, position in held.items():
            at[model.joints[model.getJointId(joint)].idx_q] = position
        model = pin.buildReducedModel(model, [model.getJointId(j) for j in held], at)
    model.armature[:] = 0.0  # rotor inertia is an effect; it must not count twice
    model.gravity.linear[:] = _gravity(gravity)
    tree_joints = tuple(Joint(j, urdf.kinds[j], *urdf.limits[j], *urdf.dynamics[j]) for j in list(model.names)[first:])
    if not tree_joints:
        raise ConfigurationError(f"robot {name!r} has no moving joint: there is nothing to identify.")
    closure, joints = closure_of(urdf, tree_joints, loop)
    nominal = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
    robot = cls(
        name=name,
        model=model,
        joints=joints,
        tree_joints=tree_joints,
        transmission=Transmission.identity(len(joints)),
        loop=closure,
        nominal=nominal if np.any(nominal) else None,
        floating_base=floating_base,
        notes=(*urdf.notes, *_mimicking(urdf, held), *_bare(model, tree_joints)),
        source=source,
        faults=_of_moving_links(urdf.faults, model),
        whole=tuple(j for j in moving if j not in dependent),
        oddities=_of_moving_links(urdf.oddities, model),
    )
    if transmission is None:
        return replace(robot, transmission=Transmission.identity(len(joints), measured))
    return robot.with_transmission(Transmission.of(transmission, measured))


def _of_moving_links(said: Mapping[str, str], model: pin.Model) -> tuple[str, ...]:
    """What is said of links that move."""
    return tuple(f"link {f.name!r}: {said[f.name]}" for f in model.frames if f.parentJoint > 0 and f.name in said)


def _mimicking(urdf: UrdfText, held: Mapping[str, float]) -> list[str]:
    """Notes on joints that follow others and are not `held`."""
    notes = []
    for master in dict.fromkeys(m.master for m in urdf.mimics if m.joint not in held):
        followers = [m.joint for m in urdf.mimics if m.master == master and m.joint not in held]
        verb = "mimics" if len(followers) == 1 else "mimic"
        notes.append(f"{some(followers)} {verb} {master}: taken as rigidly coupled (dependent), not as joints of their own.")
    return notes


def _bare(model: pin.Model, tree_joints: Sequence[Joint]) -> list[str]:
    """A note on joints that carry nothing with an inertial."""
    inertias = list(model.inertias)[-len(tree_joints) :]
    bare = [j.name for j, inertia in zip(tree_joints, inertias, strict=True) if not np.any(inertia.toDynamicParameters())]
    if not bare:
        return []
    return [f"no <inertial> on the links of joints {some(bare)}: fine for fitting, but there are no nominal values to compare with."]
