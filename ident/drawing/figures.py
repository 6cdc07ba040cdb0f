"""Figures drawn: as a file for a report, or on axes of the user's own."""

from __future__ import annotations

import importlib
import io
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError
from .document import BlockKind, Figure, Layer, Panel, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray
#: Colours that everyone distinguishes, in grey too (Okabe & Ito).
COLOURS = {
    Role.BEFORE: "#D55E00",
    Role.AFTER: "#0072B2",
    Role.EFFECT: "#009E73",
    Role.FLOOR: "#9a9a9a",
    Role.MEASURED: "#333333",
}
_WIDTH_INCHES = 9.6
#: A cloud of more points than this is drawn finer.
_MANY = 1500
_STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "svg.fonttype": "path",
    "svg.hashsalt": "ident",
}


def require_matplotlib() -> None:
    """Raises ConfigurationError where the drawing library is not installed."""
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        raise ConfigurationError("figures and reports need matplotlib; install it with: pip install 'ident[report]'") from None


def draw(figure: Figure, form: str = "svg") -> bytes:
    """A figure as a file's content; `form`: "svg", "png" or "pdf". Raises ConfigurationError without matplotlib."""
    require_matplotlib()
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    with mpl.rc_context(_STYLE):
        canvas = Canvas(figsize=_size(figure), layout="constrained")
        FigureCanvasAgg(canvas)
        _arranged(figure, canvas)
        file = io.BytesIO()
        metadata = {"Date": None, "Title": figure.title} if form == "svg" else {"Title": figure.title}
        canvas.savefig(file, format=form, dpi=150, metadata=metadata)
    return file.getvalue()


def draw_on(figure: Figure, ax: Axes | Sequence[Axes] | None = None) -> Axes | Array:
    """A figure on axes: on new ones, on as many as it has panels, or with all its panels inside a single one.

    Returns the axes: one of them where there is one panel, else an array with one for each. Raises ConfigurationError without matplotlib,
    or for a wrong number of axes."""
    require_matplotlib()
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    count = len(figure.panels)
    with mpl.rc_context(_STYLE):
        if ax is None:
            axes = _arranged(figure, plt.figure(figsize=_size(figure), layout="constrained"))
        elif isinstance(ax, mpl.axes.Axes):
            axes = [ax] if count == 1 else _inside(ax, count, figure.columns)
        else:
            axes = list(np.asarray(ax, object).flat)
            if len(axes) != count:
                raise ConfigurationError(f"plot: {len(axes)} axes were given for {count} panels; give one of them, or {count}.")
        if ax is not None:
            for own, panel in zip(axes, figure.panels, strict=True):
                _panel(own, panel)
            if any(layer.label for layer in figure.panels[0].layers):
                axes[0].legend(frameon=False, loc="best")
    return axes[0] if count == 1 else np.array(axes, object)


def _size(figure: Figure) -> tuple[float, float]:
    """Width and height of a figure, inches: panels that name things are as high as these need."""
    named = max((len(panel.names) for panel in figure.panels), default=0)
    each = max(2.9 if figure.columns > 1 else 1.75, 0.19 * named + 0.6 if named else 0.0)
    return _WIDTH_INCHES, each * -(-len(figure.panels) // figure.columns) + 0.45


def _arranged(figure: Figure, canvas: Any) -> list[Axes]:
    """The panels in rows of `columns`, with one legend."""
    rows = -(-len(figure.panels) // figure.columns)
    # Residuals side by side are compared by eye: on one scale. Below each other, panels have one axis of time.
    shared = figure.columns > 1 and len({panel.y_label for panel in figure.panels[: figure.columns]}) == 1
    axes = canvas.subplots(rows, figure.columns, squeeze=False, sharey="row" if shared else False, sharex=figure.columns == 1)
    for ax, panel in zip(axes.flat, figure.panels, strict=False):
        _panel(ax, panel)
    for ax in axes.flat[len(figure.panels) :]:
        ax.set_visible(False)
    _legend(canvas, axes.flat[: len(figure.panels)])
    return list(axes.flat[: len(figure.panels)])


def _inside(ax: Axes, count: int, columns: int) -> list[Axes]:
    """Axes for `count` panels within one, which itself shows nothing any more."""
    ax.set_axis_off()
    rows = -(-count // columns)
    width, height = 1.0 / columns, 1.0 / rows
    return [
        ax.inset_axes((i % columns * width + 0.2 * width, 1.0 - (i // columns + 0.8) * height, 0.75 * width, 0.55 * height))
        for i in range(count)
    ]


def _panel(ax: Axes, panel: Panel) -> None:
    for layer in panel.layers:
        _layer(ax, layer)
    if panel.names:
        ax.set_yticks(range(len(panel.names)), panel.names)
        ax.set_ylim(len(panel.names) - 0.5, -0.5)
        ax.grid(False, axis="y")
    if panel.to_scale:
        ax.set_aspect("equal", adjustable="datalim")
    ax.set_title("\n".join(textwrap.wrap(panel.title, 58)), loc="left")
    ax.set_xlabel(panel.x_label)
    ax.set_ylabel(panel.y_label)
    ax.margins(x=0.01)


def _layer(ax: Axes, layer: Layer) -> None:
    colour = COLOURS[layer.role]
    x, y = (np.array([np.nan if v is None else v for v in values]) for values in (layer.x, layer.y))
    if layer.kind == BlockKind.SPAN:
        ax.axvspan(x[0], x[1], color="#f0f0f0", zorder=0, label=layer.label or None, linewidth=0)
    elif layer.kind == BlockKind.BAND:
        upper = np.array([np.nan if v is None else v for v in layer.upper])
        # With an edge: where a stretch holds a single row, least and greatest value are the same, and the band is a line.
        style: dict[str, Any] = {"alpha": 0.25, "linewidth": 0} if layer.role == Role.FLOOR else {"alpha": 0.75, "linewidth": 0.8}
        ax.fill_between(x, y, upper, color=colour, label=layer.label or None, **style)
    elif layer.kind == BlockKind.CELLS:
        cells = np.full((int(np.nanmax(y)) + 1, int(np.nanmax(x)) + 1), np.nan)
        cells[y.astype(int), x.astype(int)] = [np.nan if v is None else v for v in layer.upper]
        drawn = ax.imshow(cells, cmap="PuOr", vmin=-1.0, vmax=1.0, aspect="auto", interpolation="nearest")
        ax.figure.colorbar(drawn, ax=ax, fraction=0.03, pad=0.01)
    elif layer.kind == BlockKind.POINTS:
        size, alpha = (1.8, 0.35) if len(x) > _MANY else (3.0, 0.5)
        ax.plot(x, y, ".", color=colour, markersize=size, alpha=alpha, rasterized=True, label=layer.label or None)
    elif layer.kind == BlockKind.MARKS:
        ax.plot(x, y, "o", color=colour, markersize=4.5, label=layer.label or None)
    else:
        style = {"linestyle": "--", "linewidth": 1.0} if layer.role == Role.FLOOR else {"linewidth": 1.5}
        if layer.role == Role.MEASURED:
            style = {"linewidth": 2.6, "alpha": 0.35}
        ax.plot(x, y, color=colour, label=layer.label or None, **style)


def _legend(canvas: Any, axes: Any) -> None:
    """One legend for all panels, above them."""
    shown: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    if not shown:
        return
    legend = canvas.legend(shown.values(), shown.keys(), loc="outside upper right", ncols=len(shown), frameon=False, markerscale=2)
    for handle in legend.legend_handles:
        handle.set_alpha(0.9)
