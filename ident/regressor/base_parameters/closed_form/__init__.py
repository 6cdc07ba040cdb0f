"""Base parameters in closed form, for the structures of Yoshida's theorems; no samples, no rank decisions.

Each function takes a Robot and returns a `BaseForm`; a structure outside its theorem is refused with UnsupportedError."""

from __future__ import annotations

from .inertia import inertia_matrix
from .mixed import mixed
from .oblique import oblique
from .parallelogram import parallelogram
from .rotational import rotational

__all__ = ["inertia_matrix", "mixed", "oblique", "parallelogram", "rotational"]
