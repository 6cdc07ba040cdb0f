"""Which code does the rigid-body work: the compiled kernel where it was built, NumPy elsewhere, with the same numbers."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache
from types import ModuleType

from .._native.choice import asked, missing
from . import numpy_drive, numpy_dynamics, numpy_rows, numpy_series


class SlowPathWarning(RuntimeWarning):
    """The compiled kernel is not there, and NumPy does its work."""


@dataclass(frozen=True)
class Kernel:
    """The modules that do the work: `dynamics` of a tree, `rows` of the regression equation with their information, `series`: filters along
    time, and `drive`: a tree with the terms of its drives."""

    dynamics: ModuleType
    rows: ModuleType
    series: ModuleType
    drive: ModuleType

    @property
    def compiled(self) -> bool:
        """It is the compiled one."""
        return self.dynamics is not numpy_dynamics


def kernel() -> Kernel:
    """The kernel that IDENT_KERNEL asks for ("native" or "numpy"), else the compiled one, else NumPy, which is said once.

    Raises ConfigurationError for another name, and where the compiled one is asked for and not there."""
    return _kernel(asked())


@cache
def _kernel(name: str) -> Kernel:
    plain = Kernel(numpy_dynamics, numpy_rows, numpy_series, numpy_drive)
    if name == "numpy":
        return plain
    try:
        from . import native
    except ImportError as error:
        if name == "native":
            raise missing(str(error)) from None
        warnings.warn(
            "the compiled kernel is not there: NumPy takes its place, with the same numbers, ten to fifty times slower."
            " In a checkout run `pip install -e .`; else install a wheel, or a C++ compiler and then ident again."
            " IDENT_KERNEL=numpy silences this.",
            SlowPathWarning,
            stacklevel=4,
        )
        return plain
    try:
        from . import native_drive, native_series
    except ImportError:  # the kernel was built from older sources: all but the newer parts
        return Kernel(native, native, numpy_series, numpy_drive)
    return Kernel(native, native, native_series, native_drive)
