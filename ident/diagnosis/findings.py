"""Findings: what was accepted, in the terms of the answer, with confidence; and the verdict on the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..effect import Effect
from ..places import motors_of, place_of, place_of_joints
from .leftover import Leftover
from .search import Hit, parameter_std
from .selection import Found, Selection, Stage, touched

Array = np.ndarray
#: A finding is ambiguous when its rivals together are at least this probable.
AMBIGUOUS = 0.2
#: Rivals less probable than this are not worth a word.
_NAMED = 0.01
#: A finding is trusted no further than this: the catalogue may lack the true one.
_MOST = 0.99


@dataclass(frozen=True)
class FoundParameter:
    """A parameter of a finding: linear ones and shapes alike."""

    name: str
    value: float
    std: float
    unit: str

    def to_dict(self) -> dict[str, Any]:
        return {"name": self.name, "value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class Imitator:
    """A rival of a finding and its probability; `motors`: joints whose motors a coupling ties in."""

    effect: str
    joints: tuple[str, ...]
    confidence: float
    motors: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        """Its joints, in words."""
        return place_of_joints(self.joints, self.motors)

    def to_dict(self) -> dict[str, Any]:
        tied = {"motors": list(self.motors)} if self.motors else {}
        return {"effect": self.effect, "joints": list(self.joints), **tied, "confidence": self.confidence}


@dataclass(frozen=True, eq=False)
class Finding:
    """An effect that the model lacks. `heldout_gain`: share of the held-out loss that it removes; `evidence`: the same as twice a
    log-likelihood; `confidence` that it is this effect, on these joints; `advice`: what to do next."""

    effect: Effect
    joints: tuple[str, ...]
    parameters: tuple[FoundParameter, ...]
    heldout_gain: float
    evidence: float
    confidence: float
    imitators: tuple[Imitator, ...]
    advice: str = ""

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def place(self) -> str:
        """Its joints, in words."""
        return place_of(self.effect, self.joints)

    @property
    def ambiguous(self) -> bool:
        """Whether its rivals account for the same about as well."""
        return sum(i.confidence for i in self.imitators) >= AMBIGUOUS

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.name,
            "joints": list(self.joints),
            **({"motors": list(motors)} if (motors := motors_of(self.effect)) else {}),
            "parameters": [p.to_dict() for p in self.parameters],
            "heldout_gain": self.heldout_gain,
            "evidence": self.evidence,
            "confidence": self.confidence,
            "imitators": [i.to_dict() for i in self.imitators],
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


def assess(selection: Selection, left: Sequence[Leftover]) -> tuple[str, tuple[Finding, ...], tuple[Unexplained, ...]]:
    """Verdict, findings (the strongest first) and what stays unexplained."""
    robot = selection.final.problem.model.robot
    counted = [x for x in left if x.weight >= 1.0]
    findings = sorted((_finding(f, selection, left) for f in selection.found), key=lambda f: -f.evidence)
    unexplained = tuple(
        Unexplained(robot.joint_names[x.joint], x.signature, x.text(robot.joint_names[x.joint]), x.evidence) for x in counted
    )
    if unexplained:
        verdict = "unexplained"
    elif any(f.ambiguous for f in findings):
        verdict = "ambiguous"
    else:
        verdict = "explained" if findings else "clean"
    return verdict, tuple(findings), unexplained


def _finding(found: Found, selection: Selection, left: Sequence[Leftover]) -> Finding:
    stage = selection.final
    rows = touched(found.judged.hit.columns)
    weight = max((x.weight for x in left if rows[x.joint]), default=0.0)
    trust = min(_MOST, 1.0 / (1.0 + weight**2)) if weight >= 1.0 else _MOST

    def place(hit: Hit) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        # The same effect at the same place in another configuration (an angle on the other side) is no rival.
        return hit.candidate.name, hit.candidate.joints, motors_of(hit.effect)

    own = place(found.judged.hit)
    total = {own: found.weight}
    for rival, probability in zip(found.rivals, found.weights[1:], strict=True):
        total[place(rival.hit)] = total.get(place(rival.hit), 0.0) + float(probability)
    imitators = tuple(
        Imitator(key[0], key[1], trust * probability, key[2])
        for key, probability in sorted(total.items(), key=lambda x: -x[1])
        if key != own and probability >= _NAMED
    )
    loss = float(selection.declared.frame.heldout_loss.sum())
    return Finding(
        found.effect,
        found.judged.hit.candidate.joints,
        _parameters(found, stage),
        float(np.clip(found.judged.score.heldout / max(loss, 1e-300), 0.0, 1.0)),
        found.judged.evidence,
        trust * total[own],
        imitators[:6],
    )


def _parameters(found: Found, stage: Stage) -> tuple[FoundParameter, ...]:
    """Values in the whole model, with standard deviations that count the doubt about shapes in."""
    effect, robot = found.effect, stage.problem.model.robot
    names = stage.problem.model.names
    own = [names.index(p.name) for p in effect.parameters(robot)]
    values = stage.problem.base.expand(stage.frame.base_values)[own]
    shape = effect.shape()
    slopes = [_slope(found, stage, values, p.name, p.log) for p in shape]
    std = _joint_std(found, stage, values, slopes)
    linear = [
        FoundParameter(p.name, float(v), float(s), p.unit)
        for p, v, s in zip(effect.parameters(robot), values, std[: len(own)], strict=True)
    ]
    shapes = []
    for p, s in zip(shape, std[len(own) :], strict=True):
        value = float(getattr(effect, p.name))
        shapes.append(FoundParameter(p.name, value, float(s) * (value if p.log else 1.0), p.unit))
    return (*linear, *shapes)


def _slope(found: Found, stage: Stage, values: Array, name: str, log: bool) -> Array:
    """Derivative (n, M, 1) of the finding's whitened torque with respect to a shape (its logarithm where that is natural)."""
    effect = found.effect
    at = float(getattr(effect, name))
    p = next(p for p in effect.shape() if p.name == name)
    h = 1e-3
    ends = []
    for step in (h, -h):
        x = at * np.exp(step) if log else at + step * (abs(at) + 1e-6)
        x = float(np.clip(x, p.lower, p.upper))
        columns = stage.search.whitened(effect.with_shape(**{name: x}))
        ends.append((columns @ values, np.log(x) if log else x))
    width = ends[0][1] - ends[1][1]
    return np.asarray(((ends[0][0] - ends[1][0]) / width)[:, :, None] if width else np.zeros((*ends[0][0].shape, 1)))


def _joint_std(found: Found, stage: Stage, values: Array, slopes: list[Array]) -> Array:
    """Standard deviations of the finding's parameters and shapes beside the whole model."""
    model = stage.problem.model
    names = [p.name for p in found.effect.parameters(model.robot)]
    base_names = list(stage.problem.base.names)
    T = stage.frame.transform
    covariance = T @ stage.frame._inverse_gram @ T.T
    places = [base_names.index(name) for name in names if name in base_names]
    plain = np.zeros(len(names))
    for i, name in enumerate(names):
        if name in base_names:
            plain[i] = np.sqrt(max(covariance[base_names.index(name), base_names.index(name)], 0.0))
    if not slopes or len(places) < len(names):
        return np.concatenate([plain, np.full(len(slopes), np.nan)]) if slopes else plain
    Z = np.concatenate(slopes, axis=2)
    shape_std = parameter_std(Z, stage.frame)
    # Doubt about the shapes adds to that about the linear parameters through their correlation (block inverse).
    X = stage.frame.columns.reshape(-1, stage.frame.columns.shape[2])
    z = Z.reshape(-1, Z.shape[2])
    along = T @ (stage.frame._inverse_gram @ (X.T @ z))
    cross = X.T @ z
    own = z.T @ z - cross.T @ stage.frame._inverse_gram @ cross
    extra = np.einsum("ik,kl,il->i", along[places], np.linalg.pinv(own, rcond=1e-10, hermitian=True), along[places])
    return np.concatenate([np.sqrt(plain**2 + np.maximum(extra, 0.0)), shape_std])
