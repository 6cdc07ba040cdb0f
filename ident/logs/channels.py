"""Columns that belong together: those whose names differ in one number or one joint's name, and what the words of the name say."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .languages import english, in_english
from .readers.moments import MOMENT
from .readers.runs import RUNS
from .stamps import fraction_of
from .units import as_suffix, bracketed, is_unit, split_unit, unit_of
from .words import (
    COMPUTED,
    ESTIMATED,
    HANDS,
    MOTOR,
    NOT_JOINTS,
    QUANTITIES,
    QUANTITY_WORDS,
    SAID,
    TAKEN,
    TIME,
    WANTED,
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
#: What stands in brackets and is no unit, and in names and tells no joint: which joint, side or sensor it is of.
BESIDE = {"joint", "axis", "motor", "link", "arm", "side", "raw", "left", "right", "sensor", "encoder", "si"}
#: What two sensors of one joint are told by.
_SIDES = {"joint", "axis", "motor", "link", "load", "output", "input", "drive", "gear", "encoder", "sensor", "raw"}
#: Words at a name's end that tell a share, or what a sensor counts: no unit whose size is known.
_NO_UNITS = {
    "percent", "pct", "prozent", "permille", "promille", "permil", "perthousand", "ticks", "tick", "counts", "count", "lsb", "inc", "incs",
    "increments", "digits", "adc", "pu",
}  # fmt: skip
#: A letter or two before a unit: a multiple that is not known.
_LIKE_UNIT = re.compile(r"[a-zµ]{1,2}(deg|rad|nm|rpm|rev|turns?)|(deg|rad|nm|rev|turns?|mm)(per)?[a-z]{1,3}", re.IGNORECASE)
#: What is told for something a time, in other units of time than those of rates that are known.
_RATE = re.compile(r"/\s*(ms|us|µs|ns|h|cycle|tick|sample)\b", re.IGNORECASE)
_LAST_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")


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
    return out


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
        split = re.split(r"(?:[^\w%]|_)+", plain if plain.isascii() else in_english(plain))
        parts = [piece for part in split if part for piece in _words_written_as_one(part)]
        said = [part for part in parts if english(part.lower()) in SAID]
        joint = "_".join(part for part in parts if part not in said)
        if bare_name(joint) not in known and (rest := [p for p in parts if p not in said and english(p.lower()) not in BESIDE]):
            joint = "_".join(rest)
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


def _words_written_as_one(part: str) -> list[str]:
    """`LageIst`: two words that say what a column holds; else the part itself, which may be a joint's name."""
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", part).split()
    return words if all(english(word.lower()) in SAID for word in words) else [part]


def bare_name(joint: str) -> str:
    """A joint's name without its path, the word for joint, and what separates its words."""
    return "".join(part for part in re.split(r"[^a-z0-9]+", joint_of(joint).lower()) if part != "joint")


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
    own = tuple(unit_suffix(units.get(c, "")) or _unit_in(c) for c in columns)
    if any(own) and not all(own):  # beside another that tells its unit, a single letter is one
        own = tuple(found or split_unit(c)[1] or "" for found, c in zip(own, columns, strict=True))
    differ = len(set(own)) > 1 and any({unit_of(u).dimension for u in own if u} <= alike for alike in _ALIKE) and all(own)
    unit = unit_suffix(units.get(columns[0], "")) or _unit_in(stem) or (own[0] if differ else "")
    unread = "" if unit else unread_unit(units.get(columns[0], "")) or unread_in(stem)
    quantity = told.removesuffix("_ref") or quantity_of(words)
    if words in ({"observation", "state"}, {"action"}):  # LeRobot: positions, and what was asked for
        quantity = "q"
    if not quantity and unit:
        quantity = _DIMENSIONS.get(unit_of(unit).dimension, "")
    if not quantity:
        return None
    return ChannelGroup(stem, columns, tuple(m[2] for m in members), quantity, words, unit, unread, own if differ else ())


def _unit_in(stem: str) -> str:
    """The unit that a name tells: `act_pos_mot#_deg`, `vel#_deg_per_s`, `speed # [rpm]`; single letters count only in brackets."""
    bare = stem.replace("[#]", "").replace("[]", "").replace("#", "")
    if found := unit_suffix(bracketed(bare)[1]):
        return found
    unit = split_unit(re.sub(r"_+", "_", bare.replace("_per_", "_")).strip("_"))[1] or ""
    return unit if len(unit) > 1 else ""


def unread_unit(text: str) -> str:
    """What is told for a unit, where it says something that is no unit that is known; "" for a unit, for nothing, and for words."""
    inside = text.strip().strip("[]()").strip()
    plain = (
        not inside
        or inside in "-–—."
        or inside.isdecimal()
        or unit_suffix(inside)
        or (bool(words_of(inside) & (SAID | TIME | BESIDE)) and not _RATE.search(inside))
    )
    return "" if plain else inside


def unread_in(name: str) -> str:
    """What a name tells for a unit, in brackets or behind its last line, where it is none that is known."""
    bare = name.replace("[#]", "").replace("[]", "").replace("#", "")
    found = _LAST_BRACKETS.search(bare)
    last = re.split(r"[_\s]+", bare.strip("_ "))[-1]
    alike = last != bare and bool(_LIKE_UNIT.fullmatch(last)) and last.lower() != "return" and not words_of(last) & (SAID | TIME | BESIDE)
    suffix = last.lower() in _NO_UNITS or (alike and not unit_suffix(last))
    return unread_unit(found[1]) if found else last if suffix else ""


def known_scale(unit: str) -> float:
    """SI value of one unit, by its suffix."""
    return unit_of(unit).scale


def scalar_time_names(names: Sequence[str], units: Mapping[str, str] | None = None) -> list[str]:
    """Columns whose name, or unit, is one of time, the likeliest first: the sender's stamp before the recorder's, plain names before
    others."""
    exact = (
        "t",
        "time",
        "timestamp",
        "timestamps",
        "tstamps",
        "zeit",
        "stamp",
        "secs",
        "sec",
        "seconds",
        "ms",
        "%time",
        "ipoc",
        "x_value",  # LabVIEW
        "clock",
        "ts",
    )
    lower = {n.lower(): n for n in names}
    found = [lower[k] for k in lower if re.search(r"stamp[./_](sec|secs)$|header[./]stamp$", k)] + [lower[k] for k in exact if k in lower]
    others = [n for n in names if words_of(n) & (TIME - {"t", "ms", "ts", "stamp"})]
    split = [n for n in names if fraction_of(n, names)]
    return list(dict.fromkeys([*found, *split, *others, *(n for n in names if _time_unit(n, units or {}))]))


def _time_unit(name: str, units: Mapping[str, str]) -> bool:
    if units.get(name) == MOMENT:
        return True
    unit = unit_suffix(units.get(name, "")) or unit_suffix(bracketed(name)[1])
    return bool(unit) and unit_of(unit).dimension == "time"
