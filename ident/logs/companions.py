"""What belongs to the positions of a recording: velocities, torques and currents of the same joints, and what is said of the rest."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..errors import DataError
from .channel_group import ChannelGroup, bare_name, known_scale
from .clocks import RecordedTime, rate_ratio
from .languages import english
from .time_names import scalar_time_names
from .told_units import BESIDE
from .unread_units import unread_note
from .words import MOTOR, QUANTITY_WORDS, SAID

Array = np.ndarray
Reader = Callable[[Sequence[str]], Mapping[str, Array]]
#: Motors that turn so many times as fast as the joints have gears.
_GEARED = 3.0
#: Correlation of a motor's position with its joint's.
_WITH = 0.99
#: Two encoders of a joint differ by less than this share of its range.
SAME = 0.05
#: Columns named in a question.
_SHOWN = 6


def companions(
    q: ChannelGroup, found: Sequence[ChannelGroup], table: Mapping[str, Array], names: Sequence[str], joints: Sequence[str] | None
) -> tuple[dict[str, ChannelGroup], list[str]]:
    """Velocities, and torque or current, of the same joints, and what is said of such that are not taken; nothing where torque is there for
    some joints only. A torque that is computed counts only where there is neither another nor a current."""
    chosen, notes = {"q": q}, list[str]()
    n = len(q.columns)
    at_rest = all(np.ptp(table[c][np.isfinite(table[c])]) < 1e-3 for c in q.columns if np.isfinite(table[c]).any())
    for quantity in ("dq", "i", "tau"):
        plain = [g for g in found if g.quantity == quantity and not g.wanted and not g.estimated]
        same = [g for g in plain if len(g.columns) == n and (moves(table, g) or (quantity == "dq" and at_rest))]
        if quantity == "tau" and not same and any(moves(table, g) and len(g.columns) != n for g in plain):
            return {}, []
        notes += [f"{g} do not tell the joints that {q} tell, and are not used." for g in same if g.along(q, names) is None]
        same = [g for one in same if (g := one.along(q, names)) is not None]
        read = [g for g in same if not g.unread and not (quantity == "dq" and g.of_motors and not q.of_motors)]
        notes += [unread_note(f"{g.quantity}1", g.columns, g.unread) for g in same if g.unread]
        notes += [f"{g} are of the motors, and not used for the joints." for g in same if not g.unread and g not in read]
        if quantity == "tau" and "i" in chosen and all(g.computed for g in read):
            continue
        if read:
            chosen[quantity] = max(read, key=lambda g: (not g.computed, len(g.words & q.words), g.measured, _shared(g, q), -len(g.stem)))
    if "tau" in chosen:
        chosen.pop("i", None)
        g = chosen["tau"]
        if g.computed:
            notes.append(
                f"{g} are computed values, going by their names, not measurements: the parameters can only be as good as"
                f" whatever computed them."
            )
    elif "i" not in chosen:
        asked = [g for g in found if g.quantity == "tau" and g.wanted and not g.estimated and len(g.columns) == n and moves(table, g)]
        notes += [
            f"{g} are external torques, without gravity and friction, and hold no information on the robot's own dynamics."
            for g in found
            if _external(g)
        ][:1]
        notes += [
            f"{g} are commanded torques, not measured ones: to use them, map them under [columns] ({_as_torque(g)})." for g in asked[:1]
        ]
    return chosen, [*notes, *_of_other_names(q, joints), *_others(q, found, table)]


def _external(g: ChannelGroup) -> bool:
    return g.quantity == "tau" and bool(g.words & {"ext", "external", "et"})


def _shared(g: ChannelGroup, q: ChannelGroup) -> int:
    """How many letters two names have in common at their beginning: `run2_tau` goes with `run2_q`."""
    return next((k for k, (a, b) in enumerate(zip(g.stem, q.stem, strict=False)) if a != b), len(g.stem))


def side_of_motors(
    g: ChannelGroup,
    motors: Sequence[ChannelGroup],
    q: ChannelGroup,
    table: Mapping[str, Array],
    scale: float,
    time: RecordedTime,
    read: Reader,
) -> tuple[bool, str]:
    """Whether torques that are called the motors' are before the gears, as the speeds of the motors, or their positions (`motors`), tell;
    and what to say of them."""
    measured = [own for own in motors if len(own.columns) == len(q.columns) and not own.wanted and not own.estimated]
    for own in [own for own in measured if own.quantity == "q" and own.unit == q.unit]:
        if (far := _turns_as_far(own, q, table)) > _GEARED:
            return True, f"{g} are motor-side torques: {own} turn about {far:.3g} times as far as the joints ([drive] ratio)."
    for dq in [dq for dq in motors if dq.quantity == "dq" and dq.unit and len(dq.columns) == len(q.columns) and time.column]:
        ratio = rate_ratio(time.factor * np.asarray(read([time.column])[time.column], float), table, q, dq, (scale, known_scale(dq.unit)))
        if ratio is not None and ratio < 1 / _GEARED:
            return True, f"{g} are motor-side torques: {dq} turn about {1 / ratio:.3g} times as fast as the joints ([drive] ratio)."
    return (
        False,
        f'{g} are named after the motors, but taken as joint torques; if they are on the motor side, set [drive] torque = "motor".',
    )


def _turns_as_far(own: ChannelGroup, q: ChannelGroup, table: Mapping[str, Array]) -> float:
    """How many times as far as the joints others turn that move with them; 0 where they do not, or count something."""
    ratios = []
    for a, b in zip(own.columns, q.columns, strict=True):
        turned, moved = (np.asarray(table[c], float) for c in (a, b))
        known = np.isfinite(turned) & np.isfinite(moved)
        if not known.any() or np.ptp(moved[known]) == 0 or np.ptp(turned[known]) == 0 or np.all(turned[known] == np.round(turned[known])):
            return 0.0
        if abs(np.corrcoef(turned[known], moved[known])[0, 1]) < _WITH:
            return 0.0
        ratios.append(float(np.std(turned[known]) / np.std(moved[known])))
    return float(np.median(ratios))


def _as_torque(g: ChannelGroup) -> str:
    return f'tau1 = "{g.columns[0]}" …'


def _of_other_names(q: ChannelGroup, joints: Sequence[str] | None) -> list[str]:
    """What is said of joints that the file names otherwise than the robot does."""
    own = {bare_name(name) for name in joints or ()}
    told = [name for name in q.joints if re.search("[A-Za-z]", bare_name(name))]
    if not joints or not told or {bare_name(name) for name in q.joints} == own or all(re.search(r"\d", x) for x in told):
        return []
    return [f"the log names its joints {', '.join(q.joints)}; the robot's, {', '.join(joints)}, are taken to be in the same order."]


def _others(q: ChannelGroup, found: Sequence[ChannelGroup], table: Mapping[str, Array]) -> list[str]:
    """What is said of other joints' positions (another arm's)."""
    own = np.stack([table[c] for c in q.columns])
    for g in [g for g in found if g.quantity == "q" and not g.wanted and not g.estimated]:
        if g is not q and len(g.columns) == len(q.columns) and not set(g.columns) & set(q.columns) and not g.computed and moves(table, g):
            other = np.stack([table[c] for c in g.columns])
            with np.errstate(invalid="ignore"):
                apart = np.nanmax(np.abs(own - other), initial=0.0) > SAME * np.nanmax(np.ptp(own, axis=1), initial=0.0)
            if apart:
                return [
                    f"{g} also hold positions (of another arm?), and are not used; {q} are read. To use others, map them under [columns]."
                ]
    return []


def moves(table: Mapping[str, Array], group: ChannelGroup) -> bool:
    """Whether a group holds anything: arrays that are present and all zero are none."""
    return any(np.nanmax(np.abs(table[c]), initial=0.0) > 0.0 for c in group.columns)


def refuse_parts(found: Sequence[ChannelGroup], names: Sequence[str]) -> None:
    """Raise DataError where positions stand in columns of their own, each of some joint, and nothing tells which: none is taken alone.
    `names`: all columns."""
    positions = [g for g in found if g.quantity == "q" and not g.wanted and not g.estimated]
    if any(len(g.columns) > 1 for g in positions):
        return
    parts: dict[frozenset[str], dict[frozenset[str], ChannelGroup]] = {}
    for g in positions:
        if (own := _own_words(g)) and not g.of_motors:
            parts.setdefault(frozenset(map(english, g.words & SAID)) - QUANTITY_WORDS["q"], {}).setdefault(own, g)
    for alike in parts.values():
        if len(alike) > 1:
            columns = [g.columns[0] for g in alike.values()]
            more = " …" if len(columns) > _SHOWN else ""
            said = ", ".join(f'q{j + 1} = "{column}"' for j, column in enumerate(columns[:_SHOWN])) + more
            clock = next((f't = "{name}", ' for name in scalar_time_names(names) if name != "t"), "")
            torque = _torques_of([*alike], found)
            raise DataError(
                f"{', '.join(map(repr, columns[:_SHOWN]))}{more} hold positions, but it is not clear of which joints. Map them"
                f" under [columns] of a study file, with time and torques: {clock}{said}, {torque}."
            )


def _own_words(g: ChannelGroup) -> frozenset[str]:
    """The words of a group's name that say neither what it holds nor of which kind it is."""
    return frozenset(word for word in g.words if english(word) not in SAID | MOTOR | BESIDE)


def _torques_of(joints: Sequence[frozenset[str]], found: Sequence[ChannelGroup]) -> str:
    """The lines of [columns] for the torques, or currents, of joints that words tell; as an example where none is there."""
    for quantity in ("tau", "i"):
        own = [g for g in found if g.quantity == quantity and not g.wanted and not g.estimated]
        of = {_own_words(g): g.columns[0] for g in reversed(own)}
        said = [f'{quantity}{j + 1} = "{of[words]}"' for j, words in enumerate(joints[:_SHOWN]) if words in of]
        if said:
            return ", ".join(said) + (" …" if len(joints) > _SHOWN else "")
    return 'tau1 = "…" …'
