"""`python -m tests.fuzz.kills`: writing commands ended by SIGKILL at random times. What they leave is whole: the old, or the new."""

from __future__ import annotations

import argparse
import gzip
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from . import seeds

#: Rows of the log that is streamed: enough for work that lasts, and for a checkpoint.
_STREAMED = 40_000


@dataclass(frozen=True)
class Writing:
    """A command that writes into a folder; `files`: all that it writes there. `resumes`: it leaves a checkpoint, and is taken up again."""

    name: str
    arguments: tuple[str, ...]
    files: frozenset[str]
    resumes: bool = False


def writings(base: Path) -> list[Writing]:
    """The writing commands, on small inputs in `base`."""
    (base / "arm.urdf").write_text(seeds.URDF)
    (base / "log.csv").write_bytes(seeds.table(rows=400))
    (base / "long.csv").write_bytes(seeds.table(rows=_STREAMED))
    arm, log = ("--urdf", str(base / "arm.urdf")), ("--log", str(base / "log.csv"))
    fit = base / "given" / "fit.json"
    if run(["fit", *arm, *log, "--out", str(fit.parent)]) not in (0, 1):
        raise SystemExit("the fit that other commands start from does not run")
    diagnosis = {"diagnosis.json", "diagnosis.txt", "before.fit.json", "after.fit.json", "extended.toml", "report.json"}
    return [
        Writing("fit", ("fit", *arm, *log), frozenset({"fit.json", "fit.txt"})),
        Writing("simulate", ("simulate", *arm, "--seconds", "2"), frozenset({"simulated.csv", "simulation.json"})),
        Writing("validate", ("validate", "--fit", str(fit), *log), frozenset({"validation.json"})),
        Writing("check", ("check", *arm, *log), frozenset({"check.json"})),
        Writing("excite", ("excite", *arm, "--starts", "1", "--seconds", "5"), frozenset({"excitation.csv", "excitation.json"})),
        Writing("plan", ("plan", *arm), frozenset({"plan.toml", "plan.txt", "plan.json"})),
        Writing("judge", ("judge", str(fit)), frozenset({"judgement.json"})),
        Writing("diagnose", ("diagnose", *arm, *log), frozenset(diagnosis)),
        Writing("stream", ("fit", *arm, "--log", str(base / "long.csv"), "--stream"), frozenset({"fit.json", "fit.txt"}), resumes=True),
    ]


def run(arguments: list[str], after: float | None = None) -> int:
    """Run a command; SIGKILL it after some seconds."""
    process = subprocess.Popen([sys.executable, "-m", "ident.cli", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if after is not None:
        deadline = time.monotonic() + after
        while process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
    return process.wait()


def state(out: Path) -> dict[str, str]:
    """Every file of a folder but those of unfinished work, by its digest."""
    if not out.exists():
        return {}
    files = [p for p in sorted(out.rglob("*")) if p.is_file() and p.relative_to(out).parts[0] != "checkpoint"]
    return {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def whole(path: Path) -> bool:
    """Whether a file of results can be read to its end."""
    try:
        if path.suffix == ".json":
            json.loads(path.read_text())
        if path.suffix == ".gz":
            gzip.decompress(path.read_bytes())
    except (ValueError, EOFError, OSError):
        return False
    return path.stat().st_size > 0


def values(path: Path) -> object:
    """The parameters of a saved fit."""
    return [(p["name"], p["value"], p["std"]) for p in json.loads(path.read_text())["parameters"]]


def kill_once(writing: Writing, folder: Path, after: float, reference: Path, *, over: bool) -> str:
    """One kill; what was wrong afterwards, "" if nothing. `over`: into a folder that holds a note and old results, with --force."""
    out = folder / "out"
    if over:
        out.mkdir()
        for name in ("note.txt", *writing.files):
            (out / name).write_text("old")
    before = state(out)
    run([*writing.arguments, "--out", str(out), *(["--force"] if over else [])], after)
    now = state(out)
    changed = {k for k in writing.files if now.get(k) != before.get(k)}
    if changed and changed != set(writing.files):
        return f"mixed: of {sorted(writing.files)} only {sorted(changed)} are new"
    if over and now.get("note.txt") != before["note.txt"]:
        return "the user's own file is gone"
    if changed and not all(whole(out / name) for name in writing.files):
        return "a file is cut off"
    if not changed and set(now) != set(before):
        return f"files that are none of its results: {sorted(set(now) - set(before))}"
    how = ["--resume"] if writing.resumes and (out / "checkpoint" / "key.json").exists() and not changed else []
    again = run([*writing.arguments, "--out", str(out), *how, *(["--force"] if over or changed else [])])
    if again not in (0, 1) or not set(writing.files) <= set(state(out)):
        return f"the same command afterwards ({' '.join(how) or 'anew'}) ends with {again}"
    if writing.resumes and values(out / "fit.json") != values(reference / "fit.json"):
        return "what was taken up again has other values"
    left = [p.name for p in folder.iterdir() if ".ident-" in p.name]
    return f"left behind: {left}" if left else ""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="kills over all commands (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", help="these commands alone")
    given = parser.parse_args()
    rng, outcomes, wrong = random.Random(given.seed), Counter[str](), 0
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with TemporaryDirectory() as name:
        base = Path(name)
        commands = [w for w in writings(base) if given.only is None or w.name in given.only]
        usual = {}
        for w in commands:
            start = time.monotonic()
            code = run([*w.arguments, "--out", str(base / f"whole-{w.name}")])
            usual[w.name] = time.monotonic() - start
            if code not in (0, 1) or not w.files <= set(state(base / f"whole-{w.name}")):
                raise SystemExit(f"{w.name} does not run at all, or writes other files: {code}, {sorted(state(base / f'whole-{w.name}'))}")
        for i in range(given.count):
            writing, over = commands[i % len(commands)], bool(rng.getrandbits(1))
            folder = base / f"kill-{i}"
            folder.mkdir()
            # Half of them near the end, where the writing is.
            share = rng.uniform(0.0, 1.1) if rng.random() < 0.5 else rng.uniform(0.85, 1.1)
            found = kill_once(writing, folder, share * usual[writing.name], base / f"whole-{writing.name}", over=over)
            outcomes[writing.name] += 1
            if found:
                wrong += 1
                print(f"kill {i}: {writing.name}{' --force' if over else ''}, at {share:.2f} of its time: {found}", flush=True)
            shutil.rmtree(folder)
    print(f"{sum(outcomes.values())} kills ({', '.join(f'{k} {v}' for k, v in outcomes.items())}): {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
