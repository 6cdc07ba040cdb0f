"""Sets of parameters that the data allow, drawn from a fit's joint covariance, or from the spread of several units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..drives.result import DriveFit
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..physical.pseudo_inertia import smallest_eigenvalues
from .identified import Identified
from .sampling import bounded_normal, total_covariance

Array = np.ndarray
#: A value whose standard deviation is more than this share of it is not determined, and is drawn up to twice its value.
SHARE = 0.3


@dataclass(frozen=True, eq=False)
class Draws:
    """Sets of parameters of one robot, each ready to be exported, and what is to be said of them."""

    sets: tuple[Identified, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Free:
    """What is drawn: names (p,), values, covariance and bounds."""

    names: tuple[str, ...]
    mean: Array
    covariance: Array
    lower: Array
    upper: Array


def draws(found: Identified, units: Sequence[Identified], count: int, seed: int) -> Draws:
    """`count` sets of parameters. Raises ConfigurationError where a fit has no covariance, or units are not of one model."""
    free = [_free(one) for one in (found, *units)]
    names = free[0].names
    for other in free[1:]:
        if other.names != names:
            differ = sorted(set(other.names) ^ set(names))
            raise ConfigurationError(f"the units' fits do not have the same parameters ({', '.join(differ[:5])}); fit all with one model.")
    mean, covariance, notes = free[0].mean, free[0].covariance, []
    if units:
        values = np.array([one.mean for one in free])
        mean, covariance = total_covariance(values, np.mean([one.covariance for one in free], axis=0))
        notes.append(
            f"ranges are for one further unit: the spread of {len(free)} units, where it exceeds the uncertainty of their estimates."
        )
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    wide = std > SHARE * np.abs(mean)
    lower = free[0].lower
    bounded = np.isfinite(lower)
    mean = np.where(bounded, np.maximum(mean, lower), mean)
    # What alone it is known to, the others held: the size of what the data hardly show.
    held = std * _held(covariance, std)
    upper = free[0].upper.copy()
    closed = wide & bounded & np.isinf(upper)
    upper[closed] = lower[closed] + 2.0 * np.maximum(mean - lower, held)[closed]
    if wide.any():
        told = ", ".join(name for name, here in zip(names, wide, strict=True) if here)
        notes.append(f"not determined to {SHARE:.0%} each; where it has a bound, drawn up to twice the value: {told}.")
    sample = bounded_normal(mean, covariance, lower, upper, count, np.random.default_rng(seed))
    sets, unreal = _sets(found, sample)
    if unreal:
        notes.append(f"in {unreal} of {count} sets the links would be physically inconsistent: those sets keep the identified links.")
    return Draws(sets, tuple(notes))


def _held(covariance: Array, std: Array) -> Array:
    """Share (p,) of each standard deviation that stays when all others are known."""
    scale = np.where(std > 0, std, 1.0)
    correlation = covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(std))
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(np.linalg.inv(correlation)), 1.0)))


def _free(found: Identified) -> _Free:
    fit = found.fit
    if isinstance(fit, DriveFit):
        return _of_law(fit)
    if isinstance(fit, Estimate):
        lower = np.full(len(fit.values), -np.inf)
        for i, (parameter, row) in enumerate(zip(fit.parameters, fit.base.regroup, strict=True)):
            if np.count_nonzero(row) == 1:
                lower[i] = parameter.lower
        return _Free(tuple(fit.names), fit.values.copy(), fit.covariance, lower, np.full(len(lower), np.inf))
    raise ConfigurationError("ranges are drawn from the covariance of a fit: give the fit itself, not parameters.")


def _of_law(fit: DriveFit) -> _Free:
    """Of what the logs set no limit to, the covariance has none either: it is drawn as far as it may go, apart from the others."""
    lower, upper = np.array([u.lower for u in fit.unknowns]), np.full(len(fit.values), np.inf)
    covariance = fit.covariance.copy()
    reach = fit.delay_interval()
    for i in np.flatnonzero(~np.isfinite(np.diag(covariance))):
        covariance[i], covariance[:, i] = 0.0, 0.0
        low, high = reach.get(fit.names[i], (0.0, lower[i], np.inf))[1:]
        if np.isfinite([low, high]).all():
            lower[i], upper[i] = low, high
        covariance[i, i] = max(abs(fit.values[i]), high - low if np.isfinite(high - low) else 0.0, 1e-12) ** 2
    return _Free(fit.names, fit.values.copy(), covariance, lower, upper)


def _sets(found: Identified, sample: Array) -> tuple[tuple[Identified, ...], int]:
    """A model for each sample, and how many would have links that are no bodies."""
    fit = found.fit
    part = next(s for e, s in zip(found.model.effects, found.model.slices, strict=True) if isinstance(e, RigidBody))
    out, unreal = [], 0
    for row in sample:
        if isinstance(fit, DriveFit):
            one = _of_drives(found, fit, row)
        else:
            assert isinstance(fit, Estimate)
            values = found.values.copy()
            values[fit.base.independent] += row - fit.values
            one = replace(found, values=values)
        moved = not np.array_equal(one.values[part], found.values[part])
        if moved and np.any(smallest_eigenvalues(one.inertial) <= 0):
            unreal += 1
            one = replace(one, values=np.concatenate([one.values[: part.start], found.values[part], one.values[part.stop :]]))
        out.append(one)
    return tuple(out), unreal


def _of_drives(found: Identified, fit: DriveFit, row: Array) -> Identified:
    assert found.law is not None
    values, constants = found.values.copy(), fit.constants()
    law = {key: x.copy() for key in constants if (x := getattr(found.law, key, None)) is not None}
    law |= {} if found.law.per_volt is None else {"per_volt": found.law.per_volt.copy()}
    scale, gains = constants["torque_scale"], [key for key in ("kp", "kd", "ki", "effort_limit") if key in law]
    for unknown, old, new in zip(fit.unknowns, fit.values, row, strict=True):
        if unknown.column >= 0:
            values[unknown.column] += new - old
        if unknown.column >= 0 or unknown.log:
            continue
        at = slice(None) if unknown.joint < 0 else slice(unknown.joint, unknown.joint + 1)
        if unknown.place == "torque_scale":
            for key in gains:
                law[key][at] *= new / old
            if found.law.per_volt is not None:
                law["per_volt"][at] = new
        else:
            # Gains and limits are told times the scale of the torque.
            ratio = law[unknown.place][at] / constants[unknown.place][at] if unknown.place in gains else 1.0
            law[unknown.place][at] = np.where(np.isfinite(ratio), ratio, scale[at]) * new
    return replace(found, values=values, law=replace(found.law, **law))
