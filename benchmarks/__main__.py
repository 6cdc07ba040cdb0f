"""`python -m benchmarks [TOPIC …] [--short] [--out FOLDER]`: the tables, each with what it measured, on which data, against what.

Topics are the sub-packages that hold a module `run` with `main(short, folder)`; without a topic, all of them in turn."""

from __future__ import annotations

import argparse
import importlib
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pinocchio
import scipy

TOPICS = ("real", "actuators", "methods", "diagnosis", "performance", "physical", "excitation", "monitoring")
#: Distributions that topics need beyond `ident` itself.
NEEDS = {"performance": ("pyarrow", "rosbags"), "methods": ("example-robot-data",), "excitation": ("example-robot-data",)}


def lacking(topic: str) -> str:
    """What a topic needs and this environment lacks, with the remedy; "" where nothing is lacking."""
    missing = [name for name in NEEDS.get(topic, ()) if not _installed(name)]
    return f"{topic} needs {' and '.join(missing)}: pip install -e '.[test]'" if missing else ""


def _installed(distribution: str) -> bool:
    try:
        version(distribution)
    except PackageNotFoundError:
        return False
    return True


def main() -> int:
    """Run the topics asked for."""
    known = [t for t in TOPICS if (Path(__file__).parent / t / "run.py").is_file()]
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("topics", nargs="*", choices=[*known, []], default=known, help=", ".join(known))
    parser.add_argument("--short", action="store_true", help="fewer runs, for continuous integration")
    parser.add_argument(
        "--out", type=Path, default=Path("out/benchmarks"), help="folder for figures and result files (default: %(default)s)"
    )
    args = parser.parse_args()
    versions = f"numpy {np.__version__}, scipy {scipy.__version__}, pinocchio {pinocchio.__version__}, Python {platform.python_version()}"
    print(f"{platform.machine()} {platform.system()}, {versions}")
    args.out.mkdir(parents=True, exist_ok=True)
    worst = 0
    # Said before hours of work, not after.
    lacks = [said for topic in args.topics if (said := lacking(topic))]
    if lacks:
        print("\n".join(lacks), file=sys.stderr)
        return 1
    for topic in args.topics:
        print(f"\n== {topic} ==", flush=True)
        worst = max(worst, int(importlib.import_module(f"benchmarks.{topic}.run").main(short=args.short, folder=args.out) or 0))
    return worst


if __name__ == "__main__":
    sys.exit(main())
