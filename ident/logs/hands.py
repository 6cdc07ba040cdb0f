"""Hands: their joints are left out where no robot has them and nothing drives them, which is said."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from .channel_group import ChannelGroup, bare_name
from .words import HANDS, words_of

Array = np.ndarray
Reader = Callable[[Sequence[str]], Mapping[str, Array]]


def driven_hands(found: Sequence[ChannelGroup], read: Reader) -> frozenset[str]:
    """Joints of hands (`bare_name`) that have a torque or a current of their own: they are joints like any other."""
    torques = [g for g in found if g.quantity in ("tau", "i") and not g.wanted and not g.estimated]
    own = {c: bare_name(joint) for g in torques for c, joint in zip(g.columns, g.joints, strict=True) if words_of(joint) & HANDS}
    table = read([*own]) if own else {}
    return frozenset(joint for c, joint in own.items() if np.nanmax(np.abs(np.asarray(table[c], float)), initial=0.0) > 0.0)


def left_hands(q: ChannelGroup, found: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """What is said of hands that are left out."""
    (whole,) = [g for g in found if g.stem == q.stem and set(q.columns) <= set(g.columns)][:1] or [q]
    left = [joint for c, joint in zip(whole.columns, whole.joints, strict=True) if c not in q.columns and words_of(joint) & HANDS]
    said = f"{', '.join(left)}: joints of a hand without torque, left out; to keep them, name a robot that has them."
    return (said,) if left else ()
