"""Time per sample of the rigid-body kernels, as ratios to the plain Pinocchio loop and to NumPy's lstsq, measured in one run.

    python benchmarks/performance/kernel.py                # everything below 1e7 samples, a few minutes
    python benchmarks/performance/kernel.py --quick        # smaller sizes, half a minute
    python benchmarks/performance/kernel.py --large        # also 1e7 samples (2.5 GB of memory)
    python benchmarks/performance/kernel.py --json out.json

One thread is timed by its processor time, several by the clock on the wall; each number is the best of several runs."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import ident
from ident.errors import ConfigurationError
from ident.regressor import numpy_kernel, rigid
from ident.regressor.tree import RigidBodyTree

Array = np.ndarray


def best(work: Callable[[], Any], count: int, threads: int = 1, budget: float = 1.0) -> float:
    """Microseconds per sample: the best of the runs that fit the budget (s), three at least."""
    clock = time.thread_time if threads == 1 else time.perf_counter
    work()
    times: list[float] = []
    end = time.perf_counter() + budget
    while len(times) < 3 or (time.perf_counter() < end and len(times) < 200):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times) / count * 1e6


class Case:
    """A robot with base columns, drive columns and random motion of N samples."""

    def __init__(self, model: pin.Model, samples: int, K: Array | None = None, drives: int | None = None) -> None:
        rng = np.random.default_rng(0)
        self.model, self.tree, self.samples = model, RigidBodyTree.from_pinocchio(model), samples
        nv = model.nv
        self.q = rng.uniform(-2, 2, (samples, model.nq))
        if self.tree.floating:
            self.q[:, 3:7] /= np.linalg.norm(self.q[:, 3:7], axis=1)[:, None]
        self.dq, self.ddq, self.tau = rng.normal(size=(3, samples, nv))
        self.rows = np.eye(nv) if K is None else K.T.copy()
        base = base_columns(self.tree)
        drives = nv if drives is None else drives
        rates = self.dq if K is None else self.dq @ np.linalg.inv(K).T
        accelerations = self.ddq if K is None else self.ddq @ np.linalg.inv(K).T
        # Coulomb, viscous and rotor-inertia columns, as many as asked for from the end.
        self.extra = np.ascontiguousarray(np.concatenate([accelerations, rates, np.sign(rates)], axis=1)[:, 3 * nv - drives :])
        self.pattern = np.ascontiguousarray(np.tile(np.eye(nv), 3)[:, 3 * nv - drives :])
        self.columns = np.concatenate([base, 10 * self.tree.nb + np.arange(drives)])
        self.inertia = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
        self.added = np.diag(np.full(nv, 0.5))

    def information(self, form: str, samples: int | None = None, threads: int = 1) -> Array:
        part = slice(samples)
        return rigid.information(
            self.tree,
            self.q[part],
            self.dq[part],
            self.ddq[part],
            self.tau[part],
            rows=self.rows,
            columns=self.columns,
            extra=self.extra[part],
            pattern=self.pattern,
            form=form,  # type: ignore[arg-type]
            threads=threads,
        )[0]


def base_columns(tree: RigidBodyTree) -> Array:
    """Independent columns of the regressor, by orthogonalisation of random samples."""
    rng = np.random.default_rng(1)
    count = 20 * tree.nb // tree.nv + 40
    q = rng.uniform(-2, 2, (count, tree.nq))
    if tree.floating:
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    Y = numpy_kernel.regressor(tree, q, *rng.normal(size=(2, count, tree.nv))).reshape(-1, 10 * tree.nb)
    length = np.linalg.norm(Y, axis=0)
    order = [10 * i + k for i in range(tree.nb) for k in (9, 4, 5, 7, 8, 1, 2, 3, 6, 0) if length[10 * i + k] > 1e-9 * length.max()]
    diagonal = np.abs(np.diag(np.linalg.qr(Y[:, order] / length[order], mode="r")))
    return np.sort(np.array(order)[diagonal > 1e-8])


def chain(joints: int) -> pin.Model:
    """A serial arm of revolute joints about z, each turned by a right angle against the last."""
    rng = np.random.default_rng(joints)
    model = pin.Model()
    parent = 0
    for j in range(joints):
        turn = pin.rpy.rpyToMatrix(np.pi / 2 * (j % 2), 0, 0)
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(turn, np.array([0.1, 0.0, 0.2])), f"joint{j + 1}")
        model.inertias[parent] = pin.Inertia(1.0, rng.normal(size=3) * 0.1, np.eye(3) * 0.05)
    return model


def humanoid() -> pin.Model | None:
    """Talos on a free-flyer, where example-robot-data is installed."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        return None
    found = [f for f in files if str(f).endswith("talos_reduced.urdf")]
    return pin.buildModelFromUrdf(str(found[0].locate()), pin.JointModelFreeFlyer()) if found else None


def pinocchio_loop(case: Case, what: str, samples: int) -> Callable[[], Any]:
    """The plain loop over samples in Python; the regressor's columns are stacked, as a user of lstsq has to."""
    model, data = case.model, case.model.createData()
    q, dq, ddq = case.q[:samples], case.dq[:samples], case.ddq[:samples]
    if what == "regressor":
        return lambda: [pin.computeJointTorqueRegressor(model, data, a, b, c) for a, b, c in zip(q, dq, ddq, strict=True)]
    if what == "inverse":
        return lambda: [pin.rnea(model, data, a, b, c) for a, b, c in zip(q, dq, ddq, strict=True)]
    return lambda: [pin.aba(model, data, a, b, c) for a, b, c in zip(q, dq, ddq, strict=True)]


def stacked_lstsq(case: Case, samples: int) -> Callable[[], Any]:
    """Regressor by the loop, stacking of all columns, and numpy.linalg.lstsq."""
    model, data, nv = case.model, case.model.createData(), case.tree.nv

    def work() -> Array:
        loop = [
            np.array(pin.computeJointTorqueRegressor(model, data, a, b, c)).reshape(nv, -1)
            for a, b, c in zip(case.q[:samples], case.dq[:samples], case.ddq[:samples], strict=True)
        ]
        Y = np.concatenate([case.rows @ np.stack(loop), case.extra[:samples, None, :] * case.pattern], axis=2)[:, :, case.columns]
        return np.linalg.lstsq(Y.reshape(-1, len(case.columns)), case.tau[:samples].reshape(-1), rcond=None)[0]

    return work


def puma_table(samples: int) -> list[dict[str, Any]]:
    """PUMA 560, motor side, coupled gears, 52 parameters; one thread."""
    robot = ident.load_robot("puma560")
    case = Case(robot.model, samples, robot.transmission.K, drives=16)
    few = min(samples, 4000)
    tree, q, dq, ddq, tau = case.tree, case.q, case.dq, case.ddq, case.tau
    fixed = rigid.dynamics(tree, case.inertia, case.added)
    loop = {what: best(pinocchio_loop(case, what, few), few) for what in ("regressor", "inverse", "forward")}
    lstsq = best(stacked_lstsq(case, few), few)

    def single() -> None:
        for i in range(200):
            fixed.forward(q[i], dq[i], tau[i])

    rows = [
        ("regressor, written out", best(lambda: rigid.regressor(tree, q[:few], dq[:few], ddq[:few], threads=1), few), loop["regressor"]),
        ("regressor + information, Gram", best(lambda: case.information("gram"), samples), lstsq),
        ("regressor + information, QR-grade", best(lambda: case.information("triangle"), samples), lstsq),
        ("inverse dynamics", best(lambda: rigid.inverse_dynamics(tree, case.inertia, q, dq, ddq, threads=1), samples), loop["inverse"]),
        (
            "forward dynamics, batch",
            best(lambda: rigid.forward_dynamics(tree, case.inertia, q, dq, tau, case.added, threads=1), samples),
            loop["forward"],
        ),
        ("forward dynamics, one state a call", best(single, 200), loop["forward"]),
    ]
    name = {"regressor": "Pinocchio loop", "inverse": "Pinocchio loop", "forward": "Pinocchio loop"}
    return [
        {
            "work": work,
            "us": us,
            "against": "Pinocchio loop, stacked, lstsq" if "information" in work else name["regressor"],
            "their_us": other,
        }
        for work, us, other in rows
    ]


def by_instruction_set(samples: int) -> list[dict[str, Any]]:
    """The same information on each instruction set, and by NumPy."""
    robot = ident.load_robot("puma560")
    case = Case(robot.model, samples, robot.transmission.K, drives=16)
    found = []
    native = native_module()
    for name in native.instruction_sets() if native else ():
        native.use_instruction_set(name)
        found.append(
            {
                "kernel": name,
                "gram_us": best(lambda: case.information("gram"), samples),
                "qr_us": best(lambda: case.information("triangle"), samples),
            }
        )
    chosen = os.environ.get("IDENT_KERNEL")
    os.environ["IDENT_KERNEL"] = "numpy"
    found.append(
        {
            "kernel": "numpy",
            **{
                f"{key}_us": best(lambda form=form: case.information(form), samples, budget=0.1)
                for key, form in (("gram", "gram"), ("qr", "triangle"))
            },
        }
    )  # type: ignore[misc]
    os.environ.pop("IDENT_KERNEL")
    if chosen is not None:
        os.environ["IDENT_KERNEL"] = chosen
    return found


def by_samples(sizes: list[int], threads: list[int]) -> list[dict[str, Any]]:
    """Information of the PUMA for more and more samples, by threads."""
    robot = ident.load_robot("puma560")
    case = Case(robot.model, max(sizes), robot.transmission.K, drives=16)
    return [
        {
            "samples": n,
            "threads": t,
            "gram_us": best(lambda n=n, t=t: case.information("gram", n, t), n, t),  # type: ignore[misc]
            "qr_us": best(lambda n=n, t=t: case.information("triangle", n, t), n, t),  # type: ignore[misc]
        }
        for n in sizes
        for t in threads
    ]


def by_joints(counts: list[int]) -> list[dict[str, Any]]:
    """Serial arms with viscous and Coulomb friction; Pinocchio's loop computes the regressor alone."""
    found = []
    for joints in counts:
        samples = 8192  # enough that setting up the factors does not count
        case = Case(chain(joints), samples, drives=2 * joints)
        few = min(samples, 1000)
        found.append(
            {
                "joints": joints,
                "columns": len(case.columns),
                "gram_us": best(lambda case=case: case.information("gram"), samples),  # type: ignore[misc]
                "qr_us": best(lambda case=case: case.information("triangle"), samples),  # type: ignore[misc]
                "pinocchio_regressor_us": best(pinocchio_loop(case, "regressor", few), few),
            }
        )
    return found


def floating_table(samples: int) -> list[dict[str, Any]]:
    """Humanoid on a free-flyer: base columns and viscous friction on every row."""
    model = humanoid()
    if model is None:
        return []
    case = Case(model, samples)
    few = 500
    return [
        {
            "robot": model.name,
            "rows": model.nv,
            "columns": len(case.columns),
            "gram_us": best(lambda: case.information("gram"), samples),
            "qr_us": best(lambda: case.information("triangle"), samples),
            "pinocchio_regressor_us": best(pinocchio_loop(case, "regressor", few), few),
            "lstsq_us": best(stacked_lstsq(case, few), few, budget=0.1),
        }
    ]


def native_module() -> Any:
    """The compiled kernel, or None."""
    try:
        from ident.regressor import native
    except ImportError:
        return None
    return native


def peak() -> float:
    """Multiplications and additions a second of one thread in dgemm, 1e9/s: what this machine gives to dense algebra."""
    A = np.random.default_rng(0).normal(size=(512, 512))
    return 2 * 512**3 / (best(lambda: A @ A, 1) * 1e-6) * 1e-9


def machine() -> dict[str, Any]:
    """What was measured on."""
    cpu = platform.processor()
    if Path("/proc/cpuinfo").exists():
        lines = [line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        cpu = lines[0] if lines else cpu
    native = native_module()
    return {
        "processor": cpu,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "kernel": native.instruction_sets()[-1] if native else "numpy",
        "dgemm_gflops": peak(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "pinocchio": pin.__version__,
    }


def show(title: str, table: list[dict[str, Any]]) -> None:
    """A table on standard output."""
    if not table:
        return
    print(f"\n{title}")
    names = list(table[0])
    cells = [names, *([f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()] for row in table)]
    widths = [max(len(row[c]) for row in cells) for c in range(len(names))]
    for row in cells:
        print("  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))


def main() -> None:
    """Measure and print all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="smaller sizes")
    parser.add_argument("--large", action="store_true", help="also 1e7 samples")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    arguments = parser.parse_args()
    if min(arguments.threads) < 1:
        raise ConfigurationError("--threads: must be 1 or more.")
    sizes = [10_000, 100_000] if arguments.quick else [10_000, 100_000, 1_000_000]
    sizes += [10_000_000] if arguments.large else []
    about = machine()
    print("  ".join(f"{k}: {v:.1f}" if isinstance(v, float) else f"{k}: {v}" for k, v in about.items()))
    puma = puma_table(8192)
    for row in puma:
        row["ratio"] = row["their_us"] / row["us"]
    tables = {
        "PUMA 560, motor side, 52 parameters, one thread (us a sample)": puma,
        "the same information by kernel": by_instruction_set(8192),
        "by samples and threads": by_samples(sizes, arguments.threads),
        "by joints": by_joints([1, 2, 4, 6, 7, 12] if arguments.quick else [1, 2, 3, 4, 6, 7, 9, 12, 18, 24, 30, 36]),
        "floating base": floating_table(1024 if arguments.quick else 16384),
    }
    for title, table in tables.items():
        show(title, table)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({"schema": "ident.benchmark.kernel/1", "machine": about, "tables": tables}, indent=1))


if __name__ == "__main__":
    main()
