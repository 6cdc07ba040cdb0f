"""Targets of the fast core against what is measured here, in one run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ident.regressor import numpy_series
from ident.regressor.kernel_choice import kernel as chosen_kernel

from . import estimation, kernel, live, reading, startup, streaming
from .table import Row, show, show_rows
from .timing import machine


def main(short: bool, folder: Path) -> int:
    """Print every row as it is measured; write `performance.json`. A missed target is no failure: timings depend on load."""
    module = chosen_kernel()
    if not module.compiled or module.series is numpy_series:
        print("the compiled kernel is not there, or of older sources; a benchmark of the slow path says nothing. Run: pip install -e .")
        return 2
    about = machine()
    print("  ".join(f"{k}: {v:.1f}" if isinstance(v, float) else f"{k}: {v}" for k, v in about.items()))
    print(
        "processor time of one thread unless threads are named; the best of rounds in which all that is compared has its turn\n", flush=True
    )
    rows: list[Row] = []

    def add(found: list[Row]) -> None:
        show_rows(found)
        rows.extend(found)

    add(kernel.information_rows(10_000 if short else 50_000, folder))
    add(kernel.humanoid_row(8192))
    add(estimation.simulation_rows())
    add([estimation.recursion_row(12_000 if short else 120_000)])
    add(estimation.instrument_rows(10_000 if short else 100_000))
    add(live.live_rows(10_000 if short else 100_000))
    add(startup.startup_rows())
    add(reading.reading_rows(20_000 if short else 200_000))
    add([streaming.memory_row(100_000 if short else 1_000_000)])
    add(streaming.csv_rows([100_000] if short else [100_000, 1_000_000, 10_000_000], [1] if short else [1, 2]))
    tables: dict[str, list[dict[str, Any]]] = {}

    def table(title: str, found: list[dict[str, Any]]) -> None:
        show(title, found)
        tables[title] = found

    table("PUMA 560, one thread (us a sample or call)", kernel.dynamics_table(8192))
    table("information by kernel (us a sample, 8192 samples)", kernel.by_instruction_set(8192))
    joints = [1, 6, 12] if short else [1, 2, 3, 4, 6, 7, 9, 12, 18, 24, 30, 36]
    table("serial arms by joints (us a sample)", kernel.by_joints(joints))
    sizes = [10_000, 100_000] if short else [10_000, 100_000, 1_000_000, 10_000_000]
    table("PUMA 560 by samples and threads (us a sample)", kernel.by_samples(sizes, [1, 2]))
    text = {"schema": "ident.benchmark.performance/3", "machine": about, "rows": [r.to_dict() for r in rows], "tables": tables}
    (folder / "performance.json").write_text(json.dumps(text, indent=1))
    met = [r for r in rows if r.target is not None]
    print(f"\n{sum(not r.misses for r in met)} of {len(met)} targets met")
    return 0
