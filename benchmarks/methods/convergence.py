"""How much data each method needs for a small torque error on unseen motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import IdentError

from .data import Data, make_case
from .methods import METHODS

Array = np.ndarray
#: Torque error, rms over the joints, at which a method counts as converged.
CONVERGED = 0.01
GROWING = ("ls_raw", "wls", "momentum", "iv_desired")


@dataclass(frozen=True, eq=False)
class Growth:
    """Torque error `errors` (m,) of a method against the samples of its data, `samples` (m,)."""

    title: str
    samples: Array
    errors: Array

    @property
    def converged_at(self) -> int | None:
        """Samples from which on the error stays below the limit; None: not within the data."""
        good = self.errors <= CONVERGED
        if not good[-1]:
            return None
        bad = np.flatnonzero(~good)
        return int(self.samples[bad[-1] + 1 if len(bad) else 0])


def growth(data: Data, methods: Sequence[str] = GROWING, seed: int = 1) -> dict[str, Growth]:
    """Torque error against the amount of data, runs being added."""
    found: dict[str, Growth] = {}
    for key in methods:
        samples, errors = [], []
        for size in data.scale.sizes:
            case = make_case(data, data.quick.part(slice(0, size)), seed)
            samples.append(sum(len(log) for log in case.logs))
            try:
                estimate = METHODS[key].solve(case)
                errors.append(data.torque_measure(data.world.model.base.base_values(estimate.all_values) - data.world.truth))
            except IdentError:
                errors.append(np.inf)
        found[key] = Growth(METHODS[key].title, np.array(samples), np.array(errors))
    return found
