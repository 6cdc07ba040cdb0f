"""Columns that belong together: those whose names differ in one number or one joint's name, and what the words of the name say."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .readers.wording import DESIRED, MEASURED
from .units import UNITS, bracketed, is_unit, split_unit, unit_of

Array = np.ndarray
_NUMBER = re.compile(r"\d+")
_ELEMENT = re.compile(r"^(?P<stem>.*)\[(?P<joint>[^\[\]]*[A-Za-z][^\[\]]*)\](?P<rest>.*)$")
_BY_NAME = re.compile(r"^(?P<joint>.+)[./](?P<word>position|velocity|acceleration|effort|torque|current)$", re.IGNORECASE)
_INDEXED = re.compile(r"\[\d+\]$")
_WORDS = {
    "q": {"q", "pos", "position", "positions", "angle", "angles", "winkel", "mp", "ip", "qpos", "aipos", "aspos"},
    "dq": {"qd", "dq", "v", "vel", "velocity", "velocities", "speed", "drehzahl", "qvel", "dp"},
    "ddq": {"qdd", "ddq", "acc", "acceleration"},
    "tau": {"tau", "torque", "torques", "effort", "eff", "moment", "drehmoment", "mt", "force"},
    "i": {"current", "currents", "strom"},
}
_WANTED = DESIRED | {"d", "ip", "aspos", "planned", "pl", "plan", "action"}
_ESTIMATED = {
    "ext",
    "mocap",
    "et",
    "external",
    "hat",
    "model",
    "gravity",
    "filtered",
    "rel",
    "relative",
    "error",
    "err",
    "deviation",
    "feedforward",
    "ff",
    "next",
}
_MEASURED = MEASURED | {"present", "fb", "mp", "mt", "act", "mes"}
_NOT_JOINTS = {
    "euler", "quat", "tcp", "tool", "imu", "foot", "temp", "temperature", "temperatur", "ee", "cart", "base", "voltage", "mode", "id",
    "limit", "status",
}  # fmt: skip
HANDS = {"hand", "gripper", "finger", "thumb", "knuckle", "grasp"}
_DIMENSIONS = {"angle": "q", "rate": "dq", "acceleration": "ddq", "torque": "tau", "current": "i"}
_QUANTITIES = frozenset.union(*map(frozenset, _WORDS.values()))
#: Words beside which what is left of a name is a joint's.
_SAID = frozenset.union(*map(frozenset, (*_WORDS.values(), _WANTED, _ESTIMATED, _MEASURED)))
#: Names of a frame's axes, which are no joints' where no robot says so.
_AXES = {"x", "y", "z", "rx", "ry", "rz", "roll", "pitch", "yaw"} | _NOT_JOINTS - {"base"}
#: What rows of units and labels write, beside the suffixes of our own.
_WRITTEN = {"°": "deg", "grad": "deg", "°/s": "deg_s", "deg/s": "deg_s", "rad/s": "rad_s", "u/min": "rpm", "1/min": "rpm", "µs": "us"}


@dataclass(frozen=True)
class ChannelGroup:
    """Columns of one quantity over the joints, in their order. `joints`: their names, "" where only numbers tell them; `unit`: as told."""

    stem: str
    columns: tuple[str, ...]
    joints: tuple[str, ...]
    quantity: str
    words: frozenset[str]
    unit: str = ""

    @property
    def wanted(self) -> bool:
        """Whether it is what was asked for."""
        return bool(self.words & _WANTED)

    @property
    def estimated(self) -> bool:
        """Whether it is estimated, modelled or a difference."""
        return bool(self.words & _ESTIMATED)

    @property
    def measured(self) -> bool:
        """Whether its name says that it is measured."""
        return bool(self.words & _MEASURED)

    @property
    def named(self) -> bool:
        """Whether the joints' names are told."""
        return any(self.joints)

    def only(self, keep: Sequence[int]) -> ChannelGroup:
        """Some of its columns."""
        return ChannelGroup(
            self.stem, tuple(self.columns[k] for k in keep), tuple(self.joints[k] for k in keep), self.quantity, self.words, self.unit
        )

    def arms(self) -> ChannelGroup:
        """Without the channels of hands, where the others are more."""
        keep = [k for k, name in enumerate(self.joints) if not words_of(name) & HANDS]
        return self.only(keep) if 0 < len(keep) < len(self.columns) else self

    def __str__(self) -> str:
        return repr(self.columns[0]) if len(self.columns) == 1 else f"{self.columns[0]!r} … {self.columns[-1]!r}"


def joint_of(name: str) -> str:
    """A joint's name from the path by which a channel names it: the last part that is no word for a quantity (`arm/elbow.pos`: elbow)."""
    parts = [part for part in re.split(r"[/.]", name) if part]
    return next((part for part in reversed(parts) if part.lower() not in _QUANTITIES), parts[-1] if parts else name)


def words_of(name: str) -> frozenset[str]:
    """The words of a name, small: `FB_POS_RJ1`, `torquesFromCurrent`, `Sollwinkel`."""
    split = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower().replace("torques", "torque")
    split = re.sub(r"\b(soll|ist)(?=[a-z]{3})", r"\1_", split)
    return frozenset(x for x in re.split(r"[^a-z%°]+", split) if x)


def unit_suffix(text: str) -> str:
    """A unit as a row of units or a label writes it, as our own suffix; "" where it is none."""
    word = text.strip().strip("[]()").lower()
    word = _WRITTEN.get(word, word)
    return unit_of(word).name if is_unit(word) else ""


def groups(
    names: Sequence[str], joints: Sequence[str] | None, units: Mapping[str, str], told: Mapping[str, str] | None = None
) -> list[ChannelGroup]:
    """Groups of columns. `joints`: the robot's, whose order counts where columns name joints; `units`: told of columns; `told`: quantity
    (`q`, `dq`, `tau`, `i`, `q_ref`) → a column's name with {} for the joint's number."""
    stems: dict[str, list[tuple[int, str, str]]] = {}
    for name in names:
        by_name, element = _BY_NAME.match(name), _element(name)
        if by_name and not _INDEXED.search(by_name["joint"]):
            joint, topic = re.split(r"[./]", by_name["joint"])[-1], by_name["joint"].rpartition("/")[0]
            _put(stems, f"{topic}|{by_name['word']}", name, joint, joints)
        elif element:
            _put(stems, f"{element['stem']}[]{element['rest']}", name, element["joint"], joints)
        else:
            for found in _NUMBER.finditer(name):
                stem = name[: found.start()] + "#" + name[found.end() :]
                stems.setdefault(stem, []).append((int(found.group()), name, ""))
    stems |= _around_names([name for name in names if not (_BY_NAME.match(name) or _element(name))], joints, stems)
    known = {template.replace("{}", "#"): quantity for quantity, template in (told or {}).items()}
    out = [made for stem, members in stems.items() if (made := _group(stem, members, units, known.get(stem, "")))]
    if not any(g.quantity == "q" for g in out):
        out += [made for name in names if (made := _group(name, [(0, name, "")], units, ""))]
    return out


def _element(name: str) -> re.Match[str] | None:
    """An array's element that is told by a joint's name; what stands in the brackets may also be a unit."""
    found = _ELEMENT.match(name)
    return found if found and not unit_suffix(found["joint"]) else None


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
        plain = plain if unit_suffix(unit) else name
        parts = [part for part in re.split(r"[^A-Za-z0-9%]+", plain) if part]
        said = [part for part in parts if part.lower() in _SAID]
        joint = "_".join(part for part in parts if part not in said)
        named = any(part.lower() in _QUANTITIES for part in said) and re.search("[A-Za-z]", joint)
        if not named or (known and bare_name(joint) not in known) or (not known and words_of(joint) & _AXES):
            continue
        stem = " ".join(said).lower() + (f" [{unit_suffix(unit)}]" if unit_suffix(unit) else "")
        _put(stems, stem, name, known.get(bare_name(joint), joint), joints)
    of_stem = {stem: {joint for *_, joint in members} for stem, members in stems.items()}
    placed = [
        own for stem, own in of_stem.items() if words_of(stem) & _WORDS["q"] and len(own) > 1 and any(not re.search(r"\d", x) for x in own)
    ]
    # Without a robot, joints are those that have positions.
    told = {stem: members for stem, members in stems.items() if known or any(of_stem[stem] <= own for own in placed)}
    mine = {name for members in told.values() for _, name, _ in members}
    for stem, members in numbered.items():
        if mine & {name for _, name, _ in members}:
            told[stem] = []
    return told


def bare_name(joint: str) -> str:
    """A joint's name without its path, the word for joint, and what separates its words."""
    return "".join(part for part in re.split(r"[^a-z0-9]+", joint_of(joint).lower()) if part != "joint")


def _put(stems: dict[str, list[tuple[int, str, str]]], stem: str, name: str, joint: str, joints: Sequence[str] | None) -> None:
    members = stems.setdefault(stem, [])
    place = list(joints).index(joint) if joints and joint in joints else len(members)
    members.append((place, name, joint))


def _group(stem: str, members: list[tuple[int, str, str]], units: Mapping[str, str], told: str) -> ChannelGroup | None:
    words = frozenset({"reference"} if told.endswith("_ref") else {"measured"}) if told else words_of(stem)
    numbers = sorted({m[0] for m in members})
    if not members or len(numbers) != len(members) or numbers != list(range(numbers[0], numbers[0] + len(numbers))) or numbers[0] > 1:
        return None
    if words & _NOT_JOINTS:
        return None
    members = sorted(members)
    columns = tuple(m[1] for m in members)
    unit = unit_suffix(units.get(columns[0], "")) or _unit_in(stem)
    quantity = told.removesuffix("_ref") or next((k for k in ("ddq", "dq", "tau", "i", "q") if words & _WORDS[k]), "")
    if words in ({"observation", "state"}, {"action"}):  # LeRobot: positions, and what was asked for
        quantity = "q"
    if not quantity and unit:
        quantity = _DIMENSIONS.get(unit_of(unit).dimension, "")
    if not quantity:
        return None
    return ChannelGroup(stem, columns, tuple(m[2] for m in members), quantity, words, unit)


def _unit_in(stem: str) -> str:
    """The unit that a name tells: `act_pos_mot#_deg`, `vel#_deg_per_s`, `speed # [rpm]`; single letters count only in brackets."""
    bare = stem.replace("[#]", "").replace("[]", "").replace("#", "")
    if found := unit_suffix(bracketed(bare)[1]):
        return found
    unit = split_unit(re.sub(r"_+", "_", bare.replace("_per_", "_")).strip("_"))[1] or ""
    return unit if len(unit) > 1 else ""


def known_scale(unit: str) -> float:
    """SI value of one unit, by its suffix."""
    return UNITS[unit].scale if unit in UNITS else unit_of(unit).scale


def scalar_time_names(names: Sequence[str]) -> list[str]:
    """Columns whose name is one of time, the likeliest first: the sender's stamp before the recorder's, plain names before others."""
    exact = ("t", "time", "timestamp", "timestamps", "tstamps", "zeit", "stamp", "secs", "sec", "seconds", "ms", "%time", "ipoc", "clock")
    lower = {n.lower(): n for n in names}
    found = [lower[k] for k in lower if re.search(r"header[./]stamp$", k)] + [lower[k] for k in exact if k in lower]
    others = [n for n in names if words_of(n) & {"time", "timestamp", "zeit", "tout", "clock"}]
    return list(dict.fromkeys(found + others))
