"""Real logs: each study file beside this module, fitted whole and fitted in part to predict the rest; what declared models lack."""

from __future__ import annotations

import json
from pathlib import Path

from ident._utils.json import jsonable
from ident.errors import DataError
from ident.study.session import Session
from ident.study.study import read_study

from . import diagnosed, repeated

HERE = Path(__file__).parent


def main(short: bool, folder: Path) -> int:
    """Print one line a study; write `real.json`."""
    rows = []
    print(f"{'log':<18}{'parameters':>11}{'cut-off Hz':>11}{'rows':>7}{'fit %':>8}{'held out %':>12}{'URDF inertials %':>18}  status")
    for file in sorted(HERE.glob("*.toml")):
        try:
            session = Session(read_study(file))
            estimate = session.estimate
            validation = session.validation(simulate=False)
        except DataError as error:
            print(f"{file.stem:<18}not run: {error}")
            continue
        nominal = "" if validation.nominal is None else f"{100 * validation.nominal.relative_all:.2f}"
        fit, held = (100 * e.relative_all for e in (estimate.fit_error, validation.error))
        cutoff = session.fit_signals.report.cutoff_hz
        left = f"{file.stem:<18}{len(estimate.values):>11}{cutoff:>11.3g}{estimate.samples:>7}"
        print(f"{left}{fit:>8.2f}{held:>12.2f}{nominal:>18}  {estimate.status.code.value}")
        rows.append({"study": file.stem, "estimate": estimate.to_dict(), "validation": validation.to_dict()})
    (folder / "real.json").write_text(json.dumps(jsonable(rows), indent=1))
    print(
        "fit: relative torque error on the fitted part; held out: on the rest; URDF inertials: the same rest, only drive parameters fitted"
    )
    print("\nIV and DIDIM")
    repeated.main(short, folder)
    print()
    return diagnosed.main(short, folder)
