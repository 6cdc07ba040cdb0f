"""Studies: what to identify, from which logs and how, as a TOML file or as command-line flags (docs/formats.md)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.files import write_atomic
from .._utils.plugins import load_modules
from .._utils.toml import Unfit, anything, check_options, check_table, load_toml, table_of, texts, to_toml
from ..drives.law import DriveLaw
from ..effects.declared import declared_effects, effect_entry, named_effects
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..estimators import Capability, estimator_types, make_estimator
from ..logs.recorders import add_recorders
from ..problem.integrated import FORMULATIONS, TORQUE
from ..robots.description import Description
from ..robots.tables import DriveTable, RobotTable, read_drive, read_loop
from ..signals.preparation import Preparation, make_preparation
from .misplaced import refuse_misplaced
from .paths import all_files, expanded, from_folder, relative
from .tables import LogsTable, Strategy, column_entry, logs_table, strategy

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimators import Estimator
    from ..model import Model
    from ..robots.robot import Robot

DEFAULT_PREPARATION = "zero_phase"
DEFAULT_METHOD = "wls"
#: Endings of files that hold a robot.
_URDF = (".urdf", ".xml")
_COLUMN_ENTRIES = (
    'a table of quantity = "column of the file", with a unit as in q1_deg = "...", or = { column = "...", scale = -1, offset = 0 }'
)


@dataclass(frozen=True)
class Study:
    """What is identified, from what, and how. Read it with `read_study`, or make it with `Study.from_flags`.

    `path`: the file it came from. `plugins`: modules of the user's own, loaded with the study. `description`: the robot, its drive
    and its loops. `form` of the equations that are fitted: torque, momentum or energy. `columns`: canonical log column → column of the
    file.

    Examples
    --------
    >>> import ident
    >>> study = ident.Study.from_flags(robot="scara", effects=["viscous"])
    >>> [effect.name for effect in study.model().effects]
    ['rigid_body', 'viscous']
    """

    path: Path | None = None
    description: Description = field(default_factory=Description)
    logs: LogsTable = field(default_factory=LogsTable)
    signals: Strategy = field(default_factory=Strategy)
    estimator: Strategy = field(default_factory=Strategy)
    columns: Mapping[str, Any] = field(default_factory=dict)
    plugins: tuple[str, ...] = ()
    form: str = TORQUE

    def __post_init__(self) -> None:
        if self.form not in FORMULATIONS:
            raise unknown_name("form", str(self.form), FORMULATIONS)

    @classmethod
    def from_flags(
        cls,
        *,
        robot: str | None = None,
        urdf: str | Path | None = None,
        drive: str | Path | None = None,
        logs: Iterable[str | Path] = (),
        validate: Iterable[str | Path] = (),
        method: str | None = None,
        effects: Iterable[str] | None = None,
    ) -> Study:
        """A study from what the command line gives; see `with_flags`."""
        return cls().with_flags(robot=robot, urdf=urdf, drive=drive, logs=logs, validate=validate, method=method, effects=effects)

    def with_flags(
        self,
        *,
        robot: str | None = None,
        urdf: str | Path | None = None,
        drive: str | Path | None = None,
        logs: Iterable[str | Path] = (),
        validate: Iterable[str | Path] = (),
        method: str | None = None,
        effects: Iterable[str] | None = None,
        form: str | None = None,
    ) -> Study:
        """The same study with some things replaced; what is not given stays.

        `drive`: a drive file (`read_drive`). `effects`: names, one or several a text, separated by commas, or NAME:JOINTS:KEY=VALUE,…
        Raises ConfigurationError."""
        if robot is not None and urdf is None and robot.lower().endswith(_URDF) and Path(robot).is_file():
            robot, urdf = None, robot  # a file by its name
        if robot is not None and urdf is not None:
            raise ConfigurationError("a robot by name and a URDF are both given; give one of them.")
        table, gearing = self.description.robot, self.description.drive
        if robot is not None or urdf is not None:
            table = replace(table, name=robot, urdf=None if urdf is None else Path(urdf))
        if drive is not None:
            gearing = read_drive(Path(drive)).over(gearing)
        if effects is not None:
            gearing = replace(gearing, effects=tuple(entry for text in effects for entry in named_effects(text)))
        fit, held = tuple(map(str, logs)), tuple(map(str, validate))
        return replace(
            self,
            description=replace(self.description, robot=table, drive=gearing),
            logs=replace(self.logs, fit=fit or self.logs.fit, validate=held or self.logs.validate),
            estimator=self.estimator if method is None else Strategy(method),
            form=self.form if form is None else form,
        )

    def reading(self) -> dict[str, Any]:
        """How `read_logs` is to read the logs (its keyword arguments)."""
        drive = self.description.whole_drive()
        given = {"missing": self.logs.missing, "rate_hz": self.logs.rate_hz, "torque": drive.torque, "torque_sign": drive.torque_sign}
        return {key: value for key, value in given.items() if value is not None}

    def with_effects(self, effects: Iterable[Effect]) -> Study:
        """The same study with these effects declared beside the rigid body (an extended model)."""
        entries = tuple(effect_entry(e) for e in effects if e.name != "rigid_body")
        return replace(self, description=replace(self.description, drive=replace(self.description.drive, effects=entries)))

    def robot(self) -> Robot:
        """The robot, behind its drive. Raises ConfigurationError."""
        return self.description.build()

    def model(self, robot: Robot | None = None) -> Model:
        """The declared model: the rigid body and the declared effects, else those of the robot's own description, else the
        usual ones (rotor inertia, viscous and Coulomb friction). Raises ConfigurationError for unknown effects or joints."""
        model = (self.robot() if robot is None else robot).rigid_body()
        for effect in declared_effects(self.description.whole_drive()):
            model = model + effect
        return model

    def drive_law(self, robot: Robot | None = None) -> DriveLaw | None:
        """The law from command to torque that `[drive] law` declares; None where the logs hold torque or current.
        Raises ConfigurationError for constants of a law where there is none."""
        table = self.description.whole_drive()
        return DriveLaw.read(table, self.robot() if robot is None else robot)

    def make_estimator(self) -> Estimator:
        """The estimator that `[estimator]` asks for; weighted least squares if it names none."""
        name = self.estimator.method or DEFAULT_METHOD
        kind = estimator_types().get(name)
        if kind is not None:
            check_options(kind, self.estimator.options, "[estimator]", {"method", "form"})
        options = dict(self.estimator.options)
        for key in options.keys() & (frozenset() if kind is None or self.path is None else kind.files):
            if isinstance(options[key], str) and self.path is not None:
                options[key] = from_folder(self.path.parent, options[key])
        return make_estimator(name, **options)

    def require_form(self, estimator: Estimator) -> None:
        """Raise UnsupportedError where a method cannot take equations of the study's form."""
        if self.form == TORQUE or _takes_any_form(type(estimator)):
            return
        able = ", ".join(name for name, kind in estimator_types().items() if _takes_any_form(kind))
        raise UnsupportedError(f"method {estimator.name!r} does not support the {self.form} form; methods that do: {able}.")

    def make_preparation(self) -> Preparation:
        """The strategy that turns logs into signals, as `[signals]` asks for; zero-phase filtering if it names none."""
        name, options = self.signals.method or DEFAULT_PREPARATION, dict(self.signals.options)
        kind = next((k for k in Preparation.__subclasses__() if k.method == name), None)
        if kind is not None:
            check_options(kind, options, "[signals]", {"method"})
        return make_preparation(name, **options)

    def fit_files(self) -> tuple[Path, ...]:
        """The logs to fit, patterns expanded; where none are named, those that the estimator's own plan names.

        Raises ConfigurationError if there are none, DataError for a pattern without a match."""
        own = () if self.logs.fit else self.make_estimator().own_logs()
        if own:
            return own
        if not self.logs.fit:
            raise ConfigurationError("no log to fit is given; name it in [logs] fit, or with --log.")
        return expanded(self.logs.fit, "[logs] fit")

    def repeated(self) -> str:
        """A sentence on files that are named more than once; "" where none is."""
        found = []
        for key, entries in (("fit", self.logs.fit), ("validate", self.logs.validate)):
            files = all_files(entries, f"[logs] {key}")
            found += [str(f) for f in dict.fromkeys(files) if files.count(f) > 1]
        return f"{', '.join(found)} {'is' if len(found) == 1 else 'are'} named more than once, but read once." if found else ""

    def validation_files(self) -> tuple[Path, ...]:
        """The logs to validate on, patterns expanded; empty where a part of the fitted logs is to be held out."""
        return expanded(self.logs.validate, "[logs] validate")

    def to_toml(self, folder: Path | None = None) -> str:
        """The study as TOML text. Paths are written relative to `folder` (default: as they are held)."""
        robot, drive = self.description.robot, self.description.drive
        tables: dict[str, dict[str, Any]] = {
            "plugins": {"modules": list(self.plugins) or None},
            "robot": {f.name: getattr(robot, f.name) or None for f in fields(robot)},
            "drive": {f.name: getattr(drive, f.name) for f in fields(drive)},
            "loop": dict(self.description.loop),
            "logs": {
                **{key: [relative(p, folder) for p in getattr(self.logs, key)] or None for key in ("fit", "validate")},
                "missing": self.logs.missing,
                "rate_hz": self.logs.rate_hz,
                "recorders": [relative(p, folder) for p in self.logs.recorders] or None,
            },
            "signals": {"method": self.signals.method, **self.signals.options},
            "estimator": {"method": self.estimator.method, "form": None if self.form == TORQUE else self.form, **self.estimator.options},
            "columns": dict(self.columns),
        }
        if robot.urdf is not None:
            tables["robot"]["urdf"] = relative(str(robot.urdf), folder)
        if drive.effects is not None:
            tables["drive"]["effects"] = [e["name"] if len(e) == 1 else e for e in drive.effects]
        return to_toml(tables)


def _takes_any_form(kind: type[Estimator]) -> bool:
    """Whether a method works from information alone, whatever the rows are of."""
    return Capability.STREAMING in kind.capabilities and Capability.NOISY_REGRESSOR not in kind.capabilities


def read_study(path: str | Path) -> Study:
    """Read a study file. Relative paths in it start at its folder.

    Parameters
    ----------
    path : str or Path
        A TOML file.

    Returns
    -------
    Study

    Raises
    ------
    ConfigurationError
        No such file, not TOML, unknown tables or keys (with the nearest, or the table where they belong), wrong types.

    Examples
    --------
    >>> import ident, tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "study.toml"
    >>> _ = file.write_text('[robot]\\nname = "scara"\\n')
    >>> ident.read_study(file).robot().n
    4
    """
    path = Path(path)
    where = f"study {path}"
    schema = dict.fromkeys(("plugins", "robot", "drive", "loop", "logs", "signals", "estimator", "columns"), anything)
    found = load_toml(path, "study")
    refuse_misplaced(found, schema, where)
    data = check_table(found, schema, "", where)
    plugins = check_table(data.get("plugins", {}), {"modules": texts}, "plugins", where).get("modules", ())
    load_modules(plugins, path.parent, f"{where}: [plugins]")
    logs = logs_table(data.get("logs", {}), path.parent, where)
    for file in logs.recorders:
        add_recorders(Path(file))
    strategies = {table: strategy(data.get(table, {}), table, where) for table in ("signals", "estimator")}
    form = strategies["estimator"].options.get("form", TORQUE)
    try:
        columns = table_of(column_entry, _COLUMN_ENTRIES)(data.get("columns", {}))
    except Unfit as expected:
        raise ConfigurationError(f"{where}: [columns] must be {expected}.") from None
    return Study(
        path,
        Description(
            RobotTable.read(data.get("robot", {}), path.parent, where),
            DriveTable.read(data.get("drive", {}), where),
            read_loop(data.get("loop", {}), where),
        ),
        logs,
        strategies["signals"],
        strategies["estimator"].without("form"),
        columns,
        tuple(plugins),
        form,
    )


def write_study(path: str | Path, study: Study, *, force: bool = False) -> Path:
    """Write a study file; its paths are written relative to its folder. Raises ConfigurationError if the file exists."""
    path = Path(path)
    return write_atomic(path, study.to_toml(path.parent), force=force)
