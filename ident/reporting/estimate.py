"""The report of an estimate."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from .._utils.text import counted
from ..drawing.document import Report, Section, Text, joined
from ..estimate.pictures import correlation_figure, estimate_sections, residual_figures, values_figure
from .robot import robot_sections

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate


def estimate_report(estimate: Estimate) -> Report:
    """Status, errors, parameters with intervals and correlations, the residual in every view where the signals are at hand, the robot's
    links, and warnings."""
    robot = estimate.model.robot
    sections: list[Section] = [*estimate_sections(estimate)]
    sections += [values_figure(estimate), correlation_figure(estimate)]
    if estimate.problem is not None:
        signals = estimate.problem.signals
        sections += residual_figures(estimate, signals, estimate.residual(signals), "fitted")
    sections += robot_sections(estimate)
    if estimate.dropped:
        sections.append(Text("Not determined by the data", (joined(estimate.dropped),)))
    if estimate.warnings:
        sections.append(Text("Warnings", estimate.warnings))
    code = estimate.status.code.value
    declared = joined(e.name for e in estimate.model.effects)
    headline = re.split(r"[;.] ", estimate.status.text)[0].rstrip(".")
    return Report(f"{estimate.method}: {headline}", code, f"{robot.name}, {counted(robot.n, 'joint')}; model: {declared}", tuple(sections))
