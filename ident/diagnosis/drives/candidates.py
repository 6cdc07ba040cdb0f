"""What can be missing of joints under a drive law: effects of the model, and constants of the law that are not as declared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...drives.given import VelocityCommand
from ...drives.law import SHARED, DriveLaw
from ...drives.plant import DrivePlant
from ...drives.starts import largest_asked, starts
from ...drives.unknowns import CONSTANTS
from ...effects.registry import make_effect

Array = np.ndarray
#: Effects of the model, with what their first parameter is in the simulation.
_EFFECTS = {
    "rotor_inertia": "armature", "viscous": "viscous", "coulomb": "dry", "offset": "offset", "load_dependent_friction": "load",
    "stribeck": "excess", "linear_spring": "spring",
}  # fmt: skip
#: Names of what is found where a constant of the law is not as declared.
_CONSTANTS = {
    "kp": "kp", "kd": "kd", "delay_s": "delay", "gear_loss": "gear_loss", "joint_stiffness": "joint_elasticity",
    "feed_forward": "feed_forward", "ki": "ki", "deadband": "deadband", "effort_limit": "effort_limit",
}  # fmt: skip
#: Stribeck velocities that are looked at, as shares of a joint's usual speed.
_SLOW = (0.1, 0.4)
#: Resonances (Hz) of links on springs that are looked at.
_SPRINGS_HZ = (4.0, 7.0, 12.0, 20.0)
#: Damping of such a spring as a share of the critical.
_DAMPED = 0.02
#: Limits of the drives' torque that are looked at, as shares of the largest that the commands ask for.
_LIMITS = (0.8, 0.5)
#: What may be smaller than declared.
_EITHER_WAY = ("offset", "kp", "kd", "delay_s", "feed_forward", "ki")


@dataclass(frozen=True)
class DriveCandidate:
    """One thing that may be missing: `name` of the effect, its `place` in the simulation, further configuration (`v_s`, `hz`, `share`)."""

    name: str
    place: str
    settings: dict[str, float] = field(default_factory=dict)

    @property
    def either_way(self) -> bool:
        """Whether it may be smaller than declared, too."""
        return self.place in _EITHER_WAY or (self.place == "effort_limit" and not self.settings)

    @property
    def of_all(self) -> bool:
        """Whether it is one number for all joints, as a delay is."""
        return self.place in SHARED

    @property
    def far(self) -> bool:
        """Whether it is looked at from a number of its own, because nothing shows near what is declared: a spring is stiff there, and a
        limit out of reach."""
        return "hz" in self.settings or "share" in self.settings

    def added_to(self, plant: DrivePlant, joints: Sequence[int]) -> DrivePlant:
        """The plant with it on these joints, to be identified."""
        law, model = plant.law, plant.model
        if self.place in law.constants:
            constants = {key: values.copy() for key, values in law.constants.items()}
            constants[self.place][slice(None) if self.of_all else list(joints)] = np.nan
            if self.place == "joint_stiffness":
                constants["joint_damping"][list(joints)] = np.nan
            shared = law.shared | ({self.place} if self.of_all else set())
            return replace(plant, law=replace(law, constants=constants, shared=shared))
        names = tuple(plant.robot.joint_names[j] for j in joints)
        settings = {"v_s": self.settings["v_s"]} if "v_s" in self.settings else {}
        return replace(plant, model=model + make_effect(self.name, joints=names, **settings))

    def declared(self, law: DriveLaw, joint: int) -> float:
        """Its value where nothing is missing."""
        return float(law.constants[self.place][joint]) if self.place in law.constants else 0.0


def candidates(plant: DrivePlant) -> Iterator[DriveCandidate]:
    """Those that the declared model and law leave room for."""
    law = plant.law
    declared = {effect.name for effect in plant.model.effects}
    for name, place in _EFFECTS.items():
        if name in declared or (name == "offset" and "linear_spring" in declared):
            continue
        if name != "stribeck":
            yield DriveCandidate(name, place)
            continue
        speed = np.sqrt(np.mean(np.concatenate([np.gradient(log.q, log.t, axis=0) for log in plant.logs]) ** 2))
        yield from (DriveCandidate(name, place, {"v_s": share * float(speed)}) for share in _SLOW)
    by_log = {key for table in law.by_log.values() for key in table["constants"]}
    moved = any(np.any(log.dq_cmd) for log in plant.logs)
    for place, name in _CONSTANTS.items():
        if place == "joint_stiffness":
            # A spring on one joint leaves the others in doubt. Of links that are not known either, it would have to part rotor and link.
            if plant.law.links_known and place not in by_log and np.isinf(law.constants[place]).any() and "rotor_inertia" in declared:
                yield from (DriveCandidate(name, place, {"hz": hz}) for hz in _SPRINGS_HZ)
            continue
        if place == "effort_limit" and not law.in_volts and not any(np.isnan(law.constants[key]).any() for key in ("kp", "kd", place)):
            yield from (DriveCandidate(name, place, {"share": share}) for share in _LIMITS)
            if not np.isfinite(law.constants[place]).all():
                continue
        if place in law.fixed or place in by_log or np.isnan(law.constants[place]).any():
            continue
        if place == "feed_forward" and not any(np.any(log.tau_ff) for log in plant.logs):
            continue
        if (place == "kd" and not moved) or (place == "kp" and (law.kind == "pd_velocity" or not law.links_known)):
            continue
        yield DriveCandidate(name, place)


def same_motion(candidate: DriveCandidate, joints: Sequence[int], law: DriveLaw, wider: DrivePlant, values: Array) -> tuple[str, ...]:
    """What else of a declared `law` may be another than declared, and leads to the very same motion as the candidate on these joints.

    A kd that acts on a velocity command which nobody logged says how large that command was, as long as viscous friction makes up for the
    rest. Where the scale of the torque is not known, a gain is one beside the limit. `values` (p,): of the `wider` plant, with both."""
    found = {(u.place, u.joint): u.factor * float(v) for u, v in zip(wider.unknowns, values, strict=True)}
    if candidate.place == "kd":
        sent = {law.for_log(log.name).velocity_command for log in wider.logs if np.any(log.dq_cmd)}
        more = [found["kd", j] - candidate.declared(law, j) for j in joints]
        friction = [found.get(("viscous", j), -np.inf) for j in joints]
        made_up = all(f + m >= 0.0 for f, m in zip(friction, more, strict=True))
        return ("velocity_command",) if sent == {VelocityCommand.DERIVATIVE} and made_up else ()
    if candidate.place == "kp":
        own = list(joints)
        free = np.isnan(law.constants["torque_scale"][own]) & np.isfinite(law.constants["effort_limit"][own])
        return ("effort_limit",) if np.all(free & (law.constants["kd"][own] == 0.0)) else ()
    return ()


def values_in(wider: DrivePlant, plant: DrivePlant, values: Array, candidate: DriveCandidate, inertia: Array) -> tuple[Array, Array, Array]:
    """Values and sizes (p,) of the wider plant's unknowns where nothing is missing, and which of them are the candidate's own (p,).

    `inertia` (n,): what each joint moves, kg m²."""
    known = {u.name: float(v) for u, v in zip(plant.unknowns, values, strict=True)}
    _, sizes = starts(wider)
    at, own = np.zeros(len(wider.unknowns)), np.zeros(len(wider.unknowns), bool)
    for i, unknown in enumerate(wider.unknowns):
        if unknown.name in known:
            at[i] = known[unknown.name]
            continue
        own[i] = True
        if unknown.place in ("joint_stiffness", "joint_damping"):
            at[i] = _spring(unknown.place, float(inertia[unknown.joint]), candidate.settings["hz"])
        elif "share" in candidate.settings:
            at[i] = candidate.settings["share"] * float(largest_asked(plant, plant.law.constants[plant.law.gain])[unknown.joint])
        elif unknown.place in CONSTANTS:
            at[i] = candidate.declared(plant.law, max(unknown.joint, 0))
    return at, np.maximum(sizes, 1e-3 * np.abs(at)), own


def _spring(place: str, inertia: float, hz: float) -> float:
    stiffness = inertia * (2.0 * np.pi * hz) ** 2
    return stiffness if place == "joint_stiffness" else 2.0 * _DAMPED * inertia * 2.0 * np.pi * hz
