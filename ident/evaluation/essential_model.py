"""The essential model: an estimate without the parameters that are zero within what the data tell (Pham and Gautier, 1991)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import condition, lstsq, pinv
from .._utils.text import wrapped
from .._utils.threads import with_one_blas_thread
from ..drawing.document import Figure, Section, Table, Text, plain
from ..drawing.shown import Shown
from ..errors import ConfigurationError, UnsupportedError
from ..estimate.estimate import Estimate
from ..estimate.pictures import estimate_frame, parameters_section, values_figure
from ..regressor.base_parameters.reduction import BaseReduction
from ..statistics.torque_error import JudgedOn, TorqueError, number
from .comparison import Comparison, compare

if TYPE_CHECKING:
    import pandas as pd


Array = np.ndarray
#: A torque error of so small a share is rounding.
_ROUNDING = 1e-6
_MEANING = (
    "Removed parameters are statistically zero in these data, not physically zero: a longer log, or motion that excites"
    " them, may reveal them."
)


@dataclass(frozen=True)
class Removal:
    """One parameter left out: `value` and `std` (in `unit`) in the fit it was removed from, F and p of its Wald test there (`f`, `p`), and
    of the test that it and all removed before it are zero together in the whole fit (`f_all`, `p_all`)."""

    name: str
    unit: str
    value: float
    std: float
    f: float
    p: float
    f_all: float
    p_all: float


@dataclass(frozen=True, eq=False, repr=False)
class Essential(Shown, ShortRepr):
    """The essential model of an estimate.

    `estimate`: the whole fit; `reduced`: the fit of the kept parameters alone, an estimate like any other (it predicts, saves, exports);
    `removed`: what was left out, in order; `restored`: what the tests would have left out as well, but held-out data did not allow;
    `level` of the tests; `comparison`: errors before and after on held-out data, None where none were given.

    See `ident.essential`.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> essential = ident.essential(ident.fit(train, "puma560", held=test))
    >>> len(essential.removed) + len(essential.reduced.names)
    52
    """

    estimate: Estimate
    reduced: Estimate
    removed: tuple[Removal, ...]
    restored: tuple[str, ...]
    level: float
    comparison: Comparison | None = None

    def figure(self) -> Figure:
        """Each kept parameter with its 95 % interval; see `plot`."""
        return values_figure(self.reduced)

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter, the kept ones first: value (0: removed), std, 95 % interval, unit; order of removal with its F and p."""
        import pandas as pd

        kept = estimate_frame(self.reduced)[["value", "std", "low", "high", "unit"]]
        order = [(r.name, 0.0, r.unit, i + 1, r.f, r.p, r.f_all, r.p_all) for i, r in enumerate(self.removed)]
        gone = pd.DataFrame(order, columns=["parameter", "value", "unit", "removed", "F", "p", "F all", "p all"]).set_index("parameter")
        return kept.join(gone.drop(columns=["value", "unit"]), how="left") if gone.empty else pd.concat([kept, gone])

    def sections(self) -> tuple[Section, ...]:
        """What was removed, the error before and after, and the kept parameters."""
        rows = tuple((r.name, r.unit, *map(plain, (r.value, r.std, r.f, r.p, r.f_all, r.p_all))) for r in self.removed)
        head = ("parameter", "unit", "value", "std", "F", "p", "F all", "p all")
        table = Table("Removed parameters", head, rows, _MEANING, left=2)
        return (Text("Essential model", (self._headline, *self._held)), table, parameters_section(self.reduced))

    def to_dict(self) -> dict[str, Any]:
        """JSON form (without the common fields)."""
        kept = self.reduced
        return {
            "level": self.level,
            "kept": [
                {"name": p.name, "value": float(v), "std": float(s), "low": float(low), "high": float(high), "unit": p.unit}
                for p, v, s, (low, high) in zip(kept.parameters, kept.values, kept.std, kept.confidence_interval(), strict=True)
            ],
            "removed": [
                {"name": r.name, "unit": r.unit, "value": r.value, "std": r.std, "f": number(r.f), "p": number(r.p),
                 "f_all": number(r.f_all), "p_all": number(r.p_all)}
                for r in self.removed
            ],
            "restored": list(self.restored),
            "torque_error": {"fit": kept.fit_error.to_dict()},
            "heldout": None if self.comparison is None else {
                "before": self.comparison.error_before.to_dict(), "after": self.comparison.error_after.to_dict(),
                "gain": number(self.comparison.gain), "gain_std": number(self.comparison.gain_std),
            },
        }  # fmt: skip

    @property
    def _headline(self) -> str:
        whole = len(self.estimate.values)
        return (
            f"essential model: {len(self.reduced.values)} of {whole} parameters kept, {len(self.removed)} removed at level {self.level:g}"
        )

    @property
    def _held(self) -> list[str]:
        """Sentences on the held-out error."""
        if self.comparison is None:
            return ["No held-out data were given: whether the torque is predicted as well without them was not checked."]
        before, after = (100 * e.relative_all for e in (self.comparison.error_before, self.comparison.error_after))
        gain, doubt = 100 * self.comparison.gain, 100 * self.comparison.gain_std
        change = f"{'falls' if gain >= 0 else 'grows'} by {abs(gain):.2g} ± {doubt:.2g} %"
        error = f"held out: relative torque error {before:.4g} % before, {after:.4g} % after"
        error += "" if max(before, after) < 100 * _ROUNDING else f"; squared error, weighted by noise, {change}"
        return [error, *([f"kept, because the held-out error grows without: {', '.join(self.restored)}"] if self.restored else [])]

    def __str__(self) -> str:
        width = max((len(p.name) for p in self.estimate.parameters), default=4)
        lines = [self._headline]
        if self.removed:
            lines += ["", f"{'removed, in order':<{width}} {'value':>11} {'std':>9} {'F':>7} {'p':>6} {'F all':>7} {'p all':>6}  unit"]
            lines += [
                f"{r.name:<{width}} {r.value:>11.4g} {r.std:>9.2g} {r.f:>7.3g} {r.p:>6.2f} {r.f_all:>7.3g} {r.p_all:>6.2f}  {r.unit}"
                for r in self.removed
            ]
            lines.append(wrapped(_MEANING))
        lines += ["", f"{'kept':<{width}} {'value':>11} {'std':>9} {'95 % interval':>24}  unit"]
        kept = self.reduced
        for p, v, s, (low, high) in zip(kept.parameters, kept.values, kept.std, kept.confidence_interval(), strict=True):
            lines.append(f"{p.name:<{width}} {v:>11.5g} {s:>9.2g} {f'{low:.4g} … {high:.4g}':>24}  {p.unit}")
        return "\n".join([*lines, "", *map(wrapped, self._held)])


@with_one_blas_thread
def essential(estimate: Estimate, held: Any | None = None, level: float = 0.05) -> Essential:
    """Leave out, one after the other, the parameters that are zero within what the data tell, and fit the others again.

    The parameter of the largest relative standard deviation goes, the others are fitted again, as long as neither the parameter alone nor
    all that were removed, taken together, are significant. With held-out data the last removals are undone until the error there does not
    grow beyond chance.

    Parameters
    ----------
    estimate : Estimate
        A fit, of this session or loaded.
    held : Signals or logs, optional
        Data that the fit did not see; logs (also a path) are prepared as the fit's were. Without them the tests alone decide.
    level : float
        Level of the tests, between 0 and 1: how probable it is that a parameter that is zero is kept.

    Returns
    -------
    Essential
        Kept parameters with intervals, removed ones with F and p, errors before and after on held-out data.

    Notes
    -----
    The tests are Wald tests with the estimate's own covariance, which holds for coloured noise: F = (θ_k/σ_k)² for one parameter, θᵀC⁻¹θ/r
    for r of them, with as many degrees of freedom as there are independent samples beyond the parameters. Ratios of residual sums of
    squares would take neighbouring samples for independent ones. The kept values minimise the weighted change of the predicted torque, from
    the information matrix alone; for weighted least squares these are the values of a fit of the kept columns with the same weights.
    Intervals are those of the last model, as if it had been chosen beforehand. Bounds and physical consistency, where the method kept them,
    are not kept again.

    References
    ----------
    M. T. Pham and M. Gautier, "Essential parameters of robots", CDC 1991.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> essential = ident.essential(ident.fit(train, robot, held=0), test)
    >>> essential.reduced.heldout_error.relative_all < 0.01
    True
    """
    if not 0 < level < 1:
        raise ConfigurationError(f"essential: level = {level} must lie between 0 and 1.")
    if estimate.information is None or not np.isfinite(estimate.covariance).all():
        raise UnsupportedError(f"essential: this fit (method {estimate.method!r}) has no covariance to test with; fit with wls or irls.")
    steps = _removals(estimate, level)
    count, reduced = len(steps), _without(estimate, steps)
    if held is None:
        return Essential(estimate, reduced, steps, (), level)
    held = estimate.prepared(held)
    comparison = compare(estimate, reduced, held)
    while count and _grows(comparison, level):
        count -= 1
        reduced = _without(estimate, steps[:count])
        comparison = compare(estimate, reduced, held)
    reduced = reduced.with_heldout(comparison.error_after)
    return Essential(estimate, reduced, steps[:count], tuple(r.name for r in steps[count:]), level, comparison)


def _grows(comparison: Comparison, level: float) -> bool:
    """Whether the later estimate's error on held-out data is larger, beyond chance (one-sided) where that can be judged.

    Squared errors before and after are compared block of time by block of time. Each joint counts by its error there, not by the fit's
    noise: a fit without noise says nothing about the noise of other data. An error that is rounding, of the torque, is none."""
    from scipy.stats import norm

    before, after = comparison.error_before, comparison.error_after
    if after.relative_all <= _ROUNDING:
        return False
    torque = np.divide(after.rms, after.relative, out=np.zeros_like(after.rms), where=after.relative > 0)
    size = np.maximum(before.rms, _ROUNDING * torque)
    seen = np.isfinite(size) & (size > 0) & (before.rows > 0)
    change = np.sum(np.diff(comparison.block_squares, axis=0)[0][:, seen] / size[seen] ** 2, axis=1)
    chance = np.sqrt(len(change)) * float(np.std(change, ddof=1)) if len(change) > 2 else 0.0
    return bool(change.sum() > float(norm.isf(level)) * chance)


def _root(estimate: Estimate) -> Array:
    """Factor (b, b) of the weighted information on the estimate's own base parameters."""
    information = estimate.information
    assert information is not None
    place = {name: i for i, name in enumerate(information.names)}
    return information.combined(estimate.weights)[0][:, [place[name] for name in estimate.names]]


def _refit(R: Array, kept: list[int]) -> Array:
    """The map (s, b) from all values to those of the kept parameters that minimise ‖R (values − kept)‖."""
    scale = np.linalg.norm(R[:, kept], axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return lstsq(R[:, kept] / scale, R, rcond=None) / scale[:, None]


def _wald(values: Array, covariance: Array) -> float:
    """θᵀ C⁻¹ θ over the number of values (r,)."""
    std = np.sqrt(np.diag(covariance))
    ratio = values / std
    return float(ratio @ pinv(covariance / np.outer(std, std), hermitian=True) @ ratio) / len(values)


def _removals(estimate: Estimate, level: float) -> tuple[Removal, ...]:
    """What the tests remove, in order."""
    from scipy.stats import f as distribution

    assert estimate.information is not None
    R, values, covariance, left = _root(estimate), estimate.values, estimate.covariance, list(range(len(estimate.values)))
    independent = float(np.sum(estimate.information.counts / np.nan_to_num(estimate.noise.correlation_time, nan=1.0)))
    freedom = max(1.0, independent - len(values))
    found: list[Removal] = []
    gone: list[int] = []
    while left:
        map_ = _refit(R, left)
        now = map_ @ values
        std = np.sqrt(np.maximum(np.diag(map_ @ covariance @ map_.T), 0.0))
        # Without a standard deviation (a noise-free log) every value is significant.
        ratio = np.abs(np.divide(now, std, out=np.full(len(now), np.inf), where=std > 0))
        at = int(np.argmin(ratio))
        gone.append(left.pop(at))
        alone = float(ratio[at] ** 2)
        together = _wald(values[gone], covariance[np.ix_(gone, gone)]) if np.isfinite(alone) else np.inf
        chances = float(distribution.sf(alone, 1, freedom)), float(distribution.sf(together, len(gone), freedom))
        if min(chances) < level:
            break
        p = estimate.parameters[gone[-1]]
        found.append(Removal(p.name, p.unit, float(now[at]), float(std[at]), alone, chances[0], together, chances[1]))
    return tuple(found)


def _without(estimate: Estimate, removed: tuple[Removal, ...]) -> Estimate:
    """The estimate of the other parameters."""
    gone = {r.name for r in removed}
    left = [i for i, name in enumerate(estimate.names) if name not in gone]
    R, base = _root(estimate), estimate.base
    map_ = _refit(R, left)
    covariance = map_ @ estimate.covariance @ map_.T
    scale = np.linalg.norm(R[:, left], axis=0)
    told = f"essential model: {len(gone)} of {len(estimate.values)} parameters are left out as zero: {', '.join(r.name for r in removed)}"
    reduced = replace(
        estimate,
        base=BaseReduction(base.parameters, base.independent[left], base.regroup[left], base.zero, base.gap, base.notes),
        values=map_ @ estimate.values,
        covariance=(covariance + covariance.T) / 2,
        condition=condition(R[:, left] / scale) if left else 1.0,
        warnings=(*estimate.warnings, *([told] if gone else [])),
        heldout_error=None,
    )
    return replace(reduced, fit_error=_fit_error(reduced))


def _fit_error(reduced: Estimate) -> TorqueError:
    """Error of the reduced fit on the fitted rows: from the information where it holds them, else from the signals."""
    information, before = reduced.information, reduced.fit_error
    assert information is not None
    if before.judged == JudgedOn.ROWS and "form" not in reduced.trace:
        values = np.zeros(information.k)
        values[[information.names.index(name) for name in reduced.names]] = reduced.values
        found = TorqueError.from_squares(information.residual_squares(values), information.torque_squares(), information.counts)
        return replace(found, judged=before.judged, band_hz=before.band_hz)
    if reduced.problem is None:
        raise ConfigurationError(
            "essential: a saved fit of this form does not hold its signals; fit again, or add --essential to ident fit."
        )
    return reduced.torque_error(reduced.problem.signals)
