"""Start-up of the command line: help, and a check of a log of 10 MB, each in a process of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .make_large_log import write
from .table import Row

#: Rows of a log of some 10 MB.
_ROWS = 42_000


def startup_rows() -> list[Row]:
    """By the clock where nothing is worked, by processor time where there is."""
    empty = min(_run(["-c", "pass"])[0] for _ in range(5))
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        log = Path(name) / "log.csv"
        write(log, _ROWS)
        size = log.stat().st_size / 1e6
        asked = ["-m", "ident", "check", "--robot", "puma560", "--log", str(log)]
        checks = [_run(asked) for _ in range(5)]
        why = slowest_imports(asked)
    helped = [_run(["-m", "ident", "--help"])[0] for _ in range(5)]
    clock, busy = min(clock for clock, _ in checks), min(busy for _, busy in checks)
    return [
        Row("`ident --help`", min(helped), "s", 0.15, why=f"an empty process takes {empty:.2g} s"),
        Row(
            f"`ident check` of a log of {size:.0f} MB, processor time", busy, "s", 1.5, why=why,
            note=f"{clock:.3g} s by the clock, the best of five",
        ),
        Row("import ident", _import(empty), "s", 0.5, why=slowest_imports(["-c", "import ident"])),
    ]  # fmt: skip


def _run(arguments: list[str]) -> tuple[float, float]:
    """Seconds by the clock and of the processor, of the interpreter with these arguments."""
    start, before = time.perf_counter(), os.times()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
    after = os.times()
    return time.perf_counter() - start, after.children_user + after.children_system - before.children_user - before.children_system


def _import(empty: float) -> float:
    """`import ident` in a new process beyond an empty one."""
    return max(min(_run(["-c", "import ident"])[0] for _ in range(5)) - empty, 1e-3)


def slowest_imports(arguments: list[str], most: int = 4) -> str:
    """The packages whose own modules take longest to import, by the interpreter's own count."""
    run = subprocess.run([sys.executable, "-X", "importtime", *arguments], check=True, capture_output=True, text=True)
    own: dict[str, float] = {}
    for line in run.stderr.splitlines():
        found = re.match(r"import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", line)
        if found:
            package = found[2].split(".")[0]
            own[package] = own.get(package, 0.0) + float(found[1]) * 1e-6
    largest = sorted(own.items(), key=lambda item: -item[1])[:most]
    return "imports of this run: " + ", ".join(f"{name} {seconds:.2g} s" for name, seconds in largest)
