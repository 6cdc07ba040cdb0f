"""Modules that register what they hold when they are imported: the built-in ones, then those of plugins."""

from __future__ import annotations

import importlib
import pkgutil

from .plugins import load_installed


def load_registering(*packages: str) -> None:
    """Import every module of packages, and the plugins that are installed."""
    for name in packages:
        for module in pkgutil.iter_modules(importlib.import_module(name).__path__):
            importlib.import_module(f"{name}.{module.name}")
    load_installed()
