"""What an estimate shows: its parameters with their intervals, measured against predicted torque, errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..drawing.document import BlockKind, Figure, Layer, Panel, Role, Section, Table, Text, percent, plain, uncertain
from ..robots.transmission import Side
from ..signals.timeline import Timeline, binned, cloud
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
    note = f"{counted(len(rows), 'base parameter')} from {counted(estimate.samples, 'row')}; condition {estimate.condition:.3g}."
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


def correlation_figure(estimate: EstimateRecord) -> Figure:
    """Correlation of each pair of base parameters: near -1 or 1, only a combination of the two is known."""
    correlation = np.nan_to_num(estimate.correlation)
    x, y = (v.ravel().astype(float) for v in np.meshgrid(*(np.arange(len(correlation)),) * 2))
    cells = Layer.of(BlockKind.CELLS, Role.AFTER, x, y, correlation.ravel())
    panel = Panel("", "parameter, in the order of the rows", "", (cells,), tuple(estimate.names))
    caption = (
        "Correlation between the errors of two parameters, from -1 to 1. Near either end, the log determines only a combination of both."
    )
    return Figure("correlation", "Correlation of the parameters", caption, (panel,))


def axes_figure(robot: Robot, signals: Signals, residual: Array, data: str = "") -> Figure:
    """The residual (M, n) of each joint against its own position, speed and acceleration, with its mean over bins."""
    side, at = robot.transmission.measured, signals.centres
    panels = []
    for j, name in enumerate(robot.joint_names):
        unit = robot.position_unit(j, Side.JOINT)
        quantities = (("position", unit, signals.q), ("speed", f"{unit}/s", signals.dq), ("acceleration", f"{unit}/s^2", signals.ddq))
        for i, (what, own, values) in enumerate(quantities):
            x, y = values[at, j], residual[:, j]
            layers = (
                Layer.of(BlockKind.POINTS, Role.BEFORE, *cloud(x, y)),
                Layer.of(BlockKind.LINE, Role.AFTER, *binned(x, y), label="mean"),
            )
            label = f"residual ({robot.force_unit(j, side)})" if i == 0 else ""
            panels.append(Panel(name, f"{what} ({own})", label, layers))
    which = f" of the {data} data" if data else ""
    caption = (
        f"Each joint's residual{which} against its own motion. A mean that follows a curve is a missing effect: friction shows against"
        " speed, springs and gravity against position, inertia and delay against acceleration."
    )
    return Figure("residual_axes", "Residual against position, speed and acceleration", caption, tuple(panels), columns=3)


def spectrum_figure(robot: Robot, signals: Signals, residual: Array, data: str = "") -> Figure:
    """Amplitude spectrum of the residual (M, n) of each joint, over frequency; rows that are not used count as zero."""
    panels = []
    for j, name in enumerate(robot.joint_names):
        longest = max((rows for rows in signals.row_runs), key=lambda rows: rows.stop - rows.start)
        x = np.nan_to_num(residual[longest, j])
        window = np.hanning(len(x))
        amplitude = 2.0 * np.abs(np.fft.rfft(x * window)) / max(window.sum(), 1e-300)
        frequency = np.fft.rfftfreq(len(x), 1.0 / signals.row_rate)
        line = Layer.of(BlockKind.LINE, Role.BEFORE, frequency[1:], amplitude[1:])
        unit = robot.force_unit(j, robot.transmission.measured)
        panels.append(Panel(name, "frequency (Hz)", f"amplitude ({unit})", (line,)))
    which = f" of the {data} data" if data else ""
    caption = f"Residual{which}, longest run, filtered like the rows. A peak at one frequency is a resonance, or something that turns."
    return Figure("spectrum", "Spectrum of the residual", caption, tuple(panels), columns=2)


def residual_figures(estimate: EstimateRecord, signals: Signals, residual: Array, data: str = "") -> tuple[Figure, ...]:
    """The residual (M, n) on `signals` in every view: with the torque over time, against motion, over frequency."""
    robot = estimate.model.robot
    measured = np.where(np.isfinite(residual), signals.tau, np.nan)
    return (
        measured_figure(robot, signals, measured, residual, data),
        axes_figure(robot, signals, residual, data),
        spectrum_figure(robot, signals, residual, data),
    )


def dots_figure(robot: Robot, errors: Mapping[str, TorqueError], roles: Sequence[Role], title: str, caption: str) -> Figure:
    """Relative torque error of each joint, one mark for each set of data."""
    names = (*robot.joint_names, "all joints")
    at = np.arange(len(names), dtype=float)
    layers = tuple(
        Layer.of(BlockKind.MARKS, role, 100 * np.append(e.relative, e.relative_all), at, label=label)
        for role, (label, e) in zip(roles, errors.items(), strict=True)
    )
    return Figure("torque_error", title, caption, (Panel("", "torque error, %", "", layers, names),))
