"""The report of a monitoring."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..drawing.document import BlockKind, Figure, Layer, Panel, Report, Role, Section, Table, Text, joined, percent, plain, uncertain
from ..effects.places import on, place_of
from ..estimate.pictures import residual_figures
from ..monitoring.result import said
from ..signals.timeline import Timeline

if TYPE_CHECKING:
    from ..monitoring import Monitoring

_JOINTS = 8


def monitoring_report(found: Monitoring) -> Report:
    """What changed, by how much; errors per joint; the residual over time."""
    robot = found.estimate.model.robot
    sections: list[Section] = [*_changes(found), *_left(found), _errors(found), _over_time(found)]
    sections += residual_figures(found.estimate, found.signals, found.residual, "new")
    if found.known:
        sections.append(Text("Not in the model, but no change", tuple(f"{name}: in the logs of the fit, too." for name in found.known)))
    rows = tuple((f"log {k}", f"{i['path']} (SHA-256 {str(i['sha256'])[:12]}…)") for k, i in enumerate(found.signals.inputs, 1))
    sections.append(Table("New logs", ("", ""), rows, left=2))
    if found.warnings:
        sections.append(Text("Warnings", found.warnings))
    text = said(found)
    return Report(
        text[0].upper() + text[1:], found.verdict, f"{robot.name}, {counted(robot.n, 'joint')}, against a saved fit", tuple(sections)
    )


def _changes(found: Monitoring) -> list[Section]:
    rows: list[tuple[str, ...]] = []
    competing: list[tuple[str, ...]] = []
    for i, change in enumerate(found.changes, 1):
        name = f"{i}. {change.effect.title} {change.how.value}"
        head: tuple[str, ...] = (name, place_of(change.effect, change.joints) or "whole robot")
        tail: tuple[str, ...] = (f"{change.confidence:.2f}", f"{percent(change.heldout_gain, 1)} %")
        for p in change.parameters:
            before, after = ("", "") if p.before is None else (plain(p.before, 4), plain(p.before + p.value, 4))
            size = uncertain(p.value, p.std) if np.isfinite(p.std) else f"{plain(p.value, 4)} (not determined)"
            rows.append((*head, p.name, size, p.unit, before, after, *tail))
            head, tail = ("", ""), ("", "")
        competing += [(name, f"{m.effect}{on(joined(m.joints))}", f"{m.confidence:.3f}") for m in change.competing]
    if not rows:
        return []
    names = ("what", "joints", "parameter", "change ± std", "unit", "before", "after", "confidence", "held-out gain")
    note = (
        "Held-out gain: share of the squared error, weighted by noise, that it removes on blocks of the new logs that its fit did not see."
    )
    sections: list[Section] = [Table("What changed", names, tuple(rows), note, left=3)]
    if competing:
        words = "Models that account for the same."
        sections.append(Table("Competing models", ("change", "could also be", "probability"), tuple(competing), words, left=2))
    return sections


def _left(found: Monitoring) -> list[Section]:
    return [Text("What stays unexplained", tuple(u.evidence for u in found.unexplained))] if found.unexplained else []


def _errors(found: Monitoring) -> Table:
    robot = found.estimate.model.robot
    sets = [found.estimate.fit_error, found.error] + ([found.corrected] if found.changes else [])
    rows = [
        (name, robot.force_unit(j, robot.transmission.measured), *(plain(e.rms[j]) for e in sets), *(percent(e.relative[j]) for e in sets))
        for j, name in enumerate(robot.joint_names)
    ]
    rows.append(("all joints", "", *("" for _ in sets), *(percent(e.relative_all) for e in sets)))
    labels = ("the fit's own logs", "new logs", "new logs, with the changes")[: len(sets)]
    head = ("joint", "unit", *(f"rms, {label}" for label in labels), *(f"relative %, {label}" for label in labels))
    return Table("Torque error of the fit", head, tuple(rows), left=2)


def _over_time(found: Monitoring) -> Figure:
    robot = found.estimate.model.robot
    line = Timeline.of([found.signals])
    usual = found.estimate.fit_error.rms
    shown = sorted(np.argsort(-np.nan_to_num(found.error.rms / np.maximum(usual, 1e-300)))[:_JOINTS].tolist())
    panels = []
    for j in shown:
        ends = [float(line.t[0]), float(line.t[-1])]
        layers = [
            Layer.of(BlockKind.BAND, Role.BEFORE, *line.envelope(found.residual[:, j]), label="the fit"),
            *(
                [Layer.of(BlockKind.BAND, Role.AFTER, *line.envelope(found.corrected_residual[:, j]), label="with the changes")]
                if found.changes
                else []
            ),
            Layer.of(BlockKind.BAND, Role.FLOOR, ends, [-usual[j]] * 2, [usual[j]] * 2, label="usual (± 1 std of the fit's residual)"),
        ]
        unit = robot.force_unit(j, robot.transmission.measured)
        panels.append(
            Panel(robot.joint_names[j], "time, runs one after the other (s)" if j == shown[-1] else "", f"residual ({unit})", tuple(layers))
        )
    caption = "Measured torque less the torque that the saved fit predicts, least to greatest value in short stretches."
    return Figure("residual_over_time", "Residual over time, new logs", caption, tuple(panels))
