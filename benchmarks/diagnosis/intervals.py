"""`python -m benchmarks.diagnosis.intervals FOLDER ...`: how often intervals of a plain fit, and of instruments, cover the truth, by group
of parameters.

Logs with nothing missing of `benchmarks.diagnosis.generate` or `benchmarks.diagnosis.feedback.suite`; each is fitted as `ident.fit` does,
on the part that is not held out."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

import ident
from ident import estimators as es
from ident.errors import DataError
from ident.problem.problem import Problem

from .score import load, read_cases
from .tables import table

#: Groups by the symbol of a base parameter's first part.
GROUPS = {"Ia": "rotor inertia", "Fv": "viscous", "Fc": "Coulomb"}
_Z95 = 1.959963985


#: What is counted: a plain fit, the same with values by instruments where `ident fit` says that they differ, and instruments.
KINDS = ("wls", "wls, iv_band where they differ", "iv_band")


def errors(folder: Path) -> dict[tuple[str, str], list[float]]:
    """Errors over standard deviations, by kind and group, of all clean logs of a folder whose model is the usual one."""
    found: dict[tuple[str, str], list[float]] = {}
    for record in read_cases(folder):
        if record["kind"] != "clean":
            continue
        case = load(folder, record)
        known = dict(zip(case.arm.model.names, case.arm.values.tolist(), strict=True))
        if not set(case.model.names) <= set(known):
            print(f"{record['id']}: left out: its true parameters are not the usual ones")
            continue
        true = np.array([known[name] for name in case.model.names])
        estimate = es.WeightedLeastSquares().solve(Problem(case.model, case.fit))
        plain = (estimate.values - estimate.base.base_values(true)) / estimate.std
        counted = [(KINDS[0], plain)]
        try:
            bias = ident.against_instruments(estimate)
        except DataError as error:
            print(f"{record['id']}: by least squares alone: {str(error)[:80]} …")
        else:
            other = (bias.instrumental.values - bias.instrumental.base.base_values(true)) / bias.instrumental.std
            moved = np.array([name in bias.significant for name in estimate.names])
            counted += [(KINDS[1], np.where(moved, other, plain)), (KINDS[2], other)]
        for kind, off in counted:
            for name, z in zip(estimate.names, off.tolist(), strict=True):
                found.setdefault((kind, GROUPS.get(name.split("_")[0], "inertial")), []).append(z)
    return found


def told(found: dict[tuple[str, str], list[float]]) -> str:
    """A table of the groups."""
    rows = []
    for (kind, group), z in sorted(found.items(), key=lambda x: KINDS.index(x[0][0])):
        size = np.abs(np.array(z))
        rows.append(
            [kind, group, f"{len(z)}", f"{100 * np.mean(size <= _Z95):.1f}", f"{np.sqrt(np.mean(size**2)):.2f}", f"{np.median(size):.2f}"]
        )
    return table(["method", "group", "intervals", "covered %", "rms error / std", "median"], rows)


def main() -> None:
    """Command line."""
    warnings.simplefilter("ignore")
    together: dict[tuple[str, str], list[float]] = {}
    for folder in sys.argv[1:]:
        for group, z in errors(Path(folder)).items():
            together.setdefault(group, []).extend(z)
    print(told(together))


if __name__ == "__main__":
    main()
