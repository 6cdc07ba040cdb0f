"""Formulas of effects as code: parsed once, shape parameters put in, printed as C or Python."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..effects.base import Effect
from ..effects.factors import declares
from ..effects.joint_effect import JointEffect
from ..effects.kinds import Factor
from ..errors import ConfigurationError
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

_OF_FACTORS = {
    Factor.ONE: "1",
    Factor.POSITION: "q",
    Factor.SPEED: "dq",
    Factor.DIRECTION: "sgn(dq)",
    Factor.ACCELERATION: "ddq",
}
_FUNCTIONS = ("sgn", "abs", "exp", "sin", "cos", "sqrt", "tanh")
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


def formulas_of(effect: Effect) -> tuple[str, ...]:
    """One formula for each column of an effect; none where it does not declare them."""
    if not isinstance(effect, JointEffect):
        return ()
    if declares(effect):
        return tuple(_OF_FACTORS[factor] for factor in effect.factors)
    # A subclass with columns of its own does not inherit what its base declared.
    says, does = (next(kind for kind in type(effect).__mro__ if name in vars(kind)) for name in ("formulas", "basis"))
    return effect.formulas if says is does else ()


def bound(effect: Effect, j: int, robot: Robot) -> dict[str, str]:
    """What the names in an effect's formulas are for joint j in written code: `q`, `dq`, `ddq`, `load`, `x`, shape parameters."""
    mark = _mark(effect.side)
    names = {name: f"{name}{mark}[{j}]" for name in ("q", "dq", "ddq", "load")}
    angle = getattr(effect, "angle", None)
    if isinstance(angle, Side):
        names["x"] = f"q{_mark(angle)}[{j}]"
    return names | {p.name: repr(float(getattr(effect, p.name))) for p in effect.shape()}


def _mark(side: Side) -> str:
    return "" if side == Side.JOINT else "_m"


def printed(formula: str, names: Mapping[str, str], power: str) -> str:
    """A formula with its names put in. `power`: how x to the y is written, with {0} and {1}."""
    return _printed(ast.parse(formula, mode="eval").body, names, power)


def _printed(node: ast.expr, names: Mapping[str, str], power: str) -> str:
    match node:
        case ast.Constant(value=value):
            return repr(float(value))  # type: ignore[arg-type]
        case ast.Name(id=name) if name in names:
            return names[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return f"(-{_printed(operand, names, power)})"
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return power.format(_printed(left, names, power), _printed(right, names, power))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return f"({_printed(left, names, power)} {_OPERATORS[type(op)]} {_printed(right, names, power)})"
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in _FUNCTIONS:
            return f"{name}({_printed(argument, names, power)})"
    raise ConfigurationError(
        f"formula of an effect: {ast.unparse(node)!r} cannot be written as code; supported are + - * / **, numbers,"
        f" {', '.join(_FUNCTIONS)}, and the names {', '.join(names)}."
    )
