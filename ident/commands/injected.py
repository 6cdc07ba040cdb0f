"""Effects with values from the command line, for simulated logs: `stribeck:joint3:Fs=2,v_s=0.1`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.base import Effect
from ..effects.kinds import Nature
from ..effects.registry import effect_types, make_effect
from ..errors import ConfigurationError, UnsupportedError, unknown_name

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.parameters import Parameter
    from ..robots.robot import Robot

Array = np.ndarray
_FORM = "NAME:JOINTS:KEY=VALUE,… such as stribeck:joint3:Fs=2,v_s=0.1 (joints separated by commas; left out: every joint)"
HELP = f"effect to add with its values, {_FORM}"


def injected(model: Model, values: Array, texts: Sequence[str]) -> tuple[Model, Array, tuple[str, ...]]:
    """The model and its values (k,) with effects as texts name them, and a line for each value. A parameter that the model has already is
    set; others join it. Raises ConfigurationError for what cannot be read, UnsupportedError for what is in the sensors alone."""
    said: list[str] = []
    for text in texts:
        effect, given = _effect(model.robot, text)
        parameters = effect.parameters(model.robot)
        own = _values(effect, parameters, given, model.robot, text)
        present = [p.name in model.names for p in parameters]
        if all(present):
            values = np.array(values)
            for p, value in zip(parameters, own, strict=True):
                values[model.names.index(p.name)] = value
        elif any(present):
            raise ConfigurationError(f"--with {text}: the model has {effect.name!r} on some of these joints already; name the others.")
        else:
            model = model + effect
            values = np.concatenate([values, own])
        said += [
            f"{effect.name}: {p.name} = {v:g} {p.unit} ({effect.side.value} side)" for p, v in zip(parameters, own, strict=True) if v != 0.0
        ]
    return model, values, tuple(said)


def _effect(robot: Robot, text: str) -> tuple[Effect, dict[str, float]]:
    """The effect of a text, and the values of its linear parameters by their symbols."""
    name, *rest = text.split(":")
    if len(rest) > 2 or any("=" in part for part in rest[:-1]):
        raise ConfigurationError(f"--with {text}: is not of the form {_FORM}.")
    joints = next((r for r in rest if r and "=" not in r), "")
    pairs = next((r for r in rest if "=" in r), "")
    if name not in effect_types():
        raise unknown_name("effect", name, effect_types())
    known = {f.name for f in fields(effect_types()[name])}
    options: dict[str, Any] = {} if not joints else {"joints": tuple(joints.split(","))}
    given: dict[str, float] = {}
    for pair in pairs.split(",") if pairs else ():
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not (equals and key and value):
            raise ConfigurationError(f"--with {text}: {pair!r} is not KEY=VALUE.")
        if key in known:
            options[key] = _value(value)
        else:
            given[key] = _number(value, text)
    effect = make_effect(name, **options)
    if effect.nature == Nature.SENSOR:
        raise UnsupportedError(
            f"--with {text}: {name!r} acts in the sensors, not in the motion; change the simulated log instead, or give"
            " ident.simulate(sensors=…) a distortion."
        )
    effect.at(robot)
    return effect, given


def _values(effect: Effect, parameters: Sequence[Parameter], given: Mapping[str, float], robot: Robot, text: str) -> Array:
    """Values of the linear parameters: those given, else the response that the effect's shape asks for, else zero."""
    response = effect.response(robot)
    out = np.zeros(len(parameters)) if response is None else np.array(response, float)
    symbols = list(dict.fromkeys(_symbols(p)[1] for p in parameters))
    for key, value in given.items():
        at = next((found for k in range(5) if (found := [i for i, p in enumerate(parameters) if _symbols(p)[k] == key])), [])
        if not at:
            raise unknown_name(f"parameter of effect {effect.name!r}", key, [*symbols, *(s.name for s in effect.shape())])
        out[at] = value
    if not given and response is None:
        raise ConfigurationError(f"--with {text}: give {effect.name!r} a value: {', '.join(symbols)}. Form: {_FORM}.")
    return out


def _symbols(parameter: Parameter) -> tuple[str, ...]:
    """What a parameter goes by: its name, that without its joint, that without a mark of its side, the last word of that, and the first."""
    bare = parameter.name.removesuffix(f"_{parameter.joint}") if parameter.joint else parameter.name
    return parameter.name, bare, bare[:-1] if bare[-1:] in "JM" else bare, bare.rpartition("_")[2], bare.split("_")[0]


def _value(text: str) -> Any:
    """A number, a text, or several of them apart by `+`."""
    parts: list[Any] = []
    for part in text.split("+"):
        try:
            parts.append(float(part))
        except ValueError:
            parts.append(part)
    return parts[0] if len(parts) == 1 else tuple(parts)


def _number(value: str, text: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = float("nan")
    if not np.isfinite(number):
        raise ConfigurationError(f"--with {text}: {value!r} is not a finite number.")
    return number
