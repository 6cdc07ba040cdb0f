"""Ranges for domain randomisation: correlated samples and quantiles of what simulators ask for (`ident.ranges/1`)."""

from __future__ import annotations

import json

import numpy as np

from ..._utils.json import jsonable
from ..._utils.version import __version__
from ...errors import ConfigurationError
from ...robots.parameters import LINK_SYMBOLS
from ...robots.tree import link_names
from ..actuation import Actuation, JointActuator
from ..draws import draws
from ..identified import Identified
from ..target import ExportOptions, ExportTarget, WrittenFile, register_target

Array = np.ndarray
_QUANTILES = (0.025, 0.05, 0.25, 0.5, 0.75, 0.95, 0.975)
#: Numbers of an actuator, with their units where it turns and where it slides.
_UNITS = {
    "armature": ("kg m^2", "kg"),
    "damping": ("N m s/rad", "N s/m"),
    "dry": ("N m", "N"),
    "breakaway": ("N m", "N"),
    "offset": ("N m", "N"),
    "stiffness": ("N m/rad", "N/m"),
    "kp": ("N m/rad", "N/m"),
    "kd": ("N m s/rad", "N s/m"),
    "ki": ("N m/(rad s)", "N/(m s)"),
    "effort_limit": ("N m", "N"),
    "delay_s": ("s", "s"),
    "command_lag_s": ("s", "s"),
    "deadband": ("rad", "m"),
}


@register_target
class RangesTarget(ExportTarget):
    """Samples that hold together: a set is one row, and what the data tie together moves together."""

    name = "ranges"
    title = "JSON: correlated samples and quantiles for domain randomisation"

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        if options.samples < 2:
            raise ConfigurationError(f"{options.samples} samples do not make a range; ask for at least 2 (--samples).")
        drawn = draws(found, options.units, options.samples, options.seed)
        names, units, nominal = _numbers(found)
        rows = np.array([_numbers(one)[2] for one in drawn.sets])
        varies = rows.max(axis=0) != rows.min(axis=0)
        entries = [
            {
                "name": name,
                "unit": unit,
                "nominal": float(value),
                "mean": float(np.mean(column)),
                "std": float(np.std(column, ddof=1)),
                "quantiles": {f"{q:g}": float(x) for q, x in zip(_QUANTILES, np.quantile(column, _QUANTILES), strict=True)},
            }
            for name, unit, value, column, here in zip(names, units, nominal, rows.T, varies, strict=True)
            if here
        ]
        same = {name: float(value) for name, value, here in zip(names, nominal, varies, strict=True) if not here and np.isfinite(value)}
        notes = (*found.notes, *drawn.notes, "each row of samples is one set: do not combine entries of different rows.")
        body = {
            "schema": "ident.ranges/1",
            "ident_version": __version__,
            "robot": found.robot.name,
            "units": 1 + len(options.units),
            "seed": options.seed,
            "fields": entries,
            "constant": same,
            "samples": rows[:, varies].tolist(),
            "correlation": _correlation(rows[:, varies]).tolist(),
            "notes": list(notes),
        }
        return WrittenFile(json.dumps(jsonable(body), indent=1, allow_nan=False) + "\n", notes)


def _numbers(found: Identified) -> tuple[list[str], list[str], Array]:
    """Names, units and values of everything that a set consists of: actuators, then links."""
    actuators = Actuation.of(found).actuators
    pairs = [(actuator, key) for actuator in actuators for key in _UNITS if getattr(actuator, key) is not None]
    links = [f"{symbol}_{link}" for link in link_names(found.robot.model) for symbol in LINK_SYMBOLS]
    names = [f"{_name(key)}_{actuator.joint}" for actuator, key in pairs] + links
    units = [_unit(actuator, key) for actuator, key in pairs] + [_link_unit(name) for name in links]
    return names, units, np.array([float(getattr(actuator, key)) for actuator, key in pairs] + found.inertial.tolist())


def _name(key: str) -> str:
    return {"dry": "frictionloss", "delay_s": "delay", "command_lag_s": "command_lag"}.get(key, key)


def _unit(actuator: JointActuator, key: str) -> str:
    return _UNITS[key][int(actuator.prismatic)]


def _link_unit(name: str) -> str:
    symbol = name.split("_", maxsplit=1)[0]
    return "kg" if symbol == "m" else "kg m" if symbol in ("mx", "my", "mz") else "kg m^2"


def _correlation(rows: Array) -> Array:
    centred = rows - rows.mean(axis=0)
    size = np.sqrt(np.sum(centred**2, axis=0))
    return np.asarray(centred.T @ centred / np.outer(size, size))
