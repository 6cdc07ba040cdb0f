"""Does a verdict depend on round-off? `python -m benchmarks.diagnosis.stability FOLDER RESULTS.jsonl [--count N]`.

Cases of a folder (`benchmarks.diagnosis.feedback.suite`, `generate`) are diagnosed as they are, then with two threads, on the NumPy path,
with another seed of the draws that give the critical value, and with the last 1 % of each log left out. Counted: the same verdict and the
same first finding. Results are appended, and what is done already is left alone."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident import estimators as es
from ident.diagnosis.inference import significance
from ident.problem.problem import Problem

from .score import load, read_cases
from .tables import table

#: What each variant changes in the environment of its process.
VARIANTS: dict[str, dict[str, str]] = {
    "as it is": {},
    "two threads": {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
    "NumPy path": {"IDENT_KERNEL": "numpy"},
    "other draws": {},
    "1 % shorter": {},
}
_ONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_SHORTER = 0.99


def diagnosed(folder: Path, record: dict[str, Any], variant: str, scratch: Path) -> dict[str, Any]:
    """Verdict and first finding of a case under a variant, in this process."""
    warnings.simplefilter("ignore")
    if variant == "other draws":
        significance.SEED = 2
    if variant == "1 % shorter":
        with np.load(folder / f"{record['id']}.npz") as data:
            rows = len(data["t"])
            np.savez(scratch / f"{record['id']}.npz", **{k: x[: int(_SHORTER * rows)] if len(x) == rows else x for k, x in data.items()})
        folder = scratch
    case = load(folder, record)
    before = es.WeightedLeastSquares().solve(Problem(case.model, case.fit))
    found = ident.diagnose(before, case.held)
    first = found.findings[0] if found.findings else None
    return {
        "id": record["id"],
        "variant": variant,
        "verdict": found.verdict.value,
        "first": None if first is None else [first.name, *first.joints],
    }


def compared(results: list[dict[str, Any]]) -> str:
    """A table: of how many cases each variant has the verdict and the first finding of the case as it is."""
    told = {(r["id"], r["variant"]): (r["verdict"], r["first"]) for r in results}
    rows = []
    for variant in list(VARIANTS)[1:]:
        names = [name for name, v in told if v == variant and (name, "as it is") in told]
        both = [(told[name, variant], told[name, "as it is"]) for name in names]
        verdict, first = sum(a[0] == b[0] for a, b in both), sum(a[1] == b[1] for a, b in both)
        rows.append([variant, str(len(both)), str(verdict), str(first), str(sum(a == b for a, b in both))])
    return table(["variant", "cases", "same verdict", "same first finding", "both (asked: 98 %)"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--count", type=int, help="so many cases, spread over the folder")
    parser.add_argument("--variant", choices=list(VARIANTS), help="this one, in this process (the others are started for it)")
    args = parser.parse_args()
    records = read_cases(args.folder)
    if args.count:
        records = [records[int(k)] for k in np.linspace(0, len(records) - 1, min(args.count, len(records))).round()]
    if args.variant is None:
        for variant, environment in VARIANTS.items():
            own = [sys.executable, "-m", "benchmarks.diagnosis.stability", str(args.folder), str(args.results), "--variant", variant]
            own += ["--count", str(args.count)] if args.count else []
            subprocess.run(own, env={**os.environ, **_ONE, **environment}, check=True)
        print(compared([json.loads(line) for line in args.results.read_text().splitlines()]))
        return
    done = {(r["id"], r["variant"]) for r in map(json.loads, args.results.read_text().splitlines())} if args.results.exists() else set()
    scratch = args.results.parent / "shorter"
    scratch.mkdir(parents=True, exist_ok=True)
    for record in records:
        if (record["id"], args.variant) in done:
            continue
        one = diagnosed(args.folder, record, args.variant, scratch)
        with args.results.open("a") as out:
            out.write(json.dumps(one) + "\n")
        (scratch / f"{record['id']}.npz").unlink(missing_ok=True)


if __name__ == "__main__":
    main()
