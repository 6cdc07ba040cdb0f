"""Base parameters of a whole model by rank-revealing orthogonalisation: which parameters stay, and what is grouped into them.

Columns are sampled at random states within the joint limits, scaled, and taken in a fixed order of preference (Gautier's rule:
from the base to the tip, moments before masses): a column stays if it is independent of those that stayed before. Ranks are
decided by the gap in the distances, not by a bare tolerance (Gautier, 1991)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..._utils.short_repr import ShortRepr
from ...robots.parameters import Parameter
from .expressions import LINK_PREFERENCE, expression

Array = np.ndarray

_ZERO = 1e-15
#: A column this far from the others stands out clearly: its direction is known to some thirteen digits.
_CLEAR = 1e-3
#: Rounding of a column's entries, some units in the last place.
_ROUNDING = 10 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False, repr=False)
class BaseReduction(ShortRepr):
    """Base parameters p = regroup @ (all k parameters).

    `parameters`: all k. `independent` (b,): indices of those that stay, in the model's order. `regroup` (b, k): 1 at the
    stayer, coefficients of what is grouped into it, 0 elsewhere. `zero`: indices without any effect on a torque. `gap`: (smallest
    distance kept, largest dropped), relative; `notes` say when the decision was not clear."""

    parameters: tuple[Parameter, ...]
    independent: Array
    regroup: Array
    zero: Array
    gap: tuple[float, float]
    notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        return len(self.independent)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each base parameter: that of the parameter that stayed."""
        return tuple(self.parameters[i].name for i in self.independent)

    @cached_property
    def expressions(self) -> tuple[str, ...]:
        """Readable grouped expressions, e.g. `Izz_joint3 + Iyy_joint4`."""
        names = tuple(p.name for p in self.parameters)
        return tuple(expression(row, names) for row in self.regroup)

    def base_values(self, values: Array) -> Array:
        """Base values (b,) of all parameters' values (k,)."""
        return self.regroup @ values

    def expand(self, base_values: Array) -> Array:
        """All parameters (k,) that give the base values (b,), with everything grouped set to zero: same torques, not physical."""
        out = np.zeros(len(self.parameters))
        out[self.independent] = base_values
        return out

    @property
    def grouped(self) -> tuple[int, ...]:
        """Indices of parameters that act only in combination with others."""
        stay = set(self.independent.tolist()) | set(self.zero.tolist())
        return tuple(i for i in range(len(self.parameters)) if i not in stay)


def preference(parameters: tuple[Parameter, ...]) -> list[int]:
    """Order in which parameters may stay: rigid body from base to tip, then everything else in the model's order."""
    rigid = [i for i, p in enumerate(parameters) if p.effect == "rigid_body"]
    order = [rigid[10 * link + s] for link in range(len(rigid) // 10) for s in LINK_PREFERENCE]
    chosen = set(order)
    return order + [i for i in range(len(parameters)) if i not in chosen]


def reduce_columns(columns: Array, parameters: tuple[Parameter, ...], order: list[int]) -> BaseReduction:
    """Base reduction of sampled columns (rows, k); `order` says which column may stay before which."""
    R = np.linalg.qr(columns, mode="r")  # the same column relations in k rows
    scale = np.linalg.norm(R, axis=0)
    zero = scale <= 1e-11 * max(scale.max(initial=0.0), 1e-300)
    unit = np.divide(R, scale, out=np.zeros_like(R), where=~zero)
    live = [i for i in order if not zero[i]]
    # What rounds a column is of the size of the largest, from whose terms it is made: of a faint one that is a large share.
    rounding = np.divide(_ROUNDING * scale.max(initial=0.0), scale, out=np.full_like(scale, np.inf), where=~zero)
    kept, _, distance = _orthogonalise(unit, live, np.maximum(1e-8, rounding))
    threshold, gap, notes = _threshold(distance, [parameters[i].name for i in live])
    if abs(np.log10(threshold / 1e-8)) > 1e-9:
        kept, _, distance = _orthogonalise(unit, live, np.maximum(threshold, rounding))
    independent = np.array(sorted(kept), dtype=int)
    regroup = np.zeros((len(independent), len(parameters)))
    if len(independent):
        q_factor, r_factor = np.linalg.qr(unit[:, independent])
        for i in live:
            if i in kept:
                regroup[np.searchsorted(independent, i), i] = 1.0
            else:
                beta = np.linalg.solve(r_factor, q_factor.T @ unit[:, i]) * scale[i] / scale[independent]
                noise = 1e-9 * scale[i] / scale[independent]
                regroup[:, i] = np.where(np.abs(beta) > noise, beta, 0.0)
    return BaseReduction(parameters, independent, regroup, np.flatnonzero(zero), gap, notes)


def _orthogonalise(unit: Array, order: list[int], threshold: Array) -> tuple[set[int], Array, Array]:
    """Greedy Gram-Schmidt with one repetition: which columns stay, their basis, and every column's distance from those that stayed.

    `threshold` (k,): what a column must be away at least.

    Columns that stand out clearly stay first, in the given order; of the others about the farthest goes first. What is left of a column
    near the others has a direction as uncertain as rounding over its distance, and is harmless only to columns that are no farther."""
    basis = np.zeros((unit.shape[0], min(unit.shape)))
    kept: dict[int, float] = {}

    def left(columns: Array) -> Array:
        Q = basis[:, : len(kept)]
        v = columns - Q @ (Q.T @ columns)
        return np.asarray(v - Q @ (Q.T @ v))

    def keep(i: int, v: Array, size: float) -> None:
        basis[:, len(kept)] = v / size
        kept[i] = size

    for i in order:
        v = left(unit[:, i])
        if len(kept) < basis.shape[1] and np.linalg.norm(v) > max(_CLEAR, threshold[i]):
            keep(i, v, float(np.linalg.norm(v)))
    rest = [i for i in order if i not in kept]
    while True:
        remains = left(unit[:, rest])
        sizes = np.linalg.norm(remains, axis=0)
        able = sizes > threshold[rest]
        if len(kept) == basis.shape[1] or not able.any():
            break
        place = int(np.flatnonzero(able & (sizes >= 0.1 * sizes[able].max()))[0])
        keep(rest.pop(place), remains[:, place], float(sizes[place]))
    found = dict(zip(rest, sizes.tolist(), strict=True)) | kept
    return set(kept), basis[:, : len(kept)], np.array([found[i] for i in order])


def _threshold(distance: Array, names: list[str]) -> tuple[float, tuple[float, float], tuple[str, ...]]:
    """Where to cut: the widest gap below 1e-4. Distances between are near-degenerate geometry, and are said."""
    d = np.maximum(np.sort(distance)[::-1], _ZERO)
    if not len(d) or d[-1] > 1e-7:
        return 1e-8, (float(d[-1]) if len(d) else 1.0, 0.0), ()
    ratios = d[:-1] / d[1:]
    allowed = d[1:] < 1e-6
    cut = int(np.argmax(np.where(allowed, ratios, 0.0))) if allowed.any() else -1
    high, low = (float(d[cut]), float(d[cut + 1])) if cut >= 0 else (1.0, float(d[0]))
    notes = []
    near = [name for name, x in zip(names, distance, strict=True) if low < x < 1e-5 or 1e-12 < x <= low]
    if near:
        notes.append(
            f"nearly degenerate geometry: {', '.join(near[:6])} differ from other columns by less than 1e-5 of their size;"
            f" the rank was cut at the widest gap ({high:.1e} kept, {low:.1e} dropped)."
        )
    return float(np.sqrt(high * low)), (high, low), tuple(notes)
