"""`python -m tests.fuzz`: fresh inputs of every class, counted; each kind of fault once, with a file that reproduces it."""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from .kinds import KINDS
from .outcomes import Count
from .run import fuzz_apart

#: GB of memory beyond which an input is a bomb.
_MEMORY = 6


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("kinds", nargs="*", default=[*KINDS], help=f"classes of input: {', '.join(KINDS)} (default: all)")
    parser.add_argument("--minutes", type=float, help="how long, over all classes")
    parser.add_argument("--count", type=int, default=1000, help="inputs of each class, where no time is given")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--keep", type=Path, help="folder for files that reproduce faults")
    parser.add_argument("--memory", type=int, default=_MEMORY, help="GB of memory that an input may take; 0: no limit")
    given = parser.parse_args()
    if given.memory:
        resource.setrlimit(resource.RLIMIT_AS, (given.memory << 30, given.memory << 30))
    counts: list[Count] = []
    for name in given.kinds:
        until = None if given.minutes is None else time.monotonic() + 60 * given.minutes / len(given.kinds)
        with TemporaryDirectory() as folder:
            count = fuzz_apart(KINDS[name], Path(folder), given.seed, None if until else given.count, until)
        counts.append(count)
        print(f"{count.line()}\n{count.sources()}", flush=True)
        for i, (seen, outcome, data, seed) in enumerate(count.faults.values()):
            print(f"  {outcome.kind} x{seen} at {outcome.where}, seed {seed}: {outcome.text}", flush=True)
            if given.keep is not None:
                given.keep.mkdir(parents=True, exist_ok=True)
                (given.keep / f"{name}-{i}-{seed}.bin").write_bytes(data)
    print(f"all          inputs {sum(c.total for c in counts):<7} faults {sum(sum(f[0] for f in c.faults.values()) for c in counts)}")
    return 1 if any(c.faults for c in counts) else 0


if __name__ == "__main__":
    sys.exit(main())
