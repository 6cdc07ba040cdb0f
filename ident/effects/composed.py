"""What a model, a sum of effects on one robot, is to the code that serves it: its reduction and its own prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from ..robots.parameters import Parameter
    from ..robots.robot import Robot
    from .base import Effect
    from .motion import Motion

Array = np.ndarray


class ComposedModel(Protocol):
    """The part of `ident.Model` that the effects' own layer uses."""

    @property
    def robot(self) -> Robot: ...

    @property
    def effects(self) -> tuple[Effect, ...]: ...

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def slices(self) -> tuple[slice, ...]: ...

    def columns(self, motion: Motion) -> Array: ...

    def of_robot(self, robot: Robot) -> ComposedModel: ...

    def of(self, effects: tuple[Effect, ...]) -> ComposedModel: ...
