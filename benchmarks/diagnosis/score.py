"""What the diagnosis makes of a case, and whether that is right: the record of one case."""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident import estimators as es
from ident import friction as fr
from ident.effects.base import Effect
from ident.logs.log import Log, LogSet
from ident.model import Model
from ident.problem.problem import Problem
from ident.robots.robot import Robot
from ident.robots.transmission import Side
from ident.signals import Signals, ZeroPhase
from ident.signals.reversing import without_reversals
from ident.statistics.torque_error import number
from ident.study.session import like

from .arms import Arm, arm
from .oracle import Oracle, residual, rms, same_place
from .wide_band import analysis_signals

Array = np.ndarray
#: The last part of each log, which neither fit nor selection sees.
HELD = 0.25
#: Cut-off (Hz) that every held-out part is long enough for.
_SHORTEST = 5.0
#: A rival of an ambiguous finding is named from this probability on.
_NAMED = 0.05


@dataclass(frozen=True, eq=False)
class Loaded:
    """A case at hand: the arm, the declared model, both parts of the log, the standard deviation (n,) of the torque
    reading's noise, or all that disturbs it (N, n)."""

    arm: Arm
    model: Model
    fit: Signals
    held: Signals
    noise: Array


@cache
def _arm(name: str) -> Arm:
    return arm(name)


def load(folder: Path, record: dict[str, Any]) -> Loaded:
    """Read a case of `generate.py`; what is `undeclared` is left out of the model."""
    with np.load(folder / f"{record['id']}.npz") as data:
        a = _arm(record["arm"])
        tau = {a.robot.transmission.measured.value: data["tau"]}
        wanted = {f"q_ref{j + 1}": data["q_ref"][:, j] for j in range(a.robot.n)} if "q_ref" in data else {}
        logs = LogSet((Log(record["id"], data["t"], q=data["q"], tau=tau, extra=wanted),), robot=a.robot)
        noise = data["noise"]
    fit, held = logs.split(by="fraction", held=HELD)
    model = a.robot.rigid_body()
    for kind, name in ((fr.RotorInertia, "rotor_inertia"), (fr.Viscous, "viscous"), (fr.Coulomb, "coulomb")):
        out = {j for p in record["parts"] if p["undeclared"] == name for j in p["joints"]}
        kept = tuple(j for j in a.robot.joint_names if j not in out)
        model = model + (kind(joints=kept) if out else kind())
    signals = ZeroPhase()(fit)
    try:
        late = like(signals.report.to_dict())(held)
    except ident.DataError:
        # Too short for so low a cut-off; the diagnosis prepares both anew with a wider band anyway.
        late = ZeroPhase(cutoff_hz=_SHORTEST)(held)
    return Loaded(a, model, signals, late, noise)


def run(folder: Path, record: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a case; everything that the tables need."""
    warnings.simplefilter("ignore")
    begin = time.process_time()
    case = load(folder, record)
    before = es.WeightedLeastSquares().solve(Problem(case.model, case.fit))
    start, wall = time.process_time(), time.perf_counter()
    found = ident.diagnose(before, case.held)
    seconds, wall = time.process_time() - start, time.perf_counter() - wall
    fit, late = analysis_signals(case.fit, case.held)
    held = without_reversals(late) if late is not None else case.held
    floor = _floor(fit, case.noise)
    oracle = Oracle(found, fit, held, floor)

    def of_fitted_part(estimate: Any) -> Any:
        # Where both parts were searched together, the diagnosis' own fits have seen the rows that are to judge them.
        return estimate if found.held is not None else oracle.refitted(estimate.model, estimate.all_values)

    declared, after = of_fitted_part(found.before), of_fitted_part(found.after)
    out: dict[str, Any] = {
        "id": record["id"],
        "arm": record["arm"],
        "kind": record["kind"],
        "parts": record["parts"],
        "size": [p[2] for p in record["case"]["parts"]],
        "verdict": found.verdict,
        "findings": [{**f.to_dict(), "evidence": f.evidence, "motors": getattr(f.effect, "motors", None)} for f in found.findings],
        "unexplained": [u.to_dict() for u in found.unexplained],
        "seconds": seconds,
        "wall_seconds": wall,
        "both_parts": found.held is None,
        "before": _ratio(declared, held, floor),
        "after": _ratio(after, held, floor),
        "reported_floor": _ratio(after, held, np.asarray(found.noise_floor)),
        "trail": list(found.trail),
    }
    if record["kind"] in ("single", "pair"):
        true, out["oracle"] = oracle.parts(record["parts"])
        out["named"] = [_named(oracle, found.findings, part, i, true) for i, part in enumerate(record["parts"])]
    out["coverage"] = _coverage(found, record["parts"])
    out["whole_seconds"] = time.process_time() - begin
    return out


def _floor(signals: Signals, noise: Array) -> Array:
    """Standard deviation (n,) behind the row filter of what disturbs the torque (N, n), or of its noise (n,), whose colour is 0.3."""
    from scipy.signal import lfilter

    if noise.ndim == 2:
        rows = signals.row_filter.apply(noise) if signals.row_filter is not None else noise
        return np.asarray(np.std(rows, axis=0))

    rng = np.random.default_rng(0)
    x = lfilter([np.sqrt(1 - 0.3**2)], [1.0, -0.3], rng.normal(size=200_000))
    return noise * (float(np.std(signals.row_filter.apply(x[:, None]))) if signals.row_filter is not None else 1.0)


def _ratio(estimate: Any, held: Signals, floor: Array) -> list[float | None]:
    """Held-out rms over a noise floor: over all joints together, then joint by joint."""
    scaled = residual(estimate, held) / floor
    return [number(float(x)) for x in (*rms(scaled.reshape(-1, 1)), *rms(scaled))]


def is_part(effect: str, joints: Sequence[str], motors: Sequence[str] | None, part: dict[str, Any], names: Sequence[str]) -> bool:
    """Whether a name and place are those of a true part; of a coupling, the motor too. `names`: of the robot's joints."""
    if effect != part["effect"] or not same_place(joints, part["joints"]):
        return False
    return not motors or "motor" not in part["truth"] or names[int(part["truth"]["motor"])] in motors


def _named(oracle: Oracle, findings: Sequence[Any], part: dict[str, Any], i: int, true: Sequence[Effect | None]) -> dict[str, Any]:
    """How a true part is named: by which finding, directly ("found"), as its other name ("same": the very columns on this motion, told
    beside it), or as the rival of an ambiguous one ("rival"), else "no".

    Where it is not called by its name, or the finding is ambiguous: whether the other one (the rival, or what stands in the truth's place)
    truly foretells the held-out data as well as the truth, all other true parts being in the model."""
    names = oracle.found.before.model.robot.joint_names
    beside = [e for k, e in enumerate(true) if k != i and e is not None]
    truth = true[i]

    def told(how: str, place: int, other: Effect | None) -> dict[str, Any]:
        check = {"as_good": None} if other is None or truth is None else oracle.as_good(other, truth, beside)
        return {"how": how, "finding": place, **check}

    for place, f in enumerate(findings):
        if is_part(f.name, f.joints, getattr(f.effect, "motors", None), part, names):
            if not f.ambiguous:
                return told("found", place, None)
            rival = max(f.competing, key=lambda m: m.confidence)
            return told("found, ambiguous", place, oracle.rival(rival.effect, rival.joints))
    for place, (f, x) in enumerate(zip(findings, oracle.found.decision.named, strict=True)):
        if any(m.renamed and is_part(m.effect.name, m.joints, getattr(m.effect, "motors", None), part, names) for m in x.competing):
            return told("same", place, f.effect)
        if not f.ambiguous:
            continue
        if any(m.confidence >= _NAMED and is_part(m.effect, m.joints, None, part, names) for m in f.competing):
            return told("rival", place, f.effect)
    return {"how": "no", "finding": None, "as_good": None}


def _coverage(found: Any, parts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each parameter of a rightly named finding whose truth is known: its error over its standard deviation."""
    names = found.before.model.robot.joint_names
    out = []
    for part in parts:
        for f in found.findings:
            if not is_part(f.name, f.joints, getattr(f.effect, "motors", None), part, names):
                continue
            for p in f.parameters:
                symbol = _symbol(p.name, names, part["truth"])
                if symbol and np.isfinite(p.std) and p.std > 0:
                    factor = _orders_per_order(f.effect, found.before.model.robot) if symbol == "order" else 1.0
                    truth = part["truth"][symbol]
                    out.append({"effect": f.name, "parameter": symbol, "value": factor * p.value, "std": factor * p.std, "truth": truth})
    return out


def _orders_per_order(effect: Effect, robot: Robot) -> float:
    """What an order found is in cycles of the angle that the truth counts: the usual side of the effect."""
    if not hasattr(effect, "angle"):
        return 1.0
    side, usual = effect.angle, type(effect).__dataclass_fields__["angle"].default
    j = effect.at(robot)[0]
    ratio = float(abs(robot.transmission.K_inverse[j, j]))
    return 1.0 if side == usual else ratio if usual == Side.JOINT else 1.0 / ratio


def _symbol(name: str, joints: Sequence[str], truth: dict[str, float]) -> str:
    """The symbol under which a parameter's truth is known; "" where it is not."""
    for _ in range(2):
        for joint in joints:
            name = name.removesuffix(f"_{joint}")
    name = name.replace("+", "")
    return next((s for s in (name, name.rsplit("_", 1)[-1]) if s in truth), "")


def read_cases(folder: Path) -> list[dict[str, Any]]:
    """The records of `generate.py`."""
    return [json.loads(line) for line in (folder / "cases.jsonl").read_text().splitlines()]


def part_is_named(named: dict[str, Any]) -> bool:
    """Whether a true part counts as named: found for sure, or ambiguous with a rival that truly does as well."""
    return named["how"] == "found" or (named["how"] != "no" and bool(named["as_good"]))


def right(record: dict[str, Any]) -> dict[str, bool]:
    """Judgement of one single-fault or pair case.

    `top`: the first finding is a true effect on its joint (an ambiguous one counts where the rival truly does as well); `only`:
    nothing beside what is true; `all`: every true part is named, and only those."""
    named = record.get("named", [])
    good = [n for n in named if part_is_named(n)]
    top = any(n["finding"] == 0 for n in good)
    return {
        "top": top,
        "only": len(record["findings"]) <= len(record["parts"]),
        "all": len({n["finding"] for n in good}) == len(record["parts"]) == len(record["findings"]),
    }
