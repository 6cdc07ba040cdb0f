"""The tables that describe a robot and its drive, as study files, drive files and built-in robots write them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .._utils.json_schema import NUMBER, of_kind, of_table
from .._utils.text import counted
from .._utils.toml import Kind, Unfit, check_table, described, flag, load_toml, matrix, number, numbers, one_of, table_of, text, texts
from ..errors import ConfigurationError
from .transmission import Side, Transmission

#: The model beside the rigid body where nothing is declared: what every geared joint has.
DEFAULT_EFFECTS = ("rotor_inertia", "viscous", "coulomb")
#: What a logged torque may be: behind the gears, of the motors, a current, an estimate, of outside forces alone, a command, or nothing.
TORQUES = ("link", "motor", "current", "estimated", "external", "command", "none")


#: Constants of a law from command to torque that a drive need not have: they are then without end.
ENDLESS = ("effort_limit", "joint_stiffness", "no_load_speed")


def constants(value: Any) -> Any:
    """A constant of a drive law: a number, a list of numbers, a table by joint, or "identify" (also "fit") for what is unknown."""
    return _constants(value, 'a number, a list of numbers, a table of joint = number, or "identify"')


def endless_constants(value: Any) -> Any:
    """The same of one that a drive need not have (`ENDLESS`): "none" where it has none."""
    return _constants(value, 'a number, a list of numbers, a table of joint = number, "identify", or "none"', ("none",))


def _constants(value: Any, expected: str, words: tuple[str, ...] = ()) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _constant(v, expected, words) for k, v in value.items()}
    if isinstance(value, list | tuple) and value:
        return tuple(_constant(v, expected, words) for v in value)
    return _constant(value, expected, words)


def _constant(value: Any, expected: str, words: tuple[str, ...]) -> float | str:
    if value in ("identify", "fit"):
        return "identify"
    if isinstance(value, str) and value in words:
        return value
    try:
        return number(value)
    except Unfit:
        only = f'; only {", ".join(ENDLESS[:-1])} and {ENDLESS[-1]} may be "none"' if value == "none" else ""
        raise Unfit(expected + only) from None


for _kind, _words in ((constants, ["identify", "fit"]), (endless_constants, ["identify", "fit", "none"])):
    _one = {"anyOf": [NUMBER, {"enum": _words}]}
    _many = [{"type": "array", "items": _one}, {"type": "object", "additionalProperties": _one}]
    described(_kind, {"anyOf": [*_one["anyOf"], *_many]})


def effect_entries(value: Any) -> tuple[Mapping[str, Any], ...]:
    """Effects as a file gives them (a name, a table, or a list of both), each as a table with its name."""
    entries = [value] if isinstance(value, str | Mapping) else value
    expected = 'a list of effect names or tables such as { name = "coulomb", joints = ["joint1"] }'
    if not isinstance(entries, list | tuple):
        raise Unfit(expected)
    found = []
    for entry in entries:
        named = {"name": entry} if isinstance(entry, str) else entry
        if not isinstance(named, Mapping) or not isinstance(named.get("name"), str):
            raise Unfit(expected)
        found.append(dict(named))
    return tuple(found)


def _signs(value: Any) -> tuple[float, ...]:
    """1 or -1, or a list of such."""
    entries = value if isinstance(value, list | tuple) else [value]
    if not entries or any(isinstance(x, bool) or x not in (1, -1) for x in entries):
        raise Unfit("1 or -1, or a list of them, one per joint")
    return tuple(float(x) for x in entries)


described(_signs, {"anyOf": [{"enum": [1, -1]}, {"type": "array", "items": {"enum": [1, -1]}, "minItems": 1}]})


def load(value: Any) -> Mapping[str, Any]:
    """A known body that a link carries, as a table."""
    if not isinstance(value, Mapping):
        raise Unfit('a table such as { joint = "joint1", mass = 0.5, com = [0, 0, -0.2] }')
    return dict(value)


_three, _six = ({"type": "array", "items": NUMBER, "minItems": k, "maxItems": k} for k in (3, 6))
_body = {"joint": {"type": "string"}, "mass": {**NUMBER, "exclusiveMinimum": 0}, "com": _three, "inertia": _six}
described(load, {"type": "object", "properties": _body, "required": ["joint", "mass", "com"], "additionalProperties": False})


@dataclass(frozen=True)
class RobotTable:
    """`[robot]`: which robot, and how it stands. None: as the robot's own description has it.

    `name`: built-in or of example-robot-data; `urdf`: file instead; `gravity` (3,) m/s²; `locked`: joint → position of
    joints that are not identified; `joints`: those to keep; `payload`: one that the built-in robot offers."""

    name: str | None = None
    urdf: Path | None = None
    gravity: tuple[float, ...] | None = None
    locked: Mapping[str, float] | None = None
    joints: tuple[str, ...] | None = None
    payload: str | None = None
    floating_base: bool = False

    SCHEMA: ClassVar[Mapping[str, Kind]] = {
        "name": text,
        "urdf": text,
        "gravity": numbers(3),
        "locked": table_of(number, "a table of joint = position"),
        "joints": texts,
        "payload": text,
        "floating_base": flag,
    }

    @classmethod
    def read(cls, data: Any, folder: Path, where: str) -> RobotTable:
        """From a TOML table; `folder` is where relative paths start."""
        values = check_table(data, cls.SCHEMA, "robot", where)
        if "name" in values and "urdf" in values:
            raise ConfigurationError(f"{where}: [robot] has both name and urdf; give one of them.")
        if "urdf" in values:
            values["urdf"] = folder / values["urdf"]
        return cls(**values)


#: Constants of a law from command to torque.
LAW_CONSTANTS = (
    "kp", "kd", "delay_s", "effort_limit", "torque_scale", "back_emf", "gear_loss", "gear_loss_square", "gear_loss_slow", "slow_speed",
    "joint_stiffness", "joint_damping", "feed_forward", "command_lag_s", "deadband", "ki", "integral_start", "no_load_speed",
)  # fmt: skip


@dataclass(frozen=True)
class DriveTable:
    """`[drive]`: the transmission as data, and the declared effects. None: not given.

    `measured`: side of the logged torque; `ratio` (n,): motor turns per joint turn, or `K` (n, n): θ = K θ_m; `zero` (n,):
    joint positions at motor zero; `torque_constants` (n,) N m/A; `effects`: {"name": …, key: value, …} each; `torque`: what the logged
    torque is (`TORQUES`); `torque_sign`: 1 or -1 for all joints, or for each, by which it is taken.

    What a drive makes of its commands, for logs without torque (`ident.drives`): `law` and its constants (each a number, numbers
    per joint, a table by joint, "identify", or, of `ENDLESS`, "none"); `command`, `velocity_command`: what happens between and beside
    the logged commands; `supply`: which voltage of a drive that is sent pulses;
    `links`: "known" (the URDF's inertials are right) or "identify"; `by_log`: name or pattern of a log → constants of that log, and `load`:
    a known body that a link carries there."""

    measured: str | None = None
    ratio: tuple[float, ...] | None = None
    K: tuple[tuple[float, ...], ...] | None = None
    zero: tuple[float, ...] | None = None
    torque_constants: tuple[float, ...] | None = None
    effects: tuple[Mapping[str, Any], ...] | None = None
    torque: str | None = None
    torque_sign: tuple[float, ...] | None = None
    law: str | None = None
    kp: Any = None
    kd: Any = None
    delay_s: Any = None
    effort_limit: Any = None
    torque_scale: Any = None
    back_emf: Any = None
    gear_loss: Any = None
    gear_loss_square: Any = None
    gear_loss_slow: Any = None
    slow_speed: Any = None
    joint_stiffness: Any = None
    joint_damping: Any = None
    feed_forward: Any = None
    command_lag_s: Any = None
    deadband: Any = None
    ki: Any = None
    integral_start: Any = None
    no_load_speed: Any = None
    command: str | None = None
    velocity_command: str | None = None
    supply: str | None = None
    links: str | None = None
    by_log: Mapping[str, Mapping[str, Any]] | None = None

    #: Keys that a log may have for itself, under `by_log`.
    OF_A_LOG: ClassVar[Mapping[str, Kind]] = {
        **{key: endless_constants if key in ENDLESS else constants for key in LAW_CONSTANTS},
        "command": one_of("staircase", "ramp"),
        "velocity_command": one_of("logged", "zero", "derivative"),
        "supply": one_of("logged", "mean"),
    }
    SCHEMA: ClassVar[Mapping[str, Kind]] = {
        "measured": one_of("motor", "joint"),
        "ratio": numbers(),
        "K": matrix,
        "zero": numbers(),
        "torque_constants": numbers(),
        "effects": effect_entries,
        "torque": one_of(*TORQUES),
        "torque_sign": _signs,
        "law": text,
        **OF_A_LOG,
        "links": one_of("known", "identify"),
        "by_log": described(
            table_of(lambda value: value, "a table of log = constants"),
            {"type": "object", "additionalProperties": of_table({key: of_kind(kind) for key, kind in (*OF_A_LOG.items(), ("load", load))})},
        ),
    }

    @classmethod
    def read(cls, data: Any, where: str) -> DriveTable:
        """From a TOML table."""
        values = check_table(data, cls.SCHEMA, "drive", where)
        for name, table in values.get("by_log", {}).items():
            values["by_log"][name] = check_table(table, {**cls.OF_A_LOG, "load": load}, f"drive.by_log.{name}", where)
        if "ratio" in values and "K" in values:
            raise ConfigurationError(f"{where}: [drive] has both ratio and K; give one of them.")
        return cls(**values)

    @property
    def moves(self) -> bool:
        """Whether it says how motors and joints are geared."""
        return self.ratio is not None or self.K is not None

    def over(self, other: DriveTable) -> DriveTable:
        """This table, completed by another. A gearing replaces the whole gearing of the other, its zero included."""
        hidden = {"ratio", "K", "zero"} if self.moves else set()
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return DriveTable(**{k: getattr(other, k) if v is None and k not in hidden else v for k, v in values.items()})

    def transmission(self, n: int) -> Transmission:
        """The transmission of a robot with n joints. Raises ConfigurationError for sizes and values that do not fit."""
        if self.ratio is not None:
            K = Transmission.from_ratio(np.array(self.ratio)).K
        elif self.K is not None:
            K = np.array(self.K)
        else:
            K = np.eye(n)
        if len(K) != n:
            raise ConfigurationError(
                f"[drive] {'ratio' if self.ratio is not None else 'K'} describes {counted(len(K), 'joint')}, but the robot has {n}."
            )
        constants = None if self.torque_constants is None else np.array(self.torque_constants)
        zero = np.zeros(n) if self.zero is None else np.array(self.zero)
        return Transmission(K, zero, Side(self.measured or Side.JOINT), constants)


def read_loop(data: Any, where: str) -> dict[str, dict[str, float]]:
    """`[loop]`: dependent joint → {independent joint: factor, "offset": constant}."""
    rule = table_of(number, "a table of joint = factor, and offset = constant")
    if not isinstance(data, Mapping):
        raise ConfigurationError(f"{where}: [loop] must be a table, not {data!r}.")
    return check_table(data, dict.fromkeys(data, rule), "loop", where)


def read_drive(path: Path) -> DriveTable:
    """A drive file: a `[drive]` table, or its keys at top level. Raises ConfigurationError."""
    data = load_toml(path, "drive file")
    return DriveTable.read(data.get("drive", data), f"drive file {path}")
