"""The words by which names of columns say what these hold."""

from __future__ import annotations

import re
from functools import lru_cache

from .languages import english, in_english

#: Words by which names say that something was asked for, or measured: of files, of topics and of columns.
DESIRED = frozenset({"desired", "des", "target", "reference", "ref", "command", "commanded", "commands", "cmd", "setpoint", "soll", "goal"})
MEASURED = frozenset({"measured", "meas", "actual", "feedback", "state", "ist"})
#: Words for a quantity, by its symbol.
QUANTITY_WORDS = {
    "q": {"q", "pos", "position", "positions", "angle", "angles", "winkel", "mp", "ip", "qpos", "aipos", "aspos", "theta", "posicion",
          "posicao", "posizione", "angolo", "stellung", "travel", "stroke", "extension", "displacement"},
    "dq": {"qd", "dq", "v", "vel", "velocity", "velocities", "speed", "drehzahl", "qvel", "dp", "qdot", "omega", "geschwindigkeit",
           "vitesse", "velocidad", "velocidade", "velocita", "dtheta", "velo",
           "spd", "angvel", "dpos", "dangle", "thetadot", "rate", "rates"},
    "ddq": {"qdd", "ddq", "acc", "acceleration", "accelerations", "qddot", "beschleunigung"},
    "tau": {"tau", "torque", "torques", "effort", "efforts", "eff", "moment", "drehmoment", "mt", "force", "trq", "torq", "tq", "couple",
            "coppia"},
    "i": {"current", "currents", "iq", "strom", "courant", "corriente"},
}  # fmt: skip
WANTED = DESIRED | {"d", "ip", "aspos", "planned", "pl", "plan", "action"}
#: Words for what is no measurement of what the rest of the name says.
ESTIMATED = {
    "ext", "mocap", "et", "external", "hat", "model", "gravity", "filtered", "rel", "relative", "error", "err", "deviation", "feedforward",
    "ff", "disturb",
    "disturbance", "next", "prev", "previous", "predicted", "pred", "ideal", "max", "std", "stdev", "sigma", "lower", "upper",
}  # fmt: skip
#: Words for a value that is computed: taken only where there is no other.
COMPUTED = {"est", "estimated", "estimate", "computed", "calculated", "calc"}
TAKEN = MEASURED | {"present", "fb", "mp", "mt", "act", "mes"}
#: Words for the motor's side of the gears.
MOTOR = {"mot", "motor", "motors"}
TIME = {
    "t", "time", "timestamp", "timestamps", "tstamps", "tstamp", "zeit", "tout", "clock", "stamp", "ts", "tempo", "temps", "tiempo", "ms",
    "secs", "sec", "seconds", "datetime", "elapsed", "millis", "micros", "nanos", "epoch", "zeitstempel",
}  # fmt: skip
#: What rates are of that are no joints' velocities.
_RATES_OF = {
    "sample", "samples", "sampling", "frame", "frames", "update", "control", "data", "baud", "heart", "publish", "refresh", "drop", "slew",
    "packet", "packets", "loss", "bit", "scan", "log", "loop", "clock", "bus", "message", "messages", "learning", "success", "error",
}  # fmt: skip
NOT_JOINTS = {
    "euler", "quat", "tcp", "tool", "imu", "foot", "temp", "temperature", "temperatur", "ee", "cart", "base", "voltage", "supply", "mode",
    "id", "limit", "status",
}  # fmt: skip
HANDS = {"hand", "gripper", "finger", "thumb", "knuckle", "grasp"}
QUANTITIES = frozenset.union(*map(frozenset, QUANTITY_WORDS.values()))
#: Words beside which what is left of a name is a joint's.
SAID = frozenset.union(QUANTITIES, *map(frozenset, (WANTED, ESTIMATED, COMPUTED, TAKEN)))
#: What is written before a quantity without anything between: `jpos`, `motorcurrent`, `actpos`.
_BEFORE = SAID | {"joint", "motor", "axis", "j", "robot", "arm", "drive", "servo"}
_SHORT = {"j", "q"}


@lru_cache(maxsize=4096)
def words_of(name: str) -> frozenset[str]:
    """The words of a name, small: `FB_POS_RJ1`, `torquesFromCurrent`, `Sollwinkel`, `jtorque`, `qdes`."""
    split = in_english(re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower()).replace("torques", "torque")
    split = re.sub(r"\b(soll|ist)(?=[a-z]{3})", r"\1_", split)
    parts = [part for x in re.split(r"[^a-z%°]+", split) if x for part in _apart(x)]
    return frozenset(word for part in parts for word in (part, english(part)))


def _apart(word: str) -> tuple[str, ...]:
    """Two known words that are written as one."""
    if word in _BEFORE or word in TIME:
        return (word,)
    for k in range(1, len(word) - 1):
        one, two = word[:k], word[k:]
        if one in _BEFORE and two in SAID and (k > 1 or one in _SHORT):
            return one, two
    return (word,)


def quantity_of(words: frozenset[str]) -> str:
    """The symbol of the quantity that words tell, "" for none; a dot makes a rate of a position."""
    if words & {"rate", "rates"} and words & (_RATES_OF | QUANTITY_WORDS["tau"] | QUANTITY_WORDS["i"] | QUANTITY_WORDS["ddq"]):
        return ""
    if words & {"ddot", "dotdot"} and words & QUANTITY_WORDS["q"]:
        return "ddq"
    if "dot" in words and words & QUANTITY_WORDS["q"]:
        return "dq"
    return next((k for k in ("ddq", "dq", "tau", "i", "q") if words & QUANTITY_WORDS[k]), "")
