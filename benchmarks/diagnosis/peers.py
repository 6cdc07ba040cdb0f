"""`python -m benchmarks.diagnosis.peers FOLDER RESULTS.jsonl`: other ways to find what a model lacks, on the same cases, by the same count.

Each is written as its field uses it, with our catalogue, our columns and our filters, so that only the way to decide differs:

- *stepwise*: least squares on the measured motion, forward by Schwarz's criterion over the whole catalogue;
- *best law*: for each joint the friction law with the least error on the last fifth of the data fitted (as servo models are chosen);
- *rules*: a fixed list tried in order on all joints at once, each kept if the validation error falls by a hundredth (as simulators are
  tuned).

RESULTS.jsonl holds what `benchmarks.diagnosis.run_cases` made of the same cases: ours."""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident import estimators as es
from ident.diagnosis.design.catalogue import Catalogue
from ident.diagnosis.inference.scores import Scores
from ident.errors import IdentError
from ident.instruments.fit import Fit
from ident.instruments.prepared import full_rate
from ident.instruments.rows import kept_hz, run_rows, usual_speed
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase

from .score import Loaded, load, read_cases

Array = np.ndarray
#: Effects that a stepwise search adds at most, and what an added law must save of a validation error.
_MOST, _SAVES = 5, 0.01
_VALIDATION = 0.2
Named = list[tuple[str, tuple[str, ...]]]


def stepwise(case: Loaded) -> Named:
    """Forward selection by least squares and Schwarz's criterion."""
    full, robot = full_rate(case.fit), case.arm.robot
    fit = Fit(run_rows(full, robot, np.full(robot.n, kept_hz(full.rate)), np.zeros(robot.n)), case.model)
    fit.solved(0)
    catalogue = Catalogue.of(fit, usual_speed(robot.transmission.motor_rate(full.dq)))
    accepted: list[Any] = []
    found: Named = []
    for _ in range(_MOST):
        fit = fit.with_effects(tuple(accepted))
        frame = fit.solved(0)
        # One weight for each motor: the inverse of what it leaves.
        size = np.sqrt(np.mean(frame.residual**2, axis=0))
        frame = fit.behind(tuple(g / np.where(size > 0, size, np.inf)[:, None] for g in frame.gains))
        catalogue = catalogue.at(fit)
        scores = Scores.of(fit, frame, catalogue)
        squares = np.add.reduceat(scores.total**2, scores.starts)
        gain = np.where(scores.named, squares - scores.degrees * np.log(frame.rows), -np.inf)
        k = int(np.argmax(gain))
        if gain[k] <= 0.0:
            break
        group = scores.group(k)
        assert group.effect is not None
        # Two forms of one effect may sit on the same joint: their parameters are kept apart by labels.
        accepted.append(replace(group.effect, label="+" * (len(accepted) + 1)))
        found.append(group.kind)
    return found


def best_law(case: Loaded) -> Named:
    """For each joint the friction law of the least validation error."""
    laws = ("stribeck", "load_dependent_friction", "nonlinear_viscous", "asymmetric_coulomb", "position_dependent_friction")
    train, validation = _halves(case)
    found: Named = []
    least = _errors(case.model, train, validation)
    for j, joint in enumerate(case.arm.robot.joint_names):
        options = {name: _errors(case.model + ident.make_effect(name, joints=[joint], label="+"), train, validation)[j] for name in laws}
        name = min(options, key=lambda key: options[key])
        if options[name] < (1.0 - _SAVES) * least[j]:
            found.append((name, (joint,)))
    return found


def rules(case: Loaded) -> Named:
    """A fixed list on all joints, each kept if the validation error falls."""
    train, validation = _halves(case)
    model, found = case.model, []
    least = float(np.sum(_errors(model, train, validation)))
    for name in ("offset", "stribeck", "delay", "load_dependent_friction"):
        wider = model + ident.make_effect(name, label="+")
        error = float(np.sum(_errors(wider, train, validation)))
        if error < (1.0 - _SAVES) * least:
            model, least = wider, error
            found += [(name, (joint,)) for joint in case.arm.robot.joint_names]
    return found


PEERS: dict[str, Callable[[Loaded], Named]] = {"stepwise": stepwise, "best law": best_law, "rules": rules}


def _halves(case: Loaded) -> tuple[Signals, Signals]:
    assert case.fit.source is not None
    logs = ident.LogSet(tuple(case.fit.source), robot=case.arm.robot)
    return tuple(ZeroPhase()(part) for part in logs.split(by="fraction", held=_VALIDATION))  # type: ignore[return-value]


def _errors(model: ident.Model, train: Signals, validation: Signals) -> Array:
    """Mean squares (n,) of the residual on validation data; infinite where it cannot be fitted."""
    try:
        residual = es.WeightedLeastSquares().solve(Problem(model, train)).residual(validation)
    except IdentError:
        return np.full(model.robot.n, np.inf)
    return np.asarray(np.nanmean(residual**2, axis=0))


def counted(records: Sequence[dict[str, Any]], named: dict[str, Named]) -> dict[str, str]:
    """The counts of one way: what it named on each case against the truth."""
    out: dict[str, str] = {}
    of = {kind: [r for r in records if r["kind"] == kind] for kind in ("clean", "single", "pair", "outside")}
    truth = {r["id"]: [(p["effect"], tuple(p["joints"])) for p in r["parts"]] for r in records}

    def same(a: tuple[str, tuple[str, ...]], b: tuple[str, tuple[str, ...]]) -> bool:
        return a[0] == b[0] and (not a[1] or not b[1] or set(a[1]) == set(b[1]))

    out["clean: named nothing"] = _of(sum(not named[r["id"]] for r in of["clean"]), of["clean"])
    first = [r for r in of["single"] if named[r["id"]] and same(named[r["id"]][0], truth[r["id"]][0])]
    out["one missing: first name right"] = _of(len(first), of["single"])
    out["... and alone"] = _of(sum(len(named[r["id"]]) == 1 for r in first), of["single"])
    out["... another name first"] = _of(sum(bool(named[r["id"]]) and r not in first for r in of["single"]), of["single"])
    both = [
        r for r in of["pair"]
        if len(named[r["id"]]) == 2 and all(any(same(a, b) for a in named[r["id"]]) for b in truth[r["id"]])
    ]  # fmt: skip
    out["two missing: both, and only both"] = _of(len(both), of["pair"])
    out["outside the catalogue: named nothing"] = _of(sum(not named[r["id"]] for r in of["outside"]), of["outside"])
    return out


def _of(count: int, cases: Sequence[object]) -> str:
    return f"{count} of {len(cases)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("results", type=Path)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    ours = {r["id"]: r for r in map(json.loads, args.results.read_text().splitlines()) if "failed" not in r}
    records = [r for r in read_cases(args.folder) if r["id"] in ours]
    # A name beside "unexplained" has less than half a confidence, and is no answer.
    told = {k: [] if r["verdict"] == "unexplained" else [(f["effect"], tuple(f["joints"])) for f in r["findings"]] for k, r in ours.items()}
    tables = {"ours": counted(records, told)}
    seconds = {"ours": float(np.median([r["seconds"] for r in ours.values()]))}
    for name, find in PEERS.items():
        named, spent = {}, []
        for record in records:
            case = load(args.folder, record)
            start = time.process_time()
            named[record["id"]] = find(case)
            spent.append(time.process_time() - start)
        tables[name], seconds[name] = counted(records, named), float(np.median(spent))
        print(f"{name}: done", flush=True)
    print(f"{len(records)} cases of {args.folder}\n")
    print(f"| | {' | '.join(tables)} |\n|---|{'---|' * len(tables)}")
    for key in tables["ours"]:
        print(f"| {key} | {' | '.join(t[key] for t in tables.values())} |")
    print(f"| median seconds of one core | {' | '.join(f'{seconds[name]:.1f}' for name in tables)} |")


if __name__ == "__main__":
    main()
