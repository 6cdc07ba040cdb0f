"""The report of an estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .document import Report, Section, Table, Text, joined, percent, plain, uncertain

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate


def estimate_report(estimate: Estimate) -> Report:
    """Status, errors, parameters and warnings."""
    robot = estimate.model.robot
    errors = [("fit", estimate.fit_error)] + ([("held out", estimate.heldout_error)] if estimate.heldout_error else [])
    rows = []
    for j, name in enumerate(robot.joint_names):
        cells = [cell for _, e in errors for cell in (plain(e.rms[j]), percent(e.relative[j]))]
        rows.append((name, robot.force_unit(j, robot.transmission.measured), *cells))
    rows.append(("all joints", "", *(cell for _, e in errors for cell in ("", percent(e.relative_all)))))
    head = ("joint", "unit", *(f"{label}, {what}" for label, _ in errors for what in ("rms", "relative %")))
    side = robot.transmission.measured.value
    sections: list[Section] = [Table("Torque error", head, tuple(rows), f"On the {side} side.", left=2)]
    sections.append(_parameters(estimate))
    if estimate.dropped:
        sections.append(Text("Not determined by the data", (joined(estimate.dropped),)))
    if estimate.warnings:
        sections.append(Text("Warnings", estimate.warnings))
    code = estimate.status.code.value
    declared = joined(e.name for e in estimate.model.effects)
    return Report(f"{estimate.method}: {estimate.status.text}", code, f"{robot.name}, {robot.n} joints; model: {declared}", tuple(sections))


def _parameters(estimate: Estimate) -> Table:
    rows = []
    for p, value, std, expression in zip(estimate.parameters, estimate.values, estimate.std, estimate.base.expressions, strict=True):
        ratio = abs(value) / std if std > 0 else np.inf
        rows.append((p.name, expression, uncertain(float(value), float(std)), p.unit, plain(float(ratio))))
    head = ("parameter", "base-parameter expression", "value ± std", "unit", "|value| / std")
    note = f"{len(rows)} base parameters from {estimate.samples} rows; condition {estimate.condition:.3g}."
    return Table("Parameters", head, tuple(rows), note, left=2)
