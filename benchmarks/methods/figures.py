"""Figures as PNG. Those numbered 3.6.1 to 3.6.4 show what the dissertation's figures of the same number show, on data of our own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .convergence import CONVERGED, Growth
from .data import Data
from .degradation import Sweep
from .methods import METHODS
from .monte_carlo import Trials
from .recursions import BAND, Recursion
from .trajectories import Forward

#: Which method stands for which of the source in the figures of motion.
SHOWN = {"steps": "step by step", "ls_raw": "simultaneous (LS)", "iv_plain": "advanced simultaneous (IV)"}
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")


def _new(rows: int, columns: int, width: float, height: float):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    # A fixed layout: searching one costs more than the drawing.
    figure.subplots_adjust(0.9 / width, 0.6 / height, 1 - 0.3 / width, 1 - 0.7 / height, wspace=0.3, hspace=0.4)
    return figure, axes


def _write(figure, folder: Path, name: str) -> Path:
    path = folder / name
    figure.savefig(path, dpi=110)
    return path


def convergence_figure(recursions: Mapping[str, Recursion], folder: Path) -> Path:
    """3.6.1: J1z and J5z against the number of iterations, by the simultaneous and by the advanced method."""
    figure, axes = _new(2, 1, 8, 7)
    for axis, name, label in zip(axes, ("Izz_joint1", "Izz_joint5"), ("$J_{1z}$", "$J_{5z}$"), strict=True):
        for colour, r in zip(_COLOURS[:2], recursions.values(), strict=True):
            axis.plot(r.samples, r.course(name), color=colour, lw=1.4, label=r.title)
            settled = r.settled_one(name)
            if np.isfinite(settled):
                axis.axvline(settled, color=colour, lw=0.8, ls="--", label=f"within ±{100 * BAND:g} % of its end from {settled:,.0f} on")
        first = next(iter(recursions.values()))
        truth = first.truth[first.names.index(name)]
        axis.axhline(truth, color="black", lw=0.8, ls=":", label="true value")
        axis.set(xlabel="number of iterations (samples of 5 ms)", ylabel=f"{label} / kg m²", xlim=(0, first.instants))
        # What comes after the first thirtieth, which is far off.
        seen = [x for r in recursions.values() for x in r.course(name)[len(r.samples) // 30 :] if np.isfinite(x)]
        low, high = min(*seen, truth), max(*seen, truth)
        axis.set_ylim(low - 0.15 * (high - low), high + 0.15 * (high - low))
        axis.legend(fontsize=7, loc="best")
    figure.suptitle("3.6.1  Convergence of $J_{1z}$ and $J_{5z}$: simultaneous and advanced simultaneous identification")
    return _write(figure, folder, "figure_3_6_1.png")


def motion_figures(forward: Mapping[str, Forward], folder: Path) -> list[Path]:
    """3.6.2, 3.6.3, 3.6.4: joints 1 and 2, 3 and 4, 5 and 6 of one run from standstill, measured and simulated with the three methods.

    The run is that of the median error of the simultaneous method, which is the largest."""
    made = []
    replays = {key: forward[key].replay for key in SHOWN if key in forward}
    first = next(iter(replays.values()))
    run = int(np.argsort(np.sqrt(np.mean(replays["ls_raw"].window_error ** 2, axis=1)))[(len(first.starts) - 1) // 2])
    for number, pair in (("3.6.2", (0, 1)), ("3.6.3", (2, 3)), ("3.6.4", (4, 5))):
        figure, axes = _new(2, 1, 8, 7)
        for axis, j in zip(axes, pair, strict=True):
            measured = np.degrees(first.measured[:, run, j])
            axis.plot(first.t, measured, color="black", lw=2.8, alpha=0.5, label="measured")
            for colour, style, (key, label) in zip(_COLOURS, ("-", "--", "-."), SHOWN.items(), strict=False):
                if key in replays:
                    axis.plot(replays[key].t, np.degrees(replays[key].simulated[:, run, j]), color=colour, lw=1.3, ls=style, label=label)
            room = 0.35 * np.ptp(measured) + 1.0
            axis.set(xlabel="time / s", ylabel=f"joint {j + 1} / deg", xlim=(0, first.t[-1]))
            axis.set_ylim(measured.min() - room, measured.max() + room)
        axes[0].legend(fontsize=7, loc="best")
        figure.suptitle(f"{number}  Joints {pair[0] + 1} and {pair[1] + 1}: measured and simulated trajectories from standstill")
        made.append(_write(figure, folder, f"figure_{number.replace('.', '_')}.png"))
    return made


def error_course_figure(data: Data, forward: Mapping[str, Forward], folder: Path) -> Path:
    """Error of the simulated motion against time, median over the validation runs; not a figure of the source."""
    figure, axes = _new(2, 3, 11, 6)
    for colour, (key, label) in zip(_COLOURS, SHOWN.items(), strict=False):
        if key not in forward:
            continue
        run = forward[key].replay
        error = np.degrees(np.median(np.abs(np.nan_to_num(run.simulated - run.measured, nan=np.inf)), axis=1))
        for j, axis in enumerate(axes[: error.shape[1]]):
            axis.semilogy(run.t[1:], np.maximum(error[1:, j], 1e-5), color=colour, label=label)
            axis.set(title=data.world.model.robot.joint_names[j], xlabel="time / s", ylabel="error / deg")
    axes[0].legend(fontsize=7)
    figure.suptitle("error of the simulated motion, median over the validation runs")
    return _write(figure, folder, "motion_error.png")


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
