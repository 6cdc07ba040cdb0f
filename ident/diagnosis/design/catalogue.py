"""The catalogue as rows: every effect at every place, in a few shapes, and the generic shapes, made along the instrument's motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.registry import effect_types
from ...errors import IdentError
from ...instruments.columns import is_order, motor_columns
from ...instruments.fit import Fit, depends
from .places import places
from .shapes import shapes, waves

if TYPE_CHECKING:
    from ...effects.motion import Motion

Array = np.ndarray
Gains = tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that are scored together: an effect in one shape, or (effect None) a generic shape. `columns`: their places among all."""

    name: str
    joints: tuple[str, ...]
    effect: Effect | None
    columns: Array = field(repr=False)

    @property
    def named(self) -> bool:
        return self.effect is not None

    @property
    def kind(self) -> tuple[str, tuple[str, ...]]:
        """What it is and where, whatever its shape."""
        return self.name, self.joints


@dataclass
class _Kept:
    """The columns that were whitened last, of all the catalogues that share their fixed ones: one such set is what memory is for."""

    of: Catalogue | None = None
    gains: Gains | None = None
    columns: list[tuple[int, Array, Array]] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Catalogue:
    """Groups, and for each motor which columns act on it (`places`) and their spectra for each run (k, F): `fixed` ones, that hang on the
    motion alone, come first; `following` ones follow what a model predicts. `waves`: for each motor, columns of friction that varies along
    the travel, per unit of it (no group's: some of it always does)."""

    groups: list[Group]
    places: list[Array]
    fixed: list[list[Array]]
    following: list[list[Array]]
    count: int
    waves: list[Array] = field(default_factory=list)
    _kept: _Kept = field(default_factory=_Kept, repr=False)

    @classmethod
    def of(cls, fit: Fit, speeds: Array) -> Catalogue:
        """Everything that could be beside the fit's model."""
        changes = [] if fit.known is None else list(fit.known.own)
        return _made(fit, [*changes, *_effects(fit, (kind for kind in _causes() if Need.TORQUE not in kind.needs))], speeds)

    @classmethod
    def of_effects(cls, fit: Fit, effects: Sequence[tuple[Effect, tuple[str, ...]]]) -> Catalogue:
        """These effects alone."""
        return _made(fit, effects, None)

    @classmethod
    def of_readings(cls, fit: Fit) -> Catalogue:
        """Effects of the torque's reading itself (what a drive demands beyond its limit). No instrument knows it, so that any noise goes
        with it: such a score says what to try, and never that something is left."""
        return cls.of_effects(fit, [*_effects(fit, (kind for kind in _causes() if Need.TORQUE in kind.needs))])

    def at(self, fit: Fit) -> Catalogue:
        """The same with the columns that follow what a model predicts at the fit's values."""
        chosen = [g for g in self.groups if g.effect is not None and depends(g.effect)]
        motions = fit.motions(instrument=True)
        new = [[np.zeros_like(x) for x in each] for each in self.following]
        where = [{int(c): k for k, c in enumerate(ids[len(ids) - len(each[0]) :])} for ids, each in zip(self.places, new, strict=True)]
        for g in chosen:
            assert g.effect is not None
            own = fit.motions(instrument=True, effect=g.effect) if is_order(g.effect) else motions
            for m, spectra in _spectra(fit, g.effect, own).items():
                # What acted on no row of a motor at the values before has no place there.
                known = [k for k, c in enumerate(g.columns.tolist()) if c in where[m]]
                at = [where[m][int(g.columns[k])] for k in known]
                for x, s in zip(new[m], spectra, strict=True):
                    x[at] = s[known]
        return replace(self, following=new)

    def whitened(self, fit: Fit, gains: Gains) -> list[tuple[int, Array, Array]]:
        """Motors with the places of their columns in order, and these behind whitening filters (k, R); kept until others are asked for."""
        kept = self._kept
        if kept.of is not self or kept.gains is not gains:
            kept.of, kept.gains, kept.columns = None, None, []
            for m, ids in enumerate(self.places):
                if len(ids) and any(gain[m].any() for gain in gains):
                    order = np.argsort(ids)
                    runs = zip(fit.runs, self.fixed[m], self.following[m], gains, strict=True)
                    rows = [run.band.behind(np.concatenate([own, other])[order], gain[m]) for run, own, other, gain in runs]
                    kept.columns.append((m, ids[order], np.concatenate(rows, axis=1)))
            kept.of, kept.gains = self, gains
        return kept.columns

    def raw_squares(self, fit: Fit, gains: Gains) -> list[Array]:
        """Gram matrices (K, d, d) of the columns of each group behind whitening filters, for each width of `of_width`."""
        found = [np.zeros((*ix.shape, ix.shape[1])) for _, ix in self.of_width.values()]
        for _, ids, C in self.whitened(fit, gains):
            at = np.full(self.count, -1)
            at[ids] = np.arange(len(ids))
            for square, (_, ix) in zip(found, self.of_width.values(), strict=True):
                here = at[ix[:, 0]] >= 0
                own = C[at[ix[here]]].astype(float)
                square[here] += own @ own.swapaxes(1, 2)
        return found

    @cached_property
    def of_width(self) -> dict[int, tuple[Array, Array]]:
        """By their number of columns d, which groups have it, and their columns (K, d)."""
        widths = np.array([len(g.columns) for g in self.groups], int)
        found = {int(d): np.flatnonzero(widths == d) for d in np.unique(widths)}
        return {d: (which, np.stack([self.groups[k].columns for k in which.tolist()])) for d, which in found.items()}


def _made(fit: Fit, effects: Iterable[tuple[Effect, tuple[str, ...]]], speeds: Array | None) -> Catalogue:
    """Groups of effects, and with `speeds` generic shapes, as columns of the fit's runs."""
    n, motions = fit.robot.n, fit.motions(instrument=True)
    groups: list[Group] = []
    # For each motor the columns' places and spectra, of those that are fixed and of those that follow.
    ids: list[list[list[Array]]] = [[[] for _ in range(n)] for _ in range(2)]
    parts: list[list[list[list[Array]]]] = [[[[] for _ in fit.runs] for _ in range(n)] for _ in range(2)]
    count = 0

    def add(name: str, joints: tuple[str, ...], effect: Effect | None, width: int, spectra: dict[int, list[Array]]) -> None:
        nonlocal count
        columns = np.arange(count, count + width)
        count += width
        groups.append(Group(name, joints, effect, columns))
        follows = int(effect is not None and depends(effect))
        for m, each in spectra.items():
            ids[follows][m].append(columns)
            for i, x in enumerate(each):
                parts[follows][m][i].append(x)

    for effect, joints in effects:
        try:
            width = len(effect.parameters(fit.robot))
            spectra = _spectra(fit, effect, fit.motions(instrument=True, effect=effect) if is_order(effect) else motions)
        except IdentError:
            continue
        if spectra:
            add(effect.name, joints, effect, width, spectra)
    for name, j, columns in shapes(motions, speeds) if speeds is not None else ():
        spectra = {j: [run.masked_spectra(x, j, np.float32) for run, x in zip(fit.runs, columns, strict=True)]}
        add(name, (fit.robot.joint_names[j],), None, columns[0].shape[1], spectra)
    along: list[Array] = [np.zeros(0, int) for _ in range(n)]
    for j, each in waves(motions, speeds) if speeds is not None else ():
        along[j] = np.arange(count, count + each[0].shape[1])
        count += len(along[j])
        ids[0][j].append(along[j])
        for i, (run, x) in enumerate(zip(fit.runs, each, strict=True)):
            parts[0][j][i].append(run.masked_spectra(x, j, np.float32))
    places = [np.concatenate([np.zeros(0, int), *own, *others]) for own, others in zip(*ids, strict=True)]
    none = [run.band.spectra(np.zeros((run.band.samples, 0)), precision=np.float32) for run in fit.runs]
    fixed, following = ([[np.concatenate([empty, *x]) for empty, x in zip(none, each, strict=True)] for each in kind] for kind in parts)
    return Catalogue(groups, places, fixed, following, count, along)


def _spectra(fit: Fit, effect: Effect, motions: Sequence[Motion]) -> dict[int, list[Array]]:
    """Spectra (k, F) of an effect's columns on each motor on which it acts, run by run."""
    values = [motor_columns(effect, motion, fit.robot) for motion in motions]
    acts = sorted(set().union(*values))
    none = [np.zeros((len(motion), len(effect.parameters(fit.robot)))) for motion in motions]
    return {m: [run.masked_spectra(v.get(m, z), m, np.float32) for run, v, z in zip(fit.runs, values, none, strict=True)] for m in acts}


def _causes() -> Iterator[type[Effect]]:
    """Kinds of effects that can be what a model lacks."""
    return (kind for name, kind in effect_types().items() if kind.cause and name != "rigid_body")


def _effects(fit: Fit, kinds: Iterable[type[Effect]]) -> Iterator[tuple[Effect, tuple[str, ...]]]:
    for kind in kinds:
        yield from places(kind, fit.declared, fit.sought(kind))
