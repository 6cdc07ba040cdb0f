"""What the diagnosis makes of a case, and whether that is right: the record of one case."""

from __future__ import annotations

import json
import time
import warnings
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident import estimators as es
from ident import friction as fr
from ident.diagnosis.analysis import without_reversals
from ident.diagnosis.candidates import candidates
from ident.logs import Log, LogSet
from ident.model import Model
from ident.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.torque_error import number

from .arms import Arm, arm

Array = np.ndarray
#: The last part of each log, which neither fit nor selection sees.
HELD = 0.25
#: The true effect counts as detectable if, handed to the refit, it lowers the held-out loss by this much (twice a
#: log-likelihood; chance reaches it once in a thousand), and by three of its standard errors over blocks of time.
DETECTABLE = 10.8
_BLOCKS = 12


@dataclass(frozen=True, eq=False)
class Loaded:
    """A case at hand: the arm, the declared model, both parts of the log, the noise of the torque reading (n,)."""

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
        logs = LogSet((Log(record["id"], data["t"], q=data["q"], tau=tau),), robot=a.robot)
        noise = data["noise"]
    fit, held = logs.split(by="fraction", held=HELD)
    model = a.robot.rigid_body()
    for kind, name in ((fr.RotorInertia, "rotor_inertia"), (fr.Viscous, "viscous"), (fr.Coulomb, "coulomb")):
        out = {j for p in record["parts"] if p["undeclared"] == name for j in p["joints"]}
        kept = tuple(j for j in a.robot.joint_names if j not in out)
        model = model + (kind(joints=kept) if out else kind())
    prepare = ZeroPhase()
    return Loaded(a, model, prepare(fit), prepare(held), noise)


def run(folder: Path, record: dict[str, Any]) -> dict[str, Any]:
    """Diagnose a case; everything that the tables need."""
    warnings.simplefilter("ignore")
    begin = time.process_time()
    case = load(folder, record)
    before = es.WeightedLeastSquares().solve(Problem(case.model, case.fit))
    start = time.process_time()
    found = ident.diagnose(before, case.held)
    seconds = time.process_time() - start
    held = without_reversals(found.held) if found.held is not None else case.held
    floor = _floor(found.signals, case.noise)
    out: dict[str, Any] = {
        "id": record["id"],
        "arm": record["arm"],
        "kind": record["kind"],
        "parts": record["parts"],
        "size": [p[2] for p in record["case"]["parts"]],
        "verdict": found.verdict,
        "findings": [f.to_dict() for f in found.findings],
        "unexplained": [u.to_dict() for u in found.unexplained],
        "seconds": seconds,
        "before": _ratio(before=found.before, held=held, floor=floor),
        "after": _ratio(before=found.after, held=held, floor=floor),
        "trail": list(found.trail),
    }
    if record["kind"] == "single" and record["parts"]:
        out["oracle"] = _oracle(found, record["parts"][0], held, floor)
    out["coverage"] = _coverage(found, record["parts"])
    out["whole_seconds"] = time.process_time() - begin
    return out


def _floor(signals: Signals, noise: Array) -> Array:
    """Standard deviation (n,) that the torque noise of the generator (colour 0.3) has behind the row filter."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(0)
    x = lfilter([np.sqrt(1 - 0.3**2)], [1.0, -0.3], rng.normal(size=200_000))
    return noise * (float(np.std(signals.row_filter.apply(x[:, None]))) if signals.row_filter is not None else 1.0)


def _residual(estimate: Any, held: Signals) -> Array:
    """Residual (M, n) on held-out rows, NaN where not used."""
    problem = Problem(estimate.model, held, reference=estimate.all_values)
    out = np.full(held.tau.shape, np.nan)
    values = problem.base.base_values(estimate.all_values)
    for rows in problem.rows():
        out[rows.place] = held.tau[rows.place] - rows.columns @ values
    return np.where(held.valid, out, np.nan)


def _ratio(before: Any, held: Signals, floor: Array) -> list[float | None]:
    """Held-out rms over the noise floor: over all joints together, then joint by joint."""
    scaled = _residual(before, held) / floor
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [number(float(np.sqrt(np.nanmean(scaled**2)))), *(number(float(x)) for x in np.sqrt(np.nanmean(scaled**2, axis=0)))]


def _oracle(found: Any, part: dict[str, Any], held: Signals, floor: Array) -> dict[str, Any]:
    """Held-out gain of the true effect, its shapes as they truly are, refitted with the whole declared model; the best of its
    configurations (an angle on either side)."""
    stage = found.selection.declared
    before = _residual(found.before, held) / floor
    blocks = [rows for run in held.row_runs for rows in np.array_split(np.arange(run.start, run.stop), _BLOCKS)]
    best: dict[str, Any] = {"gain": 0.0, "error": 0.0, "detectable": False, "after": None}
    motion = stage.motions.parts[0][1]
    mine = [c for c in candidates(stage.problem.model, motion) if c.name == part["effect"] and _same_place(c.joints, part["joints"])]
    tried = []
    for candidate in mine:
        shapes = {p.name: part["truth"][p.name] for p in candidate.variants[0].shape() if p.name in part["truth"]}
        full = len(shapes) == len(candidate.variants[0].shape())
        for variant in candidate.variants[:1] if full else candidate.variants:
            try:
                tried.append(variant.with_shape(**shapes) if shapes else variant)
            except ident.IdentError:
                continue
    for effect in tried:
        estimate = es.WeightedLeastSquares().solve(Problem(found.before.model + effect, found.signals, reference=_reference(found, effect)))
        after = _residual(estimate, held) / floor
        gains = np.array([np.nansum(before[rows] ** 2) - np.nansum(after[rows] ** 2) for rows in blocks])
        gain, error = float(gains.sum()), float(np.sqrt(len(gains)) * gains.std(ddof=1))
        if gain > best["gain"]:
            best = {"gain": gain, "error": error, "detectable": gain > DETECTABLE and gain > 3.0 * error}
            best["after"] = number(float(np.sqrt(np.nanmean(after**2))))
    return best


def _reference(found: Any, effect: Any) -> Array:
    robot = found.before.model.robot
    return np.append(found.before.all_values, np.zeros(len(effect.parameters(robot))))


def _same_place(joints: tuple[str, ...], wanted: list[str]) -> bool:
    return not joints or not wanted or tuple(joints) == tuple(wanted)


def _coverage(found: Any, parts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each parameter of a rightly named finding whose truth is known: its error over its standard deviation."""
    out = []
    for part in parts:
        for f in found.findings:
            if f.name != part["effect"] or not _same_place(f.joints, part["joints"]):
                continue
            for p in f.parameters:
                symbol = p.name if p.name in part["truth"] else p.name.split("_joint")[0]
                if symbol in part["truth"] and np.isfinite(p.std) and p.std > 0:
                    out.append({"effect": f.name, "parameter": symbol, "z": (p.value - part["truth"][symbol]) / p.std})
    return out


def read_cases(folder: Path) -> list[dict[str, Any]]:
    """The records of `generate.py`."""
    return [json.loads(line) for line in (folder / "cases.jsonl").read_text().splitlines()]


def right(record: dict[str, Any]) -> dict[str, bool]:
    """Judgement of one single-fault or pair case.

    `top`: the first finding is the true effect on its joint, or the verdict is ambiguous and names it as a rival; `only`: nothing
    else beside it (a rival in its place counts as it); `all`: every true part is named, and only those."""
    wanted = [(p["effect"], tuple(p["joints"])) for p in record["parts"]]
    findings = record["findings"]

    def names(f: dict[str, Any], part: tuple[str, tuple[str, ...]]) -> bool:
        if f["effect"] == part[0] and _same_place(tuple(f["joints"]), list(part[1])):
            return True
        if record["verdict"] not in ("ambiguous", "unexplained"):
            return False
        rivals = [i for i in f["imitators"] if i["confidence"] >= 0.05 and sum(x["confidence"] for x in f["imitators"]) >= 0.2]
        return any(i["effect"] == part[0] and _same_place(tuple(i["joints"]), list(part[1])) for i in rivals)

    top = bool(findings) and any(names(findings[0], part) for part in wanted)
    named = [any(names(f, part) for f in findings) for part in wanted]
    return {"top": top, "only": len(findings) <= len(wanted), "all": all(named) and len(findings) == len(wanted)}
