"""The report of an estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..drawing.document import Report, Section, Text, joined
from ..estimate.pictures import estimate_sections, torque_figure, values_figure

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate


def estimate_report(estimate: Estimate) -> Report:
    """Status, errors, parameters, their intervals, measured and predicted torque where the signals are at hand, and warnings."""
    robot = estimate.model.robot
    sections: list[Section] = [*estimate_sections(estimate)]
    sections.append(values_figure(estimate))
    if estimate.problem is not None:
        sections.append(torque_figure(estimate, estimate.problem.signals, "fitted"))
    if estimate.dropped:
        sections.append(Text("Not determined by the data", (joined(estimate.dropped),)))
    if estimate.warnings:
        sections.append(Text("Warnings", estimate.warnings))
    code = estimate.status.code.value
    declared = joined(e.name for e in estimate.model.effects)
    return Report(f"{estimate.method}: {estimate.status.text}", code, f"{robot.name}, {robot.n} joints; model: {declared}", tuple(sections))
