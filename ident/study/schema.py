"""The JSON schema of study files, made from the classes that read them: editors complete and check a study by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from .._utils.json_schema import NUMBER, TEXT, TEXTS, first_sentence, of_fields, of_kind, of_table
from ..effects.registry import effect_types
from ..estimators import estimator_types
from ..problem.integrated import FORMULATIONS
from ..robots.tables import DriveTable, RobotTable
from ..signals.preparation import Preparation
from .study import DEFAULT_METHOD, DEFAULT_PREPARATION

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def study_schema() -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of a study file, with every effect and estimator that is registered.

    Examples
    --------
    >>> from ident.study.schema import study_schema
    >>> sorted(study_schema()["properties"])
    ['columns', 'drive', 'estimator', 'logs', 'loop', 'plugins', 'robot', 'signals']
    """
    rule = {"type": "object", "additionalProperties": NUMBER}
    robot, drive = ({key: of_kind(kind) for key, kind in table.SCHEMA.items()} for table in (RobotTable, DriveTable))
    robot["locked"] = rule
    drive["effects"] = _effects()
    preparations = {kind.method: kind for kind in Preparation.__subclasses__()}
    return {
        "$schema": _DIALECT,
        "title": "ident study",
        **of_table(
            {
                "plugins": of_table({"modules": TEXTS}, description="the user's own effects, estimators and readers: files or modules"),
                "robot": {**of_table(robot, description=first_sentence(RobotTable)), "not": {"required": ["name", "urdf"]}},
                "drive": {**of_table(drive, description=first_sentence(DriveTable)), "not": {"required": ["ratio", "K"]}},
                "loop": {"type": "object", "additionalProperties": rule, "description": "dependent joint = factors x joints + offset"},
                "logs": of_table(
                    {"fit": TEXTS, "validate": TEXTS, "missing": {"enum": ["refuse", "gap"]}, "rate_hz": NUMBER, "recorders": TEXTS}
                ),
                "signals": _strategies(preparations, DEFAULT_PREPARATION),
                "estimator": _strategies(estimator_types(), DEFAULT_METHOD, {"form": {"enum": [*FORMULATIONS]}}),
                "columns": {
                    "type": "object",
                    "additionalProperties": {"anyOf": [TEXT, of_table({"column": TEXT, "unit": TEXT, "scale": NUMBER, "offset": NUMBER})]},
                    "description": "canonical name = name in the files, or a table of column, unit, scale, offset",
                },
            }
        ),
    }


def _effects() -> dict[str, Any]:
    """A name, a table, or a list of both."""
    kinds = {name: kind for name, kind in effect_types().items() if name != "rigid_body"}
    tables = []
    for name, kind in kinds.items():
        own = of_fields(kind)
        own["joints"] = TEXTS
        if "motors" in {f.name for f in fields(kind)}:
            own["motors"] = TEXTS
        tables.append(of_table({"name": {"const": name}, **own}, ["name"], first_sentence(kind)))
    one = {"anyOf": [{"enum": [*kinds]}, *tables]}
    return {"anyOf": [one, {"type": "array", "items": one}]}


def _strategies(kinds: Mapping[str, type], usual: str, also: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A table for one of several methods, each with its own options and those of `also`; without a method, the usual one's."""
    more = dict(also or {})
    tables = [
        of_table({"method": {"const": name}, **more, **of_fields(kind)}, ["method"], first_sentence(kind)) for name, kind in kinds.items()
    ]
    return {"anyOf": [of_table({**more, **of_fields(kinds[usual])}, description=first_sentence(kinds[usual])), *tables]}
