"""The effect contract: each term of a model is one small frozen object, and nothing asks which one it is.

To add an effect, subclass `Effect` (or `JointEffect`, for the common case of the same few columns on each joint), give it a
name and register it with `@register`. The contract tests then find it by themselves."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np

from .errors import ConfigurationError, unknown_name
from .motion import Coordinates, Motion
from .parameters import Parameter, ShapeParameter
from .transmission import Side

if TYPE_CHECKING:
    from .robot import Robot

Array = np.ndarray


class Axis(StrEnum):
    """The quantity against which the residual of a missing effect is best looked at."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    LOAD = "load"
    TIME = "time"
    MOTOR_ANGLE = "motor angle"
    TORQUE = "torque"


class Need(StrEnum):
    """What an effect's columns depend on beside the motion at the same instant.

    LOAD: the rigid body's torque as the model predicts it (`Motion.load`). HISTORY: the motion before, from the start of
    the run. TORQUE: the measured torque. TIME: the run's own clock."""

    LOAD = "load"
    HISTORY = "history"
    TORQUE = "torque"
    TIME = "time"


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """One additive term of the torque equation, linear in its parameters.

    `joints`: names of the joints (or motors) it sits on, None for all. `side`: the side on which its torque acts.
    Shape (nonlinear) parameters are further fields, declared by `shape`."""

    name: ClassVar[str]
    title: ClassVar[str]
    axis: ClassVar[Axis]
    needs: ClassVar[frozenset[Need]] = frozenset()

    joints: tuple[str, ...] | None = None
    side: Side = Side.MOTOR

    def __post_init__(self) -> None:
        object.__setattr__(self, "side", Side(self.side))
        if self.joints is not None:
            object.__setattr__(self, "joints", (self.joints,) if isinstance(self.joints, str) else tuple(self.joints))

    @abstractmethod
    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """The linear parameters, in the order of the columns."""

    @abstractmethod
    def columns(self, motion: Motion, robot: Robot) -> Array:
        """Torque per unit parameter, (N, n, k), on the effect's side."""

    def shape(self) -> tuple[ShapeParameter, ...]:
        """The nonlinear parameters: fields of this effect."""
        return ()

    def with_shape(self, **values: float) -> Self:
        """The same effect with other shape parameters."""
        return dataclasses.replace(self, **values)

    def at(self, robot: Robot) -> list[int]:
        """Indices of the joints the effect sits on. Raises ConfigurationError for a name the robot does not have."""
        return list(range(robot.n)) if self.joints is None else [robot.joint_index(j) for j in self.joints]


@dataclass(frozen=True, kw_only=True)
class JointEffect(Effect):
    """An effect with the same few columns on each joint: torque on joint j depends on joint j's own motion."""

    #: For each column: symbol, unit of the parameter with `{tau}`, `{q}`, `{inertia}` for the units of torque, position and inertia, lower bound.
    symbols: ClassVar[tuple[tuple[str, str, float], ...]]

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        found = []
        for j in self.at(robot):
            q, tau = robot.position_unit(j, self.side), robot.force_unit(j, self.side)
            # Behind a gear, an effect may sit on both sides of the same joint; a J marks the joint side.
            mark = "J" if self.side == Side.JOINT and not robot.is_direct(j) else ""
            for symbol, unit, lower in self.symbols:
                found.append(Parameter(f"{symbol}{mark}_{robot.joint_names[j]}", unit.format(q=q, tau=tau, inertia="kg" if q == "m" else "kg m^2"), self.name, robot.joint_names[j], lower))
        return tuple(found)

    @abstractmethod
    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        """For each column its values (N, len(at)) on the joints `at`; `own` is the motion of those on the effect's side."""

    def columns(self, motion: Motion, robot: Robot) -> Array:
        at = self.at(robot)
        full = motion.on(self.side)
        own = Coordinates(full.q[:, at], full.dq[:, at], full.ddq[:, at])
        width = len(self.symbols)
        out = np.zeros((len(motion), robot.n, width * len(at)))
        for s, values in enumerate(self.basis(own, motion, at)):
            for i, j in enumerate(at):
                out[:, j, i * width + s] = values[:, i]
        return out


_E = TypeVar("_E", bound=Effect)
_REGISTRY: dict[str, type[Effect]] = {}


def register(effect: type[_E]) -> type[_E]:
    """Class decorator: make an effect known by its name (study files, command line, diagnosis)."""
    known = _REGISTRY.get(effect.name)
    if known is not None and (known.__module__, known.__qualname__) != (effect.__module__, effect.__qualname__):
        raise ConfigurationError(f"two effects are named {effect.name!r}: {known.__module__} and {effect.__module__}.")
    _REGISTRY[effect.name] = effect
    return effect


def _load_all() -> None:
    for package_name in ("ident.effects", "ident.friction"):
        package = importlib.import_module(package_name)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package_name}.{module.name}")


def effect_types() -> dict[str, type[Effect]]:
    """Every registered effect by name, the built-in ones and the user's."""
    _load_all()
    return dict(sorted(_REGISTRY.items()))


def effect_names() -> tuple[str, ...]:
    """Names of all registered effects."""
    return tuple(effect_types())


def make_effect(name: str, **configuration: Any) -> Effect:
    """An effect by its name, as study files give it. Unknown names and keys raise ConfigurationError with the nearest."""
    types = effect_types()
    if name not in types:
        raise unknown_name("effect", name, types)
    known = {f.name for f in dataclasses.fields(types[name])}
    for key in configuration:
        if key not in known:
            raise unknown_name(f"key of effect {name!r}", key, known)
    return types[name](**configuration)
