"""`ident.fit`: from logs to an estimate in one call."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.threads import with_one_blas_thread
from ..errors import ConfigurationError, DataError
from ..estimators import Estimator, make_estimator
from ..evaluation.doubts import counted_twice, doubts, fitted_as_well, require_rows
from ..logs.log import Log, LogSet
from ..logs.reading import logs_of
from ..model import Model
from ..problem.problem import Problem
from ..robots.description import Description
from ..robots.robot import Robot
from ..robots.tables import RobotTable
from ..signals.likewise import like
from ..signals.preparation import ZeroPhase
from .session import HELD_SHARE, Session
from .study import Study, read_study

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..effects.sums import EffectSum
    from ..estimate.estimate import Estimate
    from ..signals.preparation import Preparation

Logs = LogSet | Log | str | Path | Sequence[str | Path]


@with_one_blas_thread
def fit(
    logs: Logs | Study,
    robot: Robot | str | Path | None = None,
    *,
    model: Model | EffectSum[Effect] | Effect | Iterable[Effect] | None = None,
    method: str | Estimator = "wls",
    held: Logs | float = HELD_SHARE,
    preparation: Preparation | None = None,
    **options: Any,
) -> Estimate:
    """Fit base and drive parameters to logs, and report the torque error on data that the fit did not see.

    Parameters
    ----------
    logs : LogSet, Log, path, DataFrame, sequence of paths or DataFrames, or Study
        The logs; a study file (`.toml`) or a `Study` says everything by itself.
    robot : Robot, str or Path, optional
        A robot, the name of one, or the path of a URDF; needed where the logs do not carry theirs.
    model : Model, effects or sum of effects, optional
        The declared model. Effects stand beside the rigid body. By default what the robot's own description declares, else rotor
        inertia, viscous and Coulomb friction on every joint.
    method : str or Estimator
        Name of an estimator (`options` are its settings) or an estimator.
    held : LogSet, Log, path, sequence of paths, or float
        Logs to report the error on, or the share at the end of each log that is held out; 0 holds out nothing.
    preparation : Preparation, optional
        How logs become signals; by default zero-phase filters with a cut-off chosen from the data.
    **options
        Settings of the method, by name.

    Returns
    -------
    Estimate
        With `fit_error`, and `heldout_error` unless nothing was held out.

    Raises
    ------
    ConfigurationError
        A robot, model or method that does not exist or does not fit.
    DataError
        Logs that cannot be used.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=test)
    >>> len(estimate.names), bool(estimate.heldout_error.relative_all < 0.01)
    (52, True)
    """
    study = read_study(logs) if isinstance(logs, str | Path) and str(logs).endswith(".toml") else logs
    if isinstance(study, Study):
        usual = method == "wls" and isinstance(held, float) and held == HELD_SHARE and not options
        if robot is not None or model is not None or preparation is not None or not usual:
            raise ConfigurationError(
                "a study says which robot, model, method, preparation and held-out logs to use; change the study instead of passing them"
                " to fit()."
            )
        return Session(study).estimate
    where = _robot(robot)
    whole = logs_of(logs, where)
    where = where or whole.robot
    if where is None:
        raise ConfigurationError("which robot are the logs of? Give fit() a robot, a name (ident.robot_names()) or a URDF.")
    train, test = _parts(whole, held, where)
    prepare = preparation or ZeroPhase()
    signals = prepare(train, where)
    estimator = make_estimator(method, **options) if isinstance(method, str) else method
    estimator.check_robot(where)
    found = estimator.solve(Problem(_model(model, where), signals))
    require_rows(found)
    found = replace(found, inputs=train.inputs, signals_config=signals.report.to_dict())
    said = [text for text in (counted_twice(train.inputs),) if text]
    if test is not None:
        found, more = _with_heldout(found, train, test, where, own=isinstance(held, float | int))
        said += more
    return replace(found, warnings=(*found.warnings, *where.doubts, *said, *doubts(found)))


def _with_heldout(found: Estimate, train: LogSet, test: LogSet, robot: Robot, *, own: bool) -> tuple[Estimate, list[str]]:
    """An estimate with its error on held-out logs, and warnings. `own`: they are parts of the fitted logs, which may be too short."""
    said = []
    try:
        found = found.with_heldout(found.torque_error(like(found.signals_config)(test, robot)))
    except DataError as error:
        if not own:
            raise
        said.append(f"no error on held-out data: {error}")
    if not own and (again := fitted_as_well(train.inputs, test.inputs)):
        said.append(again)
    return found, said


def _robot(given: Robot | str | Path | None) -> Robot | None:
    """The robot that is meant, None where the logs have to say it."""
    if given is None or isinstance(given, Robot):
        return given
    is_file = isinstance(given, Path) or given.lower().endswith((".urdf", ".xml")) or given.lstrip().startswith("<")
    if is_file:
        return Robot.from_urdf(given)
    return Description(RobotTable(name=str(given))).build()


def _parts(logs: LogSet, held: Any, robot: Robot) -> tuple[LogSet, LogSet | None]:
    """What is fitted and what is held out."""
    if not isinstance(held, float | int):
        return logs, logs_of(held, robot)
    if not 0 <= held < 1:
        raise ConfigurationError(f"held must be a share from 0 to less than 1, or logs, not {held!r}.")
    return (logs, None) if held == 0 else logs.split(by="fraction", held=float(held))


def _model(given: Any, robot: Robot) -> Model:
    """The declared model: as given, else as the robot's own description has it."""
    if isinstance(given, Model):
        return given
    if given is not None:
        return robot.rigid_body() + Model(robot, given)
    return Study(description=Description(RobotTable(name=robot.source.get("robot")))).model(robot)
