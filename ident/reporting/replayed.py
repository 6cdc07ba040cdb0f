"""Replayed motion before and after: both models driven by the measured torque over the same windows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role, Section, Table, Text, plain
from ..errors import IdentError
from ..simulation.replay import replay

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from ..simulation.replay import Replay

Array = np.ndarray
_WINDOWS = 12
_MOST_EVALUATIONS = 8_000
_SHOWN_WINDOWS = 6
_SHOWN_JOINTS = 4
TITLE = "Replayed motion"


def replay_sections(before: Estimate, after: Estimate, signals: Signals, data: str) -> tuple[Section, ...]:
    """A table of errors and the trajectories of the joints that move most; a word of why, where nothing can be replayed."""
    try:
        old, new = (replay(e.model, e.all_values, signals, windows=_WINDOWS, most=_MOST_EVALUATIONS) for e in (before, after))
    except IdentError as error:
        return (Text(TITLE, (f"Not replayed: {error}",)),)
    except (np.linalg.LinAlgError, FloatingPointError) as error:
        return (Text(TITLE, (f"Not replayed: a model cannot be simulated ({error}).",)),)
    table = _table(old, new, data)
    return (table, _figure(old, new, data)) if np.isfinite(new.simulated).any() else (table,)


def _table(old: Replay, new: Replay, data: str) -> Table:
    rows = []
    for j, joint in enumerate(old.robot.joints):
        scale, unit = (1e3, "mm") if joint.prismatic else (180 / np.pi, "deg")
        rows.append((joint.name, unit, *(plain(scale * float(r.median_error[j])) for r in (old, new))))
    rows.append(("windows that diverged", "", *(f"{int(r.diverged.sum())} of {len(r.starts)}" for r in (old, new))))
    note = (
        f"Median over windows of {old.t[-1]:.2g} s of the rms position error; started at the measured state, driven by the measured torque."
    )
    return Table(f"{TITLE}, {data} data", ("joint", "unit", "before", "after"), tuple(rows), note, left=2)


def _figure(old: Replay, new: Replay, data: str) -> Figure:
    """The first windows side by side; joints whose error changes most (relative to their motion) first."""
    keep = np.flatnonzero(~old.diverged | ~new.diverged)[:_SHOWN_WINDOWS]
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = np.nanstd(old.measured - old.measured[:1], axis=(0, 1))
        change = np.where(moved > 0, np.abs(old.position_error - new.position_error) / moved, 0.0)
    order = np.argsort(-np.nan_to_num(change))[:_SHOWN_JOINTS]
    length = old.t[-1]
    t = (np.append(old.t, np.nan)[:, None] + np.arange(len(keep)) * 1.08 * length).T.ravel()

    def line(values: Array, j: int, scale: float) -> Array:
        return np.concatenate([values[:, keep, j] * scale, np.full((1, len(keep)), np.nan)]).T.ravel()

    panels = []
    for j in order:
        joint = old.robot.joints[int(j)]
        scale, unit = (1e3, "mm") if joint.prismatic else (180 / np.pi, "deg")
        layers = [
            Layer.of(BlockKind.LINE, role, t, line(values, int(j), scale), label=label)
            for role, values, label in (
                (Role.MEASURED, old.measured, "measured"),
                (Role.BEFORE, old.simulated, "replayed before"),
                (Role.AFTER, new.simulated, "replayed after"),
            )
        ]
        panels.append(Panel(joint.name, "windows one after the other (s)", f"position ({unit})", tuple(layers)))
    caption = f"Both models driven by the measured torque of the {data} data, each window from the measured state."
    return Figure("replay", "Replayed trajectories before and after", caption, tuple(panels), columns=1)
