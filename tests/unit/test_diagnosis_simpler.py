"""A simpler law stands where the data do not ask for what a general one adds; a period that was not seen is no law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis_parts import rebuilt, stage_of

from ident.diagnosis.acceptance import Found
from ident.diagnosis.bank import Bank
from ident.diagnosis.candidates import Candidate, candidates
from ident.diagnosis.search import Search
from ident.diagnosis.selection import Selection
from ident.diagnosis.simpler import simplified
from ident.diagnosis.spectral import period_unseen
from ident.effects.base import Effect, make_effect


def selected(seed: int, true: str, sizes: list[float], first: str, second: str, twin: str = "") -> Selection:
    """The first of two laws as the finding and the second as its rival, on a log that holds the true one of joint j2. `twin`: a name under
    which the second is a rival once more, of little weight."""
    begun, white = stage_of(seed, [], [make_effect(true, joints="j2")], sizes)
    effects: list[Effect] = [make_effect(name, joints="j2") for name in (first, second, *([second] if twin else []))]
    names = (first, second, twin)
    hits = [begun.search.hit(Candidate(name, ("j2",), (e,)), e) for name, e in zip(names, effects, strict=False)]
    judged = [begun.search.judge(h) for h in hits]
    final = rebuilt(begun.problem.model, begun.problem.signals, white, [effects[0]])
    among = candidates(final.problem.model, final.motions)
    final = replace(final, search=Search(final.frame, final.motions, among, Bank()))
    return Selection(begun, final, (Found(judged[0], tuple(judged[1:]), np.array([0.8, 0.2, 0.0][: len(judged)])),))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("order", [("nonlinear_spring", "linear_spring"), ("linear_spring", "nonlinear_spring")])
def test_a_linear_spring_is_not_called_a_nonlinear_one(seed: int, order: tuple[str, str]) -> None:
    """Whichever of the two stands there, and whatever held-out data were thought to say."""
    found = simplified(selected(seed, "linear_spring", [0.6, 0.1], *order), Bank())
    assert [f.effect.name for f in found.found] == ["linear_spring"]
    assert [e.name for e in found.final.problem.model.effects][-1] == "linear_spring"
    assert found.found[0].weight > 0.66
    assert found.found[0].weights.sum() == pytest.approx(1.0)


def test_what_does_as_well_as_the_simple_law_is_its_rival_again() -> None:
    """The general law's other terms had outdone both."""
    (found,) = simplified(selected(0, "linear_spring", [0.6, 0.1], "nonlinear_spring", "linear_spring", "twin"), Bank()).found
    assert [found.effect.name, *(r.hit.candidate.name for r in found.rivals)] == ["linear_spring", "nonlinear_spring", "twin"]
    # A linear spring is twice as common as what is not listed.
    assert found.weights[2] == pytest.approx(0.5 * found.weights[0])
    assert found.weights.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_nonlinear_spring_stays_what_it_is(seed: int) -> None:
    before = selected(seed, "nonlinear_spring", [0.1, 0.2, 0.3, 0.3], "nonlinear_spring", "linear_spring")
    after = simplified(before, Bank())
    assert after.final is before.final
    assert after.found == before.found


@pytest.mark.parametrize("seed", range(2))
def test_laws_that_do_not_hold_one_another_are_left_alone(seed: int) -> None:
    before = selected(seed, "linear_spring", [0.6, 0.1], "linear_spring", "asymmetric_viscous")
    assert simplified(before, Bank()).found == before.found


def test_a_period_of_which_little_was_seen() -> None:
    stage, _ = stage_of(3, [], [make_effect("asymmetric_viscous", joints="j1")], [0.1])
    span = float(np.ptp(stage.motions.parts[0][1].joint.q[:, 0]))

    def unseen(effect: Effect) -> bool:
        return period_unseen(effect, stage.frame, stage.motions)

    for turned, expected in ((0.5, True), (0.95, True), (1.05, False), (6.0, False)):
        effect = make_effect("position_dependent_friction", joints="j1", order=turned / span, angle="joint")
        assert unseen(effect) is expected
    assert not unseen(make_effect("stribeck", joints="j1", v_s=1.0))
    assert not unseen(make_effect("offset", joints="j1"))
