"""The pages of the reference, made from the classes: study files, effects, methods, results, command line and Python."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import ident  # noqa: E402
from ident.cli import build_parser  # noqa: E402
from ident.commands import COMMANDS  # noqa: E402
from ident.commands.examples import EXAMPLES  # noqa: E402
from ident.effects.registry import effect_types  # noqa: E402
from ident.estimators import estimator_types  # noqa: E402
from ident.signals.preparation import Preparation  # noqa: E402
from ident.study.schema import study_schema  # noqa: E402

#: Fields that every effect has; they are described once.
COMMON = ("joints", "side", "label")
#: What the Python reference lists beside the package's own names: the packages that a user's code imports from.
PACKAGES = (
    "friction",
    "effects",
    "estimators",
    "excitation",
    "planning",
    "physical",
    "simulation",
    "logs",
    "drives",
    "exporting",
    "regressor",
)


def reference_pages() -> dict[str, str]:
    """Name of a page → its text, in MyST Markdown."""
    return {
        "index": index_page(),
        "study-keys": study_page(),
        "effects": effects_page(),
        "methods": methods_page(),
        "signals": signals_page(),
        "command-line": commands_page(),
        "python": python_page(),
        **{f"python-{name}": package_page(name) for name in PACKAGES},
    }


def index_page() -> str:
    """The table of contents."""
    python = "\n".join(["python", *(f"python-{name}" for name in PACKAGES)])
    return f"""# Reference

Made from the classes, the parser and the docstrings of ident {ident.__version__}.

- [Command line](command-line.md): every command with every flag.
- [Keys of a study file](study-keys.md), [with an example](/study.md).
- [Effects](effects.md): what a model can be made of. Pictures: [gallery](/gallery.md).
- [Methods](methods.md) of estimation with their options. Which one: [which method](/which-method.md).
- [Signals](signals.md): filters with their options.
- [Python](python.md): all public names.

```{{toctree}}
:hidden:

command-line
study-keys
effects
methods
signals
{python}
```
"""


def cell(text: object) -> str:
    """Text for a cell of a table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def prose(cls: type) -> str:
    """What a class says of itself, without sections and examples, as Markdown."""
    text = inspect.cleandoc(cls.__doc__ or "")
    text = re.split(r"\n\n\w[\w ]*\n-{3,}", text)[0]
    return text.replace("*", "\\*").replace("<", "&lt;")


def kind_of(schema: Any) -> str:
    """What a key takes, in words."""
    if not schema:
        return "anything"
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        return (
            " or ".join(f"`{json.dumps(v)}`" for v in schema["enum"] if v != "fit")
            if len(schema["enum"]) <= 8
            else "one of the names below"
        )
    if "anyOf" in schema:
        each = [s for s in schema["anyOf"] if inner(s) is None or not all(x in schema["anyOf"] for x in inner(s))]
        parts = list(dict.fromkeys(kind_of(s) for s in each))
        if several := [s["type"].replace("array", "list").replace("object", "table") for s in schema["anyOf"] if s not in each]:
            parts.append(f"{' or '.join(several)} of these")
        return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} or {parts[-1]}"
    match schema.get("type"):
        case "array":
            return f"list of {several_of(kind_of(schema.get('items', {})))}"
        case "object":
            return "table"
        case "boolean":
            return "true or false"
        case "string":
            return "text"
        case "integer":
            return "whole number"
        case other:
            return str(other or "anything")


def inner(schema: Any) -> list[Any] | None:
    """The alternatives of what a list or a table holds, None of anything else."""
    held = schema.get("items", schema.get("additionalProperties"))
    return held.get("anyOf") if isinstance(held, dict) else None


def several_of(kind: str) -> str:
    """A kind of value in the plural."""
    for one, many in (("number", "numbers"), ("text", "texts"), ("list", "lists"), ("table", "tables")):
        if kind == one or kind == f"whole {one}" or kind.startswith(f"{one} of "):
            return kind.replace(one, many, 1)
    return kind


def study_page() -> str:
    """Every table and key, from the schema that checks them."""
    introduction = """# Keys of a study file

Made from the [schema](/study.schema.json) that checks study files. What each means, with an example: [study files](/study.md).
"""
    parts = [introduction]
    for table, schema in study_schema()["properties"].items():
        parts.append(f"## `[{table}]`\n\n{cell(schema.get('description', ''))}\n")
        if table == "estimator":
            parts.append("`method`, and the options of that method: [methods](methods.md).\n")
        elif table == "signals":
            parts.append("`method`, and the options of that strategy: [signals](signals.md).\n")
        elif "properties" in schema:
            rows = [f"| `{key}` | {key_kind(table, key, value)} |" for key, value in schema["properties"].items()]
            parts.append("\n".join(["| key | takes |", "|---|---|", *rows]) + "\n")
        else:
            parts.append(f"Keys are names of your own; each takes a {kind_of(schema.get('additionalProperties', {}))}.\n")
    return "\n".join(parts)


def key_kind(table: str, key: str, schema: Any) -> str:
    """What a key takes; the effects have a page of their own."""
    return (
        "names of [effects](effects.md), or tables with `name` and their options"
        if (table, key) == ("drive", "effects")
        else cell(kind_of(schema))
    )


def fields_table(cls: type, without: tuple[str, ...] = ()) -> str:
    """The fields of a dataclass with type and default."""
    rows = [f for f in dataclasses.fields(cls) if f.name not in without and not f.name.startswith("_")]
    if not rows:
        return ""
    lines = [f"| `{f.name}` | {cell(type_of(f.type))} | {cell(default_of(f))} |" for f in rows]
    return "\n".join(["| option | takes | without it |", "|---|---|---|", *lines]) + "\n"


def type_of(annotation: Any) -> str:
    """An annotation in short words."""
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    plain = {"float": "number", "int": "whole number", "str": "text", "bool": "true or false"}
    return " or ".join(plain.get(part.strip(), f"`{part.strip()}`") for part in text.split(" | ") if part.strip() != "None")


def default_of(field: Any) -> str:
    """The default of a field."""
    if field.default is not dataclasses.MISSING:
        return "–" if field.default is None else f"`{getattr(field.default, 'value', field.default)!r}`"
    if field.default_factory is not dataclasses.MISSING:
        return f"`{field.default_factory()!r}`"
    return "required"


def entry(name: str, cls: Any, package: str, without: tuple[str, ...] = ()) -> str:
    """One registered class: name, title, what it says of itself, options."""
    title = cls.title[:1].upper() + cls.title[1:]
    return f"## `{name}`\n\n**{title}.** `{package}.{cls.__name__}`\n\n{prose(cls)}\n\n{fields_table(cls, without)}"


def effects_page() -> str:
    """Every effect with its law and options."""
    introduction = """# Effects

By name in `[drive] effects`, on the command line (`--effects`), or as classes in a sum: `robot.rigid_body() + ident.friction.Viscous()`.
Every effect takes `joints` (their names; without it, every joint) and `side` (`joint` or `motor`: where its torque acts).
Signatures and what each is confused with: [gallery](/gallery.md).
"""
    parts = [introduction]
    for name, cls in sorted(effect_types().items()):
        if cls.__module__.startswith("ident."):
            parts.append(entry(name, cls, cls.__module__.split(".")[1], COMMON))
    return "\n".join(parts)


def methods_page() -> str:
    """Every estimator with its options."""
    parts = ["# Methods\n\nBy name in `[estimator] method`, with `--method`, or `ident.fit(…, method=…)`; options stand beside it.\n"]
    for name, cls in sorted(estimator_types().items()):
        if cls.__module__.startswith("ident."):
            parts.append(entry(name, cls, "estimators"))
    return "\n".join(parts)


def signals_page() -> str:
    """Every strategy that makes signals of logs."""
    called = "`[signals] method = …`, or the class called with logs: `ident.ZeroPhase(cutoff_hz=10)(logs, robot)`."
    parts = [f"# Signals\n\n{called}\n\n{prose(Preparation)}\n"]
    parts += [
        f"## `{cls.method}`\n\n`ident.signals.{cls.__name__}`\n\n{prose(cls)}\n\n{fields_table(cls)}"
        for cls in Preparation.__subclasses__()
    ]
    return "\n".join(parts)


def commands_page() -> str:
    """Every command with its help."""
    parts = ["# Command line\n\nExit codes and what stands in the results: [formats](/formats.md).\n"]
    for name, what in COMMANDS.items():
        parser = build_parser(name)
        (commands,) = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        examples = "\n".join(("```console", *(f"$ {line}" for line in EXAMPLES[name]), "```\n"))
        parts.append(f"## `ident {name}`\n\n{cell(what)[:1].upper()}{cell(what)[1:]}.\n\n{examples}\n{flags(commands.choices[name])}")
    return "\n".join(parts)


def flags(parser: argparse.ArgumentParser) -> str:
    """The arguments of one command as a table."""
    lines = ["| argument | says |", "|---|---|"]
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction):
            called = ", ".join(f"`{o}`" for o in action.option_strings) or f"`{action.metavar or action.dest}`"
            written = " ".join(action.metavar) if isinstance(action.metavar, tuple) else str(action.metavar or "")
            values = f"{{{','.join(map(str, action.choices))}}}" if action.choices else written
            shown = f" `{values}`" if values and action.option_strings else ""
            text = (
                (action.help or "") % {"default": action.default, "prog": parser.prog}
                if "%(" in (action.help or "")
                else (action.help or "").replace("%%", "%")
            )
            lines.append(f"| {called}{shown} | {cell(text)} |")
    return "\n".join(lines) + "\n"


def python_page() -> str:
    """The public names of the package itself."""
    parts = [f"# Python\n\n```text\n{inspect.getdoc(ident)}\n```\n"]
    for name in ident.__all__:
        found = getattr(ident, name)
        if not inspect.ismodule(found) and name != "__version__":
            parts.append(documented("ident", name, found))
    return "\n".join(parts)


def package_page(package: str) -> str:
    """The public names of one package."""
    module = getattr(ident, package) if package in ident.__all__ else __import__(f"ident.{package}", fromlist=["_"])
    parts = [f"# `ident.{package}`\n\n{prose(module)}\n"]
    parts += [
        documented(f"ident.{package}", name, getattr(module, name))
        for name in module.__all__
        if not inspect.ismodule(getattr(module, name))
    ]
    return "\n".join(parts)


def documented(package: str, name: str, found: Any) -> str:
    """A directive that takes the docstrings of one name in."""
    home = getattr(found, "__module__", package) or package
    own = not home.startswith("ident") or package != "ident"
    kind = "autoclass" if inspect.isclass(found) else "autofunction" if callable(found) else "autodata"
    members = "   :members:\n" if kind == "autoclass" and own is not None else ""
    index = "" if package == "ident" else "   :no-index:\n"
    return f"## `{name}`\n\n```{{eval-rst}}\n.. {kind}:: {package}.{name}\n{members}{index}```\n"
