"""The tables of the diagnosis benchmark as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .counts import HEAD, against_gain, against_size, confusion, coverage, detectable, kinds, requirements


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Columns in line; the first `left` are words."""
    every = [tuple(head), *(tuple(r) for r in rows)]
    width = [max(len(r[i]) for r in every) for i in range(len(head))]
    return "\n".join(
        "  ".join(c.ljust(w) if i < left else c.rjust(w) for i, (c, w) in enumerate(zip(r, width, strict=True))).rstrip() for r in every
    )


def requirement_table(records: Sequence[dict[str, Any]]) -> str:
    """What was asked and what was reached, then each line's definition."""
    asked = requirements(records)
    words = [f"  {r.title}: {r.definition}." for r in asked]
    return table(HEAD, [r.row() for r in asked]) + "\n\nDefinitions\n" + "\n".join(words)


def confusion_table(records: Sequence[dict[str, Any]]) -> str:
    """One line a true effect: cases, those named right, and what the others were named."""
    rows = []
    for truth, named in sorted(confusion(records).items()):
        count = sum(named.values())
        right = named.get(truth, 0)
        others = ", ".join(f"{name} {n}" for name, n in sorted(named.items(), key=lambda x: -x[1]) if name != truth)
        rows.append((truth, str(count), str(right), "", others))
    return table(("true effect", "cases", "named so", "", "otherwise named"), rows) if rows else "no cases"


def gain_table(records: Sequence[dict[str, Any]]) -> str:
    """Detection against the held-out gain of the true effect."""
    rows = [
        (f"{low:g} … {high:g}", str(n), str(found), str(good), f"{100 * good / n:.0f} %" if n else "")
        for low, high, n, found, good in against_gain(records)
    ]
    return table(("held-out gain of the truth", "cases", "anything found", "top right", ""), rows)


def size_table(records: Sequence[dict[str, Any]]) -> str:
    """Detection against the size of the fault: right of those to be seen (of all)."""
    found = against_size(records)
    sizes = sorted({size for row in found.values() for size in row})

    def cell(row: dict[float, tuple[int, int, int]], size: float) -> str:
        if size not in row:
            return ""
        cases, seen, good = row[size]
        return f"{good}/{seen} ({cases})"

    rows = [(name, *(cell(row, s) for s in sizes)) for name, row in sorted(found.items())]
    total = {s: tuple(sum(row[s][i] for row in found.values() if s in row) for i in range(3)) for s in sizes}
    rows.append(("all", *(f"{total[s][2]}/{total[s][1]} ({total[s][0]})" for s in sizes)))
    return table(("right / to be seen (cases)", *(f"size {s:g}" for s in sizes)), rows)


def error_table(records: Sequence[dict[str, Any]]) -> str:
    """Held-out rms over the generator's torque noise, before and after: median, and the largest but one in twenty."""
    rows = []
    for kind in ("clean", "single", "pair", "outside"):
        own = [r for r in kinds(records, kind) if "failed" not in r]
        if not own:
            continue
        cells = []
        for key in ("before", "after"):
            x = np.array([r[key][0] for r in own], float)
            cells += [f"{np.median(x):.3f}", f"{np.quantile(x, 0.95):.3f}"]
        left = [r["oracle"][0]["after"] for r in own if kind == "single" and r["oracle"][0]["after"]]
        rows.append((kind, str(len(own)), *cells, f"{np.median(left):.3f}" if left else ""))
    return table(("kind", "cases", "before", "95 %", "after", "95 %", "with the true effect"), rows)


def coverage_table(records: Sequence[dict[str, Any]]) -> str:
    """Errors of rightly named findings' parameters over their standard deviations, effect by effect."""
    names = sorted({c["effect"] for r in records for c in r.get("coverage", [])})
    rows = []
    for name in [*names, ""]:
        z = coverage(records, name)
        if len(z):
            inside = f"{100 * np.mean(np.abs(z) <= 1.96):.0f}"
            rows.append((name or "all", str(len(z)), inside, f"{np.median(np.abs(z)):.2f}", f"{np.abs(z).max():.1f}"))
    return table(("effect", "values", "within 95 % interval, %", "median |z|", "largest"), rows) if rows else "no values"


def time_table(records: Sequence[dict[str, Any]]) -> str:
    """Seconds of one core a diagnosis, arm by arm."""
    rows = []
    for arm in dict.fromkeys(r["arm"] for r in records):
        x = np.array([r["seconds"] for r in records if r["arm"] == arm and "failed" not in r])
        if len(x):
            rows.append((arm, str(len(x)), f"{np.median(x):.1f}", f"{np.quantile(x, 0.95):.1f}", f"{x.max():.1f}"))
    return table(("arm", "cases", "s, median", "95 %", "largest"), rows)


def wrong_table(records: Sequence[dict[str, Any]]) -> str:
    """Every case that counts against a requirement, a line each."""
    from .run_cases import line
    from .score import right

    out = []
    for r in records:
        if "failed" in r:
            out.append(line(r))
            continue
        bad = {
            "clean": r["verdict"] != "clean",
            "outside": r["verdict"] not in ("unexplained", "ambiguous") or any(f["confidence"] > 0.5 for f in r["findings"]),
        }.get(r["kind"])
        if bad is None:
            good = right(r)
            bad = not (good["all"] if r["kind"] == "pair" else good["top"] and good["only"])
            if r["kind"] == "single" and not detectable(r):
                bad = r["verdict"] not in ("clean", "ambiguous")
        if bad:
            out.append(line(r))
    return "\n".join(out) or "none"
