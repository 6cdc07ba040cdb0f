"""`python -m tests.fuzz.kills`: writing commands ended by SIGKILL at random times. What they leave is whole: the old, or the new."""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import os
import random
import shutil
import signal
import sys
import time
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from ident import cli

from . import seeds

#: Rows of the log that is streamed: enough for work that lasts, and for a checkpoint.
_STREAMED = 40_000


@dataclass(frozen=True)
class Writing:
    """A command that writes into a folder, by `--out` or where {out} stands. `resumes`: it leaves a checkpoint, and is taken up again."""

    name: str
    arguments: tuple[str, ...]
    resumes: bool = False

    def into(self, out: Path, *more: str) -> list[str]:
        """Its arguments for a folder."""
        told = [a.format(out=out) for a in self.arguments]
        return [*told, *(() if told != [*self.arguments] else ("--out", str(out))), *more]


def writings(base: Path) -> list[Writing]:
    """The writing commands, on small inputs in `base`."""
    (base / "arm.urdf").write_text(seeds.URDF)
    (base / "log.csv").write_bytes(seeds.table(rows=400))
    for k in range(2):
        (base / f"long{k}.csv").write_bytes(seeds.table(rows=_STREAMED))
    possible = base / "possible.json"
    possible.write_text(json.dumps(seeds.possible_fit()))
    arm, log, long = ("--urdf", str(base / "arm.urdf")), ("--log", str(base / "log.csv")), [str(base / f"long{k}.csv") for k in range(2)]
    fit = str(base / "given/fit.json")
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        # In this process, so that those that are made of it find everything loaded.
        code = cli.main(["fit", *arm, *log, "--out", str(base / "given")])
    if code not in (0, 1):
        raise SystemExit("the fit that other commands start from does not run")
    return [
        Writing("fit", ("fit", *arm, *log)),
        Writing("simulate", ("simulate", *arm, "--seconds", "2")),
        Writing("validate", ("validate", "--fit", fit, *log)),
        Writing("check", ("check", *arm, *log)),
        Writing("base", ("base", *arm)),
        Writing("excite", ("excite", *arm, "--starts", "1", "--seconds", "5")),
        Writing("plan", ("plan", *arm)),
        Writing("judge", ("judge", str(possible), "--repair", "possible")),
        Writing("compare", ("compare", fit, fit, *log)),
        Writing("payload", ("payload", "--fit", fit, *log)),
        Writing("monitor", ("monitor", "--fit", fit, *log)),
        Writing("diagnose", ("diagnose", *arm, *log)),
        Writing("demo", ("demo",)),
        Writing("export", ("export", str(possible), "{out}/made.urdf")),
        Writing("report", ("report", fit, "-o", "{out}/made.html")),
        Writing("study-schema", ("study-schema", "-o", "{out}/schema.json")),
        Writing("stream", ("fit", *arm, "--log", long[0], "--stream"), resumes=True),
        Writing("stream, two files", ("fit", *arm, "--log", *long, "--stream", "--jobs", "2"), resumes=True),
    ]


def run(arguments: list[str], after: float | None = None) -> int:
    """Run a command in a process of its own, which has everything loaded already; SIGKILL it after some seconds."""
    child = os.fork()
    if child == 0:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        code = 70
        try:
            code = cli.main(arguments)
        except SystemExit as error:
            code = int(error.code or 0)
        finally:
            os._exit(code)
    deadline = None if after is None else time.monotonic() + after
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if deadline is not None and time.monotonic() >= deadline:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.001)
    return -os.WTERMSIG(ended[1]) if os.WIFSIGNALED(ended[1]) else os.WEXITSTATUS(ended[1])


def state(out: Path) -> dict[str, str]:
    """Every file of a folder but those of unfinished work (which the next run removes), by its digest."""
    if not out.exists():
        return {}
    files = ((p, p.relative_to(out)) for p in sorted(out.rglob("*")) if p.is_file())
    done = [(p, at) for p, at in files if at.parts[0] != "checkpoint" and not any(".ident-" in part for part in at.parts)]
    return {str(at): hashlib.sha256(p.read_bytes()).hexdigest() for p, at in done}


def whole(path: Path) -> bool:
    """Whether a file of results can be read to its end."""
    try:
        if path.suffix == ".json":
            json.loads(path.read_text())
    except ValueError:
        return False
    return path.stat().st_size > 0


def values(path: Path) -> object:
    """The parameters of a saved fit."""
    return [(p["name"], p["value"], p["std"]) for p in json.loads(path.read_text())["parameters"]]


def kill_once(writing: Writing, folder: Path, after: float, reference: Path, *, over: bool) -> tuple[str, str]:
    """One kill; in which state it left the folder, and what was wrong with it, "" if nothing.

    `over`: into a folder that holds a note and old results, with --force."""
    out, files = folder / "out", set(state(reference))
    if over or writing.into(out)[-1] != str(out):
        out.mkdir()
    if over:
        for name in ("note.txt", *files):
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            (out / name).write_text("old")
    before = state(out)
    code = run(writing.into(out, *(["--force"] if over else [])), after)
    left = "ended before" if code >= 0 else "checkpoint" if (out / "checkpoint" / "key.json").exists() else "old"
    now = state(out)
    changed = {k for k in files if now.get(k) != before.get(k)}
    left = left if code >= 0 or not changed else "new"
    if changed and changed != files:
        return left, f"mixed: of {sorted(files)} only {sorted(changed)} are new"
    if over and now.get("note.txt") != before["note.txt"]:
        return left, "the user's own file is gone"
    if changed and not all(whole(out / name) for name in files):
        return left, "a file is cut off"
    if not changed and set(now) != set(before):
        return left, f"files that are none of its results: {sorted(set(now) - set(before))}"
    how = ["--resume"] if writing.resumes and left == "checkpoint" else []
    again = run(writing.into(out, *how, *(["--force"] if over or changed else [])))
    if again not in (0, 1) or not files <= set(state(out)):
        return left, f"the same command afterwards ({' '.join(how) or 'anew'}) ends with {again}"
    if "fit.json" in files and values(out / "fit.json") != values(reference / "fit.json"):
        return left, f"values are others afterwards ({' '.join(how) or 'anew'})"
    lying = [str(p.relative_to(folder)) for p in folder.rglob("*") if ".ident-" in p.name]
    return left, f"left behind: {lying}" if lying else ""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="kills over all commands (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="these commands alone")
    given = parser.parse_args()
    outcomes: dict[str, Counter[str]] = {}
    rng, wrong = random.Random(given.seed), 0
    with TemporaryDirectory() as name:
        base = Path(name)
        commands = [w for w in writings(base) if given.only is None or w.name in given.only]
        usual = {}
        for w in commands:
            whole_run = base / f"whole-{w.name}"
            whole_run.mkdir()
            start = time.monotonic()
            code = run(w.into(whole_run))
            usual[w.name] = time.monotonic() - start
            if code not in (0, 1) or not state(whole_run):
                raise SystemExit(f"{w.name} does not run at all: {code}, {sorted(state(whole_run))}")
        killed = i = 0
        while killed < given.count and i < 5 * given.count:
            writing, over = commands[i % len(commands)], bool(rng.getrandbits(1))
            folder = base / f"kill-{i}"
            folder.mkdir()
            # Half of them near the end, where the writing is.
            share = rng.uniform(0.0, 1.1) if rng.random() < 0.5 else rng.uniform(0.85, 1.1)
            left, found = kill_once(writing, folder, share * usual[writing.name], base / f"whole-{writing.name}", over=over)
            outcomes.setdefault(writing.name, Counter())[left] += 1
            killed += left != "ended before"
            if found:
                wrong += 1
                print(f"kill {i}: {writing.name}{' --force' if over else ''}, at {share:.2f} of its time: {found}", flush=True)
            shutil.rmtree(folder)
            i += 1
    for command, left_as in outcomes.items():
        print(f"{command:<18} {sum(left_as.values()):>4}  {', '.join(f'{k} {v}' for k, v in sorted(left_as.items()))}")
    total = sum((c for c in outcomes.values()), Counter[str]())
    told = ", ".join(f"{k} {v}" for k, v in sorted(total.items()))
    print(f"{killed} kills of {sum(total.values())} runs ({told}): {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
