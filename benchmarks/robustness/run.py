"""Load: rows, files, gaps, joints and columns, each twice as many again; and several runs that write to one folder."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ident

Array = np.ndarray
RATE = 100.0
#: What is measured: (few, many), and in short runs of continuous integration a tenth of both.
SIZES = {"rows": (500_000, 1_000_000), "files": (500, 1_000), "gaps": (50_000, 100_000), "joints": (30, 60), "columns": (15_000, 30_000)}


def urdf(n: int) -> str:
    """A chain of n joints, the axes turned by a right angle from one to the next."""
    link = (
        '<link name="l{i}"><inertial><origin xyz="0.05 0.02 0.1"/><mass value="1"/>'
        '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>'
    )
    joint = (
        '<joint name="j{i}" type="revolute"><parent link="l{p}"/><child link="l{i}"/><origin xyz="0.1 0 0.2" rpy="{r} 0 0"/>'
        '<axis xyz="0 0 1"/></joint>'
    )
    links = "".join(link.format(i=i) for i in range(1, n + 1))
    joints = "".join(joint.format(i=i, p=i - 1, r="0" if i == 1 else "1.5708") for i in range(1, n + 1))
    return f'<robot name="chain"><link name="l0"/>{links}{joints}</robot>'


def motion(rows: int, n: int) -> tuple[Array, Array, Array]:
    t = np.arange(rows) / RATE
    w = 1.0 + 0.37 * np.arange(n)
    q = 0.8 * np.sin(np.outer(t, w) + np.arange(n)) + 0.3 * np.sin(np.outer(t, 1.7 * w))
    tau = 2.0 * np.cos(np.outer(t, 1.3 * w)) + 0.01 * np.random.default_rng(0).normal(size=(rows, n))
    return t, q, tau


def table(path: Path, t: Array, q: Array, tau: Array, more: int = 0) -> Path:
    """A log as CSV, with so many columns that nothing needs."""
    n = q.shape[1]
    names = ["t", *(f"q{j + 1}" for j in range(n)), *(f"tau{j + 1}" for j in range(n)), *(f"c{k}" for k in range(more))]
    values = np.column_stack([t, q, tau, np.zeros((len(t), more))])
    np.savetxt(path, values, fmt="%.9g", delimiter=",", header=",".join(names), comments="")
    return path


def rows(count: int, folder: Path) -> Callable[[], object]:
    path = table(folder / "a.csv", *motion(count, 3))
    return lambda: ident.fit(path, ident.Robot.from_urdf(urdf(3)), held=0)


def files(count: int, folder: Path) -> Callable[[], object]:
    t, q, tau = motion(200 * count, 2)
    paths = [table(folder / f"{i}.csv", *(a[200 * i : 200 * (i + 1)] for a in (t, q, tau))) for i in range(count)]
    return lambda: ident.fit(paths, ident.Robot.from_urdf(urdf(2)), held=0)


def gaps(count: int, folder: Path) -> Callable[[], object]:
    """A log that loses its time for a second after every dozen samples: no filter has its window there, so it is read and audited."""
    t, q, tau = motion(12 * count, 2)
    path = table(folder / "a.csv", t + np.arange(len(t)) // 12, q, tau)

    def work() -> object:
        robot = ident.Robot.from_urdf(urdf(2))
        return ident.audit(ident.read_logs(path, robot), robot)

    return work


def joints(count: int, folder: Path) -> Callable[[], object]:
    """A log of the chain itself: of other torques, the search for their signs would be measured too."""
    robot = ident.Robot.from_urdf(urdf(count))
    t, q, _ = motion(3_000, count)
    dq, ddq = (np.gradient(a, 1 / RATE, axis=0) for a in (q, np.gradient(q, 1 / RATE, axis=0)))
    tau = robot.rigid_body().inverse_dynamics(q, dq, ddq, robot.nominal)
    path = table(folder / "a.csv", t, q, tau + 0.01 * np.std(tau, axis=0) * np.random.default_rng(1).normal(size=tau.shape))
    return lambda: ident.fit(path, ident.Robot.from_urdf(urdf(count)), model=[ident.make_effect("viscous")], held=0)


def columns(count: int, folder: Path) -> Callable[[], object]:
    path = table(folder / "a.csv", *motion(500, 2), more=count)
    return lambda: ident.fit(path, ident.Robot.from_urdf(urdf(2)), held=0)


CASES: dict[str, Callable[[int, Path], Callable[[], object]]] = {
    "rows": rows, "files": files, "gaps": gaps, "joints": joints, "columns": columns,
}  # fmt: skip


def measure(case: str, count: int) -> dict[str, float]:
    """Seconds of this process's own time (others may use the machine too), and memory, of one case."""
    with tempfile.TemporaryDirectory() as folder:
        work = CASES[case](count, Path(folder))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start = time.process_time()
        try:
            work()
            outcome = 0.0
        except ident.DataError as error:
            print(error, file=sys.stderr)
            outcome = 3.0
        seconds = time.process_time() - start
        after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "megabytes": (after - before) / 1024.0, "exit": outcome}


def apart(case: str, count: int) -> dict[str, float]:
    """The same in a process of its own, whose memory is then its own."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.robustness.run", case, str(count)], capture_output=True, text=True, check=True, env=os.environ
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def at_once(runs: int = 6) -> list[int]:
    """Exit codes of commands that write to one folder at the same time."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.urdf").write_text(urdf(2))
        log = table(folder / "a.csv", *motion(2_000, 2))
        command = ["-m", "ident.cli", "fit", "--urdf", str(folder / "arm.urdf"), "--log", str(log), "--out", str(folder / "out"), "--quiet"]
        started = [subprocess.Popen([sys.executable, *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for _ in range(runs)]
        codes = sorted(p.wait() for p in started)
        left = [p.name for p in folder.iterdir() if ".ident-" in p.name]
        assert not left, left
        ident.Estimate.load(folder / "out" / "fit.json")
    return codes


def main(short: bool = False, folder: Path | None = None) -> int:
    """Print the tables."""
    print(f"{'case':<10}{'few':>10}{'s':>8}{'MB':>8}{'many':>11}{'s':>8}{'MB':>8}{'time x':>9}")
    worst = 0
    for case, sizes in SIZES.items():
        few, many = (max(1, s // 10) if short and case != "joints" else s for s in sizes)
        one, two = apart(case, few), apart(case, many)
        growth = two["seconds"] / one["seconds"]
        print(
            f"{case:<10}{few:>10}{one['seconds']:>8.2f}{one['megabytes']:>8.0f}{many:>11}{two['seconds']:>8.2f}{two['megabytes']:>8.0f}"
            f"{growth:>9.2f}",
            flush=True,
        )
        worst |= int(bool(one["exit"] or two["exit"]))
    codes = at_once()
    done, refused = codes.count(0), codes.count(2)
    print(f"{len(codes)} runs to one folder: {done} wrote, {refused} refused, {len(codes) - done - refused} else")
    return worst


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
    else:
        sys.exit(main("--short" in sys.argv))
