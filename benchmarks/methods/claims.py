"""What the dissertation claims of its three methods in sections 3.6 and 3.7, claim by claim, beside what is measured here.

It calls them *step by step*, *simultaneous* (least squares) and *advanced simultaneous* (instrumental variables). It does not claim that
the advanced method is more precise than step by step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .data import Data
from .monte_carlo import Trials
from .recursions import BAND, SAMPLES, Recursion
from .tables import number, table
from .trajectories import Forward

#: "Precise": errors at least so many times smaller than those of the method called not so precise. "As precise, or nearly": errors up to so
#: many times the other one. "About so many points": within this factor.
PRECISE, NEARLY, ABOUT = 5.0, 2.0, 2.0


class Verdict(StrEnum):
    """Of a claim, by the numbers."""

    HOLDS = "holds"
    FAILS = "does not hold"
    NONE = "not comparable"


@dataclass(frozen=True)
class SourceClaim:
    """A claim of the source, in its words where they are quoted; the measured value; the verdict and why where it needs saying."""

    topic: str
    claim: str
    measured: str
    verdict: Verdict

    def row(self) -> list[str]:
        """For a table."""
        return [self.topic, self.claim, self.measured, self.verdict.value]


def claims_table(claims: list[SourceClaim]) -> str:
    """As text."""
    rows = [["of", "claim (sections 3.6, 3.7)", "measured", "verdict"], *(c.row() for c in claims)]
    width = [max(len(row[i]) for row in rows) for i in range(4)]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, width, strict=True)).rstrip() for row in rows)


def source_claims(
    data: Data, trials: Mapping[str, Trials], forward: Mapping[str, Forward], recursions: Mapping[str, Recursion]
) -> list[SourceClaim]:
    """All claims, for which there are numbers."""
    return [*_precision(data, trials, forward), *_labour(data), *_computing(trials, recursions, data), *_points(recursions)]


def _verdict(holds: bool) -> Verdict:
    return Verdict.HOLDS if holds else Verdict.FAILS


def _precision(data: Data, trials: Mapping[str, Trials], forward: Mapping[str, Forward]) -> list[SourceClaim]:
    """By replay of torque-driven runs from standstill, as the source judges, and by the torque error on unseen motion."""
    torque = {k: 100 * float(np.median([data.torque_measure(e) for e in t.values - t.truth])) for k, t in trials.items() if t.usable}

    def told(key: str) -> str:
        motion = forward[key].degrees
        return f"{number(motion) + ' deg' if np.isfinite(motion) else 'diverged'} ({number(torque[key])} %)"

    def within(key: str, times: float, other: str) -> bool:
        """Whether both errors of a method are no larger than so many times those of another."""
        pairs = ((forward[key].degrees, forward[other].degrees), (torque[key], torque[other]))
        return all(mine <= times * yours for mine, yours in pairs)

    found = []
    plans = {"steps_few": "13 accelerated tests", "steps": "15 accelerated tests, which need no coupled gears"}
    for key, plan in plans.items():
        if key not in forward:
            continue
        worse = all(within(other, 1.0, "ls_raw") for other in (key, "iv_plain"))
        found += [
            SourceClaim(
                "precision", f"step by step is precise ({plan})", f"{told(key)}; simultaneous {told('ls_raw')}",
                _verdict(within(key, 1.0 / PRECISE, "ls_raw")),
            ),
            SourceClaim(
                "precision", f"advanced is as precise as step by step, or nearly ({plan})", f"{told('iv_plain')} against {told(key)}",
                _verdict(within("iv_plain", NEARLY, key)),
            ),
            SourceClaim(
                "precision", f'simultaneous is "not so precise" as the other two ({plan})',
                f"{told('ls_raw')} against {told(key)} and {told('iv_plain')}", _verdict(worse),
            ),
        ]  # fmt: skip
    return found


def _labour(data: Data) -> list[SourceClaim]:
    plans = {"few": "fewest", "safe": "safe"}
    told = "; ".join(
        f"{label} {_counted(data.tests[key].plan.tests)}, {data.tests[key].plan.duration:.0f} s"
        for key, label in plans.items()
        if key in data.tests
    )
    motion = data.scale.lanes * data.scale.seconds
    most = all(len(made.plan.tests) > 1 and made.plan.duration > motion for made in data.tests.values())
    return [
        SourceClaim(
            "labour", "step by step needs the most (6 static, 6 constant-velocity, 13 accelerated tests)",
            f"{told} against one motion of {motion:.0f} s", _verdict(most),
        ),
        SourceClaim("labour", "simultaneous needs the least", f"one motion of {motion:.0f} s, the same for advanced", _verdict(most)),
        SourceClaim(
            "labour", "advanced needs more than simultaneous (programming, choice of instruments)", "a choice of method", Verdict.NONE
        ),
    ]  # fmt: skip


def _counted(tests) -> str:
    kinds: dict[str, int] = {}
    for test in tests:
        kinds[str(test.kind.value)] = kinds.get(str(test.kind.value), 0) + 1
    return ", ".join(f"{count} {kind}" for kind, count in kinds.items())


def _computing(trials: Mapping[str, Trials], recursions: Mapping[str, Recursion], data: Data) -> list[SourceClaim]:
    """Processor time: step by step on its tests, the others after every one of 120,000 samples, as the source runs them."""
    least, advanced = recursions["simultaneous"], recursions["advanced"]
    steps = {k: float(np.median(trials[k].seconds)) for k in ("steps_few", "steps") if k in trials and trials[k].usable}
    if not steps:
        return []
    slowest = max(steps.values())
    told = f"{number(slowest, 2)} s against {number(least.seconds, 2)} s and {number(advanced.seconds, 2)} s"
    recorded = least.instants * least.step
    return [
        SourceClaim(
            "computing", "step by step takes the shortest time", f"{told} (recursions over {least.instants:,} samples)",
            _verdict(slowest < min(least.seconds, advanced.seconds)),
        ),
        SourceClaim(
            "computing", 'simultaneous takes "very long"',
            f"{number(least.seconds, 2)} s for {recorded:.0f} s of data; computers differ by decades", Verdict.NONE,
        ),
        SourceClaim(
            "computing", "advanced takes less than simultaneous", f"{number(advanced.seconds, 2)} s against {number(least.seconds, 2)} s",
            _verdict(advanced.seconds < least.seconds),
        ),
    ]  # fmt: skip


#: (method, parameter or all, samples that the source names; None: not within 120,000)
_POINTS = (
    ("simultaneous", "J1z", "Izz_joint1", 40_000),
    ("simultaneous", "J5z", "Izz_joint5", 80_000),
    ("simultaneous", "all", "", None),
    ("advanced", "J1z", "Izz_joint1", 30_000),
    ("advanced", "J5z", "Izz_joint5", 50_000),
    ("advanced", "all", "", 80_000),
)


def _points(recursions: Mapping[str, Recursion]) -> list[SourceClaim]:
    """Samples until a parameter stays within the band, and the order of the two methods."""
    found = []
    settled: dict[tuple[str, str], float] = {}
    for method, label, name, quoted in _POINTS:
        r = recursions[method]
        at = settled[method, label] = r.settled_one(name) if name else r.settled_all()
        late = int(np.sum(~np.isfinite(r.settled())))
        end = f"not within {r.instants:,}"
        sooner = " (sooner)" if quoted and at < quoted / ABOUT else ""
        told = f"{at:,.0f}{sooner}" if np.isfinite(at) else (f"{late} of {len(r.names)} {end}" if not name else end)
        if r.instants < SAMPLES:
            verdict = Verdict.NONE
        elif quoted is None:
            verdict = _verdict(not np.isfinite(at))
        else:
            verdict = _verdict(np.isfinite(at) and quoted / ABOUT <= at <= quoted * ABOUT)
        said = f"about {quoted:,} points" if quoted else "a few parameters not after 120,000 points"
        what = f"{label} {'settle' if label == 'all' else 'settles'} after {said}" if quoted else said
        found.append(SourceClaim("data", f"{r.title}: {what}", told, verdict))
    ahead = [
        settled["advanced", k] < settled["simultaneous", k] or not np.isfinite(settled["simultaneous", k]) for k in ("J1z", "J5z", "all")
    ]
    least, advanced = (recursions[k] for k in ("simultaneous", "advanced"))
    both = np.nan_to_num(np.array([least.settled(), advanced.settled()]), nan=np.inf)
    found.append(
        SourceClaim(
            "data", "advanced needs fewer points than simultaneous (J1z, J5z, all)",
            f"{sum(ahead)} of these 3; sooner for {int(np.sum(both[1] < both[0]))} of {len(least.names)} parameters",
            Verdict.NONE if least.instants < SAMPLES else _verdict(all(ahead)),
        )
    )  # fmt: skip
    return found


def points_table(recursions: Mapping[str, Recursion], bands: tuple[float, ...] = (0.01, BAND, 0.05)) -> str:
    """Samples of 5 ms until J1z, J5z and all parameters stay within several bands, by both methods."""

    def told(at: float) -> str:
        return f"{at:,.0f}" if np.isfinite(at) else "-"

    rows = []
    for r in recursions.values():
        for band in bands:
            all_settled = r.settled(band)
            rows.append([
                f"{r.title}, ±{100 * band:g} %", told(r.settled_one("Izz_joint1", band)), told(r.settled_one("Izz_joint5", band)),
                told(float(np.max(all_settled))), f"{int(np.isfinite(all_settled).sum())} of {len(r.names)}",
            ])  # fmt: skip
    return table(["samples until it stays within the band", "J1z", "J5z", "all", "settled by the end"], rows)
