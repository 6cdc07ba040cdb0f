"""What the diagnosis makes of logs with a known fault: the counts that are asked for, and where it fails.

    python -m benchmarks diagnosis [--short]
    python -m benchmarks.diagnosis.run OUT --suite final --first 9000 --jobs 2

Cases are simulated into OUT/diagnosis/cases and diagnosed one by one into OUT/diagnosis/results.jsonl; what is done is left alone,
so that a run that was cut off goes on where it was. The tables, `diagnosis.json` and the figures are made of all that is there."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import ident
from ident._utils.json import jsonable

from . import figures, speed, tables
from .counts import against_gain, against_size, confusion, requirements
from .generate import generate, suite
from .run_cases import diagnosed, line
from .score import read_cases


def main(short: bool, folder: Path) -> int:
    """Simulate, diagnose, count. 0 where every requirement is met (the short run is too small to judge by), else 1."""
    return benchmark(folder / "diagnosis", "short" if short else "final", jobs=1 if short else free_cores())


def benchmark(
    out: Path, name: str, *, first: int | None = None, jobs: int = 1, cases: Path | None = None, kinds: tuple[str, ...] = (), only: str = ""
) -> int:
    """`out`: folder of the results; `cases`: folder of the cases, by default beside them; `kinds`, `only`: some of the suite."""
    begin = time.perf_counter()
    out.mkdir(parents=True, exist_ok=True)
    cases = out / "cases" if cases is None else cases
    wanted = [c for c in suite(name, first) if (not kinds or c.kind in kinds) and only in c.id]
    generate(cases, wanted)
    seeds = {c.seed for c in wanted}
    records = [r for r in read_cases(cases) if r["seed"] in seeds and (not kinds or r["kind"] in kinds) and only in r["id"]]
    results = []
    for result in diagnosed(cases, records, out / "results.jsonl", jobs):
        results.append(result)
        print(f"{len(results)}/{len(records)} {line(result)}", flush=True)
    text = told(results)
    print(text)
    (out / "tables.txt").write_text(text + "\n")
    limit = None if name == "short" else speed.measured(out / "speed")
    if limit is not None:
        print(f"\n-- six joints, 60 s at 500 Hz, full catalogue, one core\n{speed.told(limit)}")
    drawn = drawings(results, out)
    kept = {
        "suite": name, "first": first, "ident_version": ident.__version__, "jobs": jobs, "cases": len(results),
        "requirements": [{**r.__dict__, "share": r.share, "interval": r.interval, "met": r.met} for r in requirements(results)],
        "confusion": confusion(results), "against_gain": against_gain(results), "against_size": against_size(results),
        "timed": limit, "figures": [p.name for p in drawn],
        "results": [{k: v for k, v in r.items() if k != "trail"} for r in results],
    }  # fmt: skip
    (out / "diagnosis.json").write_text(json.dumps(jsonable(kept), indent=1))
    names = ", ".join(p.name for p in drawn)
    print(f"\nresults.jsonl, tables.txt, diagnosis.json, {names} in {out}; {time.perf_counter() - begin:.0f} s")
    if name == "short":
        print("the short run is too small to judge by: no requirement is enforced")
        return 0
    in_time = limit is None or speed.met(limit)
    return 0 if in_time and all(r.met is not False for r in requirements(results)) else 1


def told(results: list[dict[str, Any]]) -> str:
    """All tables."""
    parts = {
        "requirements": tables.requirement_table,
        "confusion: what the first finding says (single faults that can be seen, outside, clean)": tables.confusion_table,
        "detection against magnitude": tables.gain_table,
        "detection against the size of the fault": tables.size_table,
        "held-out error over the generator's torque noise, all joints": tables.error_table,
        "coverage of the effects' parameters": tables.coverage_table,
        "time": tables.time_table,
        "cases that count against a requirement": tables.wrong_table,
    }
    return "\n".join(f"\n-- {title}\n{make(results)}" for title, make in parts.items())


def drawings(results: list[dict[str, Any]], out: Path) -> list[Path]:
    """The figures that the results are enough for."""
    drawn = []
    if any(r["kind"] == "single" for r in results):
        drawn.append(figures.detection_figure(results, out / "detection.png"))
        drawn.append(figures.size_figure(results, out / "single_faults.png"))
    if confusion(results):
        drawn.append(figures.confusion_figure(results, out / "confusion.png"))
    return drawn


def free_cores() -> int:
    """Processors that nobody uses now; one at least."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    return max(1, round(cores - busy))


def command() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--suite", default="final", choices=("development", "final", "short"))
    parser.add_argument("--first", type=int, help="another first seed: fresh motions, joints, noise and random choices")
    parser.add_argument("--jobs", type=int, help="processes (default: the cores that are free)")
    parser.add_argument("--cases", type=Path, help="folder of cases, kept from another run or shared (default: OUT/cases)")
    parser.add_argument("--kind", default="", help="some kinds only, separated by commas: single, clean, outside, pair")
    parser.add_argument("--only", default="", help="part of the case's id")
    args = parser.parse_args()
    kinds = tuple(k for k in args.kind.split(",") if k)
    jobs = free_cores() if args.jobs is None else args.jobs
    return benchmark(args.out, args.suite, first=args.first, jobs=jobs, cases=args.cases, kinds=kinds, only=args.only)


if __name__ == "__main__":
    sys.exit(command())
