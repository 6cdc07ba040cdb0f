"""What errors of the parameters mean in motion: the models driven forward from standstill by the torque of runs that no method saw."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass

import numpy as np

from ident.simulation.replay import Replay, replay

from .data import Data, exact_logs, recorded
from .monte_carlo import Trials

Array = np.ndarray
WINDOW_S = 2.0


@dataclass(frozen=True, eq=False)
class Forward:
    """Forward simulation with one set of parameters: `replay`; `degrees`: median over windows of the rms error over the joints, in
    degrees (infinite where most diverge); `diverged`: share of windows that did."""

    title: str
    replay: Replay

    @property
    def degrees(self) -> float:
        each = np.sqrt(np.mean(self.replay.window_error**2, axis=1))
        return float(np.degrees(np.median(each)))

    @property
    def per_joint(self) -> Array:
        """Median over windows (n,) of the rms error, degrees."""
        return np.degrees(self.replay.median_error)

    @property
    def diverged(self) -> float:
        return float(np.mean(self.replay.diverged))


def forward_errors(data: Data, trials: Mapping[str, Trials], methods: Container[str]) -> dict[str, Forward]:
    """The truth (what integration alone leaves), and of every method named the seed of median torque error."""
    rate = 1.0 / float(data.validation.simulations[0].t[1])
    signals = recorded()(exact_logs(data, data.validation, rate), data.world.model.robot)
    model, measure = data.world.model, data.torque_measure
    window = min(WINDOW_S, 0.25 * data.scale.seconds)
    # Every run begins at rest: its beginning alone is replayed.
    length = round(window * rate) + 1
    begins = signals.select_rows([slice(rows.start, rows.start + length + 1) for rows in signals.row_runs])

    def run(title: str, base_values: Array) -> Forward:
        made = replay(model, model.base.expand(base_values), begins, window=window, windows=data.scale.validation)
        assert not made.measured_rate[0].any()
        return Forward(title, made)

    found = {"truth": run("the true parameters", data.world.truth)}
    for key, one in trials.items():
        if key in methods and one.usable:
            found[key] = run(one.method.title, one.values[median_seed(one, measure)])
    return found


def median_seed(trials: Trials, measure) -> int:
    """The seed whose torque error is the (lower) median."""
    errors = [measure(e) for e in trials.values - trials.truth]
    return int(np.argsort(errors)[(len(errors) - 1) // 2])
