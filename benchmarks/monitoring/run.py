"""`python -m benchmarks monitoring [--short]`: verdicts of `ident.monitor` on pairs of logs with a known change, on seeds fixed beforehand.

Reference and later log have motions of their own. The fit is weighted least squares of the first log alone; the later one is watched with
the fit's own log at hand and without it."""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import ident
from ident.study.session import like

from .world import KINDS, Pair, arms, kept

#: Seeds of the pairs in which nothing changed, and of the others.
UNCHANGED, CHANGED = (0, 1, 2, 3, 4), (0,)


def watched(pair: Pair, *, reference: bool) -> dict[str, Any]:
    """What monitoring says of a pair, and how that counts."""
    warnings.simplefilter("ignore")
    robot = pair.arm.robot
    signals = ident.ZeroPhase()(ident.LogSet((pair.before,), robot=robot))
    estimate = _fitted(pair, signals)
    new = like(signals.report.to_dict())(ident.LogSet((pair.after,), robot=robot))
    start = time.process_time()
    found = ident.monitor(estimate, new, reference=signals if reference else None)
    told = [(c.effect.name, tuple(c.joints)) for c in found.changes]
    return {
        "pair": pair.name, "kind": pair.kind, "arm": pair.arm.name, "reference": reference, "count": counted(pair, found.verdict, told),
        "verdict": found.verdict, "changes": [f"{name} on {'/'.join(joints)}" for name, joints in told],
        "unexplained": [f"{u.joint}: {u.signature}" for u in found.unexplained], "known": list(found.known),
        "seconds": time.process_time() - start,
    }  # fmt: skip


def _fitted(pair: Pair, signals: ident.Signals) -> ident.Estimate:
    from ident.estimators import make_estimator
    from ident.problem.problem import Problem

    return make_estimator("wls").solve(Problem(pair.arm.declared, signals))


def counted(pair: Pair, verdict: str, told: list[tuple[str, tuple[str, ...]]]) -> str:
    """How an answer counts. Nothing changed: right, flagged (unexplained without a name), or false (a name). Else: right (only right
    names), left (the same, and something unexplained), beside (a right one first, then others), flagged, missed, or wrong."""
    if not pair.right:
        return "false" if told else "right" if verdict == "unchanged" else "flagged"
    good = [name in pair.right for name in told]
    if not told:
        return "missed" if verdict == "unchanged" else "flagged"
    if all(good):
        return "left" if verdict == "unexplained" else "right"
    return "beside" if good[0] else "wrong"


def main(short: bool, folder: Path, seeds: int = 0, only: Sequence[str] = ()) -> int:
    """Print counts; write `monitoring.json`. Returns 1 if a change is named where nothing changed. `only`: names of arms."""
    results: list[dict[str, Any]] = []
    cases = [("unchanged", s) for s in (UNCHANGED[:1] if short else UNCHANGED)] + [(k, s) for k in KINDS for s in CHANGED]
    for reference in (True, False):
        for arm in arms():
            for kind, seed in cases if not only or arm.name in only else ():
                one = watched(kept(folder / "monitoring", arm, kind, seed + seeds), reference=reference)
                results.append(one)
                where = "with" if reference else "without"
                said = ", ".join(one["changes"] + one["unexplained"] + [f"known {x}" for x in one["known"]])
                print(f"{one['count']:8} {one['pair']} ({where}): {one['verdict']}; {said} [{one['seconds']:.1f} s]", flush=True)
    (folder / "monitoring.json").write_text(json.dumps(results, indent=1))
    for reference in (True, False):
        own = [r for r in results if r["reference"] == reference]
        print(f"\n{'with' if reference else 'without'} the fit's own log, {len(own)} pairs, {sum(r['seconds'] for r in own):.0f} s")
        for name, part in (
            ("unchanged", [r for r in own if r["kind"] == "unchanged"]),
            ("changed", [r for r in own if r["kind"] != "unchanged"]),
        ):
            print(f"  {name}: " + ", ".join(f"{k} {v}" for k, v in Counter(r["count"] for r in part).most_common()))
    return int(any(r["count"] == "false" for r in results))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--short", action="store_true")
    parser.add_argument("--seeds", type=int, default=0, help="added to every seed")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--arms", nargs="*", default=[], help="puma560, scara, open (default: all)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    sys.exit(main(arguments.short, arguments.out, arguments.seeds, arguments.arms))
