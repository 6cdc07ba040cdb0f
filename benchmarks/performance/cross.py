"""The kernel of another processor, where no such machine is at hand: cross-compiled, run by an emulator, and compared with this machine's.

    pip install ziglang; apt-get download qemu-user-static
    python -m benchmarks.performance.cross --compiler "python -m ziglang c++ -target aarch64-linux-musl" --emulator qemu-aarch64-static

Numbers are compared, and vector instructions counted in the assembly. Times under an emulator say nothing of the machine: none
are told."""

from __future__ import annotations

import argparse
import shlex
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ident.regressor import native, native_tree, rigid, row_information

from .cases import Case, puma

Array = np.ndarray
_NATIVE = Path(native_tree.__file__).parents[1] / "_native"
#: As setup.py has them, for any compiler.
_FLAGS = ["-std=c++17", "-O3", "-g0", "-fno-math-errno", "-fno-tree-vectorize", f"-I{_NATIVE}"]


class _Recorded:
    """The kernel's module, which keeps what trees and plans are made of."""

    def __init__(self, module: Any) -> None:
        self._module = module
        self.tree: tuple[Any, ...] = ()
        self.plan: tuple[Any, ...] = ()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)

    def make_tree(self, *given: Any) -> Any:
        self.tree = given
        return self._module.make_tree(*given)

    def make_plan(self, *given: Any) -> Any:
        self.plan = given
        return self._module.make_plan(*given)


def _recorded(case: Case) -> tuple[_Recorded, Any]:
    """Records of a case's tree and plan."""
    module = native_tree._kernel
    recorded = _Recorded(module)
    native_tree._kernel = recorded  # type: ignore[assignment]
    try:
        own = native_tree._compile(case.tree)
        plan = own.plan(case.tree, case.rows, case.columns, case.extra, case.pattern)
    finally:
        native_tree._kernel = module
    return recorded, plan


def _case_bytes(case: Case, split: int) -> tuple[bytes, Any]:
    recorded, plan = _recorded(case)
    bodies, nv, nq, gravity = recorded.tree
    _, rows, table, steps, extras, beside, _ = recorded.plan
    own = native_tree.compiled(case.tree)
    parts = [
        np.array([nv, nq, case.samples, rows, beside]).tobytes(), bodies, gravity.tobytes(), table, steps, extras,
        *(np.ascontiguousarray(x, float).tobytes() for x in (own.inertia(case.inertia), case.q, case.dq, case.ddq, case.tau, case.extra)),
        plan.instruments(split),
    ]  # fmt: skip
    return b"".join(struct.pack("<q", len(part)) + part for part in parts), plan


def _wanted(case: Case, plan: Any, split: int) -> list[Array]:
    """Factors of this machine's kernel in its own layout, torque and acceleration."""
    given = {"columns": case.columns, "rows": case.rows, "extra": case.extra, "pattern": case.pattern, "threads": 1}
    motion = case.q, case.dq, case.ddq, case.tau
    forms: list[dict[str, Any]] = [{"form": "triangle"}, {"form": "gram"}, {"form": "gram", "split": split}]
    found = [row_information.information(case.tree, *motion, **given, **form)[0] for form in forms]
    torque = rigid.inverse_dynamics(case.tree, case.inertia, case.q, case.dq, case.ddq, threads=1)
    return [*found, torque, rigid.forward_dynamics(case.tree, case.inertia, case.q, case.dq, torque, threads=1)]


def compare(case: Case, program: list[str], folder: Path) -> dict[str, float]:
    """Largest differences between the program's numbers and this machine's: factors relative to the lengths of their columns."""
    split = len(case.columns) // 2
    written, plan = _case_bytes(case, split)
    (folder / "case").write_bytes(written)
    subprocess.run([*program, str(folder / "case"), str(folder / "result")], check=True, stderr=subprocess.DEVNULL)
    numbers = np.fromfile(folder / "result")
    size, taken, upper, _ = plan.unpacking
    wanted, out = _wanted(case, plan, split), {}
    length = np.sqrt(np.einsum("rcc->rc", wanted[1]))
    scale = np.maximum(length[:, :, None] * length[:, None, :], 1e-300)
    for i, name in enumerate(("triangle", "gram", "instruments")):
        found = np.zeros(wanted[1].shape)
        np.put(found, upper, numbers[i * size : (i + 1) * size][taken])
        if name == "triangle":
            found, own = np.swapaxes(found, 1, 2) @ found, np.swapaxes(wanted[0], 1, 2) @ wanted[0]
        else:
            own = wanted[i] if name == "instruments" else np.triu(wanted[i])
        out[name] = float(np.max(np.abs(found - own) / scale))
    rest = numbers[3 * size :].reshape(2, case.samples, -1)
    for name, found, own in zip(("inverse dynamics", "forward dynamics"), rest, wanted[3:], strict=True):
        out[name] = float(np.max(np.abs(found - own)) / np.max(np.abs(own)))
    return out


def main() -> int:
    """Build, run, compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--compiler", required=True, help="a C++ compiler for the other processor, with its target")
    parser.add_argument("--emulator", default="", help="what runs its programs (empty: they run here)")
    args = parser.parse_args()
    sources = [str(Path(__file__).with_name("cross.cpp")), str(_NATIVE / "baseline.cpp")]
    native.use_instruction_set("baseline")
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        folder = Path(name)
        compiler = shlex.split(args.compiler)
        subprocess.run([*compiler, *_FLAGS, "-static", *sources, "-o", str(folder / "cross")], check=True)
        subprocess.run([*compiler, *_FLAGS, "-S", sources[1], "-o", str(folder / "kernel.s")], check=True)
        text = (folder / "kernel.s").read_text(errors="replace")
        for kind, mark in (("NEON fused multiply-adds of two doubles", "fmla\tv"), ("scalar ones", "fmadd\td")):
            print(f"{kind} in the kernel's assembly: {text.count(mark)}")
        found = compare(puma(500), [*shlex.split(args.emulator), str(folder / "cross")], folder)
    print("largest differences to this machine's baseline kernel: " + ", ".join(f"{k} {v:.1e}" for k, v in found.items()))
    return int(max(found.values()) > 1e-12)


if __name__ == "__main__":
    sys.exit(main())
