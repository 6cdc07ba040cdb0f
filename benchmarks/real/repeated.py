"""Instrumental variables and output error (DIDIM) on real logs: how each log came about, and what the methods make of it.

EMPS logs its reference, and its controller is published. TX40 logs no reference: what can be done is shown instead, with the
measured motion below 5 Hz for the reference (hardly any noise of the encoders is left in it) and a controller tuned on the fit."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ident import Estimate, Problem
from ident.controller import Controller, Law, PDFeedforward
from ident.errors import DataError, IdentError
from ident.estimators import Desired, Estimator, Experiment, make_estimator
from ident.motion import Coordinates
from ident.results import jsonable
from ident.robot import Robot
from ident.session import Session
from ident.study import read_study

HERE = Path(__file__).parent
#: Published values (value, standard deviation or None) and relative torque error in %, from the notes beside the logs.
EMPS = {"m_axis": (95.1089, 0.1085), "Fv_axis": (203.5034, 1.146), "Fc_axis": (20.3935, 0.1012), "offset_axis": (-3.1648, 0.0444)}
EMPS_ERROR = 4.0834
#: Closed-loop simulation with the published values: relative error of the force in %.
EMPS_SIMULATED = 5.848


@dataclass(frozen=True, kw_only=True)
class PositionCascade(Controller):
    """τ = kv (kp (q_desired − q) − dq): position loop over a velocity loop without feedforward. `kp` 1/s, `kv` torque per speed."""

    kp: float
    kv: float

    def law(self, robot: Robot, desired: Coordinates, period: float) -> Law:
        return lambda k, q, dq: self.saturated(self.kv * (self.kp * (desired.q[k] - q) - dq))


def problem(name: str) -> tuple[Session, Problem]:
    """The whole log of a study beside this module. Raises DataError where it is not here."""
    session = Session(read_study(HERE / f"{name}.toml"))
    return session, Problem(session.model, session.study.make_preparation()(session.recorded))


def emps_experiment(session: Session) -> Experiment:
    """As the note beside the log says: kp 160.18 1/s, kv 243.45 V/(m/s), 35.150652 N/V, at 1 kHz."""
    desired = Desired.from_log(session.recorded[0], ["q1_ref_m"])
    loop = PositionCascade(side="joint", kp=160.18, kv=243.45 * 35.150652)
    return Experiment(controller=loop, desired={"*": desired}, window_s=2.5, settle_s=0.2)


def tx40_experiment(session: Session) -> Experiment:
    """No reference is logged: the measured motion below 5 Hz stands for it, for instruments alone; the controller plays no part."""
    from scipy.interpolate import make_interp_spline

    from ident.filters import zero_phase_lowpass

    log = session.recorded[0]
    rate = (len(log.t) - 1) / float(log.t[-1] - log.t[0])
    every = max(1, round(rate / 200.0))
    t, q = log.t[::every], zero_phase_lowpass(log.position(session.robot.transmission), 5.0, rate)[::every]
    spline = make_interp_spline(t, q, k=5)
    desired = Desired(t, Coordinates(q, spline(t, 1), spline(t, 2)))
    return Experiment(controller=PDFeedforward(kp=1.0, kd=1.0), desired={"*": desired})


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
    yield "tx40", "weighted least squares", make_estimator("wls"), p
    yield "tx40", "DIDIM (no reference logged)", make_estimator("didim"), p
    if short:
        return
    instruments = make_estimator("iv", instruments="reference", loop="closed", experiment=tx40_experiment(session))
    yield "tx40", "IV, along the motion below 5 Hz", instruments, p
    yield "tx40", "IV, measured torque (loop not told)", make_estimator("iv"), p


def compared(log: str, p: Problem, found: Estimate) -> list[str]:
    """Value ± standard deviation of what is published, beside it: a line a parameter."""
    if log == "emps":
        return [
            f"{name:<14}{found.value(name):>10.3f} ± {found.std[found.index(name)]:<8.3f} published {value:.3f} ± {std:.3f}"
            for name, (value, std) in EMPS.items()
        ]
    published = json.loads((Path(p.signals.source.inputs[0]["path"]).parent / "reference_drive_parameters.json").read_text())
    robot = p.model.robot
    lines = []
    for j, joint in enumerate(robot.joint_names[:5]):
        # Friction of motor 6 also acts on joint 5, and is within the published viscous value.
        ratio = abs(1 / robot.transmission.K[j, j])
        for symbol, key, power in (("Fv", "fv", 2), ("Fc", "fc", 1)):
            name = f"{symbol}_{joint}"
            value, std = found.value(name) * ratio**power, found.std[found.index(name)] * ratio**power
            extra = published["fvm6"] if (symbol, j) == ("Fv", 4) else 0.0
            lines.append(f"{name:<14}{value:>10.3f} ± {std:<8.3f} published {published[key][j] - extra:.3f}")
    return lines


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
