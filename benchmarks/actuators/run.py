"""Real logs without torque: error of simulated position, open loop, on logs or parts that no fit saw, beside published values.

The logs are not part of this repository: `IDENT_DATA` names their folder (default: `../shared/data` beside the checkout)."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import ident
from ident._utils.json import jsonable
from ident.drives import DriveFit, DriveLaw
from ident.drives.fit import finished
from ident.drives.folds import best, held_out
from ident.drives.plant import DrivePlant
from ident.drives.search import Fitted
from ident.drives.search import fitted as search
from ident.drives.space import drive_logs
from ident.drives.starts import starts
from ident.drives.stretches import steadied
from ident.drives.unknowns import Unknown

from . import coverage

DRIVE = ("rotor_inertia", "viscous", "coulomb", "offset")
LOADED = (*DRIVE, "load_dependent_friction")
SPRUNG = (*LOADED, "linear_spring")
#: Friction that follows the drive's torque: with its square, and with more of it at low speed. That speed decides what a joint that came to
#: rest under load does next, and is chosen as everything else is: rad/s, half a decade apart.
GEAR = {"gear_loss": "identify", "gear_loss_square": "identify"}
SLOW = tuple({**GEAR, "gear_loss_slow": "identify", "slow_speed": speed} for speed in (0.03, 0.1, 0.3))
#: A spring between motor and link.
SPRING = {"joint_stiffness": "identify", "joint_damping": "identify"}
#: Times the stiffness at which a search starts: what is so stiff is rigid to a simulation.
RIGID = 400.0
#: A delay of each joint of its own.
EACH = {"delay_s": ["identify"] * 12}
#: The AK80's feed-forward moves, so that its share can be seen beside kp and kd.
AK80: tuple[tuple[tuple[str, ...], Mapping[str, Any]], ...] = (
    (DRIVE, {}),
    (DRIVE, {"feed_forward": "identify"}),
    (LOADED, {}),
    (DRIVE, {"gear_loss": "identify"}),
    (DRIVE, {"feed_forward": "identify", "gear_loss": "identify"}),
)
#: Its stiff log is one of position control: the drive's own torque is 0.0 N m in the first 20 ms, at rest, where tau_ff is 0.76 N m.
NOT_SENT = {"*stiff*": {"feed_forward": 0.0}}
#: Share of full voltage per rad and unit of the XL330's firmware gain.
_XL330 = 4096 / (2 * np.pi) / (256 * 885)


@dataclass(frozen=True)
class Case:
    """One fit. `held`: what it is reported on, each with the target; `part`: the last share of the log, which is held out.
    `options`: effects and constants of the law beside each other, chosen by the error on halves of the training logs in turn.
    `together`: rows whose published value is one error over all their logs."""

    name: str
    urdf: str
    fit: tuple[str, ...]
    held: Mapping[str, float]
    law: Mapping[str, Any]
    options: tuple[tuple[tuple[str, ...], Mapping[str, Any]], ...] = ((DRIVE, {}),)
    joints: tuple[str, ...] | None = None
    part: float = 0.0
    kind: str = "pd_position"
    together: str = ""


def cases(short: bool) -> list[Case]:
    """All of them; the short run leaves out those that take minutes."""
    gains = {"*april*": {"kp": [20.0, 20.0, 40.0] * 4, "kd": [1.0, 1.0, 2.0] * 4}, "*march*": {"kp": 20.0, "kd": 1.5}}
    found = [
        Case(f"AK80 {one} -> {other}", "ak80_pendulum/ak80_pendulum.urdf", (f"ak80_{one}",), {f"ak80_{other}": 0.010}, both, AK80)
        for both in ({"kp": "identify", "kd": "identify", "effort_limit": 12.0, "by_log": NOT_SENT},)
        for one, other in (("sysid_stiff", "dircol"), ("dircol", "sysid_stiff"))
    ]
    # The drive of the ankle (Robstride 02) is sent kd as a share of 5 N m s/rad, the most it has: the 8 of the settings are 5 there.
    for number, joint, kp, kd in (
        ("41_hip_pitch_rs04", "dof_right_hip_pitch_04", 150.0, 8.0),
        ("43_hip_yaw_rs03", "dof_right_hip_yaw_03", 100.0, 4.0),
        ("45_ankle_rs02", "dof_right_ankle_02", 40.0, 5.0),
    ):
        law = {"kp": kp, "kd": kd, "links": "identify", "command": "ramp", "by_log": {"*chirp*": {"velocity_command": "derivative"}}}
        step = {f"kbot_{number}_step": 0.004}
        found.append(Case(f"K-Bot {number}", "kbot_robstride/kbot_right_leg.urdf", (f"kbot_{number}_chirp",), step, law, joints=(joint,)))
    if short:
        return found
    duty = {f"*kp{k}_*": {"kp": _XL330 * k} for k in (100, 200, 400, 800)}
    servo = ((LOADED, GEAR), *((LOADED, {**more, **SPRING}) for more in (GEAR, *SLOW)))
    every = sorted(f.name.removesuffix(".csv.gz") for f in (data() / "xl330_pendulum").glob("*.csv.gz"))
    for held in ("kp100_sin_sin", "kp200_up_and_down", "kp400_lift_and_drop", "kp400_sin_time_square", "kp800_up_and_down"):
        rest = tuple(name for name in every if name != f"xl330_{held}")
        name = f"XL330 without {held}"
        urdf = "xl330_pendulum/xl330_pendulum.urdf"
        found.append(
            Case(name, urdf, rest, {f"xl330_{held}": 0.060}, {"by_log": duty, "supply": "mean"}, servo, kind="pwm", together="XL330")
        )
    z1 = {"kp": [80.0, 120.0, 120.0, 80.0, 80.0, 80.0, 80.0], "kd": 2.5}
    found.append(Case("Z1 last third", "z1_iit/z1.urdf", ("z1_traj0",), {"z1_traj0 (last part)": 0.0150}, z1, part=1 / 3))
    april = {"go2_april_traj4": 0.0023, "go2_march_traj0": 0.0095}
    found.append(
        Case(
            "Go2 one April log",
            "go2_iit/go2.urdf",
            ("go2_april_traj1",),
            april,
            {"by_log": gains},
            ((DRIVE, {}), (LOADED, {}), (SPRUNG, {}), (SPRUNG, EACH)),
        )
    )
    return found


def data() -> Path:
    """The folder of actuator logs."""
    named = os.environ.get("IDENT_DATA")
    return (Path(named) if named else Path(__file__).resolve().parents[3] / "shared/data") / "actuators"


def fitted(case: Case) -> tuple[DriveFit, int]:
    """Fit one case, with its error on each held-out log, and which of its options was chosen."""
    folder = data() / Path(case.urdf).parent
    robot = ident.Robot.from_urdf(data() / case.urdf, joints=case.joints)
    logs = _logs(folder, case.fit, robot)
    if case.part:
        train, held = logs.split(by="fraction", held=case.part)
    else:
        train, held = logs, _logs(folder, tuple(case.held), robot)
    pairs = [(_model(robot, effects), DriveLaw.of(robot, case.kind, **{**case.law, **more})) for effects, more in case.options]
    found = []
    for model, law in pairs:
        plant = DrivePlant(model, law, drive_logs(train, robot, law))
        at, sizes = starts(plant)
        fit = search(plant, at, sizes, narrower=_narrower(found, plant, sizes))
        found.append((plant, fit, sizes))
    # What is chosen between is fitted to all readings alike, as they are counted in the choice.
    chosen = 0 if len(found) == 1 else best([held_out(*one) for one in found])
    plant, fit, sizes = found[chosen]
    return finished(plant, steadied(plant, fit, sizes), sizes, train.inputs).with_heldout(held, train), chosen


def _narrower(found: Sequence[tuple[DrivePlant, Fitted, np.ndarray]], plant: DrivePlant, sizes: np.ndarray) -> np.ndarray | None:
    """Values (S, p) of a plant at which it is what a narrower one was fitted to: what that one has not adds nothing there.
    `sizes` (p,): usual sizes of the unknowns."""
    rows = []
    for other, fit, _ in found:
        if {u.place for u in other.unknowns} <= {u.place for u in plant.unknowns} and _alike_when_slow(other, plant):
            known = {u.name: value for u, value in zip(other.unknowns, fit.values, strict=True)}
            shared = {u.place: known[u.name] for u in other.unknowns if u.joint < 0 and u.column < 0}
            rows.append([known.get(u.name, shared.get(u.place, _none(other, u))) for u in plant.unknowns])
    return np.where(np.isinf(rows), RIGID * sizes, rows) if rows else None


def _none(plant: DrivePlant, unknown: Unknown) -> float:
    """What a plant has where the unknown is none of its own: a number of its law, or an effect that is not there."""
    return float(plant.law.constants[unknown.place][unknown.joint]) if unknown.place in plant.law.constants else 0.0


def _alike_when_slow(one: DrivePlant, other: DrivePlant) -> bool:
    """Whether friction of the gear grows below the same speed, where it does in the first one."""
    slow = any(u.place == "gear_loss_slow" for u in one.unknowns)
    return not slow or bool(np.array_equal(one.law.constants["slow_speed"], other.law.constants["slow_speed"]))


def _model(robot: ident.Robot, effects: Sequence[str]) -> ident.Model:
    model = robot.rigid_body()
    for name in effects:
        model = model + ident.make_effect(name)
    return model


def _logs(folder: Path, names: Sequence[str], robot: ident.Robot) -> ident.LogSet:
    return ident.read_logs([str(folder / f"{name}.csv.gz") for name in names], robot)


def main(short: bool, folder: Path) -> int:
    """Print the table of known truths, and one line per held-out real log; the summary of each fit goes to `folder`."""
    coverage.main(short, folder)
    print()
    if not data().is_dir():
        print(f"not run: no logs in {data()}; set IDENT_DATA")
        return 0
    rows = []
    print(f"{'fit':<34}{'held out':<30}{'fit rad':>9}{'held rad':>10}{'target':>8}{'s':>6}  delay ms (95 %)  option")
    for case in cases(short):
        begin = time.perf_counter()
        fit, chosen = fitted(case)
        spent = time.perf_counter() - begin
        delay = ", ".join(f"{1e3 * v:.1f} ({1e3 * a:.1f} … {1e3 * b:.1f})" for v, a, b in fit.delay_interval().values())
        for name, target in case.held.items():
            held = _rms(fit.heldout_logs[name])
            met = "met" if held <= target else "not met"
            left = f"{case.name:<34}{name:<30}{_rms(fit.fit_rms):>9.4f}{held:>10.4f}{target:>8.4f}{spent:>6.0f}"
            print(f"{left}  {delay}  {met}  {chosen}", flush=True)
            rows.append({"case": case.name, "held": name, "rms": held, "target": target, "together": case.together, "fit": fit.to_dict()})
        (folder / f"actuators_{case.name.replace(' ', '_').replace('->', 'to')}.txt").write_text(fit.summary() + "\n")
    for name in dict.fromkeys(row["together"] for row in rows if row["together"]):
        error, target = _pooled([row for row in rows if row["together"] == name])
        print(f"{f'{name}, one error over these logs':<64}{'':>9}{error:>10.4f}{target:>8.4f}  {'met' if error <= target else 'not met'}")
    (folder / "actuators.json").write_text(json.dumps(jsonable(rows), indent=1))
    print("fit, held: rms over joints of simulated less measured position, open loop from the first sample under the logged commands")
    return 0


def _pooled(rows: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """Root mean square over all readings of the rows' logs, and the target of all."""
    (target,) = {row["target"] for row in rows}
    count = [len(pd.read_csv(next(data().rglob(f"{row['held']}.csv.gz")), usecols=[0])) for row in rows]
    return float(np.sqrt(np.average([row["rms"] ** 2 for row in rows], weights=count))), target


def _rms(by_joint: Any) -> float:
    return float(np.sqrt(np.mean(np.square(by_joint))))
