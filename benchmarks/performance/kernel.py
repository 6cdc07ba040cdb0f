"""The rigid-body kernel per sample: against the plain Pinocchio loop, lstsq and figaroh; by instruction set, size, joints and threads."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from ident.regressor import rigid

from .cases import Case, chain, humanoid, puma
from .figaroh_chain import microseconds as figaroh
from .limits import information_limit
from .table import Row
from .timing import TURNS, Work, best, native, together


def information_rows(samples: int, folder: Any) -> list[Row]:
    """Regressor and information of the PUMA, 52 parameters, one thread; everybody has the same samples."""
    case = puma(samples)
    found = together(
        {
            "gram": Work(lambda: case.information("gram"), samples),
            "qr": Work(lambda: case.information("triangle"), samples),
            "lstsq": Work(lambda: case.lstsq(samples), samples),
            "loop": Work(case.loop("regressor", samples), samples),
        },
        budget=12.0,
    )
    small = puma(8192)
    near = together({form: Work(lambda form=form: small.information(form), 8192) for form in ("gram", "triangle")})  # type: ignore[misc]
    theirs, note = figaroh(case, samples, folder)
    others = [
        ("Pinocchio's loop of the regressor alone", found["loop"], None),
        ("Pinocchio's loop, stacking and lstsq", found["lstsq"], 110.0),
    ]
    if theirs is not None:
        others.append(("figaroh's chain", theirs, 500.0))
    title = "regressor + information of the PUMA"
    limit, reflected = information_limit(small, 8192), information_limit(small, 8192, reflections=True)
    told = f"limit of this run {limit.value:.3g} µs"
    alone = tuple((who, us, None) for who, us, _ in others)
    return [
        Row(f"{title}, Gram, 8192 samples a call", near["gram"], "µs", 1.6 * limit.value, why=limit.why(near["gram"], "µs"), note=told),
        Row(
            f"{title}, Gram, {samples} samples", found["gram"], "µs", 1.6 * limit.value, tuple(others), limit.why(found["gram"], "µs"),
            f"{told}; {note}",
        ),
        Row(f"{title}, QR-grade", found["qr"], "µs", 2.6 * limit.value, alone, reflected.why(found["qr"], "µs"), told),
    ]  # fmt: skip


def dynamics_table(samples: int) -> list[dict[str, Any]]:
    """Other functions of the kernel on the PUMA, one thread, against Pinocchio's loop."""
    case = puma(samples)
    few = min(samples, 4000)
    tree, q, dq, ddq, tau = case.tree, case.q, case.dq, case.ddq, case.tau
    fixed = rigid.dynamics(tree, case.inertia, case.added)

    def single() -> None:
        for i in range(200):
            fixed.forward(q[i], dq[i], tau[i])

    ours = {
        ("regressor, written out", "regressor"): Work(lambda: rigid.regressor(tree, q[:few], dq[:few], ddq[:few], threads=1), few),
        ("inverse dynamics", "inverse"): Work(lambda: rigid.inverse_dynamics(tree, case.inertia, q, dq, ddq, threads=1), samples),
        ("forward dynamics, batch", "forward"): Work(
            lambda: rigid.forward_dynamics(tree, case.inertia, q, dq, tau, case.added, threads=1), samples
        ),
        ("forward dynamics, one state a call", "forward"): Work(single, 200),
    }
    theirs = {what: Work(case.loop(what, few), few) for what in ("regressor", "inverse", "forward")}  # type: ignore[arg-type]
    found = together({**{work: w for (work, _), w in ours.items()}, **theirs})
    return [{"work": work, "us": found[work], "Pinocchio's loop": found[what], "ratio": found[what] / found[work]} for work, what in ours]


def by_instruction_set(samples: int) -> list[dict[str, Any]]:
    """The same information on each instruction set, and by NumPy."""
    case, module = puma(samples), native()
    found = []
    for name in module.instruction_sets() if module else ():
        module.use_instruction_set(name)
        found.append({"kernel": name, **_both(case, samples)})
    with environment("IDENT_KERNEL", "numpy"):
        found.append({"kernel": "numpy", **_both(case, samples, rounds=2)})
    return found


def by_samples(sizes: Sequence[int], threads: Sequence[int]) -> list[dict[str, Any]]:
    """Information of the PUMA for more and more samples, by threads; by the clock on the wall where there are several."""
    case = puma(max(sizes))
    return [{"samples": n, "threads": t, **_both(case, n, t)} for n in sizes for t in threads]


def by_joints(counts: Sequence[int]) -> list[dict[str, Any]]:
    """Serial arms with viscous and Coulomb friction; Pinocchio's loop computes the regressor alone."""
    found = []
    samples, few = 8192, 500  # enough that setting up the factors does not count
    for joints in counts:
        case = Case(chain(joints), samples, drives=2 * joints)
        both = _both(case, samples)
        loop = best(case.loop("regressor", few), few, budget=0.5)
        found.append({"joints": joints, "columns": len(case.columns), **both, "Pinocchio's regressor us": loop})
    return found


def humanoid_row(samples: int) -> list[Row]:
    """Talos on a free-flyer: base columns and viscous friction on every row."""
    model = humanoid()
    if model is None:
        return []
    case, few = Case(model, samples), 300
    found = together(
        {
            "gram": Work(lambda: case.information("gram"), samples),
            "qr": Work(lambda: case.information("triangle"), samples),
            "loop": Work(case.loop("regressor", few), few),
            "lstsq": Work(lambda: case.lstsq(few), few),
        },
    )
    others = (
        ("Pinocchio's loop of the regressor alone", found["loop"], None),
        (f"the loop and lstsq of {few} samples", found["lstsq"], None),
    )
    limit = information_limit(case, samples)
    why = limit.why(found["gram"], "µs")
    work = f"humanoid on a free-flyer, {model.nv} rows, {len(case.columns)} columns, Gram, {samples} samples"
    return [Row(work, found["gram"], "µs", 2.0 * limit.value, others, why, f"limit {limit.value:.3g} µs; QR-grade {found['qr']:.3g} µs")]


def arm_rows(counts: Sequence[int], samples: int = 8192) -> list[Row]:
    """Information of serial arms as long as humanoids have joints, with viscous and Coulomb friction, against the limit of their own
    structure."""
    found = []
    for joints in counts:
        case = Case(chain(joints), samples, drives=2 * joints)
        limit = information_limit(case, samples)
        gram = together({"": Work(lambda case=case: case.information("gram"), samples)}, budget=3.0)[""]  # type: ignore[misc]
        work = f"arm of {joints} joints, {len(case.columns)} columns, Gram, {samples} samples"
        found.append(
            Row(work, gram, "µs", 2.0 * limit.value, why=limit.why(gram, "µs"), note=f"limit of its own structure {limit.value:.3g} µs")
        )
    return found


def _both(case: Case, samples: int, threads: int = 1, rounds: int = TURNS) -> dict[str, float]:
    clock = time.perf_counter if threads > 1 else time.thread_time
    works = {
        f"{key}_us": Work(lambda form=form: case.information(form, samples, threads), samples, clock)  # type: ignore[misc]
        for key, form in (("gram", "gram"), ("qr", "triangle"))
    }
    return together(works, rounds, budget=3.0)


@contextmanager
def environment(name: str, value: str) -> Iterator[None]:
    """A variable of the environment for the time being."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        os.environ.pop(name)
        if before is not None:
            os.environ[name] = before
