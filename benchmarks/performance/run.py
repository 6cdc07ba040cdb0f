"""Targets of the fast core against what is measured here, in one run: kernel, simulation step, import."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import ident
from ident.controller import Script
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.simulate import Plant

from .kernel import best, floating_table, machine, puma_table, show

#: Microseconds a sample or step; import in seconds.
_TARGETS = {"Gram": 0.2, "QR-grade": 0.4, "step, single": 1.5, "step, batch of 8": 0.4, "floating": 8.0, "import": 0.5}


def main(short: bool, folder: Path) -> int:
    """Print measured value, target and their ratio; write `performance.json`. A missed target is no failure: timings depend on load."""
    about = machine()
    print("  ".join(f"{k}: {v:.1f}" if isinstance(v, float) else f"{k}: {v}" for k, v in about.items()))
    puma = puma_table(4096 if short else 8192)
    show("PUMA 560, 52 parameters, one thread (us a sample)", [{**r, "ratio": r["their_us"] / r["us"]} for r in puma])
    found = {"Gram": puma[1]["us"], "QR-grade": puma[2]["us"]}
    found |= {"step, single": step_time(1), "step, batch of 8": step_time(8)}
    for row in floating_table(1024 if short else 8192):
        found["floating"] = row["gram_us"]
    found["import"] = import_time()
    table = [{"work": k, "measured": v, "target": _TARGETS[k], "measured / target": v / _TARGETS[k]} for k, v in found.items()]
    show("targets", table)
    text = json.dumps({"schema": "ident.benchmark.performance/1", "machine": about, "targets": table, "puma": puma}, indent=1)
    (folder / "performance.json").write_text(text)
    return 0


def step_time(lanes: int) -> float:
    """Microseconds of a Runge-Kutta step of one run, dry friction in the model, no reversal on the way; NaN without the compiled kernel."""
    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    dynamics = Plant(model, nominal_values(model)).dynamics()
    if dynamics.compiled is None:
        return float("nan")
    compiled, periods, substeps = dynamics.compiled, 20, 100
    script = Script(robot.transmission.measured, np.zeros((periods, lanes, robot.n)))
    speed = np.tile(robot.transmission.joint_rate(np.full(robot.n, 30.0)), (lanes, 1))
    state = dynamics.start(np.zeros(lanes), np.zeros((lanes, robot.n)), speed)
    steps = lanes * periods * substeps
    return best(lambda: compiled.run(script, state, None, period=1e-6 * substeps, substeps=substeps), steps, budget=0.5)


def import_time() -> float:
    """Seconds of `import ident` in a new process beyond those of an empty one, best of three."""

    def once(code: str) -> float:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        return time.perf_counter() - start

    return min(once("import ident") for _ in range(3)) - min(once("pass") for _ in range(3))
