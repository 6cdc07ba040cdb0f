"""How methods degrade with torque noise, encoder resolution, cut-off and sampling rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ident.errors import IdentError

from .data import CUTOFF, Data, make_case
from .methods import METHODS

Array = np.ndarray
COMPARED = ("ls_raw", "wls", "momentum", "iv_desired")
#: Methods whose signals are filtered at the cut-off.
_FILTERED = ("wls", "momentum")


@dataclass(frozen=True, eq=False)
class Sweep:
    """Torque errors of methods (key → (m,)) against one quantity that takes `values` (m,); `usual`: its value elsewhere."""

    title: str
    unit: str
    values: Array
    usual: float
    errors: Mapping[str, Array]


def sweeps(data: Data, seed: int = 1, methods: tuple[str, ...] = COMPARED) -> dict[str, Sweep]:
    """One quantity at a time, the others as in the main data."""
    rates = np.array([rate for rate in (50.0, 100.0, 200.0, 400.0, 500.0) if data.scale.control_rate % rate == 0])
    plans = {
        "noise": ("torque noise over its usual one", "", np.array([0.0, 1.0, 3.0, 10.0]), 1.0, "noise"),
        "counts": ("encoder counts a motor turn", "", np.array([250.0, 500.0, 1000.0, 4000.0]), data.world.counts, "counts"),
        "cutoff": ("cut-off of the filter", "Hz", np.array([4.0, 8.0, 20.0, 50.0]), CUTOFF, "cutoff"),
        "rate": ("sampling rate", "Hz", rates, data.world.rate, "rate"),
    }
    known: dict[tuple, float] = {}
    found = {}
    for key, (title, unit, values, usual, setting) in plans.items():
        values = values[: data.scale.points]
        chosen = tuple(m for m in methods if setting != "cutoff" or m in _FILTERED)
        errors: dict[str, list[float]] = {m: [] for m in chosen}
        for value in values:
            case = None
            for method in chosen:
                place = (method, "usual") if value == usual else (method, key, value)
                if place not in known:
                    case = case or make_case(data, data.main, seed, **{setting: float(value)})
                    known[place] = _error(data, method, case)
                errors[method].append(known[place])
        found[key] = Sweep(title, unit, values, usual, {m: np.array(e) for m, e in errors.items()})
    return found


def _error(data: Data, method: str, case) -> float:
    try:
        estimate = METHODS[method].solve(case)
    except IdentError:
        return float("inf")
    return data.torque_measure(data.world.model.base.base_values(estimate.all_values) - data.world.truth)
