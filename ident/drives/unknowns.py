"""What is unknown of joints under a drive law: parameters of the model and constants of the law, each with its place and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.offset import Offset
from ..effects.rigid_body import RigidBody
from ..effects.springs import LinearSpring
from ..errors import ConfigurationError, UnsupportedError
from ..friction.drive import Coulomb, RotorInertia, Viscous
from ..friction.load import LoadDependentFriction
from ..friction.speed import Stribeck
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..model import Model
    from ..robots.robot import Robot
    from .law import DriveLaw

Array = np.ndarray
#: Effects that a simulated drive can have, with what they are there.
_PLACES: dict[type[Effect], str] = {
    RotorInertia: "armature", Viscous: "viscous", Coulomb: "dry", Offset: "offset", LoadDependentFriction: "load", Stribeck: "excess",
    LinearSpring: "spring",
}  # fmt: skip
#: Constants of a law: symbol and unit, where a joint turns.
CONSTANTS = {
    "kp": ("kp", "N m/rad"), "kd": ("kd", "N m s/rad"), "delay_s": ("delay", "s"), "command_lag_s": ("lag", "s"),
    "deadband": ("deadband", "rad"), "effort_limit": ("effort_limit", "N m"),
    "torque_scale": ("s", "1"), "back_emf": ("ke", "N m s/rad"), "gear_loss": ("Fm", "1"), "gear_loss_square": ("Fmm", "1/(N m)"),
    "gear_loss_slow": ("Fms", "1"), "slow_speed": ("v_m", "rad/s"), "joint_stiffness": ("k", "N m/rad"),
    "joint_damping": ("d", "N m s/rad"), "feed_forward": ("f", "1"), "ki": ("ki", "N m/(rad s)"), "integral_start": ("I0", "N m"),
    "no_load_speed": ("v0", "rad/s"),
}  # fmt: skip

#: The same of laws whose torque grows with a voltage, where they have other units.
_UNITS = {
    "pwm": {"kp": "1/rad", "kd": "s/rad", "effort_limit": "1", "torque_scale": "N m/V"},
    "voltage": {"effort_limit": "V", "torque_scale": "N m/V"},
}
#: Units of a joint that turns, with those of one that slides.
_SLIDES = {
    "N m": "N", "N m/rad": "N/m", "N m s/rad": "N s/m", "N m/(rad s)": "N/(m s)", "1/(N m)": "1/N", "N m/V": "N/V",
    "rad": "m", "rad/s": "m/s", "1/rad": "1/m", "s/rad": "s/m",
}  # fmt: skip

#: What stays as it is when all torque of a joint is another by one factor; the scale of a duty is one of torque, its gains are not.
_APART = (
    "delay_s",
    "command_lag_s",
    "deadband",
    "load",
    "gear_loss",
    "gear_loss_square",
    "gear_loss_slow",
    "slow_speed",
    "torque_scale",
    "no_load_speed",
)
_OF_DUTY = ("kp", "kd", "effort_limit", "ki", "integral_start")


@dataclass(frozen=True)
class Unknown:
    """One unknown number. `place`: what it is in the simulation ("link": a base parameter of the links); `joint`: index, -1 for all;
    `column`: of a parameter of the model, its index among all; `lower`: bound; `expression`: what is grouped in it; `log`: the only log
    that it is of, "" for all; `factor`: what its joint has for one of it, which stands on the motor's side of gears; `scale`: whether all
    torque of the drive is in proportion to it."""

    name: str
    unit: str
    place: str
    joint: int
    lower: float = 0.0
    column: int = -1
    expression: str = ""
    effect: str = ""
    log: str = ""
    factor: float = 1.0
    scale: bool = False


def unknowns(model: Model, law: DriveLaw, starts: Sequence[tuple[str, int]] = ()) -> tuple[Unknown, ...]:
    """Everything that is to be identified, parameters of the model first. Raises UnsupportedError, ConfigurationError.

    `starts`: log and joint of each integral whose start is not known."""
    found = _of_model(model, law)
    robot = model.robot
    for key, (symbol, unit) in CONSTANTS.items():
        unit = _UNITS.get(law.kind, {}).get(key, unit)
        units = [_SLIDES.get(unit, unit) if joint.prismatic else unit for joint in robot.joints]
        if key == "integral_start":
            found += [
                Unknown(f"{symbol}_{robot.joint_names[j]}_{log}", units[j], key, j, -np.inf, effect="drive", log=log) for log, j in starts
            ]
            continue
        at = np.flatnonzero(np.isnan(law.constants[key]) & _asked(law, key))
        scale = key in law.scales
        if key in law.shared and len(at):
            found.append(Unknown(symbol, unit, key, -1, effect="drive"))
            continue
        found += [Unknown(f"{symbol}_{robot.joint_names[j]}", units[j], key, int(j), effect="drive", scale=scale) for j in at]
    if not found:
        raise ConfigurationError("nothing to identify: no effect is declared, and every constant of the drive law is known.")
    return tuple(found)


def follows_torque(unknown: Unknown, scale: str = "kp") -> bool:
    """Whether a number grows with all torque of its joint, of which `scale` ("kp", "kd", "torque_scale") is the measure."""
    if scale == "torque_scale":
        return unknown.place == scale or unknown.place not in (*_APART, *_OF_DUTY)
    return unknown.place not in _APART


def _asked(law: DriveLaw, key: str) -> Array:
    """Joints (n,) for which some log leaves the constant open."""
    n = len(law.joints)
    if key not in law.only_by_log:
        return np.ones(n, bool)
    given = [table["constants"].get(key) for table in law.by_log.values()]
    return np.array([not all(v is not None and not np.isnan(v[j]) for v in given) for j in range(n)])


def _of_model(model: Model, law: DriveLaw) -> list[Unknown]:
    robot = model.robot
    links = next((part for effect, part in zip(model.effects, model.slices, strict=True) if isinstance(effect, RigidBody)), slice(0, 0))
    place: dict[int, tuple[str, int]] = {}
    factors: dict[int, float] = {}
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, RigidBody):
            place |= dict.fromkeys(range(part.start, part.stop), ("link", -1))
            continue
        kind = next((where for known, where in _PLACES.items() if isinstance(effect, known)), None)
        if kind is None:
            raise UnsupportedError(
                f"effect {effect.name!r} is not simulated under a drive law; known: {', '.join(sorted(e.name for e in _PLACES))}."
            )
        at = effect.at(robot)
        # Joint by joint: what the effect is, then what holds at every position (a spring's torque at zero).
        each = (part.stop - part.start) // max(len(at), 1)
        own = {part.start + i: (kind if i % each == 0 else "offset", at[i // each]) for i in range(part.stop - part.start)}
        factors |= {i: _factor(effect, where, joint, robot) for i, (where, joint) in own.items()}
        place |= own
    # A spring's rest position is an offset over again where one is declared.
    offsets = [(where, i) for i, where in place.items() if where[0] == "offset"]
    doubled = {i for where, i in offsets if i != next(k for other, k in offsets if other == where)}
    expressions: dict[int, str] = {}
    if law.links_known:
        kept = [i for i in range(len(model.parameters)) if not links.start <= i < links.stop]
    else:
        kept, expressions = _grouped(model, law)
    return [
        Unknown(
            p.name,
            p.unit,
            *place[i],
            -np.inf if place[i][0] == "link" else p.lower,
            i,
            expressions.get(i, p.name),
            p.effect,
            factor=factors.get(i, 1.0),
        )
        for i in kept
        if i not in doubled
        for p in (model.parameters[i],)
    ]


def _factor(effect: Effect, place: str, joint: int, robot: Robot) -> float:
    """What a joint has for one of what an effect has on its side of the gears. Raises UnsupportedError."""
    ratio = 1.0 / float(robot.transmission.K[joint, joint])
    if effect.side == Side.JOINT or ratio == 1.0:
        return 1.0
    if isinstance(effect, LinearSpring):
        raise UnsupportedError(f'effect {effect.name!r} on the side of a geared motor is not simulated under a drive law: side = "joint".')
    return {"armature": ratio**2, "viscous": ratio**2, "offset": ratio, "load": 1.0}.get(place, abs(ratio))


def _without_sprung_rotors(model: Model, law: DriveLaw) -> Model:
    """The model without the inertias of rotors that a spring parts from their links; itself where there are none."""
    tables = [law.constants, *(table["constants"] for table in law.by_log.values())]
    sprung = np.any([~np.isinf(table["joint_stiffness"]) for table in tables if "joint_stiffness" in table], axis=0)
    kept: list[Effect] = []
    names = model.robot.joint_names
    for effect in model.effects:
        at = effect.at(model.robot) if isinstance(effect, RotorInertia) else []
        if not any(sprung[j] for j in at):
            kept.append(effect)
        elif joints := tuple(names[j] for j in at if not sprung[j]):
            kept.append(replace(effect, joints=joints))
    return model if tuple(kept) == model.effects else replace(model, effects=tuple(kept))


def _grouped(model: Model, law: DriveLaw) -> tuple[list[int], dict[int, str]]:
    """Columns of the parameters that stand for all, and what each stands for. A rotor behind a spring moves by itself: its inertia is no
    part of the link's."""
    rigid = _without_sprung_rotors(model, law)
    if rigid is model:
        kept = [int(i) for i in model.base.independent]
        return kept, dict(zip(kept, model.base.expressions, strict=True))
    at = {p.name: i for i, p in enumerate(model.parameters)}
    columns = [at[rigid.parameters[int(i)].name] for i in rigid.base.independent]
    apart = [at[name] for name in at if name not in {p.name for p in rigid.parameters}]
    return sorted([*columns, *apart]), dict(zip(columns, rigid.base.expressions, strict=True))
