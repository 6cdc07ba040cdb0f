"""Which compiled modules do the work: the one place that reads IDENT_KERNEL.

Every compiled module has the same in NumPy or Python beside it, which takes over where the module was not built or is not wanted."""

from __future__ import annotations

import importlib
import os
from functools import cache
from types import ModuleType

from ..errors import ConfigurationError


def asked() -> str:
    """What IDENT_KERNEL asks for: "native", "numpy", or "" for the compiled modules as far as they are there.

    Raises ConfigurationError for another name."""
    name = os.environ.get("IDENT_KERNEL", "").strip().lower()
    if name not in ("", "native", "numpy"):
        raise ConfigurationError(f"IDENT_KERNEL={name!r}: must be 'native' or 'numpy', or not set.")
    return name


def compiled(name: str) -> ModuleType | None:
    """The compiled module ident._native.<name>; None where IDENT_KERNEL asks for NumPy, or where the module is not there.

    Raises ConfigurationError where IDENT_KERNEL asks for the compiled one and it is not there."""
    wanted = asked()
    if wanted == "numpy":
        return None
    found, why = _loaded(name)
    if found is None and wanted == "native":
        raise missing(why)
    return found


def missing(why: str) -> ConfigurationError:
    """IDENT_KERNEL=native asks for what is not there."""
    return ConfigurationError(
        f"IDENT_KERNEL=native, but the compiled kernel is not there ({why}): install a wheel, or a C++ compiler and then ident again."
    )


@cache
def _loaded(name: str) -> tuple[ModuleType | None, str]:
    """The module, or why it cannot be loaded."""
    try:
        return importlib.import_module(f"{__package__}.{name}"), ""
    except ImportError as error:
        return None, str(error)
