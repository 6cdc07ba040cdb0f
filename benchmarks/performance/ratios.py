"""Ratios of works that belong together, against those recorded last: `python -m benchmarks performance --short`.

Times depend on machine and load; the ratio of two works that take turns in one run depends on neither much. Each is the least time of one
work over the least time of the other, and one that is too large is measured anew before it counts. A ratio more than a quarter above
what was recorded on the same kind of processor is a regression, and the exit code is 1. What is recorded for another kind only is
shown beside it.

    python -m benchmarks.performance.ratios --record     keep the ratios of this machine"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ident.estimate.feedforward import FixedModel
from ident.estimators import InstrumentalVariable, RecursiveLeastSquares
from ident.logs.readers.header import Header
from ident.physical import judge
from ident.streaming.ingest import Reading
from ident.streaming.text import TextParser

from .cases import Case, chain, noisy_subject, puma
from .estimation import PlainIteration, pass_of, raw_problem, step_work
from .limits import products
from .make_large_log import Puma, write
from .startup import process
from .timing import Work, children_clock, dgemm, in_turn, native, processor

#: What a ratio may grow by.
LIMIT = 1.25
_RECORD = Path(__file__).with_name("ratios.json")
_TURNS, _AGAIN = 5, 3


@dataclass(frozen=True)
class Group:
    """Works that take turns, and pairs of them: name -> (work, what it is compared to)."""

    works: Mapping[str, Work]
    pairs: Mapping[str, tuple[str, str]]

    def measured(self, rounds: int = _TURNS) -> dict[str, float]:
        """The ratios of one run."""
        least = {name: min(turns) for name, turns in in_turn(self.works, rounds, 0.0).items()}
        return {name: least[one] / least[other] for name, (one, other) in self.pairs.items()}


def _information() -> Group:
    case, few = puma(4096), 300
    arm = Case(chain(30), 1024, drives=60)
    operations = {"operations of 6 joints": (case, 4096), "operations of 30 joints": (arm, 1024)}
    return Group(
        {
            "Gram": Work(lambda: case.information("gram"), 4096),
            "QR-grade": Work(lambda: case.information("triangle"), 4096),
            "loop": Work(case.loop("regressor", few), few),
            "30 joints": Work(lambda: arm.information("gram"), 1024),
            **{name: _scaled(dgemm(), products(c) / 1e6) for name, (c, _) in operations.items()},
        },
        {
            "information of the PUMA / dgemm of its operations": ("Gram", "operations of 6 joints"),
            "information of 30 joints / dgemm of its operations": ("30 joints", "operations of 30 joints"),
            "QR-grade / Gram": ("QR-grade", "Gram"),
            "information / Pinocchio's loop of the regressor": ("Gram", "loop"),
        },
    )


def _scaled(work: Work, units: float) -> Work:
    """The same work counted in other units, of `units` of its own each."""
    return Work(work.call, work.count / units, work.clock)  # type: ignore[arg-type]


def _instruments() -> Group:
    robot, samples = Puma(1), 16_384
    q, dq, ddq, tau = robot.motion(np.arange(samples) / 200.0)
    tau = tau + robot.noise * np.random.default_rng(0).normal(size=tau.shape)
    problem, method = raw_problem(robot, q, tau), InstrumentalVariable(iterations=2)
    return Group(
        {
            "plain": Work(PlainIteration(robot, (q, dq, ddq), tau), 1),
            "pass": Work(pass_of(robot, (q, dq, ddq), tau), 1),
            "iv": Work(lambda: method.solve(problem), 1),
        },
        {"plain IV iteration / information pass": ("plain", "pass"), "method 'iv' / plain IV iteration": ("iv", "plain")},
    )


def _live() -> Group:
    robot, count = Puma(1), 400
    q, dq, ddq, tau = robot.motion(np.arange(count) / 200.0)
    live = RecursiveLeastSquares(noise_std=tuple(robot.noise)).start(robot.model).live()
    fixed, model = FixedModel(robot.model, robot.values), robot.robot.model
    data = model.createData()

    def each(call: Callable[..., Any], *arrays: np.ndarray) -> Work:
        return Work(lambda: [call(*state) for state in zip(*arrays, strict=True)], count)

    return Group(
        {
            "add": each(live.add, q, dq, ddq, tau),
            "feedforward": each(fixed.torque, q, dq, ddq),
            "forward": each(fixed.acceleration, q, dq, tau),
            "rnea": each(lambda *x: pin.rnea(model, data, *x), q, dq, ddq),
            "aba": each(lambda *x: pin.aba(model, data, *x), q, dq, tau),
            "step": step_work(8),
            "states": Work(lambda: fixed.acceleration(q, dq, tau), count),
        },
        {
            "live sample / pin.rnea": ("add", "rnea"),
            "feedforward / pin.rnea": ("feedforward", "rnea"),
            "forward dynamics / pin.aba": ("forward", "aba"),
            "simulation step of eight runs / forward dynamics in a batch": ("step", "states"),
        },
    )


def _reading() -> Group:
    from pyarrow import BufferReader, csv

    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        path = Path(name) / "log.csv"
        write(path, 20_000)
        header, plan = Reading(Puma(1).robot).plan(path)
        text = path.read_bytes()
    assert isinstance(header, Header)
    lines = memoryview(text)[text.index(b"\n") + 1 :]
    options = csv.ReadOptions(use_threads=False)
    return Group(
        {
            "ours": Work(lambda: TextParser(path, header, plan)(lines), 1),
            "pyarrow": Work(lambda: csv.read_csv(BufferReader(text), read_options=options), 1),
        },
        {"text of a log to arrays / pyarrow": ("ours", "pyarrow")},
    )


def _calls() -> Group:
    subject = noisy_subject(8)
    a, b = np.random.default_rng(0).normal(size=(2, 6))
    return Group(
        {"judge": Work(lambda: judge(subject), 1), "calls": Work(lambda: [np.maximum(a * b, a) for _ in range(20_000)], 1)},
        {"judgement of 8 joints / 40,000 calls of NumPy": ("judge", "calls")},
    )


def _processes() -> Group:
    def run(*arguments: str) -> Work:
        return Work(lambda: process([*arguments]), 1, children_clock)

    return Group(
        {"help": run("-m", "ident", "--help"), "import": run("-c", "import ident"), "empty": run("-c", "pass")},
        {"ident --help / an empty process": ("help", "empty"), "import ident / an empty process": ("import", "empty")},
    )


GROUPS = (_information, _instruments, _live, _reading, _calls, _processes)


def machine_key() -> str:
    """The kind of processor and kernel that ratios belong to."""
    about, module = processor(), native()
    kind = " ".join(about[k] for k in ("vendor_id", "cpu family", "model") if about[k]) or about["model name"]
    return f"{kind}, {module.instruction_sets()[-1] if module else 'numpy'}"


def recorded(path: Path = _RECORD) -> dict[str, dict[str, Any]]:
    """Machine -> day and ratios."""
    return dict(json.loads(path.read_text())) if path.exists() else {}


def compared(groups: list[Group], wanted: Mapping[str, float], again: int = _AGAIN) -> dict[str, float]:
    """The ratios of all groups; a group with one that is too large is measured anew, and of each ratio the least counts."""
    found: dict[str, float] = {}
    for group in groups:
        ratios = group.measured()
        for _ in range(again):
            if not any(beyond(value, wanted.get(name)) for name, value in ratios.items()):
                break
            more = group.measured()
            ratios = {name: min(value, more[name]) for name, value in ratios.items()}
        found |= ratios
    return found


def beyond(value: float, wanted: float | None) -> bool:
    """Whether a ratio is a regression."""
    return wanted is not None and value > LIMIT * wanted


def check(record: Path = _RECORD) -> int:
    """Measure, print and compare; 1 where a ratio is a regression."""
    key, known, start = machine_key(), recorded(record), time.perf_counter()
    mine = known.get(key, {}).get("ratios", {})
    kernel = key.rsplit(", ", 1)[-1]
    nearest = next((k for k in reversed(known) if k.endswith(kernel)), next(reversed(known), ""))
    shown = mine or known.get(nearest, {}).get("ratios", {})
    source = f"of {known[key]['recorded']}" if mine else f"of another machine ({nearest}); nothing fails"
    print(f"ratios on {key}, load {os.getloadavg()[0]:.1f}; recorded {source if shown else 'nowhere'}")
    found = compared([make() for make in GROUPS], mine)
    worse = [name for name, value in found.items() if beyond(value, mine.get(name))]
    for name, value in found.items():
        beside = f", recorded {shown[name]:.4g}" if name in shown else ", not recorded"
        print(f"  {name}: {value:.4g}{beside}" + (f": more than {LIMIT - 1:.0%} worse" if name in worse else ""))
    print(f"{len(worse)} of {len(found)} ratios are regressions; {time.perf_counter() - start:.0f} s")
    return int(bool(worse))


def keep(record: Path = _RECORD) -> None:
    """Record the ratios of this machine: of three runs the median."""
    runs = [compared([make() for make in GROUPS], {}) for _ in range(3)]
    ratios = {name: float(f"{np.median([run[name] for run in runs]):.4g}") for name in runs[0]}
    known = {k: v for k, v in recorded(record).items() if k != machine_key()}
    known[machine_key()] = {"recorded": datetime.now(UTC).date().isoformat(), "ratios": ratios}
    record.write_text(json.dumps(known, indent=1) + "\n")
    print(json.dumps(known[machine_key()], indent=1))


def main() -> int:
    """Check, or record."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.performance.ratios", description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("--record", action="store_true", help="keep the ratios of this machine instead of comparing them")
    if parser.parse_args().record:
        keep()
        return 0
    return check()


if __name__ == "__main__":
    sys.exit(main())
