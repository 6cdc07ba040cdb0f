"""The verdict: statements about the methods, each decided by the numbers of the trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .data import Data
from .monte_carlo import Trials
from .trajectories import Forward

Array = np.ndarray
#: What issue 5 asks of instrumental variables.
BIAS_SHARE, BOUND_SHARE = 0.2, 1.15
#: A difference counts from so many standard errors on.
_SURE = 2.0


class Outcome(StrEnum):
    """What the numbers say of a statement."""

    HOLDS = "holds"
    EVEN = "even"
    FAILS = "does not hold"


@dataclass(frozen=True)
class Claim:
    """A statement, what the numbers say of it, and the numbers."""

    text: str
    outcome: Outcome
    numbers: str

    def __str__(self) -> str:
        return f"{self.outcome.value:<14} {self.text}: {self.numbers}"


@dataclass(frozen=True)
class Criterion:
    """The requirements on instrumental variables for one group of parameters; biases and errors in units of the bound."""

    group: str
    bias: float
    bias_least_squares: float
    in_interval: float
    error: float
    uncertainty: float
    coverage: float

    @property
    def bias_passes(self) -> bool:
        return self.bias <= BIAS_SHARE * self.bias_least_squares

    @property
    def interval_passes(self) -> bool:
        return self.in_interval <= 1.0

    @property
    def error_passes(self) -> bool:
        return self.error <= BOUND_SHARE

    @property
    def passes(self) -> bool:
        return self.bias_passes and self.interval_passes and self.error_passes

    def row(self) -> list[str]:
        """For a table."""
        return [
            self.group, f"{self.bias:.2f}", f"{self.bias_least_squares:.0f}", _told(self.bias_passes), f"{self.in_interval:.2f}",
            _told(self.interval_passes), f"{self.error:.3f} ± {self.uncertainty:.3f}", _told(self.error_passes),
            f"{100 * self.coverage:.1f}",
        ]  # fmt: skip


CRITERION_HEAD = [
    "IV against LS on the same raw data",
    "bias IV",
    "bias LS",
    "≤ 1/5",
    "bias / interval",
    "≤ 1",
    "error / bound",
    "≤ 1.15",
    "coverage %",
]


def _told(passes: bool) -> str:
    return "pass" if passes else "FAIL"


def criteria(iv: Trials, ls: Trials, groups: Mapping[str, Sequence[int]]) -> list[Criterion]:
    """The requirements, group by group."""
    return [
        Criterion(name, iv.bias(g), ls.bias(g), iv.bias_in_intervals(g), iv.error(g), iv.error_uncertainty(g), iv.coverage(g))
        for name, g in groups.items()
    ]


#: (statement, method that should be better, method that should be worse); none of them is the source's.
_RANKING = (
    ("IV along simulated motion beats LS on the same raw data", "iv", "ls_raw"),
    ("IV along simulated motion beats step by step", "iv", "steps"),
    ("IV along simulated motion beats the source's plain IV", "iv", "iv_plain"),
    ("step by step beats WLS on filtered signals", "steps", "wls"),
    ("IV along simulated motion beats WLS on filtered signals", "iv", "wls"),
)


def ranking(data: Data, title: str, trials: Mapping[str, Trials], forward: Mapping[str, Forward]) -> list[Claim]:
    """Torque errors of two methods, seed by seed."""
    errors = {k: np.array([data.torque_measure(e) for e in t.values - t.truth]) for k, t in trials.items() if t.usable}
    found = []
    for text, better, worse in _RANKING:
        if better in errors and worse in errors:
            a, b = errors[better], errors[worse]
            told = f"torque error {100 * np.median(a):.3g} % against {100 * np.median(b):.3g} %"
            if better in forward and worse in forward:
                told += f", motion error {forward[better].degrees:.3g} against {forward[worse].degrees:.3g} deg"
            found.append(Claim(f"{title}: {text}", _compared(a, b), told))
    return found


def _compared(better: Array, worse: Array) -> Outcome:
    """Whether one method's torque errors (S,) are smaller than another's, by their logarithms over the seeds."""
    a, b = np.log(better), np.log(worse)
    gap = float(b.mean() - a.mean())
    spread = float(np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))) if min(len(a), len(b)) > 1 else abs(gap)
    if abs(gap) <= _SURE * spread:
        return Outcome.EVEN
    return Outcome.HOLDS if gap > 0 else Outcome.FAILS


def conclusion(claims: Sequence[Claim], asked: Sequence[Criterion]) -> str:
    """In plain words."""
    lines = [f"{sum(c.outcome == Outcome.HOLDS for c in claims)} of {len(claims)} statements hold."]
    for outcome, begin in ((Outcome.FAILS, "It does not hold: "), (Outcome.EVEN, "Even within what the seeds can tell: ")):
        found = [c.text for c in claims if c.outcome == outcome]
        if found:
            lines.append(begin + "; ".join(found) + ".")
    failed = [c.group for c in asked if not c.passes]
    lines.append(f"The requirements on IV fail for {', '.join(failed)}." if failed else "The requirements on IV are met in every group.")
    return " ".join(lines)
