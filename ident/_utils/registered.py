"""Classes known by their names: the built-in ones, whose modules register them when they are imported, and those of plugins."""

from __future__ import annotations

import importlib
import pkgutil
from typing import ClassVar, Generic, Protocol, TypeVar

from ..errors import ConfigurationError
from .plugins import load_installed


class _Named(Protocol):
    name: ClassVar[str]


_T = TypeVar("_T", bound=_Named)


class Registry(Generic[_T]):
    """Classes of one kind by their `name`; the modules of `packages` hold the built-in ones."""

    def __init__(self, kind: str, *packages: str) -> None:
        self._kind, self._packages = kind, packages
        self._types: dict[str, type[_T]] = {}

    def add(self, new: type[_T]) -> None:
        """Make a class known by its name. Raises ConfigurationError where another class has it."""
        known = self._types.get(new.name)
        if known is not None and (known.__module__, known.__qualname__) != (new.__module__, new.__qualname__):
            raise ConfigurationError(f"two {self._kind}s are named {new.name!r}: {known.__module__} and {new.__module__}.")
        self._types[new.name] = new

    def types(self) -> dict[str, type[_T]]:
        """Every class by name, in the order of the names, once all built-in modules and the installed plugins are imported."""
        for name in self._packages:
            for module in pkgutil.iter_modules(importlib.import_module(name).__path__):
                importlib.import_module(f"{name}.{module.name}")
        load_installed()
        return dict(sorted(self._types.items()))
