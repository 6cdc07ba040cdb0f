"""Writes docs/results.schema.json, the JSON schema of every result: `python docs/tools/make_schemas.py`.

It is made of results: one of each kind and more where they differ, as the commands below print them. What every one of a kind has is
required; a value may be null, where there is none or it is not finite; keys that are names of joints, links or logs are open. The tests
check every result that the tests of the command line see against it (tests/command_line.py), so that another form is found there."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shlex
import shutil
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(DOCS.parent))

TARGET = DOCS / "results.schema.json"
TRUTH = "--with rotor_inertia:Ia=0.05 --with viscous:Fv=1.2 --with coulomb:Fc=2.5"
COMMANDS = (
    f"simulate --urdf arm.urdf --seconds 10 --seed 1 --log a.csv {TRUTH}",
    f"simulate --urdf arm.urdf --seconds 10 --seed 2 --log b.csv {TRUTH} --with linear_spring:elbow:ks=3,ks0=1",
    "check --log a.csv",
    "check --urdf arm.urdf --log a.csv",
    "check servo.toml",
    "base --robot puma560",
    "base --urdf arm.urdf",
    "fit --urdf arm.urdf --log a.csv --validate b.csv --out f",
    "fit --urdf arm.urdf --log a.csv --method iv",
    "fit --urdf arm.urdf --log a.csv --method irls --essential",
    "fit servo.toml --out s",
    "validate --fit s --log servo.csv",
    "validate --fit f --validate b.csv",
    "diagnose --urdf arm.urdf --log b.csv --out g",
    "diagnose --urdf arm.urdf --log a.csv",
    f"simulate --urdf arm.urdf --seconds 40 --seed 1 --log long.csv {TRUTH}",
    "diagnose --urdf arm.urdf --log unexplained.csv",
    "compare g/before.fit.json g/after.fit.json --log a.csv",
    "judge f/fit.json --repair consistent",
    "judge --robot puma560 --table 1",
    "payload --robot puma560 --log loaded.csv.gz --without unloaded.csv.gz",
    "excite --urdf arm.urdf --starts 1 --seconds 5 --trajectory m.csv",
    "plan --robot scara --out p",
    "simulate --robot scara --plan p/plan.toml --out t",
    "fit --robot scara --plan t/plan.toml --method sequential",
    "monitor --fit f --log b.csv",
    "monitor --fit f --log a.csv",
    "export f/fit.json x.urdf",
    "demo",
)
#: More keys than this, or keys that differ from result to result, are names: joints, links, parameters, logs.
_MOST_KEYS = 40
#: Entries of lists and tables are described down to here.
_DEPTH = 2


def results(folder: Path) -> list[dict[str, Any]]:
    """What each command prints, run in `folder`."""
    from ident.cli import main
    from ident.robots import robot_folder

    for file in (*(DOCS / "data").iterdir(), *(robot_folder("puma560") / f"demo/{n}.csv.gz" for n in ("loaded", "unloaded"))):
        shutil.copy(file, folder)
    before, out = Path.cwd(), []
    os.chdir(folder)
    try:
        for command in COMMANDS:
            if "unexplained.csv" in command:
                crosstalk("long.csv", "unexplained.csv")
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()) as said:
                code = main([*shlex.split(command), "--json"])
            if code:
                raise RuntimeError(f"ident {command}: {said.getvalue()}")
            out.append(json.loads(printed.getvalue()))
    finally:
        os.chdir(before)
    return out


def crosstalk(log: str, target: str) -> None:
    """A log in which one joint feels another's speed, which no effect of the catalogue does: its diagnosis has something left."""
    import numpy as np
    import pandas as pd

    table = pd.read_csv(log)
    speed = np.gradient(table["q2"], table["t"])
    table["tau3"] += 2.0 * np.abs(speed) * np.sign(np.gradient(table["q1"], table["t"]))
    table.to_csv(target, index=False)


def schema_of(values: list[Any], depth: int = 0) -> dict[str, Any]:
    """A schema that all of these values satisfy."""
    kinds = {kind(v) for v in values} - {"null"}
    if len(kinds) != 1:
        return {}
    (one,) = kinds
    if one == "object":
        return of_objects([v for v in values if v is not None], depth)
    if one == "array":
        items = [x for v in values if v is not None for x in v]
        return {"type": ["array", "null"], "items": schema_of(items, depth + 1) if items else {}}
    return {"type": [one, "null"]}


def kind(value: Any) -> str:
    """The JSON type of a value; every number is a number."""
    names = {dict: "object", list: "array", str: "string", bool: "boolean", int: "number", float: "number", type(None): "null"}
    return names[type(value)]


def of_objects(values: list[dict[str, Any]], depth: int) -> dict[str, Any]:
    """A schema of objects: a result's keys, and those of its entries, unless they are names."""
    keys = [set(v) for v in values]
    common, union = set.intersection(*keys), set.union(*keys)
    kinds: dict[str, Any] = {"type": ["object", "null"] if depth else "object"}
    if not union or len(union) > _MOST_KEYS or not common:
        return kinds
    parts: dict[str, list[Any]] = defaultdict(list)
    for value in values:
        for key, own in value.items():
            parts[key].append(own)
    if depth > _DEPTH:
        return kinds
    named = {key: schema_of(own, depth + 1) for key, own in sorted(parts.items())}
    return kinds | {"properties": named, **({} if depth else {"required": sorted(common)})}


def schemas() -> dict[str, Any]:
    """The schema of all results: one definition for each kind, chosen by its name."""
    with tempfile.TemporaryDirectory() as scratch:
        found = results(Path(scratch))
    kinds: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for one in found:
        kinds[one["schema"]].append(one)
    definitions = {name: schema_of(values) for name, values in sorted(kinds.items())}
    for name, own in definitions.items():
        own["properties"]["schema"] = {"const": name}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Results of ident: what --json prints",
        "type": "object",
        "required": ["schema", "ident_version", "created", "inputs", "warnings"],
        "allOf": [
            {"if": {"properties": {"schema": {"const": name}}}, "then": {"$ref": f"#/$defs/{name.replace('/', '-')}"}}
            for name in definitions
        ],
        "$defs": {name.replace("/", "-"): own for name, own in definitions.items()},
    }


if __name__ == "__main__":
    TARGET.write_text(json.dumps(schemas(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(TARGET)
