"""What has no name still gets described: the leftover as a smooth function of the one or two quantities that it follows.

Which quantity, and how fine a function, was decided on the data fitted (`inference.described`); what it is worth is told on data that no
choice saw."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..statistics.torque_error import number
from .thresholds import WORSE

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..evaluation.comparison import Comparison
    from ..robots.robot import Robot

Array = np.ndarray
#: Terms of a formula, and the share (rms) of a function that it may miss.
_TERMS, _MISSED = 3, 0.1


@dataclass(frozen=True, eq=False)
class Law:
    """A smooth function that describes a leftover: `effect` with `values`, its course `x`, `y` (N m or N) over the range seen, the
    `formula` of few terms that fits it ("" where none does)."""

    effect: Effect
    joint: str
    follows: str
    unit: str
    values: Array = field(repr=False)
    x: Array = field(repr=False)
    y: Array = field(repr=False)
    formula: str

    def __str__(self) -> str:
        where = f"over {self.x[0]:.3g} … {self.x[-1]:.3g} {self.unit}: {self.y.min():.3g} … {self.y.max():.3g}"
        return f"{self.joint}: a function of {self.follows}, {where}" + (f"; about {self.formula}" if self.formula else "")


@dataclass(frozen=True, eq=False)
class LeftoverDescription:
    """Laws that describe what a diagnosis left unexplained, the `estimate` with them, and `comparison`: the model with the findings
    against that with the laws too, on the data that no choice saw."""

    laws: tuple[Law, ...]
    estimate: Estimate = field(repr=False)
    comparison: Comparison = field(repr=False)

    @property
    def confirmed(self) -> bool:
        """Whether the error on those data falls, beyond chance."""
        return bool(self.comparison.gain > WORSE * self.comparison.gain_std)

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        laws = [
            {"effect": x.effect.name, "joint": x.joint, "follows": x.follows, "unit": x.unit, "formula": x.formula,
             "x": x.x.tolist(), "y": x.y.tolist()}
            for x in self.laws
        ]  # fmt: skip
        c = self.comparison
        errors = {"error_before": number(c.error_before.relative_all), "error_after": number(c.error_after.relative_all)}
        return {"laws": laws, **errors, "gain": number(c.gain), "gain_std": number(c.gain_std), "confirmed": self.confirmed}

    def __str__(self) -> str:
        before, after = (100.0 * e.relative_all for e in (self.comparison.error_before, self.comparison.error_after))
        lines = [f"described, not explained: {law}" for law in self.laws]
        said = "it holds there" if self.confirmed else "no more than chance: do not use it"
        return "\n".join([*lines, f"     with it the error on data held out goes from {before:.2f} to {after:.2f} % ({said})"])


def told(robot: Robot, laws: tuple[Effect, ...], values: Array) -> tuple[Law, ...]:
    """Laws with their course; `values`: of the laws' parameters, in their order."""
    found, start = [], 0
    for effect in laws:
        width = len(effect.parameters(robot))
        own = np.asarray(values[start : start + width])
        start += width
        knots = effect.knots  # type: ignore[attr-defined]
        x = np.linspace(knots[0], knots[-1], 101)
        y = effect.splines(x) @ own  # type: ignore[attr-defined]
        y = y - y.mean() if effect.turned == "one" else y  # type: ignore[attr-defined]
        joint = (effect.joints or ("",))[0]
        what, unit = _words(effect, robot, joint)
        found.append(Law(effect, joint, what, unit, own, x, y, formula(x, y, "x")))
    return tuple(found)


def _words(effect: Effect, robot: Robot, joint: str) -> tuple[str, str]:
    by = getattr(effect, "by", "") or joint
    j = robot.joint_index(by)
    whose = "its own" if by == joint else f"{by}'s"
    length = "m" if robot.joints[j].prismatic else "rad"
    what, unit = {
        "described_position": (f"{whose} position", length),
        "described_speed": (f"{whose} speed (motor)", f"{robot.position_unit(j, effect.side)}/s"),
        "described_load": ("the load", robot.force_unit(j, effect.side)),
        "described_time": ("time", "s"),
    }[effect.name]
    turned = " times the direction of its motion" if effect.turned == "direction" else ""  # type: ignore[attr-defined]
    return what + turned, unit


def formula(x: Array, y: Array, symbol: str) -> str:
    """A course y(x) as a sum of few terms of a small library, "" where none fits; the constant is left to the offset.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1.0, 1.0, 101)
    >>> formula(x, 0.5 * np.sin(x), "q")
    '0.5 sin(q)'
    """
    library = {
        symbol: x, f"{symbol}^2": x**2, f"{symbol}^3": x**3, f"|{symbol}|": np.abs(x), f"sin({symbol})": np.sin(x),
        f"cos({symbol})": np.cos(x), f"sin(2 {symbol})": np.sin(2 * x), f"cos(2 {symbol})": np.cos(2 * x),
        f"exp(-|{symbol}|)": np.exp(-np.abs(x)), f"sgn({symbol})": np.sign(x),
    }  # fmt: skip
    names, size = list(library), float(np.std(y))
    columns = np.stack([c - c.mean() for c in library.values()], axis=1)
    target = y - y.mean()
    chosen: list[int] = []
    for _ in range(_TERMS):
        errors = []
        for k in range(len(names)):
            A = columns[:, np.array([*chosen, k])]
            errors.append(float(np.std(target - A @ np.linalg.lstsq(A, target, rcond=1e-9)[0])) if k not in chosen else np.inf)
        chosen.append(int(np.argmin(errors)))
        if min(errors) <= _MISSED * size:
            A = columns[:, np.array(chosen)]
            weights = np.linalg.lstsq(A, target, rcond=1e-9)[0]
            return " ".join(_term(w, names[k], first=i == 0) for i, (w, k) in enumerate(zip(weights, chosen, strict=True)))
    return ""


def _term(weight: float, name: str, *, first: bool) -> str:
    sign = "-" if weight < 0 else "" if first else "+"
    return f"{sign}{'' if first else ' '}{abs(weight):.3g} {name}"
