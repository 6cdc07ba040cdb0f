"""Diagnose a folder of cases, several at a time; results are appended, and what is done already is left alone.

python -m benchmarks.diagnosis.run_cases FOLDER RESULTS.jsonl --kind single --jobs 2"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from .score import read_cases, right, run


def diagnosed(folder: Path, records: list[dict[str, Any]], results: Path, jobs: int) -> Iterator[dict[str, Any]]:
    """Results of all records, those kept in `results` first."""
    kept = {r["id"]: r for r in map(json.loads, results.read_text().splitlines())} if results.exists() else {}
    # What failed is tried again: the reason may have been mended since.
    kept = {name: r for name, r in kept.items() if "failed" not in r}
    for record in records:
        if record["id"] in kept:
            yield kept[record["id"]]
    left = [r for r in records if r["id"] not in kept]
    for result in _all(folder, left, jobs):
        with results.open("a") as out:
            out.write(json.dumps(result) + "\n")
        yield result


def _all(folder: Path, records: list[dict[str, Any]], jobs: int) -> Iterator[dict[str, Any]]:
    """In the order in which they are done; in this process where one job is enough."""
    if jobs <= 1 or len(records) <= 1:
        yield from (_one(folder, record) for record in records)
        return
    for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(key, "1")
    # New interpreters: in a forked one the libraries keep the threads that they began with.
    with ProcessPoolExecutor(max_workers=jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for future in as_completed([pool.submit(_one, folder, record) for record in records]):
            yield future.result()


def _one(folder: Path, record: dict[str, Any]) -> dict[str, Any]:
    try:
        return run(folder, record)
    except Exception as error:  # noqa: BLE001 - one case must not lose the others; it is counted as failed
        return {**record, "failed": repr(error), "where": traceback.format_exc(limit=-4)}


def line(result: dict[str, Any]) -> str:
    """One result for people."""
    if "failed" in result:
        return f"FAIL {result['id']}: {result['failed']}"
    found = [(f["effect"], *f["joints"], round(f["evidence"]), round(f["confidence"], 2)) for f in result["findings"]]
    rivals = [(i["effect"], *i["joints"], round(i["confidence"], 2)) for f in result["findings"][:1] for i in f["imitators"][:3]]
    left = [(u["joint"], u["signature"], round(u["gain"])) for u in result["unexplained"]]
    good = right(result)
    ok = (not found) if not result["parts"] else good["all"]
    seen = result.get("oracle", [])
    oracle = "".join(f" oracle {o['gain']:.0f}±{o['error']:.0f}" for o in seen)
    flag = "ok" if ok else ("--" if seen and not any(o["detectable"] for o in seen) and not found else "BAD")
    return (
        f"{flag:4s}{result['seconds']:5.1f}s {result['id']:46s} {result['verdict']:11s}{oracle}"
        f" ratio {result['before'][0]:.2f} {result['after'][0]:.2f}"
        f" {found} rivals {rivals} left {left}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--kind", default="single,clean,outside,pair")
    parser.add_argument("--only", default="")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    records = [r for r in read_cases(args.folder) if r["kind"] in args.kind.split(",") and args.only in r["id"]]
    for result in diagnosed(args.folder, records[args.first :: args.every], args.results, args.jobs):
        print(line(result), flush=True)


if __name__ == "__main__":
    main()
