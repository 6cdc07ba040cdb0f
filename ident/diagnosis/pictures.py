"""What a diagnosis shows: its findings as a table, and each in the residual against the quantity that reveals it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role, Section, Table, percent, uncertain
from ..effects.places import on, place_of
from ..estimate.contribution import contribution, revealing
from ..signals.timeline import Timeline, binned, cloud

if TYPE_CHECKING:
    import pandas as pd

    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..evaluation.comparison import Comparison
    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from .result import Finding

Array = np.ndarray
#: Findings with a figure of their own, joints of the picture of a diagnosis without any.
_FIGURES = 8
_JOINTS = 4


class Diagnosed(Protocol):
    """A diagnosis, as far as its pictures look at it."""

    @property
    def before(self) -> Estimate: ...
    @property
    def after(self) -> Estimate: ...
    @property
    def signals(self) -> Signals: ...
    @property
    def held(self) -> Signals | None: ...
    @property
    def findings(self) -> tuple[Finding, ...]: ...

    @property
    def noise_floor(self) -> Array:
        """Standard deviation (n,) of what is left."""

    @property
    def comparison(self) -> Comparison:
        """Before and after."""


def data_of(d: Diagnosed) -> str:
    """Which data the errors are of, in a word."""
    return "fitted" if d.held is None else "held-out"


def diagnosis_figure(d: Diagnosed) -> Figure:
    """The first findings; without any, the residual over time of the joints whose error is largest beside the noise."""
    shown = finding_figures(d)
    if shown:
        panels = tuple(panel for figure in shown[:3] for panel in figure.panels)
        return Figure("diagnosis", "What the model lacks", shown[0].caption, panels, columns=3)
    signals = d.signals if d.held is None else d.held
    line, residual = Timeline.of([signals]), d.after.residual(signals)
    ratio = np.nan_to_num(d.comparison.error_after.rms / np.maximum(d.noise_floor, 1e-300))
    robot = d.after.model.robot
    panels = tuple(
        Panel(
            robot.joint_names[j],
            "time, runs one after the other (s)",
            f"residual ({robot.force_unit(j, robot.transmission.measured)})",
            (Layer.of(BlockKind.BAND, Role.BEFORE, *line.envelope(residual[:, j])),),
        )
        for j in sorted(np.argsort(-ratio)[:_JOINTS].tolist())
    )
    return Figure("diagnosis", "Residual", f"Measured less predicted torque, {data_of(d)} data; nothing was found.", panels)


def diagnosis_frame(d: Diagnosed) -> pd.DataFrame:
    """One row for each parameter of each finding."""
    import pandas as pd

    rows = [
        {
            "effect": f.name, "joints": f.place or "whole robot", "parameter": p.name, "value": p.value, "std": p.std, "unit": p.unit,
            "confidence": f.confidence, "heldout_gain": f.heldout_gain,
        }
        for f in d.findings
        for p in f.parameters
    ]  # fmt: skip
    columns = ("effect", "joints", "parameter", "value", "std", "unit", "confidence", "heldout_gain")
    return pd.DataFrame(rows, columns=list(columns))


def findings_section(d: Diagnosed) -> list[Section]:
    """The findings as a table; nothing where there are none."""
    rows = []
    for i, f in enumerate(d.findings, 1):
        head: tuple[str, ...] = (f"{i}. {f.name}", f.effect.title, place_of(f.effect, f.joints) or "whole robot")
        tail = (f"{f.confidence:.2f}", f"{percent(f.heldout_gain, 1)} %")
        for p in f.parameters:
            rows.append((*head, p.name, uncertain(p.value, p.std), p.unit, *tail))
            head, tail = ("", "", ""), ("", "")
    if not rows:
        return []
    head = ("effect", "what it is", "joints", "parameter", "value ± std", "unit", "confidence", "held-out gain")
    note = (
        "Confidence: that it is this effect on these joints, among all that were tried. Held-out gain: share of the squared error,"
        " weighted by noise, that it removes on blocks that the fit did not see."
    )
    return [Table("What the model lacks", head, tuple(rows), note, left=4)]


def finding_figures(d: Diagnosed) -> list[Figure]:
    """For each finding: residual before, the effect in the residual, residual after, against the quantity that reveals it."""
    out: list[Figure] = []
    for number, finding in enumerate(d.findings[:_FIGURES], 1):
        effect = _own(d, finding)
        if effect is None:
            continue
        signals = d.signals if d.held is None or effect.axis == "time" else d.held
        data = "held-out" if signals is d.held else "fitted"
        torque = contribution(d.after, effect, signals)
        before, after = d.before.residual(signals), d.after.residual(signals)
        panels: list[Panel] = []
        for row in _most(torque, signals.valid, d.noise_floor):
            joint = effect.at(d.after.model.robot)[0] if effect.joints is not None else row
            label, x = revealing(d.after, effect, joint, signals)
            panels += _three(d.after.model.robot, row, label, x, before[:, row], after[:, row], torque[:, row], d.noise_floor[row])
        if not panels:
            continue
        caption = (
            f"Residual on {data} data. Left: of the declared model. Middle: the residual of the refit, with the effect"
            " put back, and the effect itself. Right: the residual of the refit. Lines: means over bins; grey: noise floor (± 1 std)."
        )
        title = f"{number}. {finding.effect.title}{on(place_of(finding.effect, finding.joints))}"
        out.append(Figure(f"finding_{number}_{finding.name}", title, caption, tuple(panels), columns=3))
    return out


def _own(d: Diagnosed, finding: Finding) -> Effect | None:
    """The finding's effect as the model with the findings holds it."""
    declared = len(d.before.model.effects)
    return next((e for e in d.after.model.effects[declared:] if e == finding.effect), None)


def _most(torque: Array, valid: Array, floor: Array, most: int = 2) -> list[int]:
    """Rows on which an effect is largest beside the noise: one, or two that are alike."""
    used = np.where(valid, torque, 0.0)
    size = np.sqrt(np.sum(used**2, axis=0) / np.maximum(valid.sum(axis=0), 1)) / np.maximum(floor, 1e-300)
    order = np.argsort(-size)[:most]
    return [int(j) for j in order if size[j] > 0 and size[j] >= 0.5 * size[order[0]]]


def _three(robot: Robot, row: int, label: str, x: Array, before: Array, after: Array, torque: Array, floor: float) -> list[Panel]:
    unit = robot.force_unit(row, robot.transmission.measured)
    name = robot.joint_names[row]
    ends = [float(np.nanmin(x)), float(np.nanmax(x))] if np.isfinite(x).any() else [0.0, 1.0]
    band = Layer.of(BlockKind.BAND, Role.FLOOR, ends, [-floor, -floor], [floor, floor], "noise floor")

    def panel(title: str, y: Array, role: Role, words: str, *more: Layer) -> Panel:
        layers = (band, Layer.of(BlockKind.POINTS, role, *cloud(x, y)), *more, Layer.of(BlockKind.LINE, role, *binned(x, y), label=words))
        return Panel(title, label, f"torque of {name} ({unit})", layers)

    seen = np.isfinite(after)
    effect = Layer.of(BlockKind.LINE, Role.EFFECT, *binned(x, np.where(seen, torque, np.nan)), label="effect")
    return [
        panel(f"{name}: declared model", before, Role.BEFORE, "before"),
        panel(f"{name}: the effect", after + torque, Role.AFTER, "after", effect),
        panel(f"{name}: with the findings", after, Role.AFTER, "after"),
    ]
