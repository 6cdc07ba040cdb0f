"""Monte Carlo: every method on every seed, and what its errors are worth against the bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import IdentError

from .methods import Case, Method

Array = np.ndarray
_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, eq=False)
class Trials:
    """S seeds of one method: `values`, `std` (S, b); `bound` (S, b): Cramér-Rao standard deviations of each seed's data; `seconds` (S,)
    of computing; `statuses`; `failures`: (seed, message) of those that gave no estimate, which are not among the S."""

    method: Method
    seeds: tuple[int, ...]
    truth: Array
    values: Array
    std: Array
    bound: Array
    seconds: Array
    statuses: tuple[str, ...]
    failures: tuple[tuple[int, str], ...] = ()

    @property
    def errors(self) -> Array:
        """Errors (S, b) in units of the bound."""
        return (self.values - self.truth) / self.bound

    def error(self, group: Sequence[int] | slice = slice(None)) -> float:
        """Rms error over seeds and parameters of a group, in units of the bound."""
        return float(np.sqrt(np.mean(self.errors[:, group] ** 2)))

    def error_uncertainty(self, group: Sequence[int] | slice = slice(None)) -> float:
        """Standard error of `error` by the scatter between seeds."""
        each = np.mean(self.errors[:, group] ** 2, axis=1)
        if len(each) < 2:
            return float("nan")
        return float(np.std(each, ddof=1) / np.sqrt(len(each)) / (2 * np.sqrt(np.mean(each))))

    def bias(self, group: Sequence[int] | slice = slice(None)) -> float:
        """Rms over a group of the mean error, in units of the bound, less what so few seeds show of the scatter alone."""
        e = self.errors[:, group]
        chance = e.var(axis=0, ddof=1) / len(e) if len(e) > 1 else np.zeros(e.shape[1])
        return float(np.sqrt(max(0.0, np.mean(e.mean(axis=0) ** 2 - chance))))

    def bias_in_intervals(self, group: Sequence[int] | slice = slice(None)) -> float:
        """Largest mean error of a parameter of a group over half the length of its own 95 % interval."""
        mean = np.abs((self.values - self.truth).mean(axis=0)) / (_NORMAL_95 * self.std.mean(axis=0))
        return float(np.max(mean[group]))

    def coverage(self, group: Sequence[int] | slice = slice(None)) -> float:
        """Share of 95 % intervals that hold the truth."""
        inside = np.abs(self.values - self.truth) <= _NORMAL_95 * self.std
        return float(np.mean(inside[:, group]))

    @property
    def usable(self) -> bool:
        return len(self.values) > 0


def run_trials(
    methods: Iterable[Method],
    seeds: Sequence[int],
    case: Callable[[int], Case],
    bound: Callable[[int], Array],
    truth: Array,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Trials]:
    """Every method that applies on every seed."""
    found: dict[str, list] = {}
    methods = list(methods)
    for seed in seeds:
        now, sigma = case(seed), bound(seed)
        for method in methods:
            if method.applies(now):
                found.setdefault(method.key, []).append((seed, sigma, *_attempt(method, now)))
        say(f"  seed {seed} done")
    by_key = {m.key: m for m in methods}
    return {key: _collected(by_key[key], rows, truth) for key, rows in found.items()}


def _attempt(method: Method, case: Case) -> tuple:
    start = time.process_time()
    try:
        estimate = method.solve(case)
    except IdentError as error:
        return None, None, time.process_time() - start, str(error)
    seconds = time.process_time() - start
    values = case.world.model.base.base_values(estimate.all_values)
    if len(estimate.std) == len(values):
        std = estimate.std
    else:  # the data did not tell some parameters apart
        std = np.full(len(values), np.nan)
    return values, std, seconds, str(estimate.status.code)


def _collected(method: Method, rows: list[tuple], truth: Array) -> Trials:
    good = [row for row in rows if row[2] is not None]
    bad = tuple((row[0], row[5]) for row in rows if row[2] is None)
    b = len(truth)

    def stack(place: int) -> Array:
        return np.array([row[place] for row in good]).reshape(len(good), b)

    return Trials(
        method, tuple(row[0] for row in good), truth, stack(2), stack(3), stack(1), np.array([row[4] for row in good]),
        tuple(row[5] for row in good), bad,
    )  # fmt: skip
