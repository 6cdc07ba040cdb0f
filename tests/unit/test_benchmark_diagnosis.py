"""The benchmark of the diagnosis: its counts by hand-made records, its oracle's measure, and the short run from end to end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_robots import pendulum

from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.estimators import WeightedLeastSquares
from ident.friction import Viscous
from ident.logs.log import Log, LogSet
from ident.problem.problem import Problem
from ident.signals import ZeroPhase

run = pytest.importorskip("benchmarks.diagnosis.run")
from benchmarks.diagnosis import arms, peers, world  # noqa: E402
from benchmarks.diagnosis import oracle as oracle_module  # noqa: E402
from benchmarks.diagnosis.counts import Rate, Requirement, confusion, named_as, requirements  # noqa: E402
from benchmarks.diagnosis.drive import SampledDrive  # noqa: E402
from benchmarks.diagnosis.feedback.suite import Setup  # noqa: E402
from benchmarks.diagnosis.feedback.suite import generate as generate_setups  # noqa: E402
from benchmarks.diagnosis.generate import FINE_STEPS, NOISE, RATE, Case, faults, lane_of, settings, suite  # noqa: E402
from benchmarks.diagnosis.oracle import Gain, Oracle  # noqa: E402
from benchmarks.diagnosis.score import is_part, part_is_named, read_cases, right  # noqa: E402


def finding(effect: str, joint: str, confidence: float = 0.99, rivals: tuple[tuple[str, str, float], ...] = ()) -> dict[str, Any]:
    imitators = [{"effect": e, "joints": [j], "confidence": c} for e, j, c in rivals]
    return {"effect": effect, "joints": [joint], "confidence": confidence, "evidence": 50.0, "imitators": imitators, "motors": None}


def record(kind: str, verdict: str, findings: list[dict[str, Any]], named: list[dict[str, Any]] = (), **more: Any) -> dict[str, Any]:
    effects = {"single": ["stribeck"], "pair": ["stribeck", "offset"], "outside": ["knocks"], "clean": []}[kind]
    parts = [{"effect": e, "joints": [f"joint{i + 1}"], "truth": {}, "outside": kind == "outside"} for i, e in enumerate(effects)]
    seen = {"gain": 500.0, "error": 50.0, "detectable": True, "after": 1.0}
    return {
        "id": f"{kind}_{verdict}", "arm": "scara", "kind": kind, "parts": parts, "size": [1.0] * len(parts), "verdict": verdict,
        "findings": findings, "named": list(named), "oracle": [dict(seen) for _ in parts], "unexplained": [], "coverage": [],
        "before": [2.0, 2.0], "after": [1.0], "reported_floor": [1.0], "seconds": 1.0, "wall_seconds": 1.0, **more,
    }  # fmt: skip


def by_title(records: list[dict[str, Any]]) -> dict[str, Requirement]:
    return {r.title: r for r in requirements(records)}


def test_an_ambiguous_finding_counts_only_where_the_rival_does_as_well():
    assert part_is_named({"how": "found", "as_good": None})
    assert part_is_named({"how": "rival", "as_good": True})
    assert part_is_named({"how": "found, ambiguous", "as_good": True})
    for how in ("found, ambiguous", "rival"):
        assert not part_is_named({"how": how, "as_good": False})
        assert not part_is_named({"how": how, "as_good": None}), "what could not be compared does not count"
    assert not part_is_named({"how": "no", "as_good": None})


def test_single_faults():
    good = record("single", "explained", [finding("stribeck", "joint1")], [{"how": "found", "finding": 0, "as_good": None}])
    other = {"how": "found", "finding": 1, "as_good": None}
    second = record(
        "single", "explained", [finding("offset", "joint2"), finding("stribeck", "joint1")], [other]
    )  # fmt: skip
    hidden = record("single", "explained", [finding("offset", "joint2")], [{"how": "no", "finding": None, "as_good": None}])
    hidden["oracle"][0]["detectable"] = False
    failed = {**record("single", "", []), "failed": "ValueError()"}
    named_rightly = {**good, "oracle": hidden["oracle"]}
    unseen = by_title([named_rightly, hidden])["single, not to be seen: never another name"]
    assert (unseen.hits, unseen.count) == (1, 2), "a right name is no other name"
    found = by_title([good, second, hidden, failed])
    assert (found["single: top finding right"].hits, found["single: top finding right"].count) == (1, 3)
    assert found["single: nothing spurious beside it"].hits == 1
    assert (found["single, not to be seen: never another name"].hits, found["single, not to be seen: never another name"].count) == (0, 1)
    assert right(good) == {"top": True, "only": True, "all": True}
    assert right(second) == {"top": False, "only": False, "all": False}
    assert confusion([good, second, hidden, failed]) == {"stribeck": {"stribeck": 1, "offset": 1, "failed": 1}}
    assert named_as(record("single", "unexplained", [])) == "unexplained"


def test_an_ambiguous_verdict_without_a_rival_is_counted_apart():
    one = [finding("stribeck", "joint1")]
    found = by_title(
        [
            record("single", "explained", one, [{"how": "found", "finding": 0, "as_good": None}]),
            record("single", "ambiguous", one, [{"how": "found", "finding": 0, "as_good": None}]),
            record("single", "ambiguous", one, [{"how": "found, ambiguous", "finding": 0, "as_good": True}]),
            record("single", "ambiguous", one, [{"how": "found, ambiguous", "finding": 0, "as_good": False}]),
        ]
    )
    assert (found["single: top finding right"].hits, found["… ambiguous verdicts only with a rival"].hits) == (3, 2)


def test_clean_outside_and_pairs():
    both = [{"how": "found", "finding": k, "as_good": None} for k in (1, 0)]
    same = [{"how": "found", "finding": 0, "as_good": None}, {"how": "rival", "finding": 0, "as_good": True}]
    two = [finding("offset", "joint2"), finding("stribeck", "joint1")]
    found = by_title(
        [
            record("clean", "clean", [], before=[1.0, 1.1]),
            record("clean", "unexplained", [], before=[1.1, 1.0]),
            record("outside", "clean", [], before=[1.05, 1.05]),
            record("outside", "clean", [], before=[1.0, 1.2]),
            record("outside", "unexplained", [finding("stribeck", "joint1", 0.4)]),
            record("outside", "ambiguous", [finding("stribeck", "joint1", 0.6)]),
            record("outside", "explained", [finding("stribeck", "joint1", 0.9)]),
            record("pair", "explained", two, both),
            record("pair", "explained", [*two, finding("delay", "joint1")], both),
            record("pair", "ambiguous", two, same),
        ]
    )
    assert found["clean: false alarms"].hits == 1, "structure said to be unexplained is an alarm, too"
    traced, every = found["outside: unexplained or ambiguous"], found["… of all of them, traced or not"]
    assert (traced.hits, traced.count, every.hits, every.count) == (2, 4, 2, 5), "one lies below what clean logs show"
    assert found["outside: a name above one half"].hits == 2
    assert (found["pairs: both and only both"].hits, found["pairs: both and only both"].count) == (1, 3)
    hidden = record("pair", "explained", two[:1], both[:1])
    hidden["oracle"][1]["detectable"] = False
    found = by_title([hidden, record("pair", "explained", two, both)])
    assert (found["pairs: both and only both"].count, found["… of all pairs"].count) == (1, 2)


def test_too_few_cases_meet_nothing():
    assert Requirement("", "", 10, 10, 0.97, least=300).met is None
    assert Requirement("", "", 300, 300, 0.97, least=300).met is True
    assert Requirement("", "", 290, 300, 0.97, least=300).met is False
    assert Requirement("", "", 3, 200, 0.01, most=True, least=200).met is False
    # 93 of 100 intervals of 95 %: chance.
    assert Rate("", "", 93, 100, 0.95, least=100).met is True
    assert Rate("", "", 85, 100, 0.95, least=100).met is False
    low, high = Requirement("", "", 0, 200).interval
    assert (low, high) == (0.0, pytest.approx(1 - 0.025 ** (1 / 200)))


def test_couplings_are_told_apart_by_their_motor():
    part = {"effect": "gear_coupling", "joints": ["a"], "truth": {"motor": 1.0}}
    assert is_part("gear_coupling", ["a"], ["b"], part, ["a", "b", "c"])
    assert not is_part("gear_coupling", ["a"], ["c"], part, ["a", "b", "c"])
    assert not is_part("gear_coupling", ["b"], ["b"], part, ["a", "b", "c"])


def test_a_gain_beyond_chance():
    rng = np.random.default_rng(1)
    # Large in one block only: chance. In every block, however unevenly: not.
    assert not Gain.of(np.r_[50.0, rng.normal(size=11)]).clear
    assert Gain.of(np.r_[50.0, 1.0 + rng.random(11)]).clear
    assert Gain.of(np.r_[1000.0, rng.normal(size=11)]).clear, "more than any colour of the noise makes"
    assert not Gain.of(np.full(12, 0.5)).clear, "certain, but too small"
    null = [Gain.of(rng.normal(size=12) * rng.exponential(size=12)).chance for _ in range(400)]
    assert np.mean(np.array(null) < 0.1) == pytest.approx(0.1, abs=0.05)


def test_suites_have_the_cases_that_are_asked_for():
    kinds = [c.kind for c in suite("final")]
    assert {k: kinds.count(k) for k in set(kinds)} == {"single": 444, "outside": 96, "pair": 80, "clean": 204}
    assert {c.seed for c in suite("final", 9000)}.isdisjoint(c.seed for c in suite("final"))


def test_every_fault_says_what_it_is():
    from benchmarks.diagnosis.arms import arm
    from benchmarks.diagnosis.faults import FAULTS, OUTSIDE
    from ident.effects.registry import effect_names

    a = arm("puma560")
    for name in (*FAULTS, *OUTSIDE):
        made = faults(a, Case("puma560", ((name, 4, 1.0),), 3, "single"))
        if made is not None:
            assert made[0].outside == (name in OUTSIDE)
            assert made[0].outside or made[0].effect in effect_names()


def test_short_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.main(True, tmp_path) == 0
    out = tmp_path / "diagnosis"
    kept = json.loads((out / "diagnosis.json").read_text())
    results = {r["kind"]: r for r in kept["results"]}
    assert set(results) == {"clean", "single", "pair", "outside"}
    assert not any("failed" in r for r in results.values())
    assert results["clean"]["verdict"] == "clean"
    assert right(results["single"])["top"]
    assert results["single"]["oracle"][0]["detectable"]
    assert results["single"]["after"][0] < 0.2 * results["single"]["before"][0]
    for name in kept["figures"]:
        assert (out / name).read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    assert "Definitions" in said
    assert "too few" in said
    # A second run takes what is there.
    stamp = (out / "results.jsonl").stat().st_mtime_ns
    assert run.main(True, tmp_path) == 0
    assert (out / "results.jsonl").stat().st_mtime_ns == stamp


def test_truth_and_rival_count_at_their_better_refit_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """One law may be right near reversals and the other not; each is refitted with those rows and without."""
    left = {("all", "truth"): 1.0, ("few", "truth"): 1.2, ("all", "rival"): 3.0, ("few", "rival"): 1.0}
    refits = []

    class Solver:
        def solve(self, problem: tuple[str, str]) -> tuple[str, str]:
            refits.append(problem)
            return problem

    monkeypatch.setattr(oracle_module.es, "WeightedLeastSquares", Solver)
    monkeypatch.setattr(oracle_module, "without_reversals", lambda signals: "few")
    monkeypatch.setattr(oracle_module, "Problem", lambda model, signals, reference: (signals, model.effect))
    monkeypatch.setattr(oracle_module, "residual", lambda estimate, held: np.full((120, 1), left[estimate]))

    class Law:
        def __init__(self, name: str) -> None:
            self.joints = (name,)

        def parameters(self, robot: Any) -> tuple[Any, ...]:
            return ()

        def response(self, robot: Any) -> None:
            return None

    class Declared:
        robot = None

        def __add__(self, effect: Any) -> Any:
            return SimpleNamespace(robot=None, effect=effect.joints[0])

    found = SimpleNamespace(before=SimpleNamespace(model=Declared(), all_values=np.zeros(2)))
    held: Any = SimpleNamespace(row_runs=(slice(0, 120),))
    every: Any = "all"
    judge: Any = Oracle(found, every, held, np.ones(1))
    told = judge.as_good(Law("rival"), Law("truth"))
    assert told["as_good"]
    assert told["gain"] == 0.0
    # Over a floor that is too low by ten the residuals are ten times as large, and the gain is what it was.
    far: Any = Oracle(found, every, held, np.full(1, 0.1))
    left["few", "rival"] = 1.1
    near, low = (x.gain([Law("rival")], [Law("truth")]).gain for x in (Oracle(found, every, held, np.ones(1)), far))
    assert near == pytest.approx(low) == pytest.approx(120 * 0.21)
    assert sorted(refits[:4]) == [("all", "rival"), ("all", "truth"), ("few", "rival"), ("few", "truth")]


def test_the_truth_is_handed_over_with_the_response_that_its_shape_says() -> None:
    """A limit that only the held-out part reaches: the fitted part says nothing of the response, so that a fit leaves it at zero; but one
    who knows that the reading is cut off knows by how much."""
    robot = pendulum()
    model, values = robot.rigid_body() + Viscous(), np.append(robot.nominal, 0.5)
    t = np.arange(2000) / 200.0
    rng = np.random.default_rng(3)
    noise, limit = 0.01, 0.0
    parts = []
    for width in (0.3, 1.2):
        q = width * (np.sin(2.0 * t) + 0.5 * np.sin(5.0 * t + 1.0))[:, None]
        dq = width * (2.0 * np.cos(2.0 * t) + 2.5 * np.cos(5.0 * t + 1.0))[:, None]
        ddq = -width * (4.0 * np.sin(2.0 * t) + 12.5 * np.sin(5.0 * t + 1.0))[:, None]
        tau = model.torque(Motion.of(robot, q, dq, ddq), values)
        limit = limit or 1.2 * float(np.abs(tau).max())
        reading = np.clip(tau, -limit, limit) + noise * rng.normal(size=tau.shape)
        logs = LogSet((Log("run", t, q=q, tau={robot.transmission.measured.value: reading}),), robot=robot)
        parts.append(ZeroPhase(cutoff_hz=20.0)(logs))
        assert (np.abs(tau).max() > limit) == (width > 1.0)
    fit, held = parts
    before = WeightedLeastSquares().solve(Problem(model, fit))
    judge = Oracle(SimpleNamespace(before=before), fit, held, np.array([noise]))
    truth = make_effect("saturation", limit=limit, clipped="log")
    gain = judge.gain([], [truth])
    assert gain.clear
    left = np.sqrt(np.nanmean(judge.with_effects([truth]) ** 2))
    assert left < 0.1 * np.sqrt(np.nanmean(judge.with_effects([]) ** 2))
    # What its shape says nothing of is left to the fit.
    assert judge._responding(before, [make_effect("offset")], fit) is None


@pytest.mark.parametrize(("name", "joint"), [("ur5", 2), ("scara", 0)])
def test_a_gear_with_play_is_simulated_in_steps_fine_enough(name: str, joint: int) -> None:
    """On an arm whose other joints give way link and rotor are light against each other: in steps too coarse for the flank's damping both
    shook at half the step's rate (what was logged of a UR5's elbow was a fifth off, whatever the gap)."""
    arm = arms.arm(name)
    case = Case(arm.name, (("backlash", joint, 0.5),), 21, "single", 1.5)
    (fault,) = faults(arm, case) or ()
    coarse, fine = (world.simulate(arm, [lane_of(arm, case, [fault])], 1.5, RATE, n)[0] for n in (FINE_STEPS, 4 * FINE_STEPS))
    noise = NOISE * settings(arm, case)[1]
    later = coarse.t > 0.5
    off = np.abs(coarse.torque - fine.torque)[later] / noise
    assert np.quantile(off, 0.95) < 0.1
    # What moves it is the same; between its flanks the link is in no other place than at one of them, or on its way.
    apart = coarse.q[:, joint] - coarse.phi[:, joint] / arm.robot.transmission.K_inverse[joint, joint]
    assert np.abs(apart).max() < 0.6 * fault.truth["gap"]


def test_a_sampled_drive_does_what_an_ideal_one_does_but_for_its_counts_and_its_restless_friction() -> None:
    arm = arms.arm("leg.trapezoid")
    lanes = [lane_of(arm, Case(arm.name, (), 31, "clean", 4.0), [])]
    ideal = world.simulate(arm, lanes, 4.0, 1000.0, 2)[0]
    fine, restless = (
        world.simulate(arm, lanes, 4.0, 1000.0, 2, SampledDrive(2000.0, 1e7, 1e-4, 1e-4, share, 0.05))[0] for share in (0.0, 0.2)
    )
    reach = np.ptp(ideal.q, axis=0)
    assert np.all(np.abs(fine.q - ideal.q).max(axis=0) < 2e-3 * reach)
    assert not ideal.restless.any()
    assert not fine.restless.any()
    moving = np.abs(np.gradient(ideal.phi, ideal.t, axis=0)) > 0.1
    for j in range(arm.robot.n):
        share = restless.restless[moving[:, j], j] / arm.drive["Fc"][j]
        assert 0.1 < share.std() < 0.3


def test_setups_under_feedback_come_with_logs_of_their_own_rate_and_what_disturbs_them(tmp_path: Path) -> None:
    drawn = next(s for k in range(100) if (s := Setup.drawn(k)).arm.startswith("direct_drive") and s.reference and not s.jitter)
    setup = replace(drawn, seconds=4.0)
    generate_setups(tmp_path, [setup], {"clean": 1, "single": 1, "pair": 0, "outside": 1})
    generate_setups(tmp_path, [setup], {"clean": 1, "single": 1, "pair": 0, "outside": 1})
    records = read_cases(tmp_path)
    assert sorted(r["kind"] for r in records) in (["clean", "outside", "single"], ["clean", "single"], ["clean", "outside"])
    for r in records:
        with np.load(tmp_path / f"{r['id']}.npz") as log:
            assert np.allclose(np.diff(log["t"]), 1.0 / setup.rate)
            assert log["q"].shape == log["tau"].shape == log["noise"].shape == log["q_ref"].shape == (len(log["t"]), 2)
            assert np.all(log["noise"].std(axis=0) < 0.2 * log["tau"].std(axis=0))


def test_other_ways_are_counted_on_the_same_cases(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = next(s for k in range(100) if (s := Setup.drawn(k)).arm.startswith("direct_drive") and s.reference and not s.jitter)
    generate_setups(tmp_path, [replace(drawn, seconds=8.0)], {"clean": 1, "single": 0, "pair": 0, "outside": 0})
    (made,) = read_cases(tmp_path)
    results = tmp_path / "results.jsonl"
    results.write_text(json.dumps({**made, "verdict": "clean", "findings": [], "seconds": 1.0}) + "\n")
    monkeypatch.setattr("sys.argv", ["peers", str(tmp_path), str(results)])
    peers.main()
    told = capsys.readouterr().out
    (row,) = (line for line in told.splitlines() if line.startswith("| clean: named nothing"))
    ours, *others = (cell.strip() for cell in row.strip("|").split("|")[1:])
    assert ours == "1 of 1"
    assert len(others) == len(peers.PEERS)
    assert set(others) <= {"0 of 1", "1 of 1"}
