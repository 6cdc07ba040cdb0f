"""Figures of the diagnosis benchmark as PNG: detection against magnitude, and the confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .counts import against_gain, confusion, detectable, kinds
from .oracle import DETECTABLE
from .score import right


def detection_figure(records: Sequence[dict[str, Any]], path: Path) -> Path:
    """Share of single faults found and rightly named against the held-out gain of the true effect."""
    figure, axes = _new(7.5, 4.0)
    rows = [r for r in against_gain(records) if r[2]]
    x = np.arange(len(rows))
    for key, label, colour in ((3, "anything found", "#9a9a9a"), (4, "top finding right", "#0072b2")):
        axes.plot(x, [100 * r[key] / r[2] for r in rows], "o-", color=colour, label=label)
    for i, r in enumerate(rows):
        axes.annotate(f"{r[2]}", (i, 0), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=8, color="#555555")
    axes.set_xticks(x, [f"{r[0]:g} to {r[1]:g}" if np.isfinite(r[1]) else f"above {r[0]:g}" for r in rows], fontsize=7)
    axes.set_ylim(0, 105)
    axes.set_xlabel("held-out gain of the true effect (twice a log-likelihood); numbers: cases")
    axes.set_ylabel("% of single faults")
    unseen = sum(r[1] <= DETECTABLE for r in rows)
    axes.axvline(unseen - 0.5, color="#d55e00", linewidth=0.8, linestyle="--")
    axes.legend(frameon=False, loc="lower right")
    axes.set_title("Detection against magnitude (left of the dashed line: too little to be seen)", loc="left", fontsize=10)
    return _write(figure, path)


def size_figure(records: Sequence[dict[str, Any]], path: Path) -> Path:
    """Each single fault as a point: its gain, by effect; filled where it was rightly named."""
    singles = [r for r in kinds(records, "single") if "failed" not in r]
    names = sorted({r["parts"][0]["effect"] for r in singles}, reverse=True)
    figure, axes = _new(7.5, 0.24 * len(names) + 1.2)
    for good, face in ((True, "#0072b2"), (False, "none")):
        own = [r for r in singles if (right(r)["top"]) == good]
        colours = ["#0072b2" if good else ("#d55e00" if detectable(r) else "#9a9a9a") for r in own]
        axes.scatter(
            [max(r["oracle"][0]["gain"], 1.0) for r in own], [names.index(r["parts"][0]["effect"]) for r in own], s=18,
            facecolors=colours if face != "none" else "none", edgecolors=colours, linewidths=0.9,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.set_xlabel("held-out gain of the true effect (1 and below: at the left edge)")
    axes.set_title("Single faults: filled = rightly named, red = missed or wrong, grey = not to be seen", loc="left", fontsize=9)
    axes.grid(color="#eeeeee")
    axes.set_axisbelow(True)
    return _write(figure, path)


def confusion_figure(records: Sequence[dict[str, Any]], path: Path) -> Path:
    """True effect against the name that the first finding gives, shares of each row."""
    matrix = confusion(records)
    outside = {p["effect"] for r in records for p in r["parts"] if p["outside"]}
    rows = [*sorted(n for n in matrix if n not in outside and n != "clean"), *sorted(n for n in matrix if n in outside)]
    rows += ["clean"] if "clean" in matrix else []
    columns = sorted({name for row in matrix.values() for name in row} | {n for n in rows if n not in outside})
    ends = ("clean", "unexplained", "failed")
    columns = [*(n for n in columns if n not in ends), *(n for n in ends if n in columns)]
    shares = np.array([[matrix[r].get(c, 0) / sum(matrix[r].values()) for c in columns] for r in rows])
    figure, axes = _new(0.19 * len(columns) + 3.0, 0.19 * len(rows) + 3.0, left=2.2, bottom=2.2)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="equal")
    for i, r in enumerate(rows):
        for j, c in enumerate(columns):
            if matrix[r].get(c):
                axes.text(j, i, str(matrix[r][c]), ha="center", va="center", fontsize=5, color="white" if shares[i, j] > 0.5 else "black")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=6)
    axes.set_yticks(range(len(rows)), rows, fontsize=6)
    axes.set_xlabel("first finding")
    axes.set_ylabel("in the log")
    axes.set_title("Confusion (numbers: cases)", loc="left", fontsize=9)
    return _write(figure, path)


def _new(width: float, height: float, left: float = 1.9, bottom: float = 0.7):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    figure.subplots_adjust(left / width, bottom / height, 1 - 0.2 / width, 1 - 0.4 / height)
    return figure, axes


def _write(figure, path: Path) -> Path:
    figure.savefig(path, dpi=130)
    return path
