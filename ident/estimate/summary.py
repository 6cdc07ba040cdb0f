"""The report of an estimate that a person wants to read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import WIDTH, counted, shortened, wrapped
from ..problem.information import Form
from .significance import insignificant

if TYPE_CHECKING:
    from ..statistics.torque_error import TorqueError
    from .record import EstimateRecord

Array = np.ndarray


def estimate_summary(estimate: EstimateRecord, correlations: int = 5) -> str:
    """Value ± std, percent, t-ratio, unit and expression of each base parameter; torque errors; strongest correlations; status."""
    names, std, values = estimate.names, estimate.std, estimate.values
    width = max((len(n) for n in names), default=4)
    unit_width = max((len(p.unit) for p in estimate.parameters), default=4)
    count = f"{counted(len(values), 'parameter')} from {counted(estimate.samples, 'row')}"
    lines = [
        f"{estimate.method}{_form(estimate)}: {count}; condition {estimate.condition:.3g}{_reduced(estimate)}",
        wrapped(estimate.status.text),
        *_near_reversals(estimate),
        "",
        f"{'parameter':<{width}}  {'value':>12} {'std':>10} {'std %':>7} {'|t|':>8}  {'unit':<{unit_width}}  base-parameter expression",
    ]
    expressions = estimate.base.expressions
    cut = False
    for i, p in enumerate(estimate.parameters):
        share = 100 * std[i] / abs(values[i]) if values[i] else np.inf
        ratio = abs(values[i]) / std[i] if std[i] > 0 else np.inf
        head = f"{names[i]:<{width}}  {values[i]:>12.5g} {std[i]:>10.2g} {share:>7.2g} {ratio:>8.3g}  {p.unit:<{unit_width}}  "
        shown = shortened(expressions[i], WIDTH - len(head))
        cut |= shown != expressions[i]
        lines.append(head + shown)
    if cut:
        lines.append("…: cut; `ident base` and the JSON result have the whole expressions.")
    lines += _insignificant(estimate)
    lines += _held_shapes(estimate)
    lines += [
        "",
        error_table(estimate, {"fit": estimate.fit_error} | ({"held out": estimate.heldout_error} if estimate.heldout_error else {})),
    ]
    if estimate.trace.get("text"):
        lines += ["", str(estimate.trace["text"])]
    strongest = _strongest(estimate.correlation, names, correlations)
    if strongest:
        lines += ["", wrapped("strongest correlations: " + "; ".join(strongest))]
    lines += [wrapped(f"warning: {w}") for w in estimate.warnings]
    return "\n".join(lines)


def _insignificant(estimate: EstimateRecord) -> list[str]:
    """The parameters that carry no weight, and what to do about them."""
    found = insignificant(estimate)
    if not found:
        return []
    zero = [f"{i.name} ({_share(i.relative)})" for i in found if i.covers_zero]
    large = [f"{i.name} ({_share(i.relative)})" for i in found if not i.covers_zero]
    lines = ["", f"insignificant: {len(found)} of {len(estimate.values)} parameters (std in per cent of the value)"]
    lines += [wrapped(f"  95 % interval covers zero: {', '.join(zero)}")] if zero else []
    lines += [wrapped(f"  std above 30 %: {', '.join(large)}")] if large else []
    advice = (
        "  Do not read them as physical values; predicted torque along similar motion is not affected. To determine them, record"
        " motion that excites them (ident excite --sharpen NAME), or a longer log. To drop them, fit the others alone"
        " (ident fit --essential, ident.essential), or leave out an effect whose parameters are all here and compare held-out errors."
    )
    return [*lines, wrapped(advice)]


def _held_shapes(estimate: EstimateRecord) -> list[str]:
    """The shape parameters of the model's effects, which a linear fit takes as they are declared."""
    robot = estimate.model.robot
    shapes = [
        f"{p.name} = {getattr(effect, p.name):.4g} {unit if unit != '1' else ''} ({effect.name} on"
        f" {', '.join(effect.joints or ('all joints',))})".replace("  ", " ")
        for effect in estimate.model.effects
        for p in effect.shape()
        for unit in [effect.shape_unit(p, robot)]
    ]
    if not shapes:
        return []
    advice = (
        "A study file or `--effects NAME:JOINTS:KEY=VALUE` sets them; `ident diagnose` estimates them for an effect that the declared"
        " model lacks."
    )
    return ["", wrapped(f"shape parameters as declared, not fitted: {'; '.join(shapes)}. {advice}")]


def _form(estimate: EstimateRecord) -> str:
    """The form of the equations, where it is not that of torque."""
    form = estimate.trace.get("form")
    return f", {form} form" if form else ""


def _share(relative: float) -> str:
    return f"{100 * relative:.0f} %" if relative < 10 else "> 1000 %"


def _reduced(estimate: EstimateRecord) -> str:
    """How the samples were reduced, where that is known."""
    if estimate.information is None:
        return ""
    return ", from Gram matrices" if estimate.information.form == Form.GRAM else ", by QR"


def error_table(estimate: EstimateRecord, errors: dict[str, TorqueError]) -> str:
    """Torque error per joint, one line per data set; a dash where a joint has no torque to compare with."""
    joints = estimate.model.robot.joint_names
    side = estimate.model.robot.transmission.measured.value
    width = max(len(k) for k in errors)
    rms = {label: [f"({r:.3g})" if np.isfinite(r) else "" for r in error.rms] for label, error in errors.items()}
    columns = [max(len(j), 8, *(len(cells[i]) for cells in rms.values())) for i, j in enumerate(joints)]
    head = " ".join(f"{j:>{w}}" for j, w in zip(joints, columns, strict=True))
    lines = [f"torque error on the {side} side, relative % (rms), {_about(errors)}", f"{'':<{width}} {head}      all"]
    for label, error in errors.items():
        relative = [f"{100 * r:.2f}" if np.isfinite(r) else "-" for r in (*error.relative, error.relative_all)]
        cells = " ".join(f"{r:>{w}}" for r, w in zip(relative, (*columns, 8), strict=True))
        lines.append(f"{label:<{width}} {cells}")
        cells = " ".join(f"{r:>{w}}" for r, w in zip(rms[label], columns, strict=True))
        lines.append(f"{'':<{width}} {cells}".rstrip())
    return "\n".join(lines)


def _about(errors: dict[str, TorqueError]) -> str:
    """What the errors are of: once where that is one thing."""
    kinds: dict[str, list[str]] = {}
    for label, error in errors.items():
        kinds.setdefault(error.about, []).append(label.strip())
    if len(kinds) == 1:
        return next(iter(kinds))
    return "; ".join(f"{', '.join(labels)} {about}" for about, labels in kinds.items())


def _strongest(correlation: Array, names: tuple[str, ...], count: int) -> list[str]:
    upper = np.abs(np.triu(correlation, 1))
    order = np.argsort(upper, axis=None)[::-1][:count]
    pairs = [tuple(np.unravel_index(int(o), upper.shape)) for o in order]
    return [f"{names[i]} and {names[j]} {correlation[i, j]:+.3f}" for i, j in pairs if upper[i, j] > 0.8]


def _near_reversals(estimate: EstimateRecord) -> list[str]:
    """Rows near velocity reversals that the fit leaves out: how many of each joint, and why."""
    left = ", ".join(map(str, estimate.reversals_left_out))
    return [wrapped(f"left out: rows near reversals of {left}; they scatter more than the others, as with stiction")] if left else []
