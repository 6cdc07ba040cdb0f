"""Hand an identified robot on: files for simulators and other programs, each written by its target (`ident.exporting.targets`).

What is exported are standard parameters: real links that give the identified base parameters exactly (nearest to the URDF's own
where it has any). An estimate that no real links can give is refused with what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._utils.files import write_atomic
from .._utils.threads import with_one_blas_thread
from ..errors import ConfigurationError
from .identified import Identified
from .target import ExportOptions, make_target
from .urdf import Attached, BodyExport

if TYPE_CHECKING:
    from ..drives.result import DriveFit
    from ..estimate.estimate import Estimate
    from ..logs.log import LogSet


@dataclass(frozen=True)
class Exported:
    """What was written: `path`, `format`, the moving `bodies` (URDF) and `notes`."""

    path: str
    format: str
    bodies: tuple[BodyExport, ...]
    notes: tuple[str, ...]

    def text(self) -> str:
        """A few lines for people."""
        return "\n".join([f"{self.path}: {self.format} written", *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "path": self.path,
            "format": self.format,
            "bodies": [{"joint": b.joint, "link": b.link, "attached": list(b.attached), "kept": b.kept} for b in self.bodies],
            "notes": list(self.notes),
        }


@with_one_blas_thread
def export(
    source: Identified | Estimate | DriveFit,
    target: str | Path,
    *,
    kind: str | None = None,
    urdf: str | Path | None = None,
    attached: Attached | str = Attached.KEEP,
    allow_inconsistent: bool = False,
    logs: LogSet | None = None,
    units: Sequence[Identified | Estimate | DriveFit] = (),
    samples: int = 500,
    seed: int = 0,
    supply: float | None = None,
    force: bool = False,
) -> Exported:
    """Write an identified robot as a file for other programs.

    Parameters
    ----------
    source : Estimate, DriveFit or Identified
        What was identified.
    target : str or Path
        Written completely or not at all.
    kind : str, optional
        Format; by default it follows from the suffix (.urdf, .xml or .mjcf, .json, .usda, .c, .h).
    urdf : str or Path, optional
        The file to be patched; by default the one that the robot was loaded from.
    attached : Attached or str
        What becomes of the inertials of links attached through fixed joints.
    allow_inconsistent : bool
        Write parameters that no bodies can have.
    logs : LogSet, optional
        Motion on which the errors of what the target cannot express are computed; by default what the fit saw, if it was made in
        this session, else states within the limits of the joints.
    units : sequence
        Fits of further units of the same robot: ranges then hold their spread.
    samples, seed : int
        Sets of parameters that ranges draw.
    supply : float, optional
        Supply voltage at which the gains of a pwm law are told, V.
    force : bool
        Write over an existing file.

    Returns
    -------
    Exported
        The path, and what was written for each body.

    Raises
    ------
    ConfigurationError
        An unknown format, an existing file, or parameters that no bodies can have.

    Examples
    --------
    >>> import ident, tempfile, pathlib
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> ident.export(estimate, folder / "identified.json").format
    'json'
    """
    file = Path(target)
    writer = make_target(kind, file)
    if file.exists() and not force:
        raise ConfigurationError(f"{file} exists; nothing was written. Choose another name, or allow overwriting (--force, force=True).")
    found = Identified.of(source, supply=supply) if writer.bodies else Identified.plain(source, supply=supply)
    others = tuple(Identified.of(unit, supply=supply) for unit in units)
    options = ExportOptions(urdf, attached, allow_inconsistent, logs, others, samples, seed)
    made = writer.written(found, options)
    write_atomic(file, made.content, force=force)
    return Exported(str(file), writer.name, made.bodies, made.notes)


def export_urdf(estimate: Identified | Estimate | DriveFit, source: str | Path | None, target: str | Path, **options: Any) -> Exported:
    """Patch the URDF `source` with what was identified and write it to `target`; see `export`."""
    return export(estimate, target, kind="urdf", urdf=source, **options)
