"""Step-by-step identification as a plan: tests of one or two joints at a time, from the tip to the base (Yoshida, 1995, ch. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.threads import with_one_blas_thread
from ..errors import ConfigurationError
from ..excitation.limits import Limits
from ..friction import Coulomb, RotorInertia, Viscous
from ..robots.library.published import published_plan
from ..robots.robot import Robot
from .choice import Chooser, Separation
from .logs import TrackingMode, simulate_logs
from .manifest import read_manifest, write_manifest
from .sequence import Plan

if TYPE_CHECKING:
    from ..model import Model
    from ..simulation.plant import Plant

Array = np.ndarray


def default_model(robot: Robot) -> Model:
    """Rigid body, rotor inertia, viscous and Coulomb friction on every joint: what the step-by-step method identifies."""
    return robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()


@with_one_blas_thread
def make_plan(
    model: Model | Robot,
    *,
    limits: Limits | None = None,
    postures: int = 3,
    separation: Separation | str = Separation.COUPLED,
    published: str | None = None,
    seed: int = 0,
) -> Plan:
    """The step-by-step plan of a model: tests of one or two joints at a time, from the tip to the base.

    Static tests, constant velocity, and motion of one or two joints with the others frozen; as many as it takes to determine every base
    parameter, decided by ranks within the limits. Collisions are not looked at.

    Parameters
    ----------
    model : Model or Robot
        A robot stands for its links with rotor inertia, viscous and Coulomb friction on every joint.
    limits : Limits, optional
        By default nine tenths of what the robot's description allows.
    postures : int
        Least number of postures at which the other joints are frozen.
    separation : Separation or str
        How rotor and link inertia are told apart: by coupled gears where they can (fewest tests), or safely.
    published : str, optional
        A published plan of a built-in robot by its name, such as "yoshida1995" for the PUMA 560, instead of a search.
    seed : int
        Of the choice of postures.

    Returns
    -------
    Plan

    Raises
    ------
    UnsupportedError
        Effects that a plan cannot hold.

    References
    ----------
    K. Yoshida, "Studies on Dynamics of Robot Manipulators", 1995, ch. 3.

    Examples
    --------
    >>> import ident
    >>> plan = ident.plan(ident.load_robot("scara"))
    >>> plan.rank == len(plan.base)
    True
    """
    if isinstance(model, Robot):
        model = default_model(model)
    robot = model.robot
    limits = limits or Limits.of(robot)
    if postures < 2:
        raise ConfigurationError(
            f"plan: at least 2 postures are needed to separate gravity and inertia of the frozen joints, not {postures}."
        )
    chooser = Chooser(model, limits, postures, seed)
    if published is None:
        tests, rank = chooser.tests(Separation(separation))
    else:
        tests, rank = chooser.named_tests(published_plan(str(robot.source.get("robot", robot.name)), published).accelerated)
    notes = []
    if rank < model.base.count:
        revealed = {name for test in tests for name in test.reveals}
        left = [name for name in model.base.names if name not in revealed]
        notes.append(f"{model.base.count - rank} combination(s) of {', '.join(left[:8])} stay unknown within these limits.")
    return Plan(
        robot.name,
        robot.joint_names,
        tuple(e.name for e in model.effects),
        model.base.names,
        tuple(tests),
        rank,
        0.5 * limits.velocity,
        0.5 * limits.acceleration,
        tuple(notes),
    )


def write_plan(plan: Plan, path: str | Path, *, force: bool = False) -> Path:
    """Write a plan as its manifest (TOML). Raises ConfigurationError if the file exists and `force` is false."""
    return write_manifest(plan, Path(path), force=force)


def read_plan(path: str | Path) -> Plan:
    """Read a manifest. Raises ConfigurationError that names the file, the test and the key."""
    return Plan(**read_manifest(Path(path)))


def simulate_plan(
    plan: Plan,
    plant: Plant,
    folder: str | Path,
    *,
    tests: Sequence[str] | None = None,
    tracking: str = TrackingMode.CONTROLLER,
    seed: int = 0,
    force: bool = False,
    **settings: Any,
) -> Path:
    """Simulate the tests of a plan, write a log of each and the manifest `plan.toml` into `folder`; returns the manifest's path.

    `plant`: what is tested; `tests`: names, by default all; `tracking`: see `TrackingMode`. `settings` go to `simulate_batch`
    (sensors, controller, rate, feedback …); with exact tracking only rate (Hz), sensors and progress mean something. Test
    number i takes the seed `seed` + i. Raises ConfigurationError for other joints or existing files."""
    return simulate_logs(plan, plant, Path(folder), tests, tracking, seed, force, settings)
