"""The report of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..diagnosis.pictures import data_of, finding_figures, findings_section
from ..diagnosis.result import by_effect
from ..diagnosis.text import undecided
from ..drawing.document import BlockKind, Figure, Layer, Panel, Report, Role, Section, Table, Text, joined, percent, plain, uncertain
from ..effects.places import on, place_of
from ..robots.transmission import Side
from ..signals.reversing import without_reversals
from ..signals.timeline import Timeline
from .replayed import replay_sections

if TYPE_CHECKING:
    from ..diagnosis import Diagnosis
    from ..signals.signals import Signals

Array = np.ndarray
#: Joints over time, rows of the table of parameters, findings with a figure of their own.
_JOINTS = 8
_SHIFTS = 14
_FIGURES = 8
#: Probabilities are told down to this.
_LEAST = 0.001
_REPLAYED_JOINTS = 12


def diagnosis_report(d: Diagnosis, *, replay: bool = True) -> Report:
    """Verdict, findings, errors, residuals before and after, competing models, advice, shifts, replayed motion, and what was used."""
    robot = d.before.model.robot
    sections: list[Section] = [*findings_section(d), *_left(d), *_hidden(d), _errors(d), *finding_figures(d), _over_time(d)]
    sections += [*_competing(d), *_advice(d), *_shifts(d)]
    if replay and d.findings and robot.n <= _REPLAYED_JOINTS:
        sections += replay_sections(d.before, d.after, d.signals if d.held is None else d.held, data_of(d))
    sections += [_source(d), *_warnings(d)]
    declared = joined(e.name for e in d.before.model.effects)
    return Report(headline(d), d.verdict, f"{robot.name}, {counted(robot.n, 'joint')}; declared model: {declared}", tuple(sections))


def headline(d: Diagnosis) -> str:
    """The verdict in one line."""
    named = "; ".join(f"{f.name}{on(place_of(f.effect, f.joints))}" for f in d.findings)
    left = joined(dict.fromkeys(u.joint for u in d.unexplained))
    if d.verdict == "ambiguous" and not any(f.ambiguous for f in d.findings):
        return f"Ambiguous: {undecided(d)}" + (f": {named}" if named else "")
    return {
        "clean": "Clean: nothing beyond the declared model is supported by the data",
        "explained": f"Explained: the model lacks {named}",
        "ambiguous": f"Ambiguous: the model lacks {named}, or competing models that account for it equally well",
        "unexplained": f"Unexplained: structure on {left} that no catalogued effect accounts for"
        + (f"; found beside it: {named}" if named else ""),
    }[d.verdict]


def _left(d: Diagnosis) -> list[Section]:
    if not d.unexplained:
        return []
    rows = tuple((u.joint, u.signature, u.evidence) for u in d.unexplained)
    return [
        Table("What stays unexplained", ("joint", "follows", "evidence"), rows, "No catalogued effect accounts for this structure.", left=3)
    ]


def _hidden(d: Diagnosis) -> list[Section]:
    if not d.hidden:
        return []
    note = "On this motion it is not distinguishable from the model's effects: that it was not found proves nothing."
    return [
        Table(
            "What this motion could not have shown",
            ("effect", "where, and how large", "to see it"),
            tuple(by_effect(d.hidden)),
            note,
            left=3,
        )
    ]


def _errors(d: Diagnosis) -> Table:
    robot, c = d.before.model.robot, d.comparison
    # The floor is that of rows away from reversals, and so is what it is compared with.
    away = without_reversals(d.signals if d.held is None else d.held)
    with np.errstate(invalid="ignore", divide="ignore"):
        left = np.array([np.sqrt(np.mean(x[np.isfinite(x)] ** 2)) if np.isfinite(x).any() else np.nan for x in d.after.residual(away).T])
        ratio = np.where(d.noise_floor > 0, left / d.noise_floor, np.nan)
    rows = []
    for j, name in enumerate(robot.joint_names):
        before, after, floor = c.error_before.rms[j], c.error_after.rms[j], d.noise_floor[j]
        relative = (percent(c.error_before.relative[j]), percent(c.error_after.relative[j]))
        unit = robot.force_unit(j, robot.transmission.measured)
        rows.append((name, unit, plain(before), plain(after), plain(floor), plain(ratio[j]), *relative))
    rows.append(("all joints", "", "", "", "", "", percent(c.error_before.relative_all), percent(c.error_after.relative_all)))
    head = ("joint", "unit", "rms before", "rms after", "noise floor", "after / floor", "relative before %", "relative after %")
    note = (
        f"Torque error on the {robot.transmission.measured.value} side, {data_of(d)} data."
        " Noise floor: the residual when everything that any candidate can take up is taken up; it is of rows away from reversals, and"
        " so is the error that is divided by it."
    )
    return Table(f"Torque error before and after, {data_of(d)} data", head, tuple(rows), note, left=2)


def _over_time(d: Diagnosis) -> Figure:
    robot = d.before.model.robot
    parts: list[Signals] = [d.signals] if d.held is None else [d.signals, d.held]
    line = Timeline.of(parts)
    before, after = (np.concatenate([e.residual(s) for s in parts]) for e in (d.before, d.after))
    shown = _worst(d)
    panels = []
    for j in shown:
        unit = robot.force_unit(j, robot.transmission.measured)
        layers = [Layer.of(BlockKind.SPAN, Role.FLOOR, line.starts[1], label="held out")] if d.held is not None else []
        layers.append(Layer.of(BlockKind.BAND, Role.BEFORE, *line.envelope(before[:, j]), label="before"))
        if d.findings:
            layers.append(Layer.of(BlockKind.BAND, Role.AFTER, *line.envelope(after[:, j]), label="after"))
        panels.append(
            Panel(robot.joint_names[j], "time, runs one after the other (s)" if j == shown[-1] else "", f"residual ({unit})", tuple(layers))
        )
    more = f" The {len(shown)} joints with the largest error of {robot.n}." if len(shown) < robot.n else ""
    caption = f"Measured less predicted torque, least to greatest value in short stretches; gaps: rows that are not used.{more}"
    return Figure("residual_over_time", "Residual over time", caption, tuple(panels))


def _worst(d: Diagnosis) -> list[int]:
    """The joints to show, in the robot's order: those whose error before is largest beside the noise."""
    ratio = np.nan_to_num(d.comparison.error_before.rms / np.maximum(d.noise_floor, 1e-300))
    return sorted(np.argsort(-ratio)[:_JOINTS].tolist())


def _competing(d: Diagnosis) -> list[Section]:
    rows = [
        (
            f"{i}. {f.name}{on(place_of(f.effect, f.joints))}",
            f"{m.effect}{on(m.place)}",
            ", ".join(f"{value:.4g} {unit}" for _, value, unit in m.values),
            f"{100 * m.share:.0f} %" if np.isfinite(m.share) else "",
            f"{m.confidence:.3f}" if m.confidence >= _LEAST else f"< {_LEAST}",
        )
        for i, f in enumerate(d.findings, 1)
        for m in f.competing
    ]
    if not rows:
        return []
    words = "Refitted in the finding's place: what their parameters would be there, and how much of what it explains they take up."
    return [Table("Competing models", ("finding", "in its place", "with", "takes up", "probability"), tuple(rows), words, left=3)]


def _advice(d: Diagnosis) -> list[Section]:
    lines = tuple(f"{i}. {f.advice}" for i, f in enumerate(d.findings, 1) if f.advice)
    return [Text("Advice", lines)] if lines else []


def _shifts(d: Diagnosis) -> list[Section]:
    shifts = d.comparison.shifts
    moved = [s for s in shifts if abs(s.sigmas) > 2]
    if not d.findings or not moved:
        return []
    rows = tuple(
        (s.name, s.unit, uncertain(s.before, s.std_before), uncertain(s.after, s.std_after), f"{s.sigmas:+.1f}") for s in moved[:_SHIFTS]
    )
    note = (
        f"{len(moved)} of {len(shifts)} parameters moved by more than two of their former standard deviations:"
        " the bias that the missing effects had caused."
    )
    return [Table("How the other parameters moved", ("parameter", "unit", "before", "after", "move in former std"), rows, note, left=2)]


def _source(d: Diagnosis) -> Table:
    report = d.signals.report
    rows = [
        ("positions low-passed at", "–" if report.cutoff_hz is None else f"{report.cutoff_hz:.3g} Hz"),
        ("rows low-passed at", "–" if report.row_cutoff_hz is None else f"{report.row_cutoff_hz:.3g} Hz"),
        ("rows a joint: fitted, held out", f"{len(d.signals.tau)}, {0 if d.held is None else len(d.held.tau)}"),
        ("side of the torque", Side(d.before.model.robot.transmission.measured).value),
        *((f"log {k}", f"{i['path']} (SHA-256 {str(i['sha256'])[:12]}…)") for k, i in enumerate(d.before.inputs, 1)),
    ]
    return Table("Data", ("", ""), tuple(rows), left=2)


def _warnings(d: Diagnosis) -> Sequence[Section]:
    return [Text("Warnings", d.warnings)] if d.warnings else []
