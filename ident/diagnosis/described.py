"""What has no name still gets described: the leftover as a smooth function of the one or two quantities that it follows.

Which quantity, and how fine a function, was decided on the data fitted (`inference.described`); what it is worth is told on data that no
choice saw."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.singular_values import lstsq
from ..effects.described import Described, Turned
from ..statistics.torque_error import number
from .thresholds import WORSE

if TYPE_CHECKING:
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

    effect: Described
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
        said = "confirmed" if self.confirmed else "no better than chance: do not use it"
        return "\n".join([*lines, f"     with it the error on held-out data goes from {before:.2f} to {after:.2f} % ({said})"])


def told(robot: Robot, laws: tuple[Described, ...], values: Array) -> tuple[Law, ...]:
    """Laws with their course; `values`: of the laws' parameters, in their order."""
    found, start = [], 0
    for law in laws:
        own = np.asarray(values[start : start + law.count])
        start += law.count
        x = np.linspace(law.knots[0], law.knots[-1], 101)
        y = law.splines(x) @ own
        y = y - y.mean() if law.turned == Turned.ONE else y
        found.append(Law(law, (law.joints or ("",))[0], _words(law), law.unit(robot, robot.joint_index(law.followed)), own, x, y,
                         formula(x, y, "x")))  # fmt: skip
    return tuple(found)


def _words(law: Described) -> str:
    """What a law follows."""
    whose = f"{law.by}'s " if law.by else "its own " if law.elsewhere else ""
    turned = " times the direction of its motion" if law.turned == Turned.DIRECTION else ""
    return f"{whose}{law.what}{turned}"


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
            errors.append(float(np.std(target - A @ lstsq(A, target, rcond=1e-9))) if k not in chosen else np.inf)
        chosen.append(int(np.argmin(errors)))
        if min(errors) <= _MISSED * size:
            A = columns[:, np.array(chosen)]
            weights = lstsq(A, target, rcond=1e-9)
            return " ".join(_term(w, names[k], first=i == 0) for i, (w, k) in enumerate(zip(weights, chosen, strict=True)))
    return ""


def _term(weight: float, name: str, *, first: bool) -> str:
    sign = "-" if weight < 0 else "" if first else "+"
    return f"{sign}{'' if first else ' '}{abs(weight):.3g} {name}"
