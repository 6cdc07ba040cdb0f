"""How often `ident diagnose` names what was put into a servo's log without torque, and how often it finds nothing in clean ones."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

import ident
from ident.diagnosis.drives import DriveDiagnosis, diagnose_drives
from ident.drives import DriveLaw
from ident.logs.log import LogSet

from .servos import FAULTS, URDF, Servo, recorded, servo


def diagnosed(robot: ident.Robot, one: Servo, t: np.ndarray, q: np.ndarray, sent: np.ndarray) -> DriveDiagnosis:
    """The diagnosis of one log under the declared law."""
    model = robot.rigid_body()
    for name in ("rotor_inertia", "viscous", "coulomb", "offset"):
        model = model + ident.make_effect(name)
    log = ident.Log("run", t=t, q=q[:, None], extra={"q_cmd1": sent})
    return diagnose_drives(LogSet((log,)), model, DriveLaw.of(robot, **one.declared))


def main(count: int, folder: Path) -> int:
    """Seeds 0 … count - 1 of each fault; named: the first finding is the fault, and nothing else is found."""
    robot = ident.Robot.from_urdf(URDF)
    seeds = list(range(count))
    table = {}
    for fault in FAULTS if len(sys.argv) < 4 else sys.argv[3:]:
        servos = [servo(fault, seed) for seed in seeds]
        t, q, sent = recorded(servos, seeds)
        begin, told = time.process_time(), Counter()
        for seed in seeds:
            found = diagnosed(robot, servos[seed], t, q[:, seed], sent[:, seed])
            told[(str(found.verdict), *(f.effect for f in found.findings))] += 1
        wanted = () if fault == "clean" else (fault,)
        named = sum(n for what, n in told.items() if what[1:] == wanted)
        among = sum(n for what, n in told.items() if set(wanted) <= set(what[1:]))
        each = (time.process_time() - begin) / count
        print(f"{fault:<26} named {named} of {count}, among the findings {among}; {each:.1f} s of processor time each", flush=True)
        for what, n in told.most_common():
            print(f"    {n:>4}  {what[0]}: {', '.join(what[1:]) or 'nothing'}", flush=True)
        table[fault] = {"named": named, "count": count, "told": {", ".join(k): v for k, v in told.items()}}
    (folder / "actuator_faults.json").write_text(json.dumps(table, indent=1))
    return 0


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20, Path(sys.argv[2]) if len(sys.argv) > 2 else Path())
