"""Instrumental variables and output error (DIDIM) on real logs: how each log came about, and what the methods make of it.

EMPS logs its reference, and its controller is published. TX40 logs no reference: the measured motion below 10 Hz stands for it
(hardly any noise of the encoders is left in it), and for DIDIM a controller tuned on the fit."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident import Estimate, Problem
from ident._utils.json import jsonable
from ident.effects.motion import Coordinates
from ident.errors import DataError, IdentError
from ident.estimators import Desired, Estimator, Experiment, assumed_experiment, make_estimator
from ident.robots.robot import Robot
from ident.simulation.controller import Controller, Law
from ident.study.session import Session
from ident.study.study import read_study

HERE = Path(__file__).parent
#: Published values (value, standard deviation or None) and relative torque error in %, from the notes beside the logs.
EMPS = {"m_axis": (95.1089, 0.1085), "Fv_axis": (203.5034, 1.146), "Fc_axis": (20.3935, 0.1012), "offset_axis": (-3.1648, 0.0444)}
EMPS_ERROR = 4.0834
#: Closed-loop simulation with the published values: relative error of the force in %.
EMPS_SIMULATED = 5.848


@dataclass(frozen=True, kw_only=True)
class PositionCascade(Controller):
    """τ = kv (kp (q_desired − q) − v): position loop over a velocity loop without feedforward. `kp` 1/s, `kv` torque per speed.

    v is the difference of positions that are averaged over two samples, as in the drive of EMPS: it comes one sample late."""

    kp: float
    kv: float

    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        past: deque[np.ndarray] = deque(maxlen=3)

        def torque(k: int, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
            past.append(q.copy())
            speed = (past[-1] - past[0]) / (2.0 * period) if len(past) == 3 else dq
            return self.saturated(self.kv * (self.kp * (desired.q[k] - q) - speed))

        return torque


def problem(name: str) -> tuple[Session, Problem]:
    """The whole log of a study beside this module. Raises DataError where it is not here."""
    session = Session(read_study(HERE / f"{name}.toml"))
    return session, Problem(session.model, session.study.make_preparation()(session.recorded))


def emps_experiment(session: Session) -> Experiment:
    """As the note beside the log says: kp 160.18 1/s, kv 243.45 V/(m/s), 35.150652 N/V, at 1 kHz."""
    desired = Desired.from_log(session.recorded[0], ["q1_ref_m"])
    loop = PositionCascade(side="joint", kp=160.18, kv=243.45 * 35.150652)
    return Experiment(controller=loop, desired={"*": desired}, window_s=2.5, settle_s=0.2)


def tx40_experiment(session: Session, fitted: Estimate) -> Experiment:
    """No reference is logged: what `assumed_experiment` supposes, on the model as fitted."""
    return assumed_experiment(session.recorded, session.model, fitted.all_values, 10.0)


def attempts(short: bool) -> Iterator[tuple[str, str, Estimator, Problem]]:
    """Log, label, method and problem of every row of the table; `short`: what takes seconds."""
    session, p = problem("emps")
    experiment = emps_experiment(session)
    yield "emps", "weighted least squares", make_estimator("wls"), p
    yield "emps", "IV, loop simulated", make_estimator("iv", instruments="simulation", loop="closed", experiment=experiment), p
    yield "emps", "IV, along the reference", make_estimator("iv", instruments="reference", loop="closed", experiment=experiment), p
    yield "emps", "IV, measured torque (loop not told)", make_estimator("iv"), p
    yield "emps", "DIDIM", make_estimator("didim", experiment=experiment, starts=1), p
    session, p = problem("tx40")
    fitted = make_estimator("wls")
    yield "tx40", "weighted least squares", fitted, p
    yield "tx40", "DIDIM, told nothing (no reference logged)", make_estimator("didim"), p
    if short:
        return
    supposed = tx40_experiment(session, fitted.solve(p))
    instruments = make_estimator("iv", instruments="reference", loop="closed", experiment=supposed)
    yield "tx40", "IV, along the motion below 10 Hz", instruments, p
    yield "tx40", "IV, measured torque (loop not told)", make_estimator("iv"), p
    slower = Problem(session.model, replace(session.study.make_preparation(), resample_hz=1000.0)(session.recorded))
    yield "tx40", "weighted least squares, log at 1 kHz", fitted, slower
    yield "tx40", "DIDIM, log at 1 kHz, tracking the motion below 10 Hz", make_estimator("didim", experiment=supposed, starts=1), slower


def compared(log: str, p: Problem, found: Estimate) -> list[str]:
    """Value ± standard deviation of what is published, beside it: a line a parameter."""
    if log == "emps":
        return [
            f"{name:<14}{found.value(name):>10.3f} ± {found.std[found.index(name)]:<8.3f} published {value:.3f} ± {std:.3f}"
            for name, (value, std) in EMPS.items()
        ]
    return [f"{name:<14}{value:>10.3f} ± {std:<8.3f} published {told:.3f}" for name, value, std, told in published_friction(p, found)]


def published_friction(p: Problem, found: Estimate) -> Iterator[tuple[str, float, float, float]]:
    """TX40's friction on the joint side: name, value, standard deviation, and the published value."""
    published = json.loads((Path(p.signals.source.inputs[0]["path"]).parent / "reference_drive_parameters.json").read_text())
    robot = p.model.robot
    for j, joint in enumerate(robot.joint_names[:5]):
        # Friction of motor 6 also acts on joint 5, and is within the published viscous value.
        ratio = abs(1 / robot.transmission.K[j, j])
        for symbol, key, power in (("Fv", "fv", 2), ("Fc", "fc", 1)):
            name = f"{symbol}_{joint}"
            extra = published["fvm6"] if (symbol, j) == ("Fv", 4) else 0.0
            yield name, found.value(name) * ratio**power, found.std[found.index(name)] * ratio**power, published[key][j] - extra


def main(short: bool, folder: Path) -> int:
    """Print the table; write `real_iv_didim.json`."""
    kept = []
    try:
        for log, label, method, p in attempts(short):
            begin = time.perf_counter()
            print(f"{log}: {label}")
            try:
                found = method.solve(p)
            except IdentError as error:
                print(f"    refused: {error}")
                kept.append({"log": log, "method": label, "refused": str(error)})
                continue
            seconds = time.perf_counter() - begin
            print(f"    {found.status.code.value}, torque error {100 * found.fit_error.relative_all:.2f} %, {seconds:.1f} s")
            print("\n".join("    " + line for line in compared(log, p, found)), flush=True)
            kept.append({"log": log, "method": label, "seconds": seconds, "estimate": found.to_dict()})
    except DataError as error:
        print(f"not run: {error}")
    print(f"published errors: EMPS {EMPS_ERROR} % (least squares), {EMPS_SIMULATED} % (force of the simulated loop; compare with DIDIM)")
    (folder / "real_iv_didim.json").write_text(json.dumps(jsonable(kept), indent=1))
    return 0
