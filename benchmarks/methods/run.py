"""The dissertation's comparison on a synthetic PUMA 560: step-by-step, simultaneous and advanced simultaneous identification.

Tables are printed, figures and `methods.json` written. Nothing here is a constant of the comparison but its settings (`data.Scale`)."""

from __future__ import annotations

import html
import io
import json
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import scipy

import ident
from ident._utils.json import jsonable

from . import claims, excitation, figures, plain, tables, verdict
from .convergence import growth
from .data import FULL, SHORT, Data, make_case
from .degradation import sweeps
from .methods import METHODS, Method
from .monte_carlo import Trials, run_trials
from .recursions import recursions
from .trajectories import Forward, forward_errors

#: The short run has one or two of each kind.
_SHORT = ("steps", "ls_raw", "wls", "momentum", "iv_plain", "iv_dynamics", "iv")
_SHORT_LOOP = ("ls_raw", "wls", "iv_dynamics", "iv", "didim")
_SHORT_SWEPT = ("ls_raw", "wls")
#: On slow motion and in closed loop the two ends of every family are compared.
_FEW = ("steps", "ls_raw", "ls", "wls", "momentum", "iv_plain", "iv_dynamics", "iv_desired", "iv", "didim")
_LOOP = ("ls_raw", "ls", "wls", "irls", "momentum", "energy", "physical", "iv_dynamics", "iv_desired", "iv", "didim")


def main(short: bool, folder: Path) -> int:
    """Run the comparison; 0 when the requirements on instrumental variables and on excitation hold (full run), else 1.

    Tables are printed, and kept with the figures in `report.html`."""
    out = folder / "methods"
    out.mkdir(parents=True, exist_ok=True)
    said = Said(sys.stdout)
    with redirect_stdout(said):
        worst, made = _compared(short, out)
    pictures = "".join(f'<p><img src="{html.escape(name)}" alt="{html.escape(name)}"></p>\n' for name in made)
    page = f"<!doctype html><meta charset=utf-8><title>methods</title>\n{pictures}<pre>{html.escape(said.text)}</pre>\n"
    (out / "report.html").write_text(page, encoding="utf-8")
    return worst


class Said(io.TextIOBase):
    """What is printed goes on to a stream, and is kept."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.parts = stream, []  # type: TextIO, list[str]

    def write(self, text: str) -> int:
        """Pass on and keep."""
        self.parts.append(text)
        return self.stream.write(text)

    def flush(self) -> None:
        """Pass on."""
        self.stream.flush()

    @property
    def text(self) -> str:
        """All that was printed."""
        return "".join(self.parts)


def _compared(short: bool, out: Path) -> tuple[int, list[str]]:
    """The comparison, and the names of its figures."""
    begin = time.process_time()
    scale = SHORT if short else FULL
    data = Data.make(scale)
    groups = data.world.groups
    print(tables.world_text(data.world))
    results: dict[str, Any] = {"versions": versions(), "short": short, "scale": asdict(scale)}

    chosen = METHODS if scale.everything else _SHORT
    main_trials = _torque_driven(data, data.main, scale.seeds, [METHODS[k] for k in chosen])
    forward = forward_errors(data, main_trials, METHODS if scale.everything else (*figures.SHOWN, "iv"))
    growths = growth(data) if scale.everything else growth(data, _SHORT_SWEPT)
    _heading(f"torque-driven, quick motion: {scale.seeds} seeds of {scale.lanes * scale.seconds:g} s, error over the Cramér-Rao bound")
    print(tables.error_table(main_trials, groups))
    print()
    print(tables.bias_table(main_trials, groups))
    print()
    print(tables.summary_table(data, main_trials, forward, growths))
    print(tables.statuses(main_trials))
    results["quick"] = _told(data, main_trials, groups, forward)

    slow_forward: dict[str, Forward] = {}
    slow_trials: dict[str, Trials] = {}
    if scale.slow_seeds:
        slow_trials = _torque_driven(data, data.slow, scale.slow_seeds, [METHODS[k] for k in _FEW])
        slow_forward = forward_errors(data, slow_trials, _FEW)
        _heading(f"torque-driven, slow motion (a third of the speed): {scale.slow_seeds} seeds")
        print(tables.error_table(slow_trials, groups))
        print()
        print(tables.summary_table(data, slow_trials, slow_forward, {}))
        print(tables.statuses(slow_trials))
        results["slow"] = _told(data, slow_trials, groups, slow_forward)

    loop_trials = _closed_loop(data, scale.loop_seeds, [METHODS[k] for k in (_LOOP if scale.everything else _SHORT_LOOP)])
    _heading(f"closed loop on the rounded encoders: {scale.loop_seeds} seeds, a motion each")
    print(tables.error_table(loop_trials, groups))
    print()
    print(tables.bias_table(loop_trials, groups))
    print(tables.statuses(loop_trials))
    results["closed_loop"] = _told(data, loop_trials, groups, {})

    made = recursions(data)
    _heading(f"recursion over {max(r.instants for r in made.values())} samples of raw second differences against the batch solution")
    print(tables.recursion_table(made))
    print()
    print(claims.points_table(made))
    results["recursion"] = {k: {**_plain(r), "settled": r.settled()} for k, r in made.items()}
    results["data_needed"] = {k: {**_plain(g), "converged_at": g.converged_at} for k, g in growths.items()}
    if scale.everything:
        of_seeds = plain.plain_kinds(data.world)
        _heading("the source's plain IV: 12 seeds with motions of their own")
        print(plain.plain_table(of_seeds))
        results["plain"] = [{**_plain(s), "kind": asdict(s.kind)} for s in of_seeds]
    swept = sweeps(data) if scale.everything else sweeps(data, methods=_SHORT_SWEPT)
    _heading("degradation: torque error on unseen motion")
    for sweep in swept.values():
        print(tables.sweep_table(sweep))
        print()
    results["degradation"] = {k: _plain(s) for k, s in swept.items()}

    designs = _excitation(short)
    results["excitation"] = [{**asdict(d), "beats": d.beats, "holds": d.holds} for d in designs]

    _heading(f"requirements on instrumental variables (simulated motion), {max(scale.seeds, scale.deciding_seeds)} seeds")
    deciding = main_trials
    if scale.deciding_seeds > scale.seeds:
        deciding = _torque_driven(data, data.main, scale.deciding_seeds, [METHODS["iv"], METHODS["ls_raw"]], tests=False)
    asked = verdict.criteria(deciding["iv"], deciding["ls_raw"], groups)
    print(tables.table(verdict.CRITERION_HEAD, [c.row() for c in asked]))
    others = verdict.ranking(data, "quick", main_trials, forward) + verdict.ranking(data, "slow", slow_trials, slow_forward)
    _heading("beyond the source: what filtering and simulated instruments change")
    for one in others:
        print(one)
    print(verdict.conclusion(others, asked))
    found = claims.source_claims(data, main_trials, forward, made)
    _heading(f"the source's claims (replay from standstill, torque error in brackets; a value settles within ±{100 * claims.BAND:g} %)")
    print(claims.claims_table(found))
    results["requirements"] = [{**asdict(c), "passes": c.passes} for c in asked]
    results["claims"] = [asdict(c) for c in found]
    results["verdict"] = [asdict(c) for c in others]

    paths = [figures.convergence_figure(made, out)]
    paths += figures.motion_figures(forward, out)
    paths.append(figures.error_course_figure(data, forward, out))
    paths.append(figures.growth_figure(growths, out))
    paths.append(figures.degradation_figure(swept, out))
    paths.append(figures.error_figure(main_trials, groups, out))
    results["figures"] = [p.name for p in paths]
    results["seconds"] = time.process_time() - begin
    (out / "methods.json").write_text(json.dumps(jsonable(results), indent=1))
    print(f"\n{len(paths)} figures, report.html and methods.json in {out}; {results['seconds']:.0f} s of one core")
    if short:
        print("the short run is too small to judge by: no requirement is enforced")
        return 0, results["figures"]
    return int(not (all(c.passes for c in asked) and all(d.beats and d.holds for d in designs))), results["figures"]


def _torque_driven(data: Data, runs, seeds: int, methods: Sequence[Method], tests: bool = True) -> dict[str, Trials]:
    bound = data.bound(runs)
    return run_trials(
        methods, range(1, seeds + 1), lambda seed: make_case(data, runs, seed, tests=tests), lambda seed: bound, data.world.truth
    )


def _closed_loop(data: Data, seeds: int, methods: Sequence[Method]) -> dict[str, Trials]:
    loops = {seed: data.loop(seed) for seed in range(1, seeds + 1)}
    return run_trials(
        methods,
        list(loops),
        lambda seed: make_case(data, loops[seed], seed, feedback=True),
        lambda seed: data.bound(loops[seed]),
        data.world.truth,
    )


def _excitation(short: bool) -> list[excitation.Design]:
    if short:
        designs = [excitation.design("puma560", random=10, starts=1, iterations=12, seeds=200, seconds=5.0)]
    else:
        designs = [excitation.design(name) for name in excitation.ROBOTS]
    random = designs[0].random
    _heading(f"excitation: designed against the best of {random} random trajectories within the same limits")
    print(tables.table(excitation.HEAD, [excitation.row(d) for d in designs]))
    return designs


def _heading(text: str) -> None:
    print(f"\n-- {text}", flush=True)


def _told(data: Data, trials: Mapping[str, Trials], groups: Mapping[str, list[int]], forward: Mapping[str, Forward]) -> dict[str, Any]:
    """Everything measured, for the results file."""
    found: dict[str, Any] = {}
    for key, t in trials.items():
        one: dict[str, Any] = {
            "title": t.method.title, "family": t.method.family, "seeds": list(t.seeds), "failures": [list(f) for f in t.failures],
            "statuses": list(t.statuses), "seconds": t.seconds,
        }  # fmt: skip
        if t.usable:
            one |= {
                "values": t.values, "std": t.std, "bound": t.bound, "torque_error": [data.torque_measure(e) for e in t.values - t.truth],
                "groups": {
                    name: {"error": t.error(g), "error_uncertainty": t.error_uncertainty(g), "bias": t.bias(g), "coverage": t.coverage(g)}
                    for name, g in groups.items()
                },
            }  # fmt: skip
        if key in forward:
            one |= {
                "motion_error_deg": forward[key].degrees, "motion_error_per_joint_deg": forward[key].per_joint,
                "diverged": forward[key].diverged,
            }  # fmt: skip
        found[key] = one
    return {"names": data.world.names, "truth": data.world.truth, "groups": groups, "methods": found}


def _plain(thing: Any) -> dict[str, Any]:
    """Fields of a result."""
    return {k: getattr(thing, k) for k in thing.__dataclass_fields__}


def versions() -> dict[str, str]:
    """Of what the numbers depend on."""
    return {"ident": ident.__version__, "numpy": np.__version__, "scipy": scipy.__version__, "python": platform.python_version()}


__all__ = ["main", "versions"]
