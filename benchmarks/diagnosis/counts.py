"""Counts over the records of cases: each requirement with its definition, what was reached and what is asked."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .oracle import CHANCE, DETECTABLE, SURE
from .score import right

#: Standard normal quantile of a two-sided 95 % interval.
_Z95 = 1.959963985
#: After the refit, held-out rms over the noise floor.
FLOOR = 1.05


@dataclass(frozen=True)
class Requirement:
    """`hits` of `count` cases do what `definition` says; asked: a share of at least (or, `most`, at most) `target`, over at least
    `least` cases. A target of None asks for nothing and only informs."""

    title: str
    definition: str
    hits: int
    count: int
    target: float | None = None
    most: bool = False
    least: int = 0

    @property
    def share(self) -> float:
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Exact binomial 95 % interval of the share (C. Clopper, E. Pearson, Biometrika 26 (1934))."""
        from scipy.stats import beta

        k, n = self.hits, self.count
        if not n:
            return 0.0, 1.0
        return (
            0.0 if k == 0 else float(beta.ppf(0.025, k, n - k + 1)),
            1.0 if k == n else float(beta.ppf(0.975, k + 1, n - k)),
        )

    @property
    def met(self) -> bool | None:
        """None where nothing is asked, or too few cases were run to tell."""
        if self.target is None or self.count < max(self.least, 1):
            return None
        return self.share <= self.target if self.most else self.share >= self.target

    def row(self) -> tuple[str, ...]:
        """For a table."""
        low, high = self.interval
        asked = "" if self.target is None else f"{'≤' if self.most else '≥'} {100 * self.target:g} %"
        few = self.target is not None and self.count < max(self.least, 1)
        said = {True: "met", False: "NOT MET", None: f"too few (of {self.least})" if few else ""}[self.met]
        return (self.title, f"{self.hits} of {self.count}", f"{100 * self.share:.1f}", f"{100 * low:.1f} … {100 * high:.1f}", asked, said)


class Rate(Requirement):
    """A share that is to be at its nominal value: met where chance explains the shortfall."""

    @property
    def met(self) -> bool | None:
        plain = super().met
        return None if plain is None else self.interval[1] >= (self.target or 0.0)


HEAD = ("what", "cases", "%", "95 % interval", "asked", "")


def detectable(record: dict[str, Any]) -> bool:
    """Whether every true effect of a case, handed to the refit, lowers the held-out error beyond chance. A case that failed counts."""
    return "failed" in record or all(o["detectable"] for o in record["oracle"])


def leaves_a_trace(record: dict[str, Any], records: Iterable[dict[str, Any]]) -> bool:
    """Whether the declared model's held-out error on a case, over all joints or on any, is larger than on every clean log of that arm."""
    clean = [r["before"] for r in kinds(records, "clean") if "failed" not in r and r["arm"] == record["arm"]]
    if "failed" in record or not clean:
        return True
    usual = np.nanmax(np.array(clean, float), axis=0)
    return bool(np.any(np.array(record["before"], float) > usual))


def kinds(records: Iterable[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    return [r for r in records if r["kind"] == kind]


def requirements(records: Sequence[dict[str, Any]]) -> list[Requirement]:
    """Every line of the issue's list, in its order."""
    singles, clean, outside, pairs = (kinds(records, k) for k in ("single", "clean", "outside", "pair"))
    seen = [r for r in singles if detectable(r)]
    hidden = [r for r in singles if not detectable(r)]
    done = [r for r in seen if "failed" not in r]
    traced = [r for r in outside if leaves_a_trace(r, records)]
    both = [r for r in pairs if detectable(r)]
    scores = coverage(records)
    out = [
        Requirement(
            "single: top finding right",
            "single faults whose true effect, handed to the refit, lowers the held-out loss beyond chance: by more than"
            f" {DETECTABLE} (twice a log-likelihood), and blocks of either sign alike would reach it with p ≤ {CHANCE} (or by more"
            f" than {SURE:g}); the first finding names effect and joint (of a coupling the motor, too); where it is ambiguous (rivals"
            " of 0.2 or more together) only if truth and rival foretell the held-out data equally well (the truth is not better by"
            " the same measure)",
            sum(_good(r, "top") for r in seen), len(seen), 0.97, least=300,
        ),
        Requirement(
            "… ambiguous verdicts only with a rival", "the same; not counted where the verdict is ambiguous though the finding has no rival"
            " of 0.2 or more: held-out data are too few to bear it out, or had a part in it, or something else beside it is ambiguous",
            sum(_good(r, "top") and not _without_rival(r) for r in seen), len(seen),
        ),
        Requirement(
            "single: nothing spurious beside it", "the same cases; no more than one finding",
            sum(_good(r, "only") for r in seen), len(seen), 0.95, least=300,
        ),
        Requirement("single: right, alone", "both of the above", sum(_alone(r) for r in seen), len(seen)),
        Requirement(
            "single, seen: ends without a leftover", "the same cases; the verdict is not unexplained",
            sum("failed" not in r and r["verdict"] != "unexplained" for r in seen), len(seen),
        ),
        Requirement(
            "single, not to be seen: never another name", "single faults that the same measure does not show; the verdict is clean or"
            " ambiguous, or the one finding is the true effect",
            sum("failed" not in r and (r["verdict"] in ("clean", "ambiguous") or _alone(r)) for r in hidden),
            len(hidden), 1.0,
        ),
        Requirement(
            "clean: false alarms", "logs without a fault; the verdict is not clean",
            sum("failed" in r or r["verdict"] != "clean" for r in clean), len(clean), 0.01, most=True, least=200,
        ),
        Requirement(
            "outside: unexplained or ambiguous", "faults that the catalogue does not hold and that leave a trace: the declared model's"
            " held-out error, over all joints or on one, is above that of every clean log of the same arm; the verdict",
            sum("failed" not in r and r["verdict"] in ("unexplained", "ambiguous") for r in traced), len(traced), 0.95, least=30,
        ),
        Requirement(
            "… of all of them, traced or not", "the same without that condition",
            sum("failed" not in r and r["verdict"] in ("unexplained", "ambiguous") for r in outside), len(outside),
        ),
        Requirement(
            "outside: a name above one half", "faults that the catalogue does not hold, all of them; any finding with a confidence above"
            " 0.5 (every name is wrong)",
            sum(_sure(r) for r in outside), len(outside), 0.10, most=True, least=30,
        ),
        Requirement(
            "pairs: both and only both", "two faults on two joints, each of which lowers the held-out loss beyond chance beside the other;"
            " each is named (as for single faults) by a finding of its own, and there is no further one",
            sum(_good(r, "all") for r in both), len(both), 0.90, least=30,
        ),
        Requirement(
            "… of all pairs", "the same of those in which one fault cannot be seen, too",
            sum(_good(r, "all") for r in pairs), len(pairs),
        ),
        Requirement(
            "single: error after ≤ 1.05 × noise floor", "cases as in the first line; held-out rms after the refit, over all joints, rows"
            " near reversals left out, over the floor of that very log: what is left when the true effect, its shapes as they truly are,"
            " is handed to the refit",
            sum(r["after"][0] <= FLOOR * r["oracle"][0]["after"] for r in done if r["oracle"][0]["after"]), len(seen),
            0.95, least=300,
        ),
        Requirement(
            "… both parts searched together", "cases as in the first line; something showed more in the held-out part, so that shapes of"
            " the findings (not the fits that are judged here) were chosen with it",
            sum(bool(r.get("both_parts")) for r in done), len(seen),
        ),
        Requirement(
            "… of the torque noise alone", "the same over the generator's torque noise behind the same filters; that of the positions"
            " adds to what is left even where nothing is missing",
            sum(_at_floor(r, "after") for r in seen), len(seen),
        ),
        Requirement(
            "… clean logs, for comparison", "held-out rms of the declared model on clean logs over the generator's torque noise",
            sum(_at_floor(r, "before") for r in clean), len(clean),
        ),
        Requirement(
            "… of the noise floor that it reports", "as above, over the noise floor that the diagnosis gives itself",
            sum(_at_floor(r, "reported_floor") for r in seen), len(seen),
        ),
    ]  # fmt: skip
    for name, level, limit in (("95 %", 0.95, _Z95), ("68 %", 0.6827, 1.0)):
        inside = int(np.sum(np.abs(scores) <= limit))
        words = (
            "parameters and shapes of rightly named findings whose truth is a number; met where the nominal rate is in the interval of"
            " the share, or below it"
        )
        out.append(Rate(f"intervals of {name} cover the truth", words, inside, len(scores), level, least=100))
    return out


def coverage(records: Iterable[dict[str, Any]], effect: str = "") -> np.ndarray:
    """Errors of parameters over their standard deviations."""
    found = [c for r in records for c in r.get("coverage", []) if not effect or c["effect"] == effect]
    return np.array([(c["value"] - c["truth"]) / c["std"] for c in found])


def _good(record: dict[str, Any], key: str) -> bool:
    return "failed" not in record and right(record)[key]


def _alone(record: dict[str, Any]) -> bool:
    """The true effect is named first, and nothing beside it."""
    return _good(record, "top") and _good(record, "only")


def _without_rival(record: dict[str, Any]) -> bool:
    return record["verdict"] == "ambiguous" and record["named"][0]["how"] == "found"


def _sure(record: dict[str, Any]) -> bool:
    return "failed" in record or any(f["confidence"] > 0.5 for f in record["findings"])


def _at_floor(record: dict[str, Any], key: str) -> bool:
    return "failed" not in record and record[key][0] is not None and record[key][0] <= FLOOR


def named_as(record: dict[str, Any]) -> str:
    """Row of the confusion matrix in which a case ends: the first finding's effect; "clean" or "unexplained" without any."""
    if "failed" in record:
        return "failed"
    if not record["findings"]:
        return str(record["verdict"])
    first = record["findings"][0]
    true = record["parts"][0] if record["parts"] else None
    if true is not None and first["effect"] == true["effect"] and not right(record)["top"]:
        elsewhere = record["named"][0]["how"] == "no" if "named" in record else True
        return f"{first['effect']} (elsewhere)" if elsewhere else f"{first['effect']} (ambiguous with a worse one)"
    return str(first["effect"])


def true_name(record: dict[str, Any]) -> str:
    """What a case holds."""
    return "+".join(sorted(p["effect"] for p in record["parts"])) or "clean"


def confusion(records: Iterable[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """True effect → named as → number of cases; single faults that can be seen, outside ones, clean logs."""
    out: dict[str, dict[str, int]] = {}
    for r in records:
        if r["kind"] == "pair" or (r["kind"] == "single" and not detectable(r)):
            continue
        row = out.setdefault(true_name(r), {})
        row[named_as(r)] = row.get(named_as(r), 0) + 1
    return out


#: Edges of classes of magnitude: held-out gain of the true effect (twice a log-likelihood).
GAINS = (0.0, 10.8, 30.0, 100.0, 300.0, 1e3, 1e4, 1e5, np.inf)


def against_gain(records: Iterable[dict[str, Any]]) -> list[tuple[float, float, int, int, int]]:
    """(from, to, cases, found, top right) of single faults by how much the true effect gains."""
    singles = [r for r in kinds(records, "single") if "failed" not in r]
    out = []
    for low, high in itertools.pairwise(GAINS):
        own = [r for r in singles if low <= max(r["oracle"][0]["gain"], 0.0) < high]
        out.append((low, high, len(own), sum(bool(r["findings"]) for r in own), sum(_good(r, "top") for r in own)))
    return out


def against_size(records: Iterable[dict[str, Any]]) -> dict[str, dict[float, tuple[int, int, int]]]:
    """Effect → size → (cases, to be seen, top right)."""
    out: dict[str, dict[float, tuple[int, int, int]]] = {}
    for r in kinds(records, "single"):
        row = out.setdefault(true_name(r), {})
        size = float(r["size"][0]) if "size" in r else float(r["case"]["parts"][0][2])
        cases, seen, good = row.get(size, (0, 0, 0))
        row[size] = (cases + 1, seen + detectable(r), good + (detectable(r) and _good(r, "top")))
    return out
