"""200 random problems with fixed seeds: is the motion safe by a check of its own, within its limits, and what did safety cost?"""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident.errors import ConfigurationError
from ident.excitation import Clearance, DOptimality

from .check import Checker
from .problems import ARMS, ExcitationProblem, problem

Row = dict[str, Any]
COUNT, SHORT = 200, 8
#: Steps of each search at a level of its barrier; the same with and without surroundings.
ITERATIONS = 8
#: Limits hold to this; walls to what is promised between samples (m); share of the log-determinant that safety may cost, and the share of
#: random postures that must be clear for there to be space.
EXACT, BETWEEN, COST, SPACE = 1e-9, 1e-4, 0.15, 0.25
#: Differences of positions and speeds equal means of their derivatives to this (rad, rad/s): a jump of the jerk by 800 rad/s^3 at 1 kHz.
CONSISTENT = 1e-4


def solve(own: ExcitationProblem) -> Row:
    """One problem: refused with a reason, or designed and checked, and designed without surroundings."""
    row: Row = {"number": own.number, "arm": own.arm}
    settings = {"measure": DOptimality(), "starts": 1, "iterations": ITERATIONS, "rate": 1000.0, "seed": own.number}
    start = time.process_time()
    try:
        found = ident.excite(own.model, surroundings=own.room, present=own.present, **own.asked, **settings)
    except ConfigurationError as error:
        return {**row, "refused": str(error), "seconds": time.process_time() - start}
    row |= {"seconds": time.process_time() - start, "clearance": own.room.clearance}
    checker = Checker(own.arm, own.model.robot, own.room, own.box)
    row |= checker.verdict(found.to_frame(), widened(own), own.drive)
    row["only_apart"] = found.safety is not None and any("ground" in what or "wall" in what for what in found.safety.touching)
    row["certified"] = found.safety is not None and found.safety.certified
    row["approach"] = found.approach is not None
    row["posture_missed"] = 0.0 if own.posture is None else float(np.abs(found.trajectory.sample(np.zeros(1)).q[0] - own.posture).max())
    row |= {"logdet": logdet(found), "logdet_free": np.nan, "parameters": len(found.names), "space": space(own)}
    try:
        row["logdet_free"] = logdet(ident.excite(own.model, **own.asked, **settings))
    except ConfigurationError as error:
        row["no_comparison"] = str(error)
    return row


def logdet(found: ident.excitation.Excitation) -> float:
    """Log-determinant of the information."""
    return float(np.linalg.slogdet(found.information)[1])


def widened(own: ExcitationProblem) -> ident.excitation.Limits:
    """The limits, and for the approach the present posture, which lies where it lies."""
    limits = own.limits
    if own.present is None:
        return limits
    lower, upper = np.minimum(limits.lower, own.present), np.maximum(limits.upper, own.present)
    return ident.excitation.Limits(lower, upper, limits.velocity, limits.acceleration, limits.torque, limits.jerk)


def space(own: ExcitationProblem) -> float:
    """Share of random postures within the limits that keep clear."""
    rng = np.random.default_rng(0)
    q = rng.uniform(own.limits.lower, own.limits.upper, (1000, own.limits.n))
    clearance = Clearance(own.model.robot, own.room, own.limits)
    return float(np.mean((clearance.slack(q, 0.01) > 0.0).all(axis=1)))


def lines(rows: list[Row]) -> list[str]:
    """The table."""
    head = ("problems", "refused", "samples", "touching", "outside", "limits", "cost med", "cost max", "s med")
    out = [f"{'arm':<16}" + "".join(f"{name:>10}" for name in head)]
    for arm in (*ARMS, "all"):
        own = [r for r in rows if arm in (r["arm"], "all")]
        made = [r for r in own if "refused" not in r]
        if not made:
            continue
        cost = 100 * np.array([price(r) for r in made if "no_comparison" not in r])
        counts = (len(own), len(own) - len(made), *(sum(int(r[key]) for r in made) for key in ("samples", "touching")))
        faults = (sum(outside(r) for r in made), sum(worst(r) > EXACT for r in made))
        seconds = np.median([r["seconds"] for r in made])
        out.append(
            f"{arm:<16}" + "".join(f"{x:>10}" for x in (*counts, *faults)) + f"{np.median(cost):>9.1f}%{cost.max():>9.1f}%{seconds:>10.1f}"
        )
    made = [r for r in rows if "refused" not in r]
    compared = [r for r in made if "no_comparison" not in r]
    roomy = [r for r in compared if r["space"] >= SPACE]
    within = [sum(price(r) <= COST for r in x) for x in (roomy, compared)]
    least = 1000 * min(r["room"] for r in made)
    whole, way = (sum(bool(r[key]) for r in made) for key in ("certified", "approach"))
    wider = [np.exp(0.5 * (r["logdet_free"] - r["logdet"]) / r["parameters"]) for r in compared]
    out += [
        f"a quarter of random postures is clear: {len(roomy)} designs, of which within 15 % of the log-determinant {within[0]}",
        f"all {len(compared)} designs that have one without surroundings to compare with, of which within 15 % {within[1]}",
        f"largest excess of a limit {max(worst(r) for r in made):.1e}; least room beyond the clearance {least:.2f} mm",
        f"shown clear between samples too: {whole}; with an approach: {way}",
        f"standard deviations over those without surroundings, geometric mean: {np.median(wider):.2f} (median), {max(wider):.2f} (most)",
    ]
    for reason, count in Counter(str(r["refused"])[:72] for r in rows if "refused" in r).most_common():
        out.append(f"refused {count} times: {reason} …")
    return out


def price(row: Row) -> float:
    """Share of the log-determinant without surroundings that is lost to them."""
    return (row["logdet_free"] - row["logdet"]) / abs(row["logdet_free"])


def outside(row: Row) -> bool:
    """Whether the motion comes nearer to ground or walls than was promised: the clearance, or no contact where it is said that a link is
    never that far apart from them."""
    allowed = row["clearance"] if row.get("only_apart") else 0.0
    return bool(row["room"] < -BETWEEN - allowed)


def worst(row: Row) -> float:
    """By how much the worst limit is exceeded."""
    return max(x for key, x in row.items() if key.startswith("over_"))


def main(short: bool, folder: Path, first: int = 0) -> int:
    """Run the problems; 1 where a motion touches something, leaves its room or exceeds a limit."""
    rows = []
    file = folder / "excitation.jsonl"
    with tempfile.TemporaryDirectory() as scratch, file.open("w") as kept:
        for number in range(first, first + (SHORT if short else COUNT)):
            rows.append(solve(problem(number, Path(scratch))))
            kept.write(json.dumps(rows[-1], default=float) + "\n")
            kept.flush()
    print("\n".join(lines(rows)))
    made = [r for r in rows if "refused" not in r]
    bad = [r for r in made if r["touching"] or outside(r) or worst(r) > EXACT or r["still"] > 1e-8 or r["consistent"] > CONSISTENT]
    for r in bad:
        print("FAILED", json.dumps(r, default=float))
    return int(bool(bad))
