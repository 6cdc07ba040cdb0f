"""What a diagnosis finds: findings with competing models, what is left unexplained, and what the motion could not have shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.places import motors_of, place_of, place_of_joints
from ..statistics.torque_error import number

if TYPE_CHECKING:
    from ..effects.base import Effect

#: A finding is ambiguous when its competing models together are at least this probable.
AMBIGUOUS = 0.2
#: Competing models less probable than this are not worth a word.
_NAMED = 0.01
#: Sizes beyond so many times a joint's torque are of no interest; places of an effect that are told to people.
_ANY = 10.0
_PLACES = 4


@dataclass(frozen=True)
class FoundParameter:
    """A parameter of a finding: linear ones and shapes alike."""

    name: str
    value: float
    std: float
    unit: str

    def to_dict(self) -> dict[str, float | str]:
        return {"name": self.name, "value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class CompetingModel:
    """A competing model of a finding and its probability; `motors`: joints whose motors a coupling ties in.

    `share`: how much of what the finding explains it takes up in its place (NaN: not known), with the `values` (name, value, unit) of its
    linear parameters."""

    effect: str
    joints: tuple[str, ...]
    confidence: float
    motors: tuple[str, ...] = ()
    share: float = float("nan")
    values: tuple[tuple[str, float, str], ...] = ()

    @property
    def likely(self) -> bool:
        """Whether it is worth a word as what may be there in truth."""
        return self.confidence >= _NAMED

    @property
    def place(self) -> str:
        """Its joints, in words."""
        return place_of_joints(self.joints, self.motors)

    def to_dict(self) -> dict[str, Any]:
        tied = {"motors": list(self.motors)} if self.motors else {}
        values = [{"name": name, "value": value, "unit": unit} for name, value, unit in self.values]
        there = {"share": self.share, "parameters": values} if np.isfinite(self.share) else {}
        return {"effect": self.effect, "joints": list(self.joints), **tied, "confidence": self.confidence, **there}


@dataclass(frozen=True, eq=False)
class Finding:
    """An effect that the model lacks. `heldout_gain`: share of the held-out loss that it removes; `evidence`: the same as twice a
    log-likelihood; `confidence` that it is this effect, on these joints; `advice`: what to do next; `presence`: share of what it predicts
    on data held out that is there, with its standard error (NaN: none were held out)."""

    effect: Effect
    joints: tuple[str, ...]
    parameters: tuple[FoundParameter, ...]
    heldout_gain: float
    evidence: float
    confidence: float
    competing: tuple[CompetingModel, ...]
    advice: str = ""
    presence: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def place(self) -> str:
        """Its joints, in words."""
        return place_of(self.effect, self.joints)

    @property
    def configuration(self) -> dict[str, str]:
        """What its parameters refer to, where there is a choice: the side whose angle an order counts."""
        members = {f.name: getattr(self.effect, f.name) for f in fields(self.effect) if f.name != "side"}
        return {name: str(value) for name, value in members.items() if isinstance(value, StrEnum)}

    @property
    def ambiguous(self) -> bool:
        """Whether its competing models account for the same about as well."""
        return sum(i.confidence for i in self.competing) >= AMBIGUOUS

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.name,
            "joints": list(self.joints),
            **({"motors": list(motors)} if (motors := motors_of(self.effect)) else {}),
            **({"configuration": self.configuration} if self.configuration else {}),
            "parameters": [p.to_dict() for p in self.parameters],
            "heldout_gain": self.heldout_gain,
            "presence": number(self.presence[0]),
            "presence_std": number(self.presence[1]),
            "evidence": self.evidence,
            "confidence": self.confidence,
            "imitators": [i.to_dict() for i in self.competing],
            "advice": self.advice,
        }


@dataclass(frozen=True)
class Unexplained:
    """Structure that no effect of the catalogue accounts for."""

    joint: str
    signature: str
    evidence: str
    gain: float

    def to_dict(self) -> dict[str, Any]:
        return {"joint": self.joint, "signature": self.signature, "evidence": self.evidence, "gain": self.gain}


@dataclass(frozen=True)
class Undetermined:
    """A joint whose error on data held out is `times` that on the data fitted, as its uncertain parameters let it be."""

    joint: str
    times: float

    def to_dict(self) -> dict[str, Any]:
        return {"joint": self.joint, "times": self.times}


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect's parameter that may be as large as `least` (SI, `unit`) without being seen.

    Then it makes a torque of `torque` (`torque_unit`, standard deviation) on `joint`, `share` of what that joint's torque varies by; both
    are root mean squares where the effect is the same all the time. `advice`: the motion that would show it."""

    effect: str
    joints: tuple[str, ...]
    motors: tuple[str, ...]
    parameter: str
    unit: str
    least: float
    joint: str
    torque: float
    torque_unit: str
    share: float
    advice: str

    @property
    def place(self) -> str:
        """Where it sits, for people."""
        return place_of_joints(self.joints, self.motors)

    def __str__(self) -> str:
        """Place and size."""
        if self.share > _ANY:
            size = "of any size"
        else:
            size = (
                f"up to {self.least:.2g}{f' {self.unit}' if self.unit != '1' else ''}: {self.torque:.2g} {self.torque_unit} on {self.joint}"
            )
        return f"{self.place or 'whole robot'} ({size})"

    def to_dict(self) -> dict[str, Any]:
        motors = {"motors": list(self.motors)} if self.motors else {}
        return {
            "effect": self.effect, "joints": list(self.joints), **motors, "parameter": self.parameter, "unit": self.unit,
            "least": self.least, "joint": self.joint, "torque": self.torque, "torque_unit": self.torque_unit, "share": self.share,
            "advice": self.advice,
        }  # fmt: skip


def by_effect(found: Sequence[Hidden]) -> list[tuple[str, str, str]]:
    """For people: each effect, the largest first, the places where it hides and how large, and the motion that would show it."""
    effects = dict.fromkeys(h.effect for h in found)
    own = {name: [h for h in found if h.effect == name] for name in effects}
    return [(name, ", ".join(map(str, each[:_PLACES])) + _others(len(each) - _PLACES), each[0].advice) for name, each in own.items()]


def _others(count: int) -> str:
    return f", {count} more" if count > 0 else ""
