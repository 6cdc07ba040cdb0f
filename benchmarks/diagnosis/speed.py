"""What a diagnosis costs: `python -m benchmarks.diagnosis.speed FOLDER`.

Four logs of a PUMA 560 under feedback, six joints, 60 s at 500 Hz, full catalogue: nothing missing, one effect, two, and what has no name.
Each is diagnosed in a process of its own, on one core, after the libraries have been loaded; the logs stay in FOLDER."""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import ident

from .feedback.world import puma, simulated
from .tables import table

Array = np.ndarray
#: Seconds of processor time, megabytes, and times the fit of a clean log that are asked for.
SECONDS = {"clean": 5.0, "one": 10.0, "two": 25.0, "no name": 25.0}
MEGABYTES, TIMES = 500.0, 20.0
_SEED, _LENGTH, _RATE = 8800, 60.0, 500.0


def measured(folder: Path) -> list[dict[str, Any]]:
    """What each log costs."""
    folder.mkdir(parents=True, exist_ok=True)
    for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(key, "1")
    found = []
    for kind in SECONDS:
        file = folder / f"{kind}.npz"
        if not file.exists():
            _simulate(kind, file)
        # New interpreters: peak memory is that of one diagnosis.
        with ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn")) as pool:
            found.append({"kind": kind, **pool.submit(diagnosed, file).result()})
    (folder / "speed.json").write_text(json.dumps(found, indent=1))
    return found


def diagnosed(file: Path) -> dict[str, Any]:
    """Verdict, processor time and peak memory (MB) of the diagnosis of a log, and time of its fit."""
    import scipy.signal
    import scipy.stats  # noqa: F401 - loaded before the clock starts

    robot, _ = puma()
    with np.load(file) as data:
        log, held = (
            ident.Log(name, t=data["t"], q=data[f"q_{name}"], tau={robot.transmission.measured.value: data[f"tau_{name}"]})
            for name in ("fit", "held")
        )
    start = time.process_time()
    before = ident.fit(log, robot, held=0)
    fit = time.process_time() - start
    late = ident.ZeroPhase()(held, robot)
    start = time.process_time()
    found = ident.diagnose(before, late)
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    named = [" ".join((f.name, *f.joints)) for f in found.findings]
    return {"verdict": found.verdict.value, "named": named, "seconds": seconds, "fit_seconds": fit, "megabytes": peak}


def _simulate(kind: str, file: Path) -> None:
    robot, drive = puma()
    names, dry = robot.joint_names, drive["Fc"]
    offset = (ident.make_effect("offset", joints=[names[1]], label="+"), np.array([0.5 * dry[1]]))
    cogged = (ident.make_effect("cogging", joints=[names[0]], label="+", order=6.0), dry[0] * np.array([0.4, 0.1]))
    missing = {"one": [offset], "two": [offset, cogged]}.get(kind, [])
    (case,) = simulated(robot, drive, missing, [_SEED], seconds=_LENGTH, rate=_RATE)
    arrays = {"t": case.log.t}
    for name, log in (("fit", case.log), ("held", case.held)):
        q, tau = np.asarray(log.q), log.tau[robot.transmission.measured.value]
        if kind == "no name":
            # Friction of one joint that the positions of two others change.
            speed = np.gradient(robot.transmission.motor_position(q)[:, 1], log.t)
            tau[:, 1] += 1.5 * dry[1] * np.sin(3.0 * q[:, 0]) * np.sin(2.0 * q[:, 2]) * np.tanh(speed / 2.0)
        arrays |= {f"q_{name}": q, f"tau_{name}": tau}
    np.savez(file, **arrays)  # type: ignore[arg-type]


def told(found: list[dict[str, Any]]) -> str:
    """A table with what is asked for."""
    head = ["log", "verdict", "named", "s", "asked", "MB", "asked", "times the fit", "asked"]
    rows = [
        [r["kind"], r["verdict"], ", ".join(r["named"]), f"{r['seconds']:.1f}", f"{SECONDS[r['kind']]:g}", f"{r['megabytes']:.0f}",
         f"{MEGABYTES:g}", f"{r['seconds'] / r['fit_seconds']:.0f}", f"{TIMES:g}" if r["kind"] == "clean" else ""]
        for r in found
    ]  # fmt: skip
    return table(head, rows)


def met(found: list[dict[str, Any]]) -> bool:
    """Whether time and memory are what is asked for."""
    in_time = all(r["seconds"] <= SECONDS[r["kind"]] and r["megabytes"] <= MEGABYTES for r in found)
    return in_time and all(r["seconds"] <= TIMES * r["fit_seconds"] for r in found if r["kind"] == "clean")


if __name__ == "__main__":
    print(told(measured(Path(sys.argv[1]))))
