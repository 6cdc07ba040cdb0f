"""Effects by their names: the built-in ones, and those of plugins."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from .._utils.registered import Registry
from ..errors import unknown_name
from .base import Effect

_E = TypeVar("_E", bound=Effect)
_REGISTRY: Registry[Effect] = Registry("effect", "ident.effects", "ident.friction")


def register(effect: type[_E]) -> type[_E]:
    """Class decorator: make an effect known by its name (study files, command line, diagnosis).

    Parameters
    ----------
    effect : type
        A class of effects with a `name` of its own.

    Returns
    -------
    type
        The class itself.

    Raises
    ------
    ConfigurationError
        Another class has that name.

    Examples
    --------
    >>> from ident.effects import register
    >>> from ident.friction import Viscous
    >>> register(Viscous) is Viscous  # known already: nothing changes
    True
    """
    _REGISTRY.add(effect)
    return effect


def effect_types() -> dict[str, type[Effect]]:
    """Every registered effect by name, the built-in ones and those of plugins.

    Returns
    -------
    dict of str to type
        In the order of the names.

    Examples
    --------
    >>> import ident
    >>> ident.effects.effect_types()["viscous"] is ident.friction.Viscous
    True
    """
    return _REGISTRY.types()


def effect_names() -> tuple[str, ...]:
    """Names of all registered effects, the built-in ones and those of plugins.

    Returns
    -------
    tuple of str
        In alphabetical order.

    Examples
    --------
    >>> import ident
    >>> "stribeck" in ident.effect_names()
    True
    """
    return tuple(effect_types())


def make_effect(name: str, **configuration: Any) -> Effect:
    """An effect by its name, as study files give it.

    Parameters
    ----------
    name : str
        See `effect_names`.
    **configuration
        Fields of the effect: joints, side, shape parameters.

    Returns
    -------
    Effect

    Raises
    ------
    ConfigurationError
        An unknown name or key, with the nearest known ones.

    Examples
    --------
    >>> import ident
    >>> ident.make_effect("stribeck", joints=["joint3"], v_s=0.2).v_s
    0.2
    """
    types = effect_types()
    if name not in types:
        raise unknown_name("effect", name, types)
    known = {f.name for f in dataclasses.fields(types[name])}
    for key in configuration:
        if key not in known:
            raise unknown_name(f"key of effect {name!r}", key, known)
    return types[name](**configuration)
