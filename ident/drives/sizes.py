"""Friction in proportion to load or torque whose size is no size: where it stands in for something else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from .determined import Determination, Standing
from .unknowns import Unknown

Array = np.ndarray
#: What is lost of a load or of a drive's torque, as a share of it.
_SHARES = ("load", "gear_loss")
#: Friction that may be exchanged for it, and the correlation from which on two of them are.
_FRICTION, _EXCHANGED = ("dry", "viscous", "excess", "load", "gear_loss", "gear_loss_slow"), 0.7
#: Share of an unknown's own size below which it stands at its bound.
_AT_BOUND = 1e-3


def impossible(unknown: Unknown, value: float) -> bool:
    """Whether more than all of a torque would be lost, which turns a joint by none."""
    return unknown.place in _SHARES and value >= 1.0


def doubtful_sizes(unknowns: Sequence[Unknown], values: Array, covariance: Array) -> dict[int, str]:
    """Number of each unknown whose value is not what its name says → why.

    A joint that loses more than all of its load is turned by none. And where friction in proportion has pushed another friction of the
    joint to zero, its standard deviation is one of a minimum that lies beyond: the two were exchanged as far as that went."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    out: dict[int, str] = {}
    for i, unknown in enumerate(unknowns):
        if unknown.place not in _SHARES or not values[i] > 0.0:
            continue
        if impossible(unknown, float(values[i])):
            out[i] = (
                f"{unknown.name} is at least 1: all of the torque would be lost, which is physically impossible; friction that depends on"
                " the posture, or a contact, can look like this"
            )
            continue
        for k, other in enumerate(unknowns):
            at_bound = values[k] - other.lower <= _AT_BOUND * size[k]
            if k == i or other.joint != unknown.joint or other.place not in _FRICTION or not at_bound:
                continue
            if abs(covariance[i, k]) > _EXCHANGED * size[i] * size[k]:
                out[i] = f"{other.name} was estimated as zero, and {unknown.name} may stand for it: its value is not reliable"
    return out


def without_sizes(decided: Determination, doubts: Mapping[int, str]) -> Determination:
    """The same with these unknowns not determined."""
    verdicts, std = list(decided.verdicts), decided.std.copy()
    for i in doubts:
        verdicts[i] = Standing.CONFOUNDED if verdicts[i] == Standing.DETERMINED else verdicts[i]
        std[i] = np.inf
    return replace(decided, verdicts=tuple(verdicts), std=std)
