"""How often the intervals of fits without torque hold a known truth, what is said to be undetermined, and how near the values are.

Truth is played by the compiled integrator with exact friction events and a drive of 100 kHz, which no fit uses.
`python -m benchmarks.actuators.coverage SO-101 --first 2100 --rates 200` counts one robot at one rate, on seeds of its own."""

from __future__ import annotations

import argparse
import json
import re
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.determined import Standing
from ident.logs.log import LogSet
from ident.robots.library.nominal import nominal_values

from .commanded import DRIVE_HZ, PENDULUM, commanded_log

IIWA = Path(__file__).parents[1] / "excitation/iiwa14.urdf"
EFFECTS = ("rotor_inertia", "viscous", "coulomb", "offset")
RATES = (50, 200, 500)
SECONDS, NOISE = 5.0, 5e-4
#: What stands for the delay's interval by profile likelihood among the values.
PROFILE = "delay by profile"


def chain(name: str, links: list[tuple[str, float, tuple[float, float, float], tuple[float, float, float]]]) -> str:
    """A URDF of revolute joints in a row; each link: axis, mass, centre of mass, place of the next joint. Links are rods along it."""
    parts, place = [f'<robot name="{name}"><link name="base"/>'], (0.0, 0.0, 0.0)
    for i, (axis, mass, centre, after) in enumerate(links, start=1):
        long = mass * float(np.dot(after, after)) / 12.0 + 2e-4 * mass
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="{" ".join(map(str, centre))}"/><mass value="{mass}"/>'
            f'<inertia ixx="{long}" ixy="0" ixz="0" iyy="{long}" iyz="0" izz="{long}"/></inertial></link>'
            f'<joint name="joint{i}" type="revolute"><origin xyz="{" ".join(map(str, place))}"/>'
            f'<parent link="{"base" if i == 1 else f"l{i - 1}"}"/>'
            f'<child link="l{i}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="300" velocity="50"/></joint>'
        )
        place = after
    return "".join(parts) + "</robot>"


#: A leg as a Go2 has it, hung in the air; a servo arm of the size of an SO-101.
LEG = chain(
    "leg",
    [
        ("1 0 0", 0.68, (-0.005, 0.0, 0.0), (0.0, 0.095, 0.0)),
        ("0 1 0", 1.15, (-0.004, -0.02, -0.033), (0.0, 0.0, -0.213)),
        ("0 1 0", 0.24, (0.005, 0.0, -0.12), (0.0, 0.0, -0.213)),
    ],
)
ARM = chain(
    "arm",
    [
        ("0 0 1", 0.15, (0.0, 0.0, 0.03), (0.03, 0.0, 0.055)),
        ("0 1 0", 0.11, (0.03, 0.0, 0.06), (0.028, 0.0, 0.113)),
        ("0 1 0", 0.10, (0.07, 0.0, 0.005), (0.135, 0.0, 0.005)),
        ("0 1 0", 0.09, (0.03, 0.0, 0.0), (0.06, 0.0, 0.0)),
        ("1 0 0", 0.09, (0.02, 0.01, 0.0), (0.04, 0.0, 0.0)),
        ("0 0 1", 0.03, (0.03, 0.02, 0.0), (0.06, 0.0, 0.0)),
    ],
)


@dataclass(frozen=True)
class Machine:
    """A robot with usual sizes of its drives' constants, (n,) each; those of a log differ from them by up to 30 %."""

    name: str
    urdf: str
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    Ia: tuple[float, ...]
    Fv: tuple[float, ...]
    Fc: tuple[float, ...]

    def robot(self) -> ident.Robot:
        """The robot of the URDF."""
        return ident.Robot.from_urdf(self.urdf)

    def truth(self, seed: int) -> dict[str, Any]:
        """True constants of one log."""
        rng = np.random.default_rng([11, seed])
        out: dict[str, Any] = {
            key: np.array(getattr(self, key)) * rng.uniform(0.7, 1.3, len(self.kp)) for key in ("kp", "kd", "Ia", "Fv", "Fc")
        }
        out["offset"] = rng.uniform(0.2, 0.5, len(self.kp)) * np.array(self.Fc) * rng.choice([-1.0, 1.0], len(self.kp))
        out["delay"] = 1e-5 * round(1e5 * rng.uniform(0.003, 0.009))
        return out


MACHINES = (
    Machine("pendulum", PENDULUM, (25.0,), (0.8,), (0.012,), (0.08,), (0.15,)),
    Machine("Go2-like leg", LEG, (20.0, 20.0, 40.0), (1.0, 1.0, 2.0), (0.01, 0.012, 0.03), (0.12, 0.12, 0.25), (0.2, 0.2, 0.6)),
    Machine("SO-101-like arm", ARM, (15.0,) * 6, (0.4,) * 6, (0.02,) * 6, (0.3,) * 6, (0.06,) * 6),
    Machine(
        "7-joint arm", str(IIWA), (900.0, 900.0, 600.0, 600.0, 300.0, 200.0, 100.0), (40.0, 40.0, 25.0, 25.0, 10.0, 6.0, 3.0),
        (1.5, 1.5, 1.0, 1.0, 0.4, 0.3, 0.2), (12.0, 12.0, 8.0, 8.0, 3.0, 2.0, 1.2), (6.0, 6.0, 4.0, 4.0, 2.0, 1.5, 1.0),
    ),
)  # fmt: skip
GAINS = {"known": {}, "unknown": {"kp": "identify", "kd": "identify"}}
#: What may be asked for besides: the links' own parameters under known gains, as of a load that nobody weighed.
SETTINGS = {**GAINS, "links": {"links": "identify"}}


@dataclass(frozen=True)
class Counted:
    """One fit against its truth: (what, error in standard deviations, error as a share or in samples) of everything that has a value;
    names that are undetermined by physics but have a value, and those that are not (nor zero) but are said to be confounded; unseen ones;
    warnings of stretches that are none (`told`); what has a bound (`bounded`), and what of it is beyond its bound in truth (`beyond`)."""

    values: tuple[tuple[str, float, float], ...]
    missed: tuple[str, ...]
    invented: tuple[str, ...]
    unseen: tuple[str, ...]
    seconds: float
    told: tuple[str, ...] = ()
    bounded: tuple[str, ...] = ()
    beyond: tuple[str, ...] = ()


def one(machine: Machine, gains: str, rate: int, seed: int) -> Counted:
    """Simulate one log, fit it, and compare."""
    robot, truth = machine.robot(), machine.truth(seed)
    log = commanded_log(robot, truth, seed=seed, seconds=SECONDS, rate=rate, noise=NOISE, before=1.0)
    model = robot.rigid_body()
    for effect in EFFECTS:
        model = model + ident.make_effect(effect)
    given = {"kp": list(truth["kp"]), "kd": list(truth["kd"]), **SETTINGS[gains]}
    begin = time.process_time()
    fit = fit_drives(LogSet((log,)), model, DriveLaw.of(robot, **given))
    return counted(fit, truth, 1.0 / rate, time.process_time() - begin)


def counted(fit: DriveFit, truth: dict[str, Any], period: float, seconds: float) -> Counted:
    """Everything that has a value, against the truth."""
    true = {f"{key}_{joint}": np.ones(fit.model.robot.n)[j] * np.broadcast_to(truth[key], fit.model.robot.n)[j]
            for key in ("kp", "kd", "Ia", "Fv", "Fc", "offset") for j, joint in enumerate(fit.model.robot.joint_names)}  # fmt: skip
    true["delay"] = truth["delay"]
    true |= dict(zip(fit.model.names, nominal_values(fit.model), strict=True)) | true
    # The truth's drive holds its readings for 1/DRIVE_HZ: late by half of that, its kp damps less, and its kd takes inertia off.
    for joint in fit.model.robot.joint_names:
        true[f"Fv_{joint}"] -= true[f"kp_{joint}"] / (2 * DRIVE_HZ)
        true[f"Ia_{joint}"] -= true[f"kd_{joint}"] / (2 * DRIVE_HZ)
    decided = fit.determination
    assert decided is not None
    together = {u.name for u in fit.unknowns if u.place == "kd"} | {
        u.name for u in fit.unknowns if u.place == "viscous" and f"kd_{u.name.partition('_')[2]}" in fit.names
    }
    values, missed, invented, unseen = [], [], [], []
    for unknown, value, std, verdict in zip(fit.unknowns, fit.values, decided.std, decided.verdicts, strict=True):
        name = unknown.name
        if verdict == Standing.DETERMINED:
            if name in together:
                missed.append(name)
            real = _worth(unknown.expression or name, true)
            size = period if name == "delay" else abs(real)
            values.append((name, float((value - real) / std), float((value - real) / size)))
        elif verdict == Standing.CONFOUNDED and name not in together and _worth(unknown.expression or name, true):
            invented.append(name)
        elif verdict == Standing.UNSEEN:
            unseen.append(name)
    for c in decided.combinations:
        real = _worth(c.expression, true)
        values.append((c.expression, float((c.value - real) / c.std), float((c.value - real) / abs(real))))
    if "delay" in fit.names and decided.verdicts[fit.names.index("delay")] == Standing.DETERMINED:
        value, low, high = fit.delay_interval()["delay"]
        inside = low <= truth["delay"] <= high
        values.append((PROFILE, 0.0 if inside else np.inf, (value - truth["delay"]) / period))
    told = tuple(text for text in fit.warnings if "times the usual error" in text)
    bounds = {c.expression: c.below for c in decided.bounded}
    for unknown, below in zip(fit.unknowns, decided.below, strict=True):
        if unknown.name in unseen and np.isfinite(below):
            bounds[unknown.expression or unknown.name] = float(below)
    beyond = tuple(text for text, below in bounds.items() if abs(_worth(text, true)) > below)
    return Counted(tuple(values), tuple(missed), tuple(invented), tuple(unseen), seconds, told, tuple(bounds), beyond)


def _worth(expression: str, true: dict[str, float]) -> float:
    """What an expression of ours, of numbers and names, is in truth."""
    return float(eval(re.sub(r"(\d[\d.e+-]*) ([A-Za-z])", r"\1*\2", expression), {}, true))


def cases(
    only: str = "", gains: Sequence[str] = tuple(GAINS), rates: Sequence[int] = RATES, seeds: Sequence[int] = range(20)
) -> Iterator[tuple[Machine, str, int, int]]:
    """Machine, gains, rate and seed of each fit; `only`: a part of the machine's name."""
    for machine in MACHINES:
        for known in gains:
            for rate in rates:
                for seed in seeds if only in machine.name else ():
                    yield machine, known, rate, seed


def main(short: bool, folder: Path) -> None:
    """All of them; the short run has two seeds of the pendulum and the leg."""
    count(list(cases()) if not short else [c for c in cases(seeds=range(2)) if c[0] in MACHINES[:2]], folder)


def count(every: list[tuple[Machine, str, int, int]], folder: Path) -> None:
    """Print one line for each machine, gains and rate."""
    head = f"{'machine':<17}{'gains':<9}{'Hz':>4}{'fits':>6}{'values':>8}{'in 95 %':>9}{'delay':>8}{'missed':>8}{'invented':>10}"
    print(head + f"{'unseen':>8}{'beyond':>9}{'told':>6}{'Ia %':>7}{'Fv %':>7}{'Fc %':>7}{'kp %':>7}{'delay':>8}{'s':>7}")
    rows: dict[tuple[str, str, int], list[Counted]] = defaultdict(list)
    for i, (machine, gains, rate, seed) in enumerate(every):
        key = (machine.name, gains, rate)
        rows[key].append(one(machine, gains, rate, seed))
        if i + 1 == len(every) or (every[i + 1][0].name, *every[i + 1][1:3]) != key:
            print(line(key, rows[key]), flush=True)
            name = "_".join(map(str, key)).replace(" ", "_")
            (folder / f"actuator_coverage_{name}.json").write_text(json.dumps([asdict(r) for r in rows[key]]))
    print("in 95 %: values within 1.96 standard deviations of the truth; delay: its interval by profile likelihood; beyond: truths beyond")
    print("their 95 % bound; told: stretches said to be unlike the others, of which there are none; then median errors of values: Ia,")
    print("Fv (with kd where that is unknown), Fc, kp, and of the delay in samples; seconds of processor time a fit")


def line(key: tuple[str, str, int], found: list[Counted]) -> str:
    """One row of the table."""
    values = [v for one in found for v in one.values]
    plain = [v for v in values if v[0] != PROFILE]
    held = [v[1] == 0.0 for v in values if v[0] == PROFILE]

    def error(symbol: str) -> str:
        errors = [abs(e) for name, _, e in plain if name.split("_")[0] == symbol]
        return f"{100 * np.median(errors):>7.1f}" if errors else f"{'':>7}"

    late = [abs(e) for name, _, e in plain if name == "delay"]
    inside = np.mean([abs(s) < 1.96 for _, s, _ in plain])
    delay = f"{np.mean(held):>8.0%}" if held else f"{'':>8}"
    missed, invented, unseen, told = (sum(len(getattr(one, k)) for one in found) for k in ("missed", "invented", "unseen", "told"))
    spent = np.mean([one.seconds for one in found])
    beyond = f"{sum(len(one.beyond) for one in found)} of {sum(len(one.bounded) for one in found)}"
    counts = f"{len(found):>6}{len(plain):>8}{inside:>9.1%}{delay}{missed:>8}{invented:>10}{unseen:>8}{beyond:>9}{told:>6}"
    errors = "".join(error(symbol) for symbol in ("Ia", "Fv", "Fc", "kp"))
    return f"{key[0]:<17}{key[1]:<9}{key[2]:>4}{counts}{errors}{np.median(late) if late else np.nan:>8.3f}{spent:>7.1f}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("only", help="a part of the robot's name")
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--gains", nargs="*", choices=SETTINGS, default=tuple(GAINS))
    parser.add_argument("--rates", nargs="*", type=int, default=RATES)
    parser.add_argument("--folder", type=Path, default=Path())
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.count)
    count(list(cases(given.only, given.gains, given.rates, numbers)), given.folder)
