"""What can be known of a case by one who knows the truth: whether its effect could be seen at all, and whether a rival does as well.

The true effect, its shapes as they truly are (or, where the truth knows none, the best of a grid), is handed to a refit of the
whole declared model; what that gains on held-out data is compared with chance."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

import ident
from ident import estimators as es
from ident.diagnosis.design.places import choices, covers, grid, joints_of, placements
from ident.diagnosis.inference.refinement import refined
from ident.effects.base import Effect
from ident.effects.registry import effect_types
from ident.instruments.prepared import prepared
from ident.model import Model
from ident.problem.problem import Problem
from ident.signals import Signals
from ident.signals.reversing import without_reversals
from ident.statistics.torque_error import number

if TYPE_CHECKING:
    from ident.instruments.fit import Fit
    from ident.instruments.solved import Solved

Array = np.ndarray
#: A gain counts if it lowers the held-out loss by this much (twice a log-likelihood; chance reaches it once in a thousand), and if
#: blocks of time whose gains had either sign alike would reach the sum with no more than this probability (an exact test, which
#: asks nothing of how gains are spread over the blocks), or if it is ten times as large, which no colour of the noise explains.
#: What gains less beside another does as well as it.
DETECTABLE = 10.8
CHANCE = 0.005
SURE = 10.0 * DETECTABLE
_BLOCKS = 12
#: Fits of a model with known responses, each of columns at the last one's prediction.
_PASSES = 4
#: Shapes of a rival that are tried where the diagnosis did not say which.
_SHAPES = 12


@dataclass(frozen=True)
class Candidate:
    """An effect that the model may lack, in some shapes; `joints` are those it sits on."""

    name: str
    joints: tuple[str, ...]
    variants: tuple[Effect, ...]


@dataclass(frozen=True)
class Gain:
    """Fall of the held-out loss, its standard error over blocks of time, and the probability that chance gives as much."""

    gain: float
    error: float
    chance: float

    @property
    def clear(self) -> bool:
        return self.gain > DETECTABLE and (self.chance <= CHANCE or self.gain > SURE)

    @classmethod
    def of(cls, blocks: Array) -> Gain:
        """From the gains of the blocks."""
        total = float(blocks.sum())
        if len(blocks) <= _BLOCKS:
            signs = np.array(list(itertools.product((1.0, -1.0), repeat=len(blocks))))
        else:
            signs = np.random.default_rng(0).choice((1.0, -1.0), (20_000, len(blocks)))
        return cls(total, float(np.sqrt(len(blocks)) * blocks.std(ddof=1)), float(np.mean(signs @ blocks >= total * (1 - 1e-12))))


@dataclass(frozen=True, eq=False)
class Oracle:
    """Refits on the fitted part of a diagnosis (`fit`, even where that searched both parts together), judged on held-out rows over the
    generator's own noise `floor` (n,).

    Each model is refitted on all rows and on those not near reversals, as the diagnosis itself refits (there the sign of the speed is
    wrong by its own error in time, and contacts hold), and with responses free or as their shapes say; it counts at the best of these:
    the truth, and what is set against it."""

    found: Any
    fit: Signals
    held: Signals
    floor: Array

    @cached_property
    def _fitted(self) -> tuple[Signals, ...]:
        return self.fit, without_reversals(self.fit)

    @cached_property
    def _kept(self) -> dict[tuple[Effect, ...], Array]:
        return {}

    def scaled(self, estimate: Any) -> Array:
        """Residual (M, n) of an estimate on held-out rows over the noise; NaN where not used."""
        return residual(estimate, self.held) / self.floor

    def with_effects(self, effects: Sequence[Effect]) -> Array:
        """The same of the declared model refitted with effects."""
        key = tuple(effects)
        if key not in self._kept:
            model, reference = self.found.before.model, self.found.before.all_values
            for effect in effects:
                model = model + effect
                reference = np.append(reference, np.zeros(len(effect.parameters(model.robot))))
            free = self.refitted(model, reference)
            known = [self._responding(free, effects, signals) for signals in self._fitted]
            tried = [self.scaled(one) for one in (free, *known) if one is not None]
            self._kept[key] = min(tried, key=lambda x: float(np.nansum(x**2)))
        return self._kept[key]

    def _responding(self, free: Any, effects: Sequence[Effect], signals: Signals) -> Any:
        """The refit in which effects respond as their shapes say: one who knows the truth knows that a drive is cut off at its limit, or
        a prediction late by its delay, even if the fitted part shows next to nothing of it. None where no effect says so.

        Rows weigh as in the refit with `free` responses."""
        known = self._responses(effects)
        if not known:
            return None
        values = free.all_values
        base = Problem(free.model, signals, reference=values).base
        places = [i for i, name in enumerate(base.names) if name in known]
        if len(places) < len(known):
            return None
        rest = [i for i in range(base.count) if i not in places]
        fixed = np.array([known[base.names[i]] for i in places])
        weight = 1.0 / np.maximum(free.fit_error.rms, 1e-300)
        for _ in range(_PASSES):
            problem = Problem(free.model, signals, reference=values)
            parts = []
            for rows in problem.rows():
                valid, scale = signals.valid[rows.place], np.broadcast_to(weight, rows.tau.shape)
                parts.append(((rows.columns * scale[:, :, None])[valid], (rows.tau * scale)[valid]))
            columns, torque = np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])
            found = np.empty(base.count)
            found[places] = fixed
            found[rest] = np.linalg.lstsq(columns[:, rest], torque - columns[:, places] @ fixed, rcond=None)[0]
            values = base.expand(found)
        return SimpleNamespace(model=free.model, all_values=values)

    def _responses(self, effects: Sequence[Effect]) -> dict[str, float]:
        """Parameter → value, of effects whose shapes say it."""
        robot = self.found.before.model.robot
        return {
            p.name: float(value)
            for effect in effects
            if (response := effect.response(robot)) is not None
            for p, value in zip(effect.parameters(robot), response, strict=True)
        }

    def refitted(self, model: Model, reference: Array) -> Any:
        """The better one of both refits of a model; `reference`: values that its own prediction is made of."""
        estimates = [es.WeightedLeastSquares().solve(Problem(model, s, reference=reference)) for s in self._fitted]
        return min(estimates, key=lambda e: float(np.nansum(self.scaled(e) ** 2)))

    def gain(self, fewer: Sequence[Effect], more: Sequence[Effect]) -> Gain:
        """Fall of the held-out loss from one set of effects to another, joint by joint over what the other leaves: where the noise of
        positions is differentiated twice, that is many times what disturbs the torque, and a loss over less is no log-likelihood."""
        before, after = self.with_effects(fewer), self.with_effects(more)
        left = np.fmax(rms(after), 1.0)
        before, after = before / left, after / left
        blocks = [rows for run in self.held.row_runs for rows in np.array_split(np.arange(run.start, run.stop), _BLOCKS)]
        return Gain.of(np.array([np.nansum(before[rows] ** 2) - np.nansum(after[rows] ** 2) for rows in blocks]))

    def truth(self, part: dict[str, Any]) -> Effect | None:
        """The true effect of a part, in the configuration that gains most; None where no candidate of it can be fitted.

        Shapes of which the truth tells no value (the rotor's inertia behind a spring) are the best of the grid, or what the fitted part
        has them at if they are all sought there."""
        robot = self.found.before.model.robot
        tried = []
        for candidate in self._candidates:
            variants = candidate.variants
            if candidate.name != part["effect"] or not same_place(candidate.joints, part["joints"]):
                continue
            motors = getattr(variants[0], "motors", None)
            if motors is not None and "motor" in part["truth"] and motors != (robot.joint_names[int(part["truth"]["motor"])],):
                continue
            names = [p.name for p in variants[0].shape()]
            shapes = {n: part["truth"][n] for n in names if n in part["truth"]}
            for variant in variants[:1] if len(shapes) == len(names) else variants:
                try:
                    tried.append(variant.with_shape(**shapes) if shapes else variant)
                except ident.IdentError:
                    continue
            if len(shapes) < len(names):
                fit, frame = self._searched
                tried.append(refined(variants[0], candidate.joints, fit, frame))
        return self._best(tried)

    def rival(self, name: str, joints: Sequence[str]) -> Effect | None:
        """An effect that the diagnosis named as a rival: as it was scored there, else the best of the first grid."""
        for one in self.found.decision.named:
            for member in one.competing:
                if member.effect.name == name and tuple(member.joints) == tuple(joints):
                    return member.effect
        return self._best([v for c in self._candidates if c.name == name and tuple(c.joints) == tuple(joints) for v in c.variants])

    def as_good(self, one: Effect, other: Effect, beside: Sequence[Effect] = ()) -> dict[str, Any]:
        """Whether `one` foretells held-out data as well as `other` does."""
        if any(type(e) is type(one) and e.joints == one.joints for e in beside):
            return {"as_good": False, "gain": None, "error": None, "chance": None}  # it stands for another true part
        gain = self.gain([*beside, one], [*beside, other])
        return {"as_good": not gain.clear, **asdict(gain)}

    def parts(self, parts: Sequence[dict[str, Any]]) -> tuple[list[Effect | None], list[dict[str, Any]]]:
        """For each part its true effect, and what that gains beside the other parts."""
        true = [self.truth(p) for p in parts]
        out = []
        for i, effect in enumerate(true):
            others = [e for k, e in enumerate(true) if k != i and e is not None]
            if effect is None:
                out.append({"gain": 0.0, "error": 0.0, "chance": 1.0, "detectable": False, "after": None})
                continue
            gain = self.gain(others, [*others, effect])
            after = number(float(np.sqrt(np.nanmean(self.with_effects([*others, effect]) ** 2))))
            out.append({**asdict(gain), "detectable": gain.clear, "after": after})
        return true, out

    def _best(self, tried: Sequence[Effect]) -> Effect | None:
        gains = []
        for effect in tried:
            try:
                gains.append((self.gain([], [effect]).gain, effect))
            except ident.IdentError:
                continue
        return max(gains, key=lambda g: g[0])[1] if gains else None

    @cached_property
    def _candidates(self) -> tuple[Candidate, ...]:
        fit, _ = self._searched
        motions, out = fit.motions(instrument=True), []
        for name, kind in effect_types().items():
            if not kind.cause or name == "rigid_body":
                continue
            for place in placements(kind, fit.robot):
                if any(covers(e, place, fit.robot) for e in fit.declared.effects):
                    continue
                for choice in choices(place):
                    try:
                        variants = tuple(grid(choice, fit.declared, motions))
                        choice.parameters(fit.robot)
                    except ident.IdentError:
                        continue  # an effect that this robot cannot have (a payload without a link to hold it)
                    if variants:
                        out.append(Candidate(name, joints_of(place), variants[:: -(-len(variants) // _SHAPES)]))
        return tuple(out)

    @cached_property
    def _searched(self) -> tuple[Fit, Solved]:
        fit, _, _ = prepared(self.found.before.model, self.fit)
        return fit, fit.solved(1)


def residual(estimate: Any, held: Signals) -> Array:
    """Residual (M, n) on held-out rows, NaN where not used."""
    problem = Problem(estimate.model, held, reference=estimate.all_values)
    out = np.full(held.tau.shape, np.nan)
    values = problem.base.base_values(estimate.all_values)
    for rows in problem.rows():
        out[rows.place] = held.tau[rows.place] - rows.columns @ values
    return np.where(held.valid, out, np.nan)


def rms(scaled: Array) -> Array:
    """Root mean square (n,) over the rows (M, n) that are used; NaN where none is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(np.sqrt(np.nanmean(scaled**2, axis=0)))


def same_place(joints: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether a finding's joints are those of the fault; either may be of the whole robot."""
    return not joints or not wanted or tuple(joints) == tuple(wanted)
