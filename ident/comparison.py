"""Before and after: two estimates on the same data, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .torque_error import TorqueError, number

if TYPE_CHECKING:
    from .estimate import Estimate
    from .signals import Signals

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Shift:
    """How one base parameter moved: values and stds before and after, and the move in units of the std before."""

    name: str
    unit: str
    before: float
    std_before: float
    after: float
    std_after: float

    @property
    def sigmas(self) -> float:
        """Move over the std before (how much bias the old model carried, as it saw itself)."""
        return (self.after - self.before) / self.std_before if self.std_before > 0 else float("nan")


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of two estimates on data that neither fitted.

    `floor` (n,): rms of the residual that the later estimate leaves on its own fit, per joint; `shifts`: common parameters,
    the largest move first."""

    before: Estimate
    after: Estimate
    error_before: TorqueError
    error_after: TorqueError
    floor: Array
    shifts: tuple[Shift, ...]

    @property
    def gain(self) -> float:
        """Share of the squared error over all joints, each weighted by its noise, that the later estimate removes."""
        weight = 1.0 / np.maximum(self.floor, 1e-300) ** 2
        seen = np.isfinite(self.error_before.rms) & (self.error_before.rows > 0)
        total = [float(np.sum((weight * e.rms**2 * e.rows)[seen])) for e in (self.error_before, self.error_after)]
        return 1.0 - total[1] / total[0] if total[0] > 0 else 0.0

    def to_dict(self) -> dict[str, Any]:
        """JSON form (without the common fields)."""
        return {
            "before": {"fit": self.before.fit_error.to_dict(), "heldout": self.error_before.to_dict()},
            "after": {"fit": self.after.fit_error.to_dict(), "heldout": self.error_after.to_dict()},
            "noise_floor": [number(x) for x in self.floor],
            "gain": number(self.gain),
            "shifts": [
                {"name": s.name, "unit": s.unit, "before": s.before, "std_before": s.std_before, "after": s.after, "std_after": s.std_after,
                 "sigmas": number(s.sigmas)}
                for s in self.shifts
            ],
        }  # fmt: skip

    def __str__(self) -> str:
        from .summary import error_table

        lines = [error_table(self.after, {"before": self.error_before, "after": self.error_after})]
        lines.append(f"error weighted by noise falls by {100 * self.gain:.1f} % (squares)")
        moved = [s for s in self.shifts if abs(s.sigmas) > 2][:8]
        if moved:
            lines.append("parameters that moved by more than two of their former std:")
            lines += [f"  {s.name}: {s.before:.5g} -> {s.after:.5g} {s.unit} ({s.sigmas:+.1f} std)" for s in moved]
        return "\n".join(lines)


def compare(before: Estimate, after: Estimate, signals: Signals) -> Comparison:
    """Compare two estimates on prepared signals that neither was fitted to."""
    old = {name: i for i, name in enumerate(before.names)}
    shifts = [
        Shift(
            p.name, p.unit, float(before.values[old[p.name]]), float(before.std[old[p.name]]), float(after.values[i]), float(after.std[i])
        )
        for i, p in enumerate(after.parameters)
        if p.name in old
    ]
    shifts.sort(key=lambda s: -abs(s.sigmas) if np.isfinite(s.sigmas) else 0.0)
    return Comparison(before, after, before.torque_error(signals), after.torque_error(signals), after.fit_error.rms, tuple(shifts))
