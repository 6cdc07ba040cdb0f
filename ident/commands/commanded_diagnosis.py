"""`ident diagnose` on logs of commands without torque: apart from the other commands on them, which need no diagnosis."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ..diagnosis.drives import diagnose_drives
from .commanded import read_commanded, split_commanded
from .common import Output, say_split

if TYPE_CHECKING:
    from ..study.study import Study


def diagnose_under_law(study: Study, args: argparse.Namespace, out: Output) -> int:
    """What the declared model and law lack, by simulation. Returns the exit code."""
    robot, law, recorded = read_commanded(study)
    logs, held = split_commanded(study, robot, recorded)
    found = diagnose_drives(logs, study.model(robot), law, held=held, progress=out.progress("fitting"))
    out.say(found.summary())
    if not study.validation_files():
        say_split(out)
    out.result(found.to_dict(), "diagnosis")
    with out.together() as folder:
        if folder is not None:
            out.keep("diagnosis.txt", found.summary() + "\n")
            found.before.save(folder / "before.fit.json")
            found.after.save(folder / "after.fit.json")
    if out.folder is not None:
        out.note(f"saved {out.folder}: diagnosis.json, diagnosis.txt, before.fit.json, after.fit.json")
    return 1 if args.strict and found.verdict != "clean" else 0
