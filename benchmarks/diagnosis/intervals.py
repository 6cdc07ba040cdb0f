"""`python -m benchmarks.diagnosis.intervals FOLDER ...`: how often intervals of a plain fit cover the truth, by group of parameters.

Logs with nothing missing of `benchmarks.diagnosis.generate` or `benchmarks.diagnosis.feedback.suite`; each is fitted as `ident.fit` does,
on the part that is not held out."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

from ident import estimators as es
from ident.problem.problem import Problem
from ident.robots import nominal_values

from .score import load, read_cases
from .tables import table

#: Groups by the symbol of a base parameter's first part.
GROUPS = {"Ia": "rotor inertia", "Fv": "viscous", "Fc": "Coulomb"}
_Z95 = 1.959963985


def errors(folder: Path) -> dict[str, list[float]]:
    """Errors over standard deviations, by group, of all clean logs of a folder whose model is the usual one."""
    found: dict[str, list[float]] = {}
    for record in read_cases(folder):
        if record["kind"] != "clean":
            continue
        case = load(folder, record)
        drive = case.arm.drive
        true = np.concatenate([nominal_values(case.arm.robot.rigid_body()), drive["Ia"], drive["Fv"], drive["Fc"]])
        if len(true) != len(case.model.names):
            print(f"{record['id']}: left out: its true parameters are not the usual ones")
            continue
        estimate = es.WeightedLeastSquares().solve(Problem(case.model, case.fit))
        off = (estimate.values - estimate.base.base_values(true)) / estimate.std
        for name, z in zip(estimate.base.names, off.tolist(), strict=True):
            found.setdefault(GROUPS.get(name.split("_")[0], "inertial"), []).append(z)
    return found


def told(found: dict[str, list[float]]) -> str:
    """A table of the groups."""
    rows = []
    for group, z in found.items():
        size = np.abs(np.array(z))
        rows.append(
            [group, f"{len(z)}", f"{100 * np.mean(size <= _Z95):.1f}", f"{np.sqrt(np.mean(size**2)):.2f}", f"{np.median(size):.2f}"]
        )
    return table(["group", "intervals", "covered %", "rms error / std", "median"], rows)


def main() -> None:
    """Command line."""
    warnings.simplefilter("ignore")
    together: dict[str, list[float]] = {}
    for folder in sys.argv[1:]:
        for group, z in errors(Path(folder)).items():
            together.setdefault(group, []).extend(z)
    print(told(together))


if __name__ == "__main__":
    main()
