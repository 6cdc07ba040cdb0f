"""One input tried: done, refused in words, or a fault of ours (a traceback, a hang, a difference, a number that is none)."""

from __future__ import annotations

import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from ident.errors import IdentError

#: Seconds of computing after which an input hangs, how many times that it may wait in all, and characters of a message for people.
HANG_S, WAITS = 10, 30
_MESSAGE = 2000


class Hang(BaseException):
    """An input took too long. No Exception, so that nothing on the way takes it for one of its own."""


class Difference(AssertionError):
    """Two readings of one file differ, or a result breaks what it promises."""


@dataclass(frozen=True)
class Outcome:
    """`kind`: "done", "refused", "traceback", "crash", "hang", "difference"; `where`: our line that raised; `text`: what was said."""

    kind: str
    where: str = ""
    text: str = ""

    @property
    def is_fault(self) -> bool:
        return self.kind not in ("done", "refused")


def tried(action: Callable[[Path], Any], path: Path, seconds: float = HANG_S) -> Outcome:
    """What comes of `action(path)`."""

    def late(number: int, frame: FrameType | None) -> None:
        raise Hang

    # On a machine that others use too, only the process's own time tells of a hang; one that waits for ever ends by the other clock.
    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, WAITS * seconds))
    before = [signal.signal(number, late) for number, _, _ in clocks]
    for _, clock, limit in clocks:
        signal.setitimer(clock, limit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            action(path)
        return Outcome("done")
    except IdentError as error:
        text = str(error)
        if not text or len(text) > _MESSAGE or "\x00" in text:
            return Outcome("difference", "message", f"a message that is none for people: {text[:200]!r} ({len(text)} characters)")
        return Outcome("refused", type(error).__name__, text)
    except Hang as error:
        return Outcome("hang", _where(error), f"more than {seconds:g} s of computing")
    except Difference as error:
        return Outcome("difference", _where(error), str(error))
    except Exception as error:  # noqa: BLE001 - this is what is looked for
        return Outcome("traceback", _where(error), f"{type(error).__name__}: {str(error)[:300]}")
    finally:
        for (number, clock, _), handler in zip(clocks, before, strict=True):
            signal.setitimer(clock, 0)
            signal.signal(number, handler)


def _where(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/ident/" in f.filename] or list(frames)
    last = ours[-1]
    return f"{last.filename.rsplit('/ident/', 1)[-1]}:{last.lineno}"


@dataclass
class Count:
    """Outcomes of many inputs of one class; of each kind of fault the first example is kept."""

    name: str
    kinds: Counter[str] = field(default_factory=Counter)
    faults: dict[tuple[str, str, str], list[Any]] = field(default_factory=dict)
    files: Counter[str] = field(default_factory=Counter)

    def add(self, outcome: Outcome, data: bytes, seed: int, name: str = "") -> bool:
        """Count one that was made of the file `name`; True where its kind of fault is new."""
        self.kinds[outcome.kind] += 1
        self.files[name] += 1
        if not outcome.is_fault:
            return False
        key = (outcome.kind, outcome.where, outcome.text.split(":", maxsplit=1)[0])
        if key in self.faults:
            self.faults[key][0] += 1
            return False
        self.faults[key] = [1, outcome, data, seed]
        return True

    def join(self, other: Count) -> None:
        """Count what another counted."""
        self.kinds += other.kinds
        self.files += other.files
        for key, (seen, *rest) in other.faults.items():
            self.faults.setdefault(key, [0, *rest])[0] += seen

    @property
    def total(self) -> int:
        return sum(self.kinds.values())

    def line(self) -> str:
        kinds = "  ".join(f"{k} {self.kinds[k]}" for k in ("done", "refused", "traceback", "crash", "hang", "difference"))
        return f"{self.name:<12} inputs {self.total:<7} {kinds}"

    def sources(self) -> str:
        """How many were made of each file."""
        return "  of " + ", ".join(f"{name} {n}" for name, n in sorted(self.files.items()))
