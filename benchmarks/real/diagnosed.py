"""What the diagnosis makes of real logs whose declared model lacks something: verdict, findings, error before and after, time.

Study files lie in `diagnosis/` beside this module; what is known to be missing in each is `KNOWN`. A log that is not done within
a limit is stopped, and the table says so."""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident._utils.json import jsonable
from ident.errors import DataError, IdentError

HERE = Path(__file__).parent / "diagnosis"
#: Seconds of wall time a log may take; a limit of the table, not of the diagnosis.
LIMIT = 600.0
_NOT_HERE = "not run"


@dataclass(frozen=True)
class Missing:
    """What is known to be missing in a study: `effects` any of which names it, on `joint` ("" anywhere), of a coupling by `motor`.
    `beside`: beside this one, which is missing as well, nothing is left of it (the same trace is published under both names)."""

    words: str
    effects: tuple[str, ...]
    joint: str = ""
    motor: str = ""
    beside: str = ""

    def among(self, findings: list[Mapping[str, Any]]) -> bool:
        """Whether a finding names it."""
        return any(self._names(f) for f in findings)

    def told(self, findings: list[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
        """The rivals by which findings of the kind `beside` say that they stand in its place, with its size there."""
        return [m for f in findings if f["effect"] == self.beside for m in f["imitators"] if self._names(m)]

    def _names(self, found: Mapping[str, Any]) -> bool:
        here = not self.joint or self.joint in found["joints"]
        return found["effect"] in self.effects and here and (not self.motor or self.motor in (found.get("motors") or ()))


#: From the notes beside the logs: what the studies leave out.
KNOWN: dict[str, tuple[Missing, ...]] = {
    "emps": (
        Missing("viscous friction that depends on direction", ("asymmetric_viscous",), "axis"),
        Missing("offset", ("offset", "asymmetric_coulomb"), "axis", beside="asymmetric_viscous"),
    ),
    "tx40": (Missing("coupling of joint 6 to motor 5", ("gear_coupling",), "joint_6", "joint_5"),),
    "double_pendulum": (
        Missing("friction of joint 1", ("coulomb", "viscous"), "joint_1"),
        Missing("friction of joint 2", ("coulomb", "viscous"), "joint_2"),
        Missing("load dependence of friction", ("load_dependent_friction",)),
    ),
    "double_pendulum_friction": (
        Missing("load dependence of friction on joint 1", ("load_dependent_friction",), "joint_1"),
        Missing("load dependence of friction on joint 2", ("load_dependent_friction",), "joint_2"),
    ),
    "double_pendulum_released": (),
    "panda": (),
    "tiago": (),
}


def diagnosed(name: str) -> dict[str, Any]:
    """Diagnose one study. Raises DataError where its logs are not here."""
    from ident.diagnosis import diagnose
    from ident.study.session import Session
    from ident.study.study import read_study

    session = Session(read_study(HERE / f"{name}.toml"))
    estimate, held = session.estimate, session.held_signals
    begin, wall = time.process_time(), time.perf_counter()
    found = diagnose(estimate, held, estimator=session.study.make_estimator())
    seconds, wall = time.process_time() - begin, time.perf_counter() - wall
    findings = [{**f.to_dict(), "evidence": f.evidence, "motors": getattr(f.effect, "motors", None)} for f in found.findings]
    comparison, floor = found.comparison, found.noise_floor
    return {
        "study": name,
        "result": found.to_dict(),
        "findings": findings,
        "before": comparison.error_before.relative_all,
        "after": comparison.error_after.relative_all,
        "gain": comparison.gain,
        "gain_std": comparison.gain_std,
        "over_floor": [float(r / f) for r, f in zip(comparison.error_after.rms, floor, strict=True)],
        "seconds": seconds,
        "wall_seconds": wall,
        "known": [{"words": m.words, "named": m.among(findings), "told": m.told(findings)} for m in KNOWN[name]],
        "text": str(found),
        "trail": list(found.trail),
    }


def limited(name: str, limit: float = LIMIT) -> dict[str, Any]:
    """`diagnosed` in a process of its own, stopped at a limit of wall time; `{"failed": why}` where it does not come to an end."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    worker = context.Process(target=_send, args=(name, there), daemon=True)
    worker.start()
    there.close()
    try:
        return dict(here.recv()) if here.poll(limit) else {"study": name, "failed": f"not done within {limit:.0f} s"}
    except EOFError:
        return {"study": name, "failed": "the process ended without an answer"}
    finally:
        if worker.is_alive():
            worker.terminate()
        worker.join()


def _send(name: str, pipe: Any) -> None:
    try:
        pipe.send(jsonable(diagnosed(name)))
    except DataError as error:
        pipe.send({"study": name, "failed": f"{_NOT_HERE}: {error}"})
    except IdentError as error:
        pipe.send({"study": name, "failed": f"refused: {error}"})
    except Exception as error:  # noqa: BLE001 - one log must not lose the others
        pipe.send({"study": name, "failed": f"failed: {error!r}"})


def told(found: Mapping[str, Any]) -> str:
    """One log for people: verdict, errors, findings, and whether what is known to be missing is named."""
    if "failed" in found:
        return f"{found['study']}: {found['failed']}"
    gain = f"squared error {-100 * found['gain']:+.1f} ± {100 * found['gain_std']:.1f} %" if found["gain_std"] is not None else ""
    error = f"held out {100 * found['before']:.2f} -> {100 * found['after']:.2f} %"
    lines = [f"{found['study']}: {found['result']['verdict']}; {error}, {gain}; {found['seconds']:.0f} s"]
    for f in found["findings"]:
        values = ", ".join(_value(p) for p in f["parameters"][:4])
        rivals = "; ".join(f"{m['effect']} {m['confidence']:.2f}" for m in f["imitators"] if m["confidence"] >= 0.05)
        motor = f" (motor of {', '.join(f['motors'])})" if f["motors"] else ""
        where = f" on {', '.join(f['joints'])}{motor}" if f["joints"] else ""
        lines.append(f"    {f['effect']}{where}: {values}; confidence {f['confidence']:.2f}" + (f"; or {rivals}" if rivals else ""))
    lines += [f"    left: {u['evidence']}" for u in found["result"]["unexplained"]]
    lines.append("    after / noise floor: " + " ".join(f"{x:.2f}" for x in found["over_floor"]))
    lines += [f"    known to be missing: {k['words']}: {_how(k)}" for k in found["known"]]
    if found["gain_std"] is not None and not found["gain"] > 0 and found["findings"]:
        lines.append("    WRONG: what was found does not gain on held-out data")
    return "\n".join(lines)


def _how(known: Mapping[str, Any]) -> str:
    if known["named"] or not known["told"]:
        return "named" if known["named"] else "NOT named"
    first = known["told"][0]
    values = ", ".join(f"{p['value']:.3g} {p['unit']}" for p in first["parameters"])
    return f"told as {first['effect']} ({values}), which would take up {100 * first['share']:.0f} % of what a finding explains"


def _value(p: Mapping[str, Any]) -> str:
    doubt = f" ± {p['std']:.2g}" if p["std"] is not None else ""
    return f"{p['name']} = {p['value']:.4g}{doubt} {p['unit']}" if p["value"] is not None else f"{p['name']} unknown"


def main(short: bool, folder: Path) -> int:
    """Print every log; write `real_diagnosis.json`. `short`: the smallest log alone. 1 if one came to no end; logs that are not here do
    not count."""
    kept = []
    print("Diagnosis: declared models that lack something (held-out part: no fit and no selection saw it)")
    for name in ("emps",) if short else KNOWN:
        found = limited(name)
        print(told(found), flush=True)
        kept.append(found)
    (folder / "real_diagnosis.json").write_text(json.dumps(kept, indent=1))
    return int(any(lacks_an_answer(found) for found in kept))


def lacks_an_answer(found: Mapping[str, Any]) -> bool:
    """Whether a log that is here was not diagnosed."""
    return "failed" in found and not str(found["failed"]).startswith(_NOT_HERE)
