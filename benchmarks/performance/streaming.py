"""CSV to estimate by `ident fit`, streamed: seconds, and the largest memory of the process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from .limits import Limit, profiled_process
from .make_large_log import write
from .table import Row

#: Runs of which the median counts.
_RUNS = 5
_PEAK = "from benchmarks.performance.streaming import peak"


def csv_rows(sizes: list[int], threads: list[int]) -> list[Row]:
    """A fit of each size by each number of threads, and with the first of them from Parquet; files are removed one by one."""
    found = []
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        folder = Path(name)
        for rows in sizes:
            log = folder / f"{rows}.csv"
            write(log, rows)
            size = log.stat().st_size
            parsed, libraries = parsing(log)
            for jobs in threads:
                found += _fit(log, rows, size, jobs, parsed, libraries)
            log.unlink()
            write(log.with_suffix(".parquet"), rows)
            found += _fit_again(log.with_suffix(".parquet"), rows, parsed)
            log.with_suffix(".parquet").unlink()
    return found


def _fit(log: Path, rows: int, size: int, jobs: int, parsed: float, libraries: float) -> list[Row]:
    seconds, busy, memory = _medians(log, jobs, _RUNS if rows < 10_000_000 or jobs == 1 else 1)
    threads = f"{jobs} thread" + "s" * (jobs > 1)
    limit = Limit((("parsing alone by pyarrow, one thread,", parsed),))
    large = rows >= 1_000_000
    return [
        Row(
            f"CSV of {rows} rows ({size / 1e9:.2g} GB) to estimate and report, {threads}, processor time", busy, "s",
            4.0 * parsed if large else None, (("parsing alone by pyarrow", parsed, None),), limit.why(busy, "s"),
            f"{seconds:.3g} s by the clock",
        ),
        Row(f"    its memory, {threads}", memory, "MB", 200.0, why=f"the libraries alone, imported, hold {libraries:.0f} MB"),
    ]  # fmt: skip


def _fit_again(log: Path, rows: int, parsed: float) -> list[Row]:
    seconds, busy, memory = _medians(log, 1, _RUNS)
    why = profiled_process([*_command(log, 1), "--force"], 8) if rows >= 1_000_000 else ""
    shutil.rmtree(log.parent / "out", ignore_errors=True)
    return [
        Row(
            f"the same {rows} rows from Parquet, 1 thread, processor time", busy, "s", 5e-7 * rows if rows >= 1_000_000 else None,
            (("parsing the CSV alone by pyarrow", parsed, None),), why, f"{seconds:.3g} s by the clock; memory {memory:.0f} MB",
        )
    ]  # fmt: skip


def _medians(log: Path, jobs: int, runs: int) -> tuple[float, float, float]:
    """Seconds by the clock and of the processor, memory (MB): the medians of some fits."""
    each = []
    for _ in range(runs):
        each.append(_run(_command(log, jobs)))
        shutil.rmtree(log.parent / "out")
    seconds, busy, memory = np.median(each, axis=0).tolist()
    return seconds, busy, memory


def _command(log: Path, jobs: int) -> list[str]:
    out = str(log.parent / "out")
    return ["fit", "--robot", "puma560", "--log", str(log), "--stream", "--jobs", str(jobs), "--out", out, "--quiet"]


def parsing(log: Path) -> tuple[float, float]:
    """Processor seconds of pyarrow's reader over a CSV, piece by piece in one thread, and the memory (MB) of our libraries alone."""
    code = (
        "import sys, time; from pyarrow import csv; start = time.process_time()\n"
        "for _ in csv.open_csv(sys.argv[1], read_options=csv.ReadOptions(use_threads=False)): pass\n"
        "print(time.process_time() - start)"
    )
    parse = [sys.executable, "-c", code, str(log)]
    each = [float(subprocess.run(parse, check=True, capture_output=True, text=True).stdout) for _ in range(_RUNS)]
    bare = subprocess.run(
        [sys.executable, "-c", f"import ident.commands.fit; {_PEAK}; print(peak())"], check=True, capture_output=True, text=True
    )
    return float(np.median(each)), float(bare.stdout)


def _run(command: list[str]) -> tuple[float, float, float]:
    """Seconds by the clock and of the processor, and largest resident memory (MB), of `ident` with these arguments in its own process."""
    code = f"import sys; from ident.cli import main; status = main(sys.argv[1:]); {_PEAK}; print('PEAK', peak()); sys.exit(status)"
    start, before = time.perf_counter(), os.times()
    run = subprocess.run([sys.executable, "-c", code, *command], check=False, capture_output=True, text=True, env=dict(os.environ))
    seconds, after = time.perf_counter() - start, os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    if run.returncode != 0:
        raise RuntimeError(f"ident {' '.join(command)} failed: {run.stderr[-2000:]}")
    return seconds, busy, next(float(line.split()[1]) for line in reversed(run.stdout.splitlines()) if line.startswith("PEAK"))


def memory_row(samples: int) -> Row:
    """Memory that the information of many samples takes beyond the samples themselves: the regressor is never written down."""
    code = (
        f"from benchmarks.performance.cases import puma; {_PEAK}; case = puma({samples}); case.information('triangle', 100);"
        " before = peak(); case.information('triangle'); case.information('gram'); print(peak() - before)"
    )
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    stacked = samples * 6 * 53 * 8 / 1e6
    return Row(
        f"memory of the information of {samples} samples beyond theirs", max(float(run.stdout.split()[-1]), 0.1), "MB",
        others=(("the stacked matrix", stacked, None),),
    )  # fmt: skip


def peak() -> float:
    """Largest resident memory of this process so far, MB. Linux's getrusage also counts that of the process it was started from."""
    status = Path("/proc/self/status")
    if status.exists():
        return float(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))) / 1e3
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
