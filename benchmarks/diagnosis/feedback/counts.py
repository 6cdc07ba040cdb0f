"""`python -m benchmarks.diagnosis.feedback.counts [--seeds N] [--out FILE]`: verdicts under feedback, on seeds fixed beforehand.

Logs with nothing to find, and logs that lack one effect of a size around what can be seen. Each is fitted, diagnosed on its own data,
and its errors are of a second log that no choice saw."""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import ident

from .world import Case, geared, motion_of, puma, simulated

Array = np.ndarray
FIRST_SEED = 7000


def arms() -> Iterator[tuple[str, ident.Robot, dict[str, Array], float, float]]:
    """Name, robot, drive, seconds and rate of a log."""
    yield "puma560", *puma(), 38.0, 500.0
    yield "ur5", *geared("ur5", 100.0), 30.0, 250.0
    yield "panda", *geared("panda", 100.0), 30.0, 250.0
    yield "scara", *geared("scara", 50.0), 30.0, 500.0


def faults(robot: ident.Robot, drive: dict[str, Array]) -> Iterator[tuple[str, ident.Effect, Array]]:
    """An effect of each kind on a joint that moves well, with values in units of what the joint has."""
    n = robot.n
    c = motion_of(robot, 1, 30.0).sample(np.linspace(0.0, 30.0, 1500))
    speed = np.quantile(np.abs(robot.transmission.motor_rate(c.dq)), 0.98, axis=0)
    names = robot.joint_names
    dry = drive["Fc"]

    def made(name: str, j: int, sizes: list[float], **shape: float) -> tuple[str, ident.Effect, Array]:
        return name, ident.make_effect(name, joints=[names[j % n]], label="+", **shape), np.array(sizes)

    yield made("offset", 3, [0.5 * dry[3 % n]])
    yield made("stribeck", 1, [0.6 * dry[1]], v_s=0.05 * speed[1])
    yield made("load_dependent_friction", 2, [0.15])
    yield made("cogging", 0, [0.4 * dry[0], 0.1 * dry[0]], order=6.0)
    yield made("offset_drift", 1, [0.03 * dry[1]])
    yield made("nonlinear_viscous", 2, [0.8 * dry[2] / speed[2] ** 2], a=2.0)


def cases(seeds: list[int], kinds: tuple[str, ...]) -> Iterator[tuple[str, Case]]:
    for name, robot, drive, seconds, rate in arms():
        if "clean" in kinds:
            for case in simulated(robot, drive, [], seeds, seconds=seconds, rate=rate):
                yield f"{name}: clean", case
        if "single" in kinds:
            for k, (kind, effect, values) in enumerate(faults(robot, drive)):
                own = [seed + 100 * (k + 1) for seed in seeds[: max(1, len(seeds) // 4)]]
                for case in simulated(robot, drive, [(effect, values)], own, seconds=seconds, rate=rate):
                    yield f"{name}: {kind}", case


def judged(label: str, case: Case) -> dict[str, object]:
    """One diagnosis, and what is right about it."""
    before = ident.fit(case.log, case.robot, model=case.model, held=0)
    held = ident.ZeroPhase()(case.held, case.robot)
    start = time.process_time()
    found = ident.diagnose(before, held)
    true = [(e.name, e.joints) for e in case.missing]
    named = [(f.name, f.joints) for f in found.findings]
    return {
        "label": label, "verdict": found.verdict.value, "named": [f"{n} {'/'.join(j)}" for n, j in named], "first": named[:1] == true[:1],
        "alone": named == true, "confident": [f.confidence >= 0.5 for f in found.findings], "band": found.instrument.band_hz,
        "seconds": time.process_time() - start, "before": found.comparison.error_before.relative_all,
        "after": found.comparison.error_after.relative_all,
    }  # fmt: skip


def table(results: list[dict[str, object]]) -> str:
    clean = [r for r in results if str(r["label"]).endswith("clean")]
    single = [r for r in results if r not in clean]
    wrong = [r for r in single if r["named"] and not r["first"]]
    of_clean = (
        f"clean logs: {sum(r['verdict'] == 'clean' for r in clean)} of {len(clean)} clean;"
        f" named something: {sum(bool(r['named']) for r in clean)};"
        f" unexplained without a name: {sum(r['verdict'] == 'unexplained' and not r['named'] for r in clean)};"
        f" median {_median(clean):.1f} s of one core"
    )
    of_single = (
        f"one effect missing: first finding right {sum(bool(r['first']) for r in single)} of {len(single)};"
        f" right and alone {sum(bool(r['alone']) for r in single)}; another name first {len(wrong)};"
        f" not seen {sum(not r['named'] for r in single)}; median {_median(single):.1f} s"
    )
    lines = [of_clean, of_single]
    kinds = Counter(str(r["label"]).split(": ")[1] for r in single)
    for kind, total in kinds.items():
        own = [r for r in single if str(r["label"]).endswith(kind)]
        lines.append(
            f"  {kind:<26} first {sum(bool(r['first']) for r in own)} of {total}; verdicts {dict(Counter(r['verdict'] for r in own))}"
        )
    return "\n".join(lines)


def _median(results: list[dict[str, object]]) -> float:
    """Seconds of one core."""
    return float(np.median([float(str(r["seconds"])) for r in results])) if results else float("nan")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8, help="logs of each arm with nothing to find; a quarter as many of each effect")
    parser.add_argument("--kinds", nargs="+", default=["clean", "single"], choices=["clean", "single"])
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    results = []
    for label, case in cases([FIRST_SEED + k for k in range(args.seeds)], tuple(args.kinds)):
        results.append(judged(label, case))
        r = results[-1]
        print(f"{label:<34} {r['verdict']:<12} {', '.join(r['named']) or '-':<50} {r['seconds']:.1f} s", flush=True)  # type: ignore[arg-type]
        if args.out is not None:
            args.out.write_text(json.dumps(results, indent=1))
    print(table(results))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
