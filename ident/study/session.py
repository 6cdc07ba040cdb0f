"""From a study to a problem: the steps that every command takes, in one place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..auditing import Audit, audit
from ..drives.torque import with_torque
from ..errors import DataError
from ..estimators import make_estimator
from ..evaluation.contrary_stretches import contrary
from ..evaluation.doubts import HELD_OUT, all_turned, counted_twice, doubts, fitted_as_well, require_rows, settled_first
from ..evaluation.validation import validate
from ..logs.reading import read_logs
from ..problem.integrated import TORQUE, formulate
from ..problem.problem import Problem
from ..signals.known_band import unjudged
from ..signals.likewise import like

if TYPE_CHECKING:
    from pathlib import Path

    from ..estimate.estimate import Estimate
    from ..evaluation.validation import Validation
    from ..logs.log import LogSet
    from ..model import Model
    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from .study import Study

from .study import DEFAULT_METHOD

#: Share of each log that is held out (its last part) where no validation log is given.
HELD_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class Session:
    """A study taken up: robot, model, logs and signals, each made when it is first needed."""

    study: Study
    progress: Callable[[float], None] | None = None
    skip_bad_files: bool = False

    @cached_property
    def robot(self) -> Robot:
        """The robot behind its drive."""
        return self.study.robot()

    @cached_property
    def model(self) -> Model:
        """The declared model."""
        return self.study.model(self.robot)

    @cached_property
    def recorded(self) -> LogSet:
        """The logs named for fitting, whole."""
        self.study.make_estimator().check_robot(self.robot)
        return self._read(self.study.fit_files())

    @cached_property
    def _parts(self) -> tuple[LogSet, LogSet | None]:
        """What is fitted and what is held out; None where nothing of the logs can be."""
        files = self.study.validation_files()
        if files:
            return self.recorded, self._read(files)
        if self.study.make_estimator().whole_logs:
            return self.recorded, None
        return self.recorded.split(by="fraction", held=HELD_SHARE)

    def _read(self, files: Iterable[Path]) -> LogSet:
        how = {"skip_bad_files": self.skip_bad_files, **self.study.reading()}
        logs = read_logs([*map(str, files)], self.robot, self.study.columns or None, **how)
        law = self.study.drive_law(self.robot)
        return logs if law is None else with_torque(logs, law, self.robot)

    @property
    def skipped(self) -> tuple[str, ...]:
        """What was left out because it could not be read, with the reason."""
        held = () if self.held_by_split or self._parts[1] is None else self._parts[1].left_out
        return (*self.recorded.left_out, *held)

    @property
    def held_by_split(self) -> bool:
        """Whether the held-out data are the last part of the fitted logs, for want of validation logs."""
        return not self.study.validation_files()

    @cached_property
    def audit(self) -> Audit:
        """Audit of the logs named for fitting."""
        return audit(self.recorded, self.robot)

    @cached_property
    def fit_signals(self) -> Signals:
        """The signals that are fitted."""
        return self.study.make_preparation()(self._parts[0])

    @cached_property
    def held_signals(self) -> Signals:
        """The signals that no fit sees, prepared like the fitted ones (the same cut-off). Raises DataError where they are too short."""
        held = self._parts[1]
        if held is None:
            method = self.study.make_estimator().name
            raise DataError(f"method {method!r} needs whole logs; give logs to validate on with --validate, or in [logs] validate.")
        with self._naming_held_out():
            return like(self.fit_signals.report.to_dict())(held)

    @contextmanager
    def _naming_held_out(self) -> Iterator[None]:
        """A DataError raised inside says which data are held out."""
        try:
            yield
        except DataError as error:
            what = f"the last {HELD_SHARE:.0%} of the logs" if self.held_by_split else ", ".join(map(str, self.study.validation_files()))
            raise DataError(f"held-out data ({what}): {error}") from None

    @cached_property
    def problem(self) -> Problem:
        """The declared model on the fitted signals, in the form that the study asks for."""
        return replace(formulate(self.model, self.fit_signals, self.study.form), progress=self.progress)

    @cached_property
    def estimate(self) -> Estimate:
        """The estimate that the study asks for, with its error on held-out data and its inputs.

        Where no validation log is given and the part held out is too short to be used, a warning stands for that error."""
        estimator = self.study.make_estimator()
        self.study.require_form(estimator)
        found = estimator.solve(self.problem)
        require_rows(found)
        if self.study.form != TORQUE:
            found = replace(found, trace={**found.trace, "form": self.study.form})
        found = replace(found, inputs=self.inputs, signals_config=self.fit_signals.report.to_dict())
        said = [f"left out: {reason}" for reason in self.skipped]
        try:
            found = found.with_heldout(found.torque_error(self.held_signals))
        except DataError as error:
            if not self.held_by_split:
                raise
            said.append(f"no error on held-out data. {str(error)[0].upper()}{str(error)[1:]}")
        if spoilt := unjudged(self.fit_signals):
            said.append(spoilt)
        if again := fitted_as_well(*self.inputs_apart):
            said.append(again)
        said += self.repeated
        return replace(found, warnings=(*found.warnings, *self.robot.doubts, *said, *doubts(found)))

    @cached_property
    def turned(self) -> str:
        """What to say first of all where every torque has the opposite sign; "" where they have not, or where it cannot be told."""
        return "" if self._plain is None else all_turned(self._plain)

    @cached_property
    def misassigned(self) -> str:
        """What to say first where columns were reversed or exchanged, or gravity acts in another direction; "" where not, or where it
        cannot be told."""
        return "" if self._plain is None or self.turned else settled_first(self._plain)

    @cached_property
    def contrary(self) -> str:
        """What to say of stretches that contradict the rest of the logs; "" where there are none, or where it cannot be told."""
        return "" if self._plain is None or self.turned or self.misassigned else contrary(self._plain)

    @cached_property
    def _plain(self) -> Estimate | None:
        """The torque equation fitted by the usual method, on whose errors log mistakes show; None where the data do not allow it."""
        try:
            torque = self.problem if self.study.form == TORQUE else Problem(self.model, self.fit_signals)
            return make_estimator(DEFAULT_METHOD).solve(torque)
        except DataError:
            return None

    @property
    def repeated(self) -> list[str]:
        """What to say of logs that are named twice, or hold the same."""
        return [text for text in (self.study.repeated(), counted_twice(self.inputs_apart[0])) if text]

    @property
    def inputs_apart(self) -> tuple[tuple[dict[str, Any], ...], tuple[dict[str, Any], ...]]:
        """Paths and SHA-256 of the logs that are fitted, and of those named to validate on."""
        fit, held = self._parts
        return fit.inputs, () if self.held_by_split or held is None else held.inputs

    @property
    def inputs(self) -> tuple[dict[str, Any], ...]:
        """Paths and SHA-256 of every log used, each once; `use` tells which were held out."""
        fit, held = self.inputs_apart
        return (*fit, *({**one, "use": HELD_OUT} for one in held if one not in fit))

    def validation(self, *, simulate: bool) -> Validation:
        """The estimate on held-out data."""
        return validate(self.estimate, self.held_signals, simulate=simulate)
