"""A fit under a drive law, for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .._utils.text import counted, wrapped
from .combinations import Combination
from .determined import Determination, Standing

if TYPE_CHECKING:
    from .unknowns import Unknown

#: Correlations from which on two estimates are said to trade.
_TRADES = 0.7


class Summarised(Protocol):
    """A fit, as far as its summary goes."""

    @property
    def model(self) -> Any: ...

    @property
    def law(self) -> Any: ...

    @property
    def unknowns(self) -> tuple[Unknown, ...]: ...

    @property
    def values(self) -> np.ndarray: ...

    @property
    def determination(self) -> Determination | None: ...

    @property
    def fit_rms(self) -> np.ndarray: ...

    @property
    def heldout_rms(self) -> np.ndarray | None: ...

    @property
    def period(self) -> float: ...

    @property
    def samples(self) -> int: ...

    @property
    def settled(self) -> bool: ...

    @property
    def warnings(self) -> tuple[str, ...]: ...

    @property
    def names(self) -> tuple[str, ...]: ...

    def delay_interval(self) -> dict[str, tuple[float, float, float]]: ...

    def trades(self, name: str, most: int = 2) -> list[tuple[str, float]]: ...


def summary(fit: Summarised) -> str:
    """Determined values, combinations, what is not determined, delay, error of simulated position."""
    robot, found = fit.model.robot, fit.determination
    unknowns, samples = counted(len(fit.unknowns), "unknown"), counted(fit.samples, "sample")
    lines = [f"{robot.name}: {unknowns} from {samples} of commands and positions, law {fit.law.kind}"]
    if not fit.settled:
        lines.append("the search did not converge: do not rely on the values.")
    if found is not None:
        lines += _values(fit)
    lines += _delays(fit)
    lines += _errors(fit)
    return "\n".join([*lines, *(wrapped(f"warning: {text}") for text in fit.warnings)])


def _values(fit: Summarised) -> list[str]:
    found = fit.determination
    assert found is not None
    rows = list(zip(fit.unknowns, fit.values, found.verdicts, found.std, found.below, strict=True))
    width = max((len(u.expression or u.name) for u, *_ in rows), default=0)
    lines = ["", "determined (value ± standard deviation)"]
    known = [(u, v, s) for u, v, verdict, s, _ in rows if verdict == Standing.DETERMINED and u.place != "delay_s"]
    lines += [f"  {u.expression or u.name:<{width}}  {v:.4g} ± {s:.2g} {u.unit}" for u, v, s in known] or ["  none on its own"]
    if found.combinations:
        lines += ["", "determined only in combination"]
        for c in found.combinations:
            lines += [f"  {c.expression:<{width}}  {c.value:.4g} ± {c.std:.2g} {c.unit}"]
        lines += _advice(found.combinations)
    unseen = [(u, below) for u, _, verdict, _, below in rows if verdict == Standing.UNSEEN and u.place != "delay_s"]
    if unseen or found.bounded:
        lines += ["", "not determined (too little information in these logs; 95 % bound on the value)"]
        lines += [f"  {u.expression or u.name:<{width}}  {_bound(below, u.unit)}" for u, below in unseen]
        lines += [f"  {c.expression:<{width}}  {_bound(c.below, c.unit)}" for c in found.bounded]
        lines += _advice(found.bounded)
    rest = [u.name for u, _, verdict, _, _ in rows if verdict == Standing.CONFOUNDED and not _in_some(u.name, fit)]
    if rest:
        lines += ["", wrapped(f"not determined, not even in combination: {', '.join(rest)}")]
    return lines


def _advice(combinations: Sequence[Combination]) -> list[str]:
    """Which further logs would tell their members apart, those of like advice in one line."""
    lines = []
    for advice in dict.fromkeys(c.separated_by for c in combinations):
        members = [c.expression for c in combinations if c.separated_by == advice]
        lines.append(wrapped(f"  would separate {_few(members)}: {advice}"))
    return lines


def _bound(below: float, unit: str) -> str:
    return f"below {below:.2g} {unit}" if np.isfinite(below) else "no bound in these logs"


def _in_some(name: str, fit: Summarised) -> bool:
    return fit.determination is not None and any(name in c.members for c in (*fit.determination.combinations, *fit.determination.bounded))


def _few(texts: list[str]) -> str:
    return ", ".join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


def _delays(fit: Summarised) -> list[str]:
    lines, found = [], fit.determination
    for name, (value, low, high) in fit.delay_interval().items():
        if found is not None and found.verdicts[fit.names.index(name)] != Standing.DETERMINED:
            ends = f"95 % interval {1e3 * low:.2f} to {1e3 * high:.2f} ms" if np.isfinite(high) else "not bounded by these logs either"
            lines.append(f"  {name}: not determined by these logs, {ends}")
        else:
            samples = f"({value / fit.period:.2f} samples)"
            lines.append(f"  {name}  {1e3 * value:.2f} ms, 95 % interval {1e3 * low:.2f} to {1e3 * high:.2f} ms {samples}")
        traded = [f"{other} ({r:+.2f})" for other, r in fit.trades(name) if abs(r) > _TRADES]
        if traded:
            lines.append(f"    correlated with {', '.join(traded)}")
    return ["", "delay from command to torque", *lines] if lines else []


def _errors(fit: Summarised) -> list[str]:
    held = fit.heldout_rms
    whole = f"fit {_rms(fit.fit_rms):.3g}" + ("" if held is None else f", held out {_rms(held):.3g}")
    lines = ["", f"error of simulated position, open loop under the logged commands (rms, rad or m): {whole}"]
    width = max(map(len, fit.model.robot.joint_names))
    for j, name in enumerate(fit.model.robot.joint_names):
        lines.append(f"  {name:<{width}}  {fit.fit_rms[j]:.3g}" + ("" if held is None else f"  {held[j]:.3g}"))
    return lines


def _rms(by_joint: np.ndarray) -> float:
    return float(np.sqrt(np.mean(by_joint**2)))
