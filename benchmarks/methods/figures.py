"""Figures as PNG. Those of the dissertation (3.6.1 to 3.6.4, measured against simulated motion) are not at hand; these follow its text."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .convergence import CONVERGED, Growth, Recursion
from .data import Data
from .degradation import Sweep
from .methods import METHODS
from .monte_carlo import Trials
from .trajectories import Forward

#: Which method stands for which family in the figures of motion.
SHOWN = {"3.6.1": "steps", "3.6.2": "ls_raw", "3.6.3": "iv"}
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def _new(rows: int, columns: int, width: float, height: float):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    # A fixed layout: searching one costs more than the drawing.
    figure.subplots_adjust(0.9 / width, 0.6 / height, 1 - 0.2 / width, 1 - 0.7 / height, wspace=0.3, hspace=0.4)
    return figure, axes


def _write(figure, folder: Path, name: str) -> Path:
    path = folder / name
    figure.savefig(path, dpi=110)
    return path


def motion_figures(data: Data, forward: Mapping[str, Forward], folder: Path) -> list[Path]:
    """3.6.1 to 3.6.3: true and simulated joint angles of one validation run; 3.6.4: error of the three methods against time."""
    made = []
    joints = data.world.model.robot.joint_names
    for number, key in SHOWN.items():
        if key not in forward:
            continue
        run = forward[key].replay
        figure, axes = _new(2, 3, 11, 6)
        for j, axis in enumerate(axes[: len(joints)]):
            axis.plot(run.t, np.degrees(run.measured[:, 0, j]), color="black", lw=2, label="true motion")
            axis.plot(run.t, np.degrees(run.simulated[:, 0, j]), color=_COLOURS[1], lw=1.2, ls="--", label="simulated")
            axis.set(title=joints[j], xlabel="time / s", ylabel="angle / deg")
            low, high = np.degrees([run.measured[:, 0, j].min(), run.measured[:, 0, j].max()])
            axis.set_ylim(low - 0.3 * (high - low) - 1, high + 0.3 * (high - low) + 1)
        axes[0].legend()
        figure.suptitle(f"{number}  {forward[key].title}: torque-driven validation run, simulated with the estimate")
        made.append(_write(figure, folder, f"figure_{number.replace('.', '_')}.png"))
    figure, axes = _new(2, 3, 11, 6)
    for colour, key in zip(_COLOURS, SHOWN.values(), strict=False):
        if key not in forward:
            continue
        run = forward[key].replay
        # Windows that diverge count as large.
        error = np.degrees(np.median(np.nan_to_num(np.abs(run.simulated - run.measured), nan=np.pi), axis=1))
        for j, axis in enumerate(axes[: len(joints)]):
            axis.semilogy(run.t[1:], np.maximum(error[1:, j], 1e-6), color=colour, label=forward[key].title)
            axis.set(title=joints[j], xlabel="time / s", ylabel="error / deg")
    axes[0].legend(fontsize=7)
    figure.suptitle("3.6.4  error of the simulated motion, median over the validation windows")
    made.append(_write(figure, folder, "figure_3_6_4.png"))
    return made


def recursion_figure(recursions: Mapping[str, Recursion], folder: Path) -> Path:
    """Course of the followed parameters against the number of samples."""
    names = next(iter(recursions.values())).names
    figure, axes = _new(1, len(names), 4.2 * len(names), 3.8)
    for i, axis in enumerate(axes):
        for colour, r in zip(_COLOURS, recursions.values(), strict=False):
            axis.semilogx(r.samples, r.values[:, i], color=colour, label=r.title)
            axis.fill_between(r.samples, r.values[:, i] - 2 * r.std[:, i], r.values[:, i] + 2 * r.std[:, i], color=colour, alpha=0.2)
            axis.plot(r.samples[-1:], r.batch[i : i + 1], "o", color=colour, ms=5)
        truth = next(iter(recursions.values())).truth[i]
        axis.axhline(truth, color="black", lw=0.8, ls=":", label="truth")
        axis.set(title=names[i], xlabel="samples", ylabel="kg m²")
        axis.set_ylim(min(0.0, 1.5 * truth) - 0.2 * abs(truth), 1.6 * abs(truth))
    axes[0].legend(fontsize=7)
    figure.suptitle("recursive least squares against samples (dots: batch solution; bands: two standard deviations for white noise)")
    return _write(figure, folder, "recursion.png")


def growth_figure(growths: Mapping[str, Growth], folder: Path) -> Path:
    """Torque error against the amount of data."""
    figure, (axis,) = _new(1, 1, 6, 4)
    for colour, g in zip(_COLOURS, growths.values(), strict=False):
        axis.loglog(g.samples, 100 * g.errors, "o-", color=colour, label=g.title)
    axis.axhline(100 * CONVERGED, color="black", lw=0.8, ls=":")
    axis.set(xlabel="samples", ylabel="torque error on unseen motion / %")
    axis.legend(fontsize=7)
    return _write(figure, folder, "data_needed.png")


def degradation_figure(sweeps: Mapping[str, Sweep], folder: Path) -> Path:
    """Torque error against noise, encoder counts, cut-off and rate."""
    figure, axes = _new(1, len(sweeps), 3.6 * len(sweeps), 3.6)
    colours = {key: colour for colour, key in zip(_COLOURS, next(iter(sweeps.values())).errors, strict=False)}
    for axis, sweep in zip(axes, sweeps.values(), strict=True):
        for key, errors in sweep.errors.items():
            axis.loglog(np.maximum(sweep.values, 0.1), 100 * errors, "o-", color=colours[key], label=METHODS[key].title)
        axis.set(xlabel=sweep.title + (f" / {sweep.unit}" if sweep.unit else ""), ylabel="torque error / %")
    axes[0].legend(fontsize=7)
    return _write(figure, folder, "degradation.png")


def error_figure(trials: Mapping[str, Trials], groups: Mapping[str, list[int]], folder: Path) -> Path:
    """Rms error of every group over the bound."""
    used = [t for t in trials.values() if t.usable]
    figure, (axis,) = _new(1, 1, 9, 4.5)
    place = np.arange(len(used))
    for i, (name, group) in enumerate(groups.items()):
        axis.semilogy(place + 0.1 * (i - len(groups) / 2), [t.error(group) for t in used], "o", color=_COLOURS[i % 6], label=name)
    axis.axhline(1.0, color="black", lw=0.8, ls=":")
    axis.set_xticks(place, [t.method.title for t in used], rotation=40, ha="right", fontsize=7)
    axis.set_ylabel("rms error / Cramér-Rao bound")
    figure.subplots_adjust(bottom=0.4)
    axis.legend(fontsize=7)
    return _write(figure, folder, "errors.png")
