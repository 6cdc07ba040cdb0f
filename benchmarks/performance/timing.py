"""Times that stand a busy machine: works in turn, the best of many rounds, and what the machine itself can do."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Work:
    """Something to be timed, `count` units of it; `wall`: by the clock on the wall (several threads, other processes), not by the
    processor time of this thread."""

    call: Callable[[], Any]
    count: int
    wall: bool = False


def together(works: Mapping[str, Work], rounds: int = 5, budget: float = 6.0) -> dict[str, float]:
    """Microseconds per unit of each work, the best of rounds in which every work has its turn: a ratio is of one state of the machine.

    A work that takes longer than its share of `budget` (s) has fewer turns, two at least."""
    for work in works.values():
        work.call()  # caches and plans
    times: dict[str, list[float]] = {name: [] for name in works}
    spent = dict.fromkeys(works, 0.0)
    for turn in range(max(rounds, 2)):
        for name, work in works.items():
            if turn >= 2 and spent[name] > budget / len(works):
                continue
            begin = time.perf_counter()
            for _ in range(_repeats(times[name])):
                clock = time.perf_counter if work.wall else time.thread_time
                start = clock()
                work.call()
                times[name].append(clock() - start)
            spent[name] += time.perf_counter() - begin
    return {name: min(t) / works[name].count * 1e6 for name, t in times.items()}


def _repeats(times: list[float]) -> int:
    """Short works have several runs a turn: some 30 ms."""
    return 1 if not times else max(1, min(20, int(0.03 / max(min(times), 1e-6))))


def best(call: Callable[[], Any], count: int, *, wall: bool = False, rounds: int = 5, budget: float = 2.0) -> float:
    """Microseconds per unit of one work."""
    return together({"": Work(call, count, wall)}, rounds, budget)[""]


def multiplications() -> float:
    """Multiplications and additions of one thread in dgemm, 1e9/s: what this machine gives to dense algebra."""
    A = np.random.default_rng(0).normal(size=(512, 512))
    return 2 * 512**3 / (best(lambda: A @ A, 1, budget=1.0) * 1e-6) * 1e-9


def bandwidth() -> float:
    """Bytes of one thread to and from main memory in a copy of 256 MB, 1e9/s, each byte read and written."""
    source = np.ones(1 << 25)
    target = np.empty_like(source)
    return 2 * source.nbytes / (best(lambda: np.copyto(target, source), 1, budget=1.0) * 1e-6) * 1e-9


def native() -> Any:
    """The compiled kernel's module, or None."""
    try:
        from ident.regressor import native as module
    except ImportError:
        return None
    return module


def machine() -> dict[str, Any]:
    """What was measured on."""
    import pinocchio

    cpu = platform.processor()
    if Path("/proc/cpuinfo").exists():
        lines = [line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        cpu = lines[0] if lines else cpu
    module = native()
    return {
        "processor": cpu,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "kernel": module.instruction_sets()[-1] if module else "numpy",
        "dgemm GFLOP/s": multiplications(),
        "copy GB/s": bandwidth(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pinocchio": pinocchio.__version__,
    }
