"""Times that stand a busy machine: works in turn, the median of their turns, and what the machine itself can do."""

from __future__ import annotations

import os
import platform
import resource
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Work:
    """Something to be timed, `count` units of it, by a `clock` in seconds: the processor time of this thread, unless it is told otherwise
    (several threads, other processes)."""

    call: Callable[[], Any]
    count: int
    clock: Callable[[], float] = time.thread_time


def children_clock() -> float:
    """Processor time of the processes that this one has started and waited for, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


#: Turns of each work, at least.
TURNS = 5


def together(works: Mapping[str, Work], rounds: int = TURNS, budget: float = 6.0) -> dict[str, float]:
    """Microseconds per unit of each work: the median of its turns, of each of which the best of some repeats counts. Every work has its
    turn in every round, so that a ratio is of one state of the machine.

    There are `rounds` turns, and as many more as `budget` (s) allows up to three times as many."""
    return {name: float(np.median(turns)) for name, turns in in_turn(works, rounds, budget).items()}


def in_turn(works: Mapping[str, Work], rounds: int, budget: float) -> dict[str, list[float]]:
    """Microseconds per unit of each work in each of its turns."""
    for work in works.values():
        work.call()  # caches and plans
    shortest = dict.fromkeys(works, 0.0)
    found: dict[str, list[float]] = {name: [] for name in works}
    begin = time.perf_counter()
    for turn in range(3 * rounds):
        if turn >= rounds and time.perf_counter() - begin > budget:
            break
        for name, work in works.items():
            times = []
            for _ in range(_repeats(shortest[name])):
                start = work.clock()
                work.call()
                times.append(work.clock() - start)
            shortest[name] = min(times)
            found[name].append(min(times) / work.count * 1e6)
    return found


def _repeats(seconds: float) -> int:
    """Short works have several runs a turn: some 30 ms."""
    return 1 if not seconds else max(1, min(20, int(0.03 / max(seconds, 1e-6))))


def best(call: Callable[[], Any], count: int, *, rounds: int = TURNS, budget: float = 2.0) -> float:
    """Microseconds per unit of one work."""
    return together({"": Work(call, count)}, rounds, budget)[""]


def dgemm() -> Work:
    """A multiplication of matrices; its unit is 1e6 operations."""
    size = 500
    A = np.random.default_rng(0).normal(size=(size, size))
    return Work(lambda: A @ A, 2 * size**3 // 1_000_000)


def multiplications() -> float:
    """Multiplications and additions of one thread in dgemm, 1e9/s: what this machine gives to dense algebra."""
    return 1e3 / together({"": dgemm()}, budget=1.0)[""]


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


def processor() -> dict[str, str]:
    """What the system says of the processor: vendor, family, model and name, where it does."""
    found = dict.fromkeys(("vendor_id", "cpu family", "model", "model name"), "")
    found["model name"] = platform.processor()
    if Path("/proc/cpuinfo").exists():
        for line in Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines():
            name, _, value = line.partition(":")
            if name.strip() in found:
                found[name.strip()] = value.strip()
    return found


def machine() -> dict[str, Any]:
    """What was measured on."""
    import pinocchio

    module = native()
    return {
        "processor": processor()["model name"],
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "kernel": module.instruction_sets()[-1] if module else "numpy",
        "dgemm GFLOP/s": multiplications(),
        "copy GB/s": bandwidth(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pinocchio": pinocchio.__version__,
    }
