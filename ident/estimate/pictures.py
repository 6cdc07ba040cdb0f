"""What an estimate shows: its parameters with their intervals, measured against predicted torque, errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role, Section, Table, Text, percent, plain, uncertain
from ..signals.timeline import Timeline
from .significance import insignificant

if TYPE_CHECKING:
    import pandas as pd

    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from ..statistics.torque_error import TorqueError
    from .record import EstimateRecord

Array = np.ndarray
#: Intervals are drawn from and to these shares of the value; rows beyond which torque is drawn as a band of its extremes.
_LEFT, _RIGHT = -1.0, 3.0
_MOST_ROWS = 6000


def estimate_sections(estimate: EstimateRecord) -> tuple[Section, ...]:
    """Status, torque errors and parameters."""
    errors = {"fit": estimate.fit_error} | ({"held out": estimate.heldout_error} if estimate.heldout_error else {})
    return (Text(f"{estimate.method}: {estimate.status.code.value}", (estimate.status.text,)), error_section(estimate.model.robot, errors),
            parameters_section(estimate))  # fmt: skip


def error_section(robot: Robot, errors: Mapping[str, TorqueError], title: str = "Torque error") -> Table:
    """Torque error of each joint on each set of data, and over all joints."""
    side = robot.transmission.measured
    rows = []
    for j, name in enumerate(robot.joint_names):
        cells = [cell for e in errors.values() for cell in (plain(e.rms[j]), percent(e.relative[j]))]
        rows.append((name, robot.force_unit(j, side), *cells))
    rows.append(("all joints", "", *(cell for e in errors.values() for cell in ("", percent(e.relative_all)))))
    head = ("joint", "unit", *(f"{label}, {what}" for label in errors for what in ("rms", "relative %")))
    about = "; ".join(dict.fromkeys(e.about for e in errors.values()))
    return Table(title, head, tuple(rows), f"On the {side.value} side, {about}.", left=2)


def error_frame(robot: Robot, errors: Mapping[str, TorqueError]) -> pd.DataFrame:
    """The same as numbers: one row per joint and one for all; for each set of data rms (N m, N) and relative error (a share)."""
    import pandas as pd

    table: dict[str, Array] = {}
    for label, e in errors.items():
        table[f"{label}: rms"] = np.append(e.rms, np.nan)
        table[f"{label}: relative"] = np.append(e.relative, e.relative_all)
    return pd.DataFrame(table, index=pd.Index([*robot.joint_names, "all joints"], name="joint"))


def parameters_section(estimate: EstimateRecord) -> Table:
    """Each base parameter with its standard deviation, and whether it is significant."""
    rows, doubtful = [], {i.name for i in insignificant(estimate)}
    for p, value, std, expression in zip(estimate.parameters, estimate.values, estimate.std, estimate.base.expressions, strict=True):
        ratio = abs(value) / std if std > 0 else np.inf
        mark = "insignificant" if p.name in doubtful else ""
        rows.append((p.name, expression, mark, uncertain(float(value), float(std)), p.unit, plain(float(ratio))))
    head = ("parameter", "base-parameter expression", "", "value ± std", "unit", "|value| / std")
    note = f"{len(rows)} base parameters from {estimate.samples} rows; condition {estimate.condition:.3g}."
    return Table("Parameters", head, tuple(rows), note, left=3)


def estimate_frame(estimate: EstimateRecord) -> pd.DataFrame:
    """One row for each base parameter."""
    import pandas as pd

    interval, doubtful = estimate.confidence_interval(), {i.name for i in insignificant(estimate)}
    table = {
        "value": estimate.values,
        "std": estimate.std,
        "low": interval[:, 0],
        "high": interval[:, 1],
        "unit": [p.unit for p in estimate.parameters],
        "effect": [p.effect for p in estimate.parameters],
        "joint": [p.joint for p in estimate.parameters],
        "significant": [name not in doubtful for name in estimate.names],
        "expression": list(estimate.base.expressions),
    }
    return pd.DataFrame(table, index=pd.Index(estimate.names, name="parameter"))


def values_figure(estimate: EstimateRecord) -> Figure:
    """Each parameter's 95 % interval in shares of its value: what reaches to zero is insignificant."""
    doubtful = {i.name for i in insignificant(estimate)}
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = np.sort(estimate.confidence_interval() / estimate.values[:, None], axis=1)
    interval = np.clip(np.nan_to_num(interval, nan=0.0, posinf=_RIGHT, neginf=_LEFT), _LEFT, _RIGHT)
    layers = [Layer.of(BlockKind.LINE, Role.FLOOR, (0.0, 0.0), (-0.5, len(interval) - 0.5))]
    for role, label, chosen in ((Role.AFTER, "significant", False), (Role.BEFORE, "insignificant", True)):
        at = np.array([i for i, name in enumerate(estimate.names) if (name in doubtful) == chosen], int)
        if not len(at):
            continue
        x = 100 * np.column_stack([interval[at], np.full(len(at), np.nan)]).ravel()
        layers.append(Layer.of(BlockKind.LINE, role, x, np.repeat(at, 3).astype(float)))
        layers.append(Layer.of(BlockKind.MARKS, role, np.full(len(at), 100.0), at.astype(float), label=label))
    names = tuple(
        f"{p.name} = {uncertain(float(v), float(s))} {'' if p.unit == '1' else p.unit}".rstrip()
        for p, v, s in zip(estimate.parameters, estimate.values, estimate.std, strict=True)
    )
    caption = (
        "95 % interval of each base parameter in per cent of its value, cut at -100 and 300 %; its value ± standard deviation on the left."
        " Insignificant: the interval covers zero, or the standard deviation exceeds 30 %."
    )
    return Figure(
        "parameters", "Parameters with their intervals", caption, (Panel("", "95 % interval, % of the value", "", tuple(layers), names),)
    )


def torque_figure(estimate: EstimateRecord, signals: Signals, data: str = "") -> Figure:
    """For each joint measured and predicted torque, and beside them the residual on a scale of its own."""
    residual, robot = estimate.residual(signals), estimate.model.robot
    return measured_figure(robot, signals, np.where(np.isfinite(residual), signals.tau, np.nan), residual, data)


def measured_figure(robot: Robot, signals: Signals, measured: Array, residual: Array, data: str) -> Figure:
    """Measured (M, n) and predicted torque with the residual (M, n), run after run."""
    line, side = Timeline.of([signals]), robot.transmission.measured
    few = len(measured) <= _MOST_ROWS

    def layer(role: Role, values: Array, label: str) -> Layer:
        if few:
            t, y = (np.concatenate([np.append(v[rows], np.nan) for rows in line.edges]) for v in (line.t, values))
            return Layer.of(BlockKind.LINE, role, t, y, label=label)
        return Layer.of(BlockKind.BAND, role, *line.envelope(values), label=label)

    panels = []
    for j, name in enumerate(robot.joint_names):
        torque = (layer(Role.MEASURED, measured[:, j], "measured"), layer(Role.AFTER, (measured - residual)[:, j], "predicted"))
        time, unit = "time, runs one after the other (s)" if j == robot.n - 1 else "", robot.force_unit(j, side)
        panels.append(Panel(name, time, f"torque ({unit})", torque))
        panels.append(Panel(name, time, f"residual ({unit})", (layer(Role.BEFORE, residual[:, j], "residual"),)))
    which = f"{data} data, " if data else ""
    caption = f"Torque on the {side.value} side, {which}filtered like the rows; gaps: rows that are not used."
    return Figure("torque", "Measured and predicted torque", caption, tuple(panels), columns=2)


def dots_figure(robot: Robot, errors: Mapping[str, TorqueError], roles: Sequence[Role], title: str, caption: str) -> Figure:
    """Relative torque error of each joint, one mark for each set of data."""
    names = (*robot.joint_names, "all joints")
    at = np.arange(len(names), dtype=float)
    layers = tuple(
        Layer.of(BlockKind.MARKS, role, 100 * np.append(e.relative, e.relative_all), at, label=label)
        for role, (label, e) in zip(roles, errors.items(), strict=True)
    )
    return Figure("torque_error", title, caption, (Panel("", "torque error, %", "", layers, names),))
