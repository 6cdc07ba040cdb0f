"""Why a target is missed, from the same run: the parts that were measured or follow from counted operations, and where a profile lay."""

from __future__ import annotations

import cProfile
import pstats
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.regressor import rigid

from .cases import Case
from .timing import Work, multiplications, together


@dataclass(frozen=True)
class Limit:
    """What a work cannot go below: `parts`, each with what it is and its value in the unit of the work."""

    parts: tuple[tuple[str, float], ...]

    @property
    def value(self) -> float:
        return sum(value for _, value in self.parts)

    def why(self, measured: float, unit: str) -> str:
        """Each part and what is left beside them, as shares of what was measured."""
        told = [f"{what} {value:.3g} {unit} ({value / measured:.0%})" for what, value in self.parts]
        rest = measured - self.value
        return "of this run: " + ", ".join([*told, f"the rest {rest:.3g} {unit} ({rest / measured:.0%})"])


def products(case: Case) -> int:
    """Multiplications and additions a sample of the upper triangles of [Phi tau]'[Phi tau], row by row, without zero columns."""
    from ident.regressor import native_tree  # only where the kernel was built

    plan = native_tree.compiled(case.tree).plan(case.tree, case.rows, case.columns, case.extra, case.pattern)
    return sum(len(live) * (len(live) + 1) for live in plan.live)


def information_limit(case: Case, samples: int, reflections: bool = False) -> Limit:
    """The motion of the links, as inverse dynamics alone takes, and the columns' products (twice the operations for `reflections`)
    at the rate of dgemm. What is left is to fill the columns, and what the products miss of that rate."""
    q, dq, ddq = (x[:samples] for x in (case.q, case.dq, case.ddq))
    motion = together({"": Work(lambda: rigid.inverse_dynamics(case.tree, case.inertia, q, dq, ddq, threads=1), samples)})[""]
    count, rate = products(case) * (2 if reflections else 1), multiplications()
    return Limit((("the links' motion", motion), (f"{count} operations at dgemm's {rate:.0f} GFLOP/s", count / rate * 1e-3)))


def profiled(work: Callable[[], Any], most: int = 5) -> str:
    """Where a work spends its time: the functions with the largest own time, from a profile of one run of it."""
    profile = cProfile.Profile()
    profile.runcall(work)
    return _largest(pstats.Stats(profile), most)


def profiled_process(arguments: list[str], most: int = 5) -> str:
    """The same of `ident` with these arguments, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        kept = Path(name) / "profile"
        run = [sys.executable, "-m", "cProfile", "-o", str(kept), "-m", "ident", *arguments]
        subprocess.run(run, check=True, capture_output=True)
        return _largest(pstats.Stats(str(kept)), most)


def _largest(stats: Any, most: int) -> str:
    own = {name: row[2] for name, row in stats.stats.items()}
    total = sum(own.values())
    largest = sorted(own.items(), key=lambda item: -item[1])[:most]
    named = [f"{_told(*name)} {seconds / total:.0%}" for name, seconds in largest]
    return "profile of this run, own time: " + ", ".join(named)


def _told(path: str, line: int, function: str) -> str:
    return function.strip("{}") if path == "~" else f"{Path(path).stem}.{function}"
