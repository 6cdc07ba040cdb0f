"""Signals made as others were: the same preparation, with the cut-offs that it chose then."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..logs.reading import logs_of
from .preparation import Preparation, make_preparation
from .signals import Signals

if TYPE_CHECKING:
    from ..robots.robot import Robot


def like(report: Mapping[str, Any]) -> Preparation:
    """The preparation that a report (`PreparationReport.to_dict`) tells of, with the cut-offs that it chose."""
    chosen = {"cutoff_hz": report["cutoff_hz"]}
    if report["cutoff_hz"] is None:  # nothing that the row filter's would follow from
        chosen["row_cutoff_hz"] = report["row_cutoff_hz"]
    return make_preparation(**{**report["config"], **chosen})


def likewise(data: Any, robot: Robot, report: Mapping[str, Any]) -> Signals:
    """Signals as they are; anything that `read_logs` takes, and logs, prepared like those of the report."""
    return data if isinstance(data, Signals) else like(report)(logs_of(data, robot), robot)
