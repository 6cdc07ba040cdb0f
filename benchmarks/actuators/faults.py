"""How often `ident diagnose` names what was put into a robot's log without torque, and how often it finds nothing in clean ones."""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path

import numpy as np

import ident
from ident.diagnosis.drives import DriveDiagnosis, diagnose_drives
from ident.drives import DriveLaw
from ident.logs.log import LogSet

from . import limbs, servos
from .coverage import EFFECTS, MACHINES
from .servos import FAULTS

#: What is diagnosed: a servo on a pendulum, or one of the machines of several joints.
ROBOTS = {"servo": None, "leg": MACHINES[1], "arm": MACHINES[2], "7-joint": MACHINES[3]}
#: Seeds fixed before anything was run on them: where those of each robot begin.
FIRST = {"servo": 0, "leg": 500, "arm": 500, "7-joint": 500}


def diagnosed(robot: ident.Robot, declared: dict, t: np.ndarray, q: np.ndarray, sent: np.ndarray) -> DriveDiagnosis:
    """The diagnosis of one log (N, n) under the declared law."""
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    log = ident.Log("run", t=t, q=q, extra={f"q_cmd{j + 1}": column for j, column in enumerate(sent.T)})
    return diagnose_drives(LogSet((log,)), model, DriveLaw.of(robot, **declared))


def logs(robot: str, fault: str, seeds: list[int]) -> tuple[ident.Robot, list[tuple]]:
    """The robot, and of each seed: what is declared, times, positions, commands, joints with the fault."""
    machine = ROBOTS[robot]
    if machine is None:
        made = [servos.servo(fault, seed) for seed in seeds]
        t, q, sent = servos.recorded(made, seeds)
        return ident.Robot.from_urdf(servos.URDF), [(one.declared, t, q[:, [k]], sent[:, [k]], 0) for k, one in enumerate(made)]
    placed = [limbs.limb(machine, fault, seed) for seed in seeds]
    t, q, sent = limbs.recorded(machine, placed, seeds)
    return machine.robot(), [(one.declared, t, q[:, k], sent[:, k], one.joint) for k, one in enumerate(placed)]


def counted(kind: str, fault: str, seeds: list[int]) -> dict:
    """How many are named: the only finding is the fault, on the joint that has it, and nothing explains as much; and what is told of
    the others, by seed."""
    robot, made = logs(kind, fault, seeds)
    told, named, spent = {}, 0, []
    for seed, (declared, t, q, sent, joint) in zip(seeds, made, strict=True):
        begin = time.process_time()
        found = diagnosed(robot, declared, t, q, sent)
        spent.append(time.process_time() - begin)
        where = set(robot.joint_names) if fault == "delay" else {robot.joint_names[joint]}
        right = found.verdict == "clean" if fault == "clean" else [f.effect for f in found.findings] == [fault]
        right = right and (fault == "clean" or (set(found.findings[0].joints) == where and not found.findings[0].rivals))
        named += right
        if not right:
            told[seed] = f"{found.verdict}: " + (", ".join(_said(f) for f in found.findings) or "nothing")
    return {"named": named, "count": len(seeds), "others": told, "seconds": float(np.median(spent)), "longest": max(spent)}


def _said(finding) -> str:
    rivals = "".join(f" or {r.effect}" for r in finding.rivals)
    return f"{finding.effect} on {'+'.join(finding.joints)}{rivals}"


def main() -> int:
    """Print one line for each fault, then what was told of those that are not named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("folder", type=Path, nargs="?", default=Path())
    parser.add_argument("--robot", choices=ROBOTS, default="servo")
    parser.add_argument("--faults", nargs="*", choices=FAULTS, default=FAULTS)
    parser.add_argument("--first", type=int, help="the first seed; by default those that are counted")
    given = parser.parse_args()
    first = FIRST[given.robot] if given.first is None else given.first
    seeds = list(range(first, first + given.count))
    print(f"{'robot':<10}{'put in':<26}{'named':>12}{'s each':>8}{'longest':>9}")
    table = {}
    for fault in given.faults:
        row = table[fault] = counted(given.robot, fault, seeds)
        print(f"{given.robot:<10}{fault:<26}{row['named']:>5} of {row['count']:<4}{row['seconds']:>8.1f}{row['longest']:>9.1f}", flush=True)
        for what, n in Counter(row["others"].values()).most_common():
            print(f"{'':>10}    {n:>3}  {what}  (seeds {', '.join(str(s) for s, w in row['others'].items() if w == what)})", flush=True)
    (given.folder / f"actuator_faults_{given.robot}.json").write_text(json.dumps(table, indent=1))
    print("named: the fault and nothing else, on the joint that has it, nothing that explains as much; s: processor time")
    return 0


if __name__ == "__main__":
    main()
