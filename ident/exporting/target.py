"""What a file format or a simulator is to the export: a name, what it can express, and how the file is written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeVar

from .._utils.registered import Registry
from ..errors import unknown_name
from .urdf import Attached, BodyExport

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from .identified import Identified


class Expressed(StrEnum):
    """What a target may be able to say of a joint's actuator beside its links."""

    ARMATURE = "armature"
    DAMPING = "damping"
    DRY_FRICTION = "dry friction"
    BREAKAWAY = "static friction above dynamic friction"
    COUPLING = "coupled transmission"
    OFFSET = "constant torque"
    SPRING = "spring"
    DELAY = "delay"
    VELOCITY_COMMAND = "velocity command"
    VOLTAGE_COMMAND = "voltage command"
    INTEGRAL = "integral of the error"
    SPEED_TORQUE = "limit that falls with speed"
    COMMAND_FILTER = "filter of commands"


@dataclass(frozen=True, eq=False)
class ExportOptions:
    """What a caller may want. `urdf`: file to patch; `attached`, `allow_inconsistent`: links of a URDF. `logs`: motion on which the errors
    of what a target cannot express are computed. `units`: fits of further units of the same robot, `samples`, `seed`: for ranges."""

    urdf: str | Path | None = None
    attached: Attached | str = Attached.KEEP
    allow_inconsistent: bool = False
    logs: LogSet | None = None
    units: tuple[Identified, ...] = ()
    samples: int = 500
    seed: int = 0


@dataclass(frozen=True)
class WrittenFile:
    """What a target makes: the file's content, notes for people, and the bodies of a URDF."""

    content: str | bytes
    notes: tuple[str, ...] = ()
    bodies: tuple[BodyExport, ...] = field(default=())


class ExportTarget(ABC):
    """One format. A new one is one file in `ident/exporting/targets` (or a plugin's), with one class that is registered.

    `name`: as `--to` has it; `suffixes`: of files that are meant by their name; `expresses`: what it can say; the rest is listed with
    the error that leaving it out makes. `bodies`: whether it needs links that real bodies can have, or any that give the torque."""

    name: ClassVar[str]
    title: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]] = ()
    expresses: ClassVar[frozenset[Expressed]] = frozenset()
    bodies: ClassVar[bool] = True

    @abstractmethod
    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        """The file of an identified robot."""


_T = TypeVar("_T", bound=ExportTarget)
_REGISTRY: Registry[ExportTarget] = Registry("export target", "ident.exporting.targets")


def register_target(target: type[_T]) -> type[_T]:
    """Class decorator: make a target known by its name. Raises ConfigurationError where another has it."""
    _REGISTRY.add(target)
    return target


def target_types() -> dict[str, type[ExportTarget]]:
    """Every target by name."""
    return _REGISTRY.types()


def make_target(name: str | None, file: Path) -> ExportTarget:
    """A target by its name, or by the suffix of the file where no name is given. Raises ConfigurationError for none of them."""
    known = target_types()
    if name is None:
        name = next((key for key, kind in known.items() if file.suffix.lower() in kind.suffixes), file.suffix)
    if name not in known:
        raise unknown_name("export format", name, tuple(known))
    return known[name]()
