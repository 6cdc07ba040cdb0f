"""Sums of effects, before they have a robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..errors import ConfigurationError

_E = TypeVar("_E")


@dataclass(frozen=True)
class EffectSum(Generic[_E]):
    """Effects that act together: what `a + b` of two effects is.

    Parameters
    ----------
    effects : tuple of Effect
        In the order in which they were added.

    Notes
    -----
    Becomes a model on a robot: `robot.rigid_body() + effects`, or `Model(robot, effects)`.

    Examples
    --------
    >>> from ident.friction import Coulomb, Viscous
    >>> friction = Viscous() + Coulomb()
    >>> [effect.name for effect in friction]
    ['viscous', 'coulomb']
    """

    effects: tuple[_E, ...]

    def __add__(self, other: Any) -> EffectSum[_E]:
        if hasattr(other, "robot") and hasattr(other, "effects"):
            return NotImplemented
        return EffectSum((*self.effects, *terms(other)))

    def __iter__(self) -> Iterator[_E]:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)


def terms(other: Any) -> tuple[Any, ...]:
    """The effects of an effect or a sum of them. Raises ConfigurationError for anything else."""
    if isinstance(other, EffectSum):
        return other.effects
    if not isinstance(other, type) and all(hasattr(other, name) for name in ("columns", "parameters", "joints")):
        return (other,)
    hint = " Write Coulomb(), not Coulomb." if isinstance(other, type) else ""
    shown = other.__name__ if isinstance(other, type) else f"{type(other).__name__} {other!r:.40}"
    raise ConfigurationError(f"only effects can be added to a model, not {shown}.{hint}")
