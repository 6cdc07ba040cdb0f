"""figaroh's chain on the same motion, in an environment of its own: regressor, columns without effect, base parameters by QR.

IDENT_FIGAROH_PYTHON names the interpreter of an environment with figaroh (`python -m venv F; F/bin/pip install figaroh`); without it
the comparison is left out. This file is also the script which that interpreter runs: it must not import ident."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

VARIABLE = "IDENT_FIGAROH_PYTHON"


def microseconds(case: Any, samples: int, folder: Path) -> tuple[float | None, str]:
    """Time per sample of figaroh's chain, or None, and what to say of it."""
    interpreter = os.environ.get(VARIABLE, "")
    if not interpreter:
        return None, f"figaroh: not measured; {VARIABLE} names no interpreter that has it"
    motion, model = folder / "figaroh.npz", folder / "figaroh.xml"
    np.savez(motion, q=case.q[:samples], dq=case.dq[:samples], ddq=case.ddq[:samples], tau=case.tau[:samples])
    case.model.saveToXML(str(model), "model")
    plain = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "IDENT_KERNEL")}
    run = subprocess.run([interpreter, __file__, str(motion), str(model)], check=False, capture_output=True, text=True, env=plain)
    motion.unlink()
    model.unlink()
    if run.returncode != 0:
        return None, f"figaroh: its chain failed: {(run.stderr.strip().splitlines() or ['without a word'])[-1]}"
    seconds, version, columns = run.stdout.strip().splitlines()[-1].split()
    return float(seconds) / samples * 1e6, f"figaroh {version}: {samples} samples, joint side, {columns} base parameters"


def chain(motion: Any, model: Any) -> tuple[float, int]:
    """Processor seconds of the chain (best of two), and base parameters found."""
    import warnings

    from figaroh.tools.qrdecomposition import double_QR
    from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced, get_index_eliminate

    warnings.simplefilter("ignore")
    robot = SimpleNamespace(model=model, data=model.createData())
    n = model.nv
    config = {"has_friction": True, "has_actuator_inertia": True, "act_idxv": list(range(n)), "is_joint_torques": True}
    names = [f"{p}{j}" for j in range(n) for p in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
    names += [f"{p}{j}" for p in ("fv", "fs", "Ia") for j in range(n)]
    times, found = [], 0
    for _ in range(2):
        start = time.process_time()
        W = build_regressor_basic(robot, motion["q"], motion["dq"], motion["ddq"], config)
        gone, kept = get_index_eliminate(W, dict.fromkeys(names, 0.0))
        result = double_QR(motion["tau"].T.reshape(-1), build_regressor_reduced(W, gone), kept)
        times.append(time.process_time() - start)
        found = len(result[3])
    return min(times), found


def main() -> None:
    """Run the chain on the files named, and print seconds, version and number of base parameters."""
    from importlib.metadata import version

    import pinocchio

    model = pinocchio.Model()
    model.loadFromXML(sys.argv[2], "model")
    with np.load(sys.argv[1]) as motion:
        seconds, found = chain(dict(motion), model)
    print(seconds, version("figaroh"), found)


if __name__ == "__main__":
    main()
