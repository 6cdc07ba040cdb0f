"""Columns that belong together: those whose names differ in one number or one joint's name, and what the words of the name say."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from .channel_group import ChannelGroup, bare_name, unit_suffix
from .languages import english, in_english
from .readers.runs import RUNS
from .told_units import BESIDE, unit_in, unread_in, unread_unit
from .units import bracketed, is_unit, split_unit, unit_of
from .words import (
    NOT_JOINTS,
    QUANTITIES,
    QUANTITY_WORDS,
    SAID,
    TIME,
    quantity_of,
    words_of,
)

Array = np.ndarray
_NUMBER = re.compile(r"\d+")
_ELEMENT = re.compile(r"^(?P<stem>.*)\[(?P<joint>[^\[\]]*[A-Za-z][^\[\]]*)\](?P<rest>.*)$")
_BY_NAME = re.compile(r"^(?P<joint>.+)[./](?P<word>position|velocity|acceleration|effort|torque|current)$", re.IGNORECASE)
#: A word for recordings right before a number, which then counts these, not joints.
_COUNTS_RUNS = re.compile(rf"(^|[^a-z])({'|'.join(sorted(RUNS))})[ _\[(]*$", re.IGNORECASE)
_INDEXED = re.compile(r"\[\d+\]$")
_DIMENSIONS = {"angle": "q", "rate": "dq", "acceleration": "ddq", "torque": "tau", "current": "i"}
#: Dimensions that joints of one robot may have side by side.
_ALIKE = ({"angle", "length"}, {"rate", "speed"}, {"acceleration", "linear acceleration"}, {"torque", "force"}, {"current"})
#: What a column holds that is a joint's name and a unit.
_BY_UNIT = {
    "angle": "position", "length": "position", "rate": "velocity", "speed": "velocity", "torque": "torque", "force": "torque",
    "current": "current",
}  # fmt: skip
#: Names of a frame's axes, which are no joints' where no robot says so.
_AXES = {"x", "y", "z", "rx", "ry", "rz", "roll", "pitch", "yaw"} | NOT_JOINTS - {"base"}
#: What the symbols of angles and ways, of torques and forces stand for: joints of both kinds may be written side by side.
_SYMBOLS = {"position #": {"q", "theta", "th", "d", "x", "s", "l"}, "torque #": {"tau", "f", "t", "m"}}
#: Words for one quantity that joints that turn and joints that slide have each their own of.
_ONE_WORD = {
    "position": {"position", "pos", "angle", "travel", "stroke", "extension", "displacement"},
    "velocity": {"velocity", "vel", "speed", "rate"},
    "torque": {"torque", "torques", "force", "forces"},
}
#: What two sensors of one joint are told by.
_SIDES = {"joint", "axis", "motor", "link", "load", "output", "input", "drive", "gear", "encoder", "sensor", "raw"}


def groups(
    names: Sequence[str], joints: Sequence[str] | None, units: Mapping[str, str], told: Mapping[str, str] | None = None
) -> list[ChannelGroup]:
    """Groups of columns. `joints`: the robot's, whose order counts where columns name joints; `units`: told of columns; `told`: quantity
    (`q`, `dq`, `tau`, `i`, `q_ref`) → a column's name with {} for the joint's number."""
    stems: dict[str, list[tuple[int, str, str]]] = {}
    elements = _elements(names)
    for name in names:
        by_name, element = _BY_NAME.match(name), elements.get(name)
        if by_name and not _INDEXED.search(by_name["joint"]) and not (element and by_name["joint"].endswith("]")):
            joint, topic = re.split(r"[./]", by_name["joint"])[-1], by_name["joint"].rpartition("/")[0]
            _put(stems, f"{topic}|{by_name['word']}", name, joint, joints)
        elif element:
            _put(stems, f"{element['stem']}[]{element['rest']}", name, element["joint"], joints)
        else:
            for found in _NUMBER.finditer(name):
                if _COUNTS_RUNS.search(name[: found.start()]):
                    continue
                stem = name[: found.start()] + "#" + name[found.end() :]
                stems.setdefault(stem, []).append((int(found.group()), name, ""))
    stems |= _around_names([name for name in names if not (_BY_NAME.match(name) or name in elements)], joints, stems)
    known = {template.replace("{}", "#"): quantity for quantity, template in (told or {}).items()}
    stems = _of_all_units(stems, names)
    out = [made for stem, members in stems.items() if (made := _group(stem, members, units, known.get(stem, "")))]
    most = {g.stem.lower().replace("max", "min") for g in out if "max" in g.words}
    out = [g for g in out if g.stem.lower() not in most]
    if not any(g.quantity == "q" and len(g.columns) > 1 for g in out):
        out = _of_any_numbers(stems, units, out)
    if not any(g.quantity == "q" for g in out):
        out += [made for name in names if (made := _group(name, [(0, name, "")], units, ""))]
    if not any(g.quantity == "q" for g in out) and (made := _named_after_joints(names, joints, units)):
        out.append(made)
    return out


def _named_after_joints(names: Sequence[str], joints: Sequence[str] | None, units: Mapping[str, str]) -> ChannelGroup | None:
    """Positions where nothing else holds any: a column of each joint of the robot, with nothing but its name."""
    members = [(j, name, joint) for j, joint in enumerate(joints or ()) for name in names if bare_name(name) == bare_name(joint)]
    whole = bool(joints) and len({j for j, *_ in members}) == len(members) == len(joints or ())
    return _group("position", members, units, "") if whole else None


def _of_any_numbers(
    stems: Mapping[str, list[tuple[int, str, str]]], units: Mapping[str, str], usual: list[ChannelGroup]
) -> list[ChannelGroup]:
    """Groups whose numbers neither begin with 0 or 1 nor follow each other (addresses on a bus: 0x141 …), beside the usual
    ones; the numbers are the joints' names then. Only the usual ones where no positions are among them."""
    named = {
        stem: [(k, name, joint or str(k)) for k, name, joint in sorted(members)] for stem, members in stems.items() if len(members) > 1
    }
    counted = {stem: [(j, name, joint) for j, (_, name, joint) in enumerate(members)] for stem, members in named.items()}
    more = [made for stem, members in counted.items() if (made := _group(stem, members, units, ""))]
    if not any(g.quantity == "q" for g in more):
        return usual
    taken = {c for g in more for c in g.columns}
    return [*(g for g in usual if not taken & set(g.columns)), *more]


def _of_all_units(stems: Mapping[str, list[tuple[int, str, str]]], names: Sequence[str]) -> dict[str, list[tuple[int, str, str]]]:
    """Groups of which each holds some joints only, and that differ in their unit, and the words or the symbol that go with it, alone, as
    one: angles of some joints, ways of others; forces beside torques."""
    alike: dict[tuple[str, bool], list[str]] = {}
    for stem, members in stems.items():
        bare, unit = split_unit(stem)
        if not members:
            continue
        word = re.sub(r"[^a-z]", "", bare.lower())
        symbol = next((stands for stands, written in _SYMBOLS.items() if word in written), "") if unit else ""
        alike.setdefault((symbol or _same_words(bare.lower()), bool(unit)), []).append(stem)
    out = dict(stems)
    for (bare, _), own in alike.items():
        members = [m for stem in own for m in stems[stem]]
        who = [joint or str(number) for number, _, joint in members]
        if len(own) < 2 or len(set(who)) < len(who) or (bare in out and bare not in own):
            continue
        if len({number for number, *_ in members}) < len(members):  # names of which no robot tells the order
            members = [(k, name, joint) for k, (_, name, joint) in enumerate(sorted(members, key=lambda m: names.index(m[1])))]
        out = {stem: found for stem, found in out.items() if stem not in own} | {bare: members}
    return out


def _same_words(words: str) -> str:
    """Words in small letters, those for one quantity as one: what a slide has beside a joint that turns."""
    return re.sub(r"[a-z]+", lambda word: next((said for said, known in _ONE_WORD.items() if english(word[0]) in known), word[0]), words)


def _elements(names: Sequence[str]) -> dict[str, re.Match[str]]:
    """Columns that are an array's elements, told by joints' names in brackets: others differ from them in that alone. What stands in the
    brackets of one alone, or of columns that have the same there, is a unit."""
    found = {name: match for name in names if (match := _ELEMENT.match(name)) and not unit_suffix(match["joint"])}
    beside: dict[tuple[str, str], set[str]] = {}
    for match in found.values():
        beside.setdefault((match["stem"], match["rest"]), set()).add(match["joint"])
    return {name: match for name, match in found.items() if len(beside[match["stem"], match["rest"]]) > 1}


def _around_names(
    names: Sequence[str], joints: Sequence[str] | None, numbered: Mapping[str, list[tuple[int, str, str]]]
) -> dict[str, list[tuple[int, str, str]]]:
    """Groups of columns that differ in a joint's name beside the words for what they hold: `position_elbow [deg]`, `elbow torque`.

    With a robot its joints' names count; without one, names of which some hold no number. Columns that a joint's name tells are no
    longer taken for ones that a number in it counts."""
    stems: dict[str, list[tuple[int, str, str]]] = {}
    known = {bare_name(joint): joint for joint in joints or ()}
    for name in names:
        plain, unit = bracketed(name)
        unit = unit_suffix(unit) or unread_unit(unit)
        plain = plain if unit else name
        parts, said, joint = _parts(plain, known)
        if not unit and known and bare_name(joint) not in known:  # elbow_pos_deg
            bare, suffix = split_unit(name)
            if suffix and bare_name((shorter := _parts(bare, known))[2]) in known:
                (parts, said, joint), unit = shorter, suffix
        if not said and known and unit and bare_name(joint) in known and is_unit(unit):  # elbow_deg, lift_mm, elbow [N m]
            said = [word] if (word := _BY_UNIT.get(unit_of(unit).dimension)) else said
        told_by_unit = bool(said and known and unit and is_unit(unit)) and any(unit_of(unit).dimension in x for x in _ALIKE)
        named = (told_by_unit or any(english(part.lower()) in QUANTITIES for part in said)) and any(map(str.isalpha, joint))
        sides = not known and all(english(part.lower()) in _SIDES for part in parts if part not in said)
        if sides or not named or (known and bare_name(joint) not in known) or (not known and words_of(joint) & (_AXES | TIME - {"t"})):
            continue
        stem = " ".join(said).lower() + (f" [{unit}]" if unit else "")
        _put(stems, stem, name, known.get(bare_name(joint), joint), joints)
    of_stem = {stem: {joint for *_, joint in members} for stem, members in stems.items()}
    of_words: dict[str, set[str]] = {}
    for stem, own in of_stem.items():
        of_words.setdefault(_same_words(stem.partition(" [")[0]), set()).update(own)
    placed = [
        own
        for stem, own in of_words.items()
        if words_of(stem) & QUANTITY_WORDS["q"] and len(own) > 1 and any(not re.search(r"\d", x) for x in own)
    ]
    # Without a robot, joints are those that have positions.
    told = {stem: members for stem, members in stems.items() if known or any(of_stem[stem] <= own for own in placed)}
    mine = {name for members in told.values() for _, name, _ in members}
    for stem, members in numbered.items():
        if mine & {name for _, name, _ in members}:
            told[stem] = []
    return told


def _parts(name: str, known: Mapping[str, str]) -> tuple[list[str], list[str], str]:
    """The words of a name, those that say what it holds, and the joint that the others name."""
    split = re.split(r"(?:[^\w%]|_)+", name if name.isascii() else in_english(name))
    parts = [piece for part in split if part for piece in _words_written_as_one(part)]
    said = [part for part in parts if english(part.lower()) in SAID]
    joint = "_".join(part for part in parts if part not in said)
    if bare_name(joint) not in known and (rest := [p for p in parts if p not in said and english(p.lower()) not in BESIDE]):
        joint = "_".join(rest)
    return parts, said, joint


def _words_written_as_one(part: str) -> list[str]:
    """`LageIst`: two words that say what a column holds; else the part itself, which may be a joint's name."""
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", part).split()
    return words if all(english(word.lower()) in SAID for word in words) else [part]


def _put(stems: dict[str, list[tuple[int, str, str]]], stem: str, name: str, joint: str, joints: Sequence[str] | None) -> None:
    members = stems.setdefault(stem, [])
    own = [] if not joints else [k for k, known in enumerate(joints) if known == joint or bare_name(known) == bare_name(joint)]
    place = own[0] if len(own) == 1 else len(members)
    members.append((place, name, joint))


def _group(stem: str, members: list[tuple[int, str, str]], units: Mapping[str, str], told: str) -> ChannelGroup | None:
    words = frozenset({"reference"} if told.endswith("_ref") else {"measured"}) if told else words_of(stem)
    numbers = sorted({m[0] for m in members})
    if not members or len(numbers) != len(members) or numbers != list(range(numbers[0], numbers[0] + len(numbers))) or numbers[0] > 1:
        return None
    if words & NOT_JOINTS:
        return None
    members = sorted(members)
    columns = tuple(m[1] for m in members)
    own = tuple(unit_suffix(units.get(c, "")) or unit_in(c) for c in columns)
    if any(own) and not all(own):  # beside another that tells its unit, a single letter is one
        own = tuple(found or split_unit(c)[1] or "" for found, c in zip(own, columns, strict=True))
    differ = len(set(own)) > 1 and any({unit_of(u).dimension for u in own if u} <= alike for alike in _ALIKE) and all(own)
    unit = unit_suffix(units.get(columns[0], "")) or unit_in(stem) or (own[0] if differ else "")
    unread = "" if unit else unread_unit(units.get(columns[0], "")) or unread_in(stem)
    quantity = told.removesuffix("_ref") or quantity_of(words)
    if words in ({"observation", "state"}, {"action"}):  # LeRobot: positions, and what was asked for
        quantity = "q"
    if not quantity and unit:
        quantity = _DIMENSIONS.get(unit_of(unit).dimension, "")
    if not quantity:
        return None
    return ChannelGroup(stem, columns, tuple(m[2] for m in members), quantity, words, unit, unread, own if differ else ())
