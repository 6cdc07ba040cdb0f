"""The tables as text. Everything in them comes from the trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .convergence import CONVERGED, Growth
from .data import Data
from .degradation import Sweep
from .methods import METHODS
from .monte_carlo import Trials
from .recursions import Recursion
from .trajectories import Forward
from .world import World


def number(x: float, digits: int = 3) -> str:
    """A number of so many significant digits; a dash where there is none."""
    if x is None or np.isnan(x):
        return "-"
    if np.isinf(x):
        return "diverged"
    return f"{x:.{digits}g}" if abs(x) < 1e4 else f"{x:.1e}"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns under their heads, the first one flush left."""
    width = [max(len(str(row[i])) for row in [head, *rows]) for i in range(len(head))]
    lines = []
    for row in [head, *rows]:
        first, *rest = (str(x) for x in row)
        lines.append("  ".join([first.ljust(width[0]), *(x.rjust(w) for x, w in zip(rest, width[1:], strict=True))]))
    return "\n".join(lines)


def error_table(trials: Mapping[str, Trials], groups: Mapping[str, Sequence[int]]) -> str:
    """Rms error of every group over the Cramér-Rao bound."""
    rows = [
        [t.method.title, *(number(t.error(g)) for g in groups.values()), number(t.error())] if t.usable else _failed(t, len(groups) + 1)
        for t in trials.values()
    ]
    return table(["rms error / bound", *groups, "all"], rows)


def bias_table(trials: Mapping[str, Trials], groups: Mapping[str, Sequence[int]]) -> str:
    """Bias of every group over the bound (scatter taken off), and coverage of 95 % intervals."""
    rows = [
        [t.method.title, *(number(t.bias(g)) for g in groups.values()), number(100 * t.coverage())]
        if t.usable
        else _failed(t, len(groups) + 1)
        for t in trials.values()
    ]
    return table(["bias / bound", *groups, "coverage %"], rows)


def _failed(trials: Trials, columns: int) -> list[str]:
    return [trials.method.title, *["failed"] * columns]


def summary_table(data: Data, trials: Mapping[str, Trials], forward: Mapping[str, Forward], growths: Mapping[str, Growth]) -> str:
    """Torque error, forward-simulated error, data needed, labour, computing time."""
    rows = []
    true = forward.get("truth")
    if true is not None:
        rows.append([true.title, "0", number(true.degrees), number(100 * true.diverged), "", "", "", ""])
    for key, t in trials.items():
        if not t.usable:
            rows.append(_failed(t, 7))
            continue
        errors = [data.torque_measure(e) for e in t.values - t.truth]
        motion = forward.get(key)
        samples, labour = effort(data, key)
        grown = growths.get(key)
        needed = "" if grown is None else ("never" if grown.converged_at is None else f"{grown.converged_at}")
        rows.append([
            t.method.title, number(100 * float(np.median(errors))), number(motion.degrees) if motion else "",
            number(100 * motion.diverged) if motion else "", f"{samples}", needed, labour, number(float(np.median(t.seconds)), 2),
        ])  # fmt: skip
    head = [
        "",
        "torque error %",
        "motion error deg",
        "diverged %",
        "samples",
        f"for {100 * CONVERGED:g} %",
        "set-ups, seconds",
        "computing s",
    ]
    return table(head, rows)


def statuses(trials: Mapping[str, Trials]) -> str:
    """Which methods warned of their own result, on how many seeds."""
    found = []
    for t in trials.values():
        warned = [status for status in t.statuses if status != "ok"]
        found += [f"{t.method.title}: {kind} on {warned.count(kind)} of {len(t.statuses)} seeds" for kind in sorted(set(warned))]
        found += [f"{t.method.title}: no estimate on {len(t.failures)} seeds ({t.failures[0][1]})"] if t.failures else []
    return "status other than ok: " + ("; ".join(found) or "none")


def effort(data: Data, key: str) -> tuple[int, str]:
    """Samples that a method uses, and the tests that have to be set up for them with the seconds they last."""
    rate = data.world.rate
    if METHODS[key].family == "step by step":
        plan = data.tests["few" if key.startswith("steps_few") else "safe"].plan
        setups = sum(len(test.postures) for test in plan.tests)
        return round(plan.duration * rate), f"{len(plan.tests)} tests at {setups} postures, {plan.duration:.0f}"
    seconds = data.scale.lanes * data.scale.seconds
    return round(seconds * rate), f"1 motion, {seconds:.0f}"


def recursion_table(recursions: Mapping[str, Recursion]) -> str:
    """End value of the recursion against the batch solution and the truth."""
    rows = []
    for r in recursions.values():
        for name in ("Izz_joint1", "Izz_joint3", "Izz_joint5"):
            i = r.names.index(name)
            rows.append([
                f"{r.title}, {name}", f"{r.instants}", f"{r.end[i]:.10g}", f"{r.batch[i]:.10g}", f"{r.truth[i]:.6g}",
                f"{r.difference:.1e}", f"{r.difference_relative:.1e}", number(r.seconds, 2), number(r.batch_seconds, 2),
            ])  # fmt: skip
    head = ["recursion", "samples", "end value", "batch", "truth", "largest gap / std", "relative", "recursion s", "batch s"]
    return table(head, rows)


def sweep_table(sweep: Sweep) -> str:
    """Torque error of methods against one quantity."""
    head = [f"torque error %, {sweep.title}" + (f" ({sweep.unit})" if sweep.unit else ""), *(f"{v:g}" for v in sweep.values)]
    return table(head, [[METHODS[key].title, *(number(100 * e) for e in errors)] for key, errors in sweep.errors.items()])


def world_text(world: World) -> str:
    """What was simulated."""
    noise = ", ".join(f"{1e3 * x:.2g}" for x in world.noise)
    return (
        f"PUMA 560, {world.model.base.count} base parameters, true values: the consistent robot nearest to the published ones;"
        f" {world.rate:g} Hz, {world.counts:g} encoder counts a motor turn, white torque noise of {noise} mN m (2 % of rms torque)"
    )
