"""Simulated logs of a plan: every test as a run, all runs at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..simulation.plant import Plant
    from . import Plan

#: Tests are slow; so many of them need not be integrated finely.
_DEFAULTS: dict[str, Any] = {"rate": 250.0, "control_rate": 500.0, "step": 2e-3}


def simulate_logs(
    plan: Plan, plant: Plant, folder: Path, names: Sequence[str] | None, seed: int, force: bool, settings: Mapping[str, Any]
) -> Path:
    """Simulate, write logs and manifest; the manifest's path."""
    from ..simulate import simulate_batch
    from .manifest import write_manifest

    if plant.robot.joint_names != plan.joints:
        raise ConfigurationError(
            f"the plan is for joints {', '.join(plan.joints)}, but the robot has {', '.join(plant.robot.joint_names)}."
        )
    tests = plan.tests if names is None else tuple(plan.test(name) for name in names)
    if not tests:
        raise ConfigurationError("the plan holds no test.")
    folder.mkdir(parents=True, exist_ok=True)
    taken = [folder / name for name in ("plan.toml", *(t.log for t in tests)) if (folder / name).exists()]
    if taken and not force:
        raise ConfigurationError(f"{taken[0]} exists; nothing was written. Choose another folder, or allow overwriting (--force).")
    desired = [plan.trajectory(test)[0] for test in tests]
    places = [plan.tests.index(test) for test in tests]
    runs = simulate_batch(plant, desired=desired, seeds=[seed + i for i in places], **{**_DEFAULTS, **settings})
    for test, way, run in zip(tests, desired, runs, strict=True):
        run.until(way.duration).to_csv(folder / test.log, force=force)
    return write_manifest(plan, folder / "plan.toml", force=force)
