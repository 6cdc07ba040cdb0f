"""The result of a fit under a drive law: values with intervals, what is determined only together, error of simulated position."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.files import write_atomic
from .._utils.json import jsonable, result
from .._utils.short_repr import ShortRepr
from .._utils.structured import read_json
from ..errors import ConfigurationError
from ..estimate.io import model_to_dict
from ..estimate.saved import model_from_dict
from ..logs.runs import whole_runs
from .begun import begun
from .commands import DriveLog
from .determined import Determination, Standing
from .given import IDENTIFY
from .law import SHARED, DriveLaw
from .plant import DrivePlant
from .text import summary
from .unknowns import CONSTANTS, Unknown, unknowns

if TYPE_CHECKING:
    from ..logs.log import Log, LogSet
    from ..model import Model

Array = np.ndarray
METHOD = "simulation"


@dataclass(frozen=True, eq=False, repr=False)
class DriveFit(ShortRepr):
    """Model and drive law as identified from commands and positions.

    `values` (p,) of the `unknowns`: those with which the simulation runs, also where only combinations are determined
    (`determination`). `fit_rms`, `heldout_rms` (n,): error of simulated position, open loop from the first sample, rad or m."""

    model: Model
    law: DriveLaw
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array
    determination: Determination | None
    fit_rms: Array
    period: float
    samples: int
    settled: bool
    inputs: tuple[dict[str, str], ...] = ()
    heldout_rms: Array | None = None
    heldout_logs: Mapping[str, Array] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    delay_ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what was unknown."""
        return tuple(u.name for u in self.unknowns)

    def value(self, name: str) -> float:
        """The value with which the simulation runs. Whether it is determined, `determination` says."""
        return float(self.values[self.names.index(name)])

    def replay(self, logs: LogSet) -> dict[str, Array]:
        """Simulated less measured position (N, n) by log, open loop from the first sample under the logged commands."""
        seen = tuple(DriveLog.of(log, self.model.robot, self.law) for log in logs)
        return {log.name: found - log.q for log, found in zip(seen, self.simulated(seen), strict=True)}

    def simulated(self, logs: Sequence[DriveLog]) -> list[Array]:
        """Position (N, n) in each log, open loop from the first sample; what the integral of a drive begins with is, as position and speed
        are, that of the log."""
        return self._positions(logs, {u.name: float(v) for u, v in zip(self.unknowns, self.values, strict=True) if not u.log})

    def _positions(self, logs: Sequence[DriveLog], known: Mapping[str, float]) -> list[Array]:
        """The same with unknowns by name; what integrals begin with is read off the log where it is not among them."""
        plant = DrivePlant(self.model, self.law, tuple(logs))
        values = begun(plant, np.array([known.get(u.name, np.nan) for u in plant.unknowns]))
        return [found[0] for found in plant.positions(values)]

    def replay_after(self, logs: Iterable[Log], before: Iterable[Log]) -> dict[str, Array]:
        """Simulated less measured position (N, n) by log. What is a later part of a run of which the fit had the beginning (`before`) is
        simulated on from there: where it begins, commands from before it are still under way, and its speed is not known."""
        every = dict(zip(self.names, map(float, self.values), strict=True))
        shared = {u.name: every[u.name] for u in self.unknowns if not u.log}
        out: dict[str, Array] = {}
        for run, rows in whole_runs(logs, before):
            seen = DriveLog.of(run, self.model.robot, self.law)
            (found,) = self._positions((seen,), every if len(run) > sum(at.stop - at.start for at in rows.values()) else shared)
            kept = np.flatnonzero(seen.kept)
            out |= {name: (found - seen.q)[(kept >= at.start) & (kept < at.stop)] for name, at in rows.items()}
        return {log.name: out[log.name] for log in logs}

    def with_heldout(self, logs: LogSet, before: Iterable[Log] = ()) -> DriveFit:
        """The same with its error on logs that no fit saw, which may be later parts of those `before`, to which it was fitted."""
        errors = self.replay_after(logs, before)
        whole = np.concatenate(list(errors.values()))
        by_log = {name: np.sqrt(np.mean(e**2, axis=0)) for name, e in errors.items()}
        return replace(self, heldout_rms=np.sqrt(np.mean(whole**2, axis=0)), heldout_logs=by_log)

    def delay_interval(self) -> dict[str, tuple[float, float, float]]:
        """Name of each unknown delay → value and ends of its 95 % interval, s; not below zero, inf where the logs set no bound.

        By profile likelihood, the other unknowns fitted again at each end; where that was not done, by the standard deviation."""
        out = {}
        for i, unknown in enumerate(self.unknowns):
            if unknown.place == "delay_s":
                if unknown.name in self.delay_ends:
                    out[unknown.name] = (float(self.values[i]), *self.delay_ends[unknown.name])
                    continue
                reach = 1.96 * float(np.sqrt(self.covariance[i, i]))
                out[unknown.name] = (float(self.values[i]), max(0.0, float(self.values[i]) - reach), float(self.values[i]) + reach)
        return out

    def trades(self, name: str, most: int = 2) -> list[tuple[str, float]]:
        """The unknowns whose estimates are most correlated with that of `name`, and the correlations."""
        i = self.names.index(name)
        if not np.isfinite(self.covariance[i, i]):
            return []
        size = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        r = self.covariance[i] / (size * size[i])
        order = [int(k) for k in np.argsort(-np.abs(r)) if k != i][:most]
        return [(self.names[k], float(r[k])) for k in order]

    def constants(self) -> dict[str, Array]:
        """Constants of the law (n,) by name, the identified ones put in."""
        out = {key: values.copy() for key, values in self.law.constants.items()}
        for unknown, value in zip(self.unknowns, self.values, strict=True):
            if unknown.place in out and not unknown.log:
                at = slice(None) if unknown.joint < 0 else unknown.joint
                out[unknown.place][at] = value
        return out

    def drive(self) -> dict[str, Array]:
        """Effects of the drives, "armature", "viscous", "dry", "offset", "load", "excess", "spring" → (n,) of joints; zero where none."""
        out = {key: np.zeros(self.model.robot.n) for key in ("armature", "viscous", "dry", "offset", "load", "excess", "spring")}
        for unknown, value in zip(self.unknowns, self.values, strict=True):
            if unknown.place in out:
                out[unknown.place][unknown.joint] += unknown.factor * value
        return out

    def summary(self) -> str:
        """What is determined, what only together, the delay's interval and the error of simulated position."""
        return summary(self)

    def __str__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """The result as `ident fit --json` prints it (`ident.fit/1`)."""
        body: dict[str, Any] = {
            "method": METHOD,
            "status": {
                "code": "ok" if self.settled else "not_converged",
                "text": "converged" if self.settled else "the search did not converge",
            },
            "parameters": self._parameters(),
            "samples": self.samples,
            "replay": {
                "fit": {"rms": self.fit_rms.tolist()},
                "heldout": {"rms": [] if self.heldout_rms is None else self.heldout_rms.tolist()},
            },
            "delay": [self._delay(k, *reach) for k, reach in self.delay_interval().items()],
            "drive": self.law.to_dict(),
        }
        if self.determination is not None:
            decided = self.determination
            body["confounded"] = [
                {"expression": c.expression, "value": c.value, "std": c.std, "unit": c.unit, "separated_by": c.separated_by}
                for c in decided.combinations
            ] + [{"expression": c.expression, "below": c.below, "unit": c.unit, "separated_by": c.separated_by} for c in decided.bounded]
        return result("ident.fit/1", jsonable(body), inputs=self.inputs, warnings=self.warnings)

    def _delay(self, name: str, value: float, low: float, high: float) -> dict[str, Any]:
        entry = {"name": name, "interval": [low, high if np.isfinite(high) else None]}
        standing = None if self.determination is None else self.determination.verdicts[self.names.index(name)]
        return {**entry, "value": value} if standing == Standing.DETERMINED else entry

    def _parameters(self) -> list[dict[str, Any]]:
        assert self.determination is not None
        out = []
        rows = zip(self.unknowns, self.values, self.determination.verdicts, self.determination.std, self.determination.below, strict=True)
        for unknown, value, verdict, std, below in rows:
            joint = "" if unknown.joint < 0 else self.model.robot.joint_names[unknown.joint]
            entry: dict[str, Any] = {"name": unknown.name, "unit": unknown.unit, "verdict": str(verdict)}
            entry |= {"expression": unknown.expression or unknown.name, "effect": unknown.effect, "joint": joint}
            if verdict == Standing.DETERMINED:
                entry |= {"value": float(value), "std": float(std)}
            elif verdict == Standing.UNSEEN and np.isfinite(below):
                entry |= {"below": float(below)}
            out.append(entry)
        return out

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write result and state as one JSON file."""
        state = {
            "model": model_to_dict(self.model), "values": self.values, "covariance": self.covariance, "period": self.period,
            "names": list(self.names), "starts": [(u.log, u.joint) for u in self.unknowns if u.log],
        }  # fmt: skip
        return write_atomic(Path(path), json.dumps({**self.to_dict(), "drive_state": jsonable(state)}), force=force)

    @classmethod
    def load(cls, path: str | Path) -> DriveFit:
        """Read what `save` wrote; `determination` is not rebuilt. Raises ConfigurationError."""
        data = read_json(Path(path), "fit")
        if not is_drive_fit(data):
            raise ConfigurationError(f"fit {path}: is not a fit under a drive law. Write one with `ident fit --out DIR` and [drive] law.")
        try:
            state, law = data["drive_state"], dict(data["drive"])
            model = model_from_dict(state["model"])
            found = DriveLaw.of(model.robot, law.pop("law"), links=law.pop("links"), by_log=_logs(law.pop("by_log")), **_numbers(law))
            replayed = data["replay"]["heldout"]["rms"]
            values = np.array(state["values"], float)
            found = replace(found, shared=frozenset(key for key in SHARED if CONSTANTS[key][0] in state["names"]))
            free = unknowns(model, found, [(str(log), int(joint)) for log, joint in state.get("starts", [])])
            return cls(
                model, found, free, values, np.array(state["covariance"], float), None, np.array(data["replay"]["fit"]["rms"]),
                float(state["period"]), int(data["samples"]), data["status"]["code"] == "ok", tuple(data["inputs"]),
                np.array(replayed) if replayed else None, warnings=tuple(data["warnings"]),
                delay_ends={d["name"]: _ends(*d["interval"]) for d in data["delay"]},
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigurationError(f"fit {path}: is damaged, or was written by another version of ident ({error}). Fit again.") from None


def is_drive_fit(data: Any) -> bool:
    """Whether JSON data are a saved fit under a drive law."""
    return isinstance(data, Mapping) and "drive_state" in data


def _ends(low: float, high: float | None) -> tuple[float, float]:
    return float(low), np.inf if high is None else float(high)


def _numbers(table: Mapping[str, Any]) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        return [x if x == IDENTIFY else float("inf") if x == "none" else x for x in value] if isinstance(value, list) else value

    return {key: plain(value) for key, value in table.items()}


def _logs(table: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _numbers(entry) for name, entry in table.items()}
