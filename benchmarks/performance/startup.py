"""The command line in processes of its own: help, a check of a log of 10 MB, the demonstration."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import numpy as np

from .make_large_log import write
from .table import Row
from .timing import Work, children_clock, together

#: Rows of a log of some 10 MB.
_ROWS = 42_000


def startup_rows() -> list[Row]:
    """Processor time of new processes, which take turns."""
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        log = Path(name) / "log.csv"
        write(log, _ROWS)
        size = log.stat().st_size / 1e6
        check = ["-m", "ident", "check", "--robot", "puma560", "--log", str(log)]
        demo = ["-m", "ident", "demo", "--out", str(Path(name) / "demo"), "--force"]
        asked = {"empty": ["-c", "pass"], "help": ["-m", "ident", "--help"], "import": ["-c", "import ident"], "check": check, "demo": demo}
        works = {k: Work(lambda v=v: process(v), 1, children_clock) for k, v in asked.items()}  # type: ignore[misc]
        found = {k: us * 1e-6 for k, us in together(works, budget=0.0).items()}
        whys = {k: slowest_imports(asked[k]) for k in ("check", "demo")}
        clocks = {k: float(np.median([process(asked[k])[0] for _ in range(5)])) for k in ("help", "check", "demo")}
    empty = found["empty"]
    return [
        Row("`ident --help`", found["help"], "s", 0.15, why=f"an empty process takes {empty:.2g} s", note=_by_clock(clocks["help"])),
        Row(f"`ident check` of a log of {size:.0f} MB", found["check"], "s", 1.5, why=whys["check"], note=_by_clock(clocks["check"])),
        Row("`ident demo` (fit, validation, payload)", found["demo"], "s", 6.0, why=whys["demo"], note=_by_clock(clocks["demo"])),
        Row(
            "import ident, beyond an empty process", max(found["import"] - empty, 1e-3), "s", 0.5,
            why=slowest_imports(["-c", "import ident"]),
        ),
    ]  # fmt: skip


def _by_clock(seconds: float) -> str:
    return f"processor time; {seconds:.3g} s by the clock"


def process(arguments: list[str]) -> tuple[float, float]:
    """Seconds by the clock and of the processor, of the interpreter with these arguments."""
    start, before = time.perf_counter(), children_clock()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=_environment())
    return time.perf_counter() - start, children_clock() - before


def _environment() -> dict[str, str]:
    """Modules are compiled once, as in an installed package, whatever the environment says of bytecode."""
    plain = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return plain | {"PYTHONPYCACHEPREFIX": _bytecode().name}


@cache
def _bytecode() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="ident-benchmark-")


def slowest_imports(arguments: list[str], most: int = 4) -> str:
    """The packages whose own modules take longest to import, by the interpreter's own count."""
    run = subprocess.run([sys.executable, "-X", "importtime", *arguments], check=True, capture_output=True, text=True, env=_environment())
    own: dict[str, float] = {}
    for line in run.stderr.splitlines():
        found = re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", line)
        if found:
            package = found[2].split(".")[0]
            own[package] = own.get(package, 0.0) + float(found[1]) * 1e-6
    largest = sorted(own.items(), key=lambda item: -item[1])[:most]
    return "imports of this run: " + ", ".join(f"{name} {seconds:.2g} s" for name, seconds in largest)
