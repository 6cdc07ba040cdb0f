"""Columns of one quantity over the joints of a robot."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .units import as_suffix, is_unit, unit_of
from .words import (
    COMPUTED,
    ESTIMATED,
    HANDS,
    MOTOR,
    QUANTITIES,
    TAKEN,
    WANTED,
    words_of,
)

Array = np.ndarray


@dataclass(frozen=True)
class ChannelGroup:
    """Columns of one quantity over the joints, in their order. `joints`: their names, "" where only numbers tell them; `unit`: as told;
    `unread`: what is told for a unit and is none that is known; `units`: of each column, where they differ (degrees of some joints,
    millimetres of others)."""

    stem: str
    columns: tuple[str, ...]
    joints: tuple[str, ...]
    quantity: str
    words: frozenset[str]
    unit: str = ""
    unread: str = ""
    units: tuple[str, ...] = ()

    @property
    def wanted(self) -> bool:
        """Whether it is what was asked for."""
        return bool(self.words & WANTED)

    @property
    def estimated(self) -> bool:
        """Whether it is estimated, modelled or a difference."""
        return bool(self.words & ESTIMATED)

    @property
    def measured(self) -> bool:
        """Whether its name says that it is measured."""
        return bool(self.words & TAKEN)

    @property
    def computed(self) -> bool:
        """Whether its name says that it is computed from something else."""
        return bool(self.words & COMPUTED)

    @property
    def of_motors(self) -> bool:
        """Whether its name says that it is on the motors' side."""
        return bool(self.words & MOTOR)

    @property
    def named(self) -> bool:
        """Whether the joints' names are told."""
        return any(self.joints)

    def only(self, keep: Sequence[int]) -> ChannelGroup:
        """Some of its columns."""
        return ChannelGroup(
            self.stem,
            tuple(self.columns[k] for k in keep),
            tuple(self.joints[k] for k in keep),
            self.quantity,
            self.words,
            self.unit,
            self.unread,
            tuple(self.units[k] for k in keep) if self.units else (),
        )

    def in_si(self, table: Mapping[str, Array]) -> dict[str, Array]:
        """Its columns of a table as they are to be looked at: in SI units where these differ from column to column."""
        return {c: np.asarray(table[c], float) * known_scale(u) for c, u in zip(self.columns, self.units, strict=False)}

    def along(self, q: ChannelGroup, names: Sequence[str]) -> ChannelGroup | None:
        """In the order of the positions' joints; None where they are put in another order than that of the columns (`names`), and nothing
        tells which of these belongs to which."""
        own, wanted = ([bare_name(joint) for joint in g.joints] for g in (self, q))
        if all(own) and sorted(own) == sorted(wanted) and len(set(own)) == len(own):
            return self.only([own.index(joint) for joint in wanted])
        at = [names.index(column) for column in q.columns]
        return self if not q.named or at == sorted(at) else None

    def arms(self, driven: Collection[str] = ()) -> ChannelGroup:
        """Without the channels of hands, but of those joints that are `driven` (`bare_name`)."""
        keep = [k for k, name in enumerate(self.joints) if not words_of(name) & HANDS or bare_name(name) in driven]
        return self.only(keep) if 0 < len(keep) < len(self.columns) else self

    def __str__(self) -> str:
        return repr(self.columns[0]) if len(self.columns) == 1 else f"{self.columns[0]!r} … {self.columns[-1]!r}"


def joint_of(name: str) -> str:
    """A joint's name from the path by which a channel names it: the last part that is no word for a quantity (`arm/elbow.pos`: elbow)."""
    parts = [part for part in re.split(r"[/.]", name) if part]
    return next((part for part in reversed(parts) if part.lower() not in QUANTITIES), parts[-1] if parts else name)


def unit_suffix(text: str) -> str:
    """A unit as a row of units or a label writes it, as our own suffix; "" where it is none."""
    word = as_suffix(text.strip().strip("[]()"))
    return unit_of(word).name if is_unit(word) else ""


def bare_name(joint: str) -> str:
    """A joint's name without its path, the word for joint, and what separates its words."""
    return "".join(part for part in re.split(r"[^a-z0-9]+", joint_of(joint).lower()) if part != "joint")


def known_scale(unit: str) -> float:
    """SI value of one unit, by its suffix."""
    return unit_of(unit).scale
