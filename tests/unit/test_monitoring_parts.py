"""Parts of monitoring by themselves: what a change says, where it sits, and what stays unexplained."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ident import make_effect
from ident.effects.places import motors_of, on, place_of
from ident.monitoring import Change, ChangedParameter, How
from ident.monitoring.left import crowds, loud, loudness, trust
from ident.monitoring.stages.findings import Finding, Imitator


def change(effect: str, values: dict[str, tuple[float, float, float | None]], how: How = How.CHANGED, **more) -> Change:
    parameters = tuple(ChangedParameter(name, value, std, "N m", before) for name, (value, std, before) in values.items())
    made = make_effect(effect, joints=("elbow",), **more)
    return Change(
        effect=made, joints=("elbow",), parameters=parameters, heldout_gain=0.5, evidence=100.0, confidence=0.9,
        imitators=(Imitator("offset", ("elbow",), 0.05),), how=how,
    )  # fmt: skip


def test_places():
    coupling = make_effect("gear_coupling", joints=("j6",), motors=("j5",))
    assert place_of(coupling) == "j6 (motor of j5)"
    assert on(place_of(coupling)) == " on j6 (motor of j5)"
    assert motors_of(coupling) == ("j5",)
    assert place_of(make_effect("offset", joints=("a", "b"))) == "a, b"
    assert on(place_of(make_effect("base_tilt"))) == ""
    assert motors_of(make_effect("viscous")) == ()


@pytest.mark.parametrize(
    ("value", "before", "text"),
    [
        (0.2, 0.5, "grew by 0.2 ± 0.01 N m (40 %), from 0.5 to 0.7"),
        (-0.2, 0.5, "fell by 0.2 ± 0.01 N m (40 %), from 0.5 to 0.3"),
        (-0.2, -0.5, "grew by 0.2 ± 0.01 N m (40 %), from -0.5 to -0.7"),
        (0.2, 0.0, "grew by 0.2 ± 0.01 N m, from 0 to 0.2"),
    ],
)
def test_a_change_of_one_parameter_in_words(value, before, text):
    found = change("viscous", {"Fv_elbow": (value, 0.01, before)})
    assert str(found) == f"{found.effect.title} on elbow {text}"
    if before:
        assert found.brief == f"{found.effect.title} on elbow {text.split()[0]} by 40 %"


def test_what_appeared_names_what_is_determined():
    found = change("stribeck", {"Fs_elbow": (0.3, 0.01, None), "v_s": (0.1, np.inf, None)}, How.APPEARED)
    assert str(found).endswith("on elbow appeared: Fs_elbow = 0.3 ± 0.01 N m …")
    assert "(not determined)" in str(found.parameters[1])
    assert found.to_dict()["parameters"][1] == {"name": "v_s", "value": 0.1, "std": None, "unit": "N m", "before": None, "after": None}


def test_a_change_is_a_finding():
    found = change("viscous", {"Fv_elbow": (0.2, 0.01, 0.5)})
    assert isinstance(found, Finding)
    assert not found.ambiguous
    told = found.to_dict()
    assert told["how"] == "changed"
    assert "advice" not in told
    assert "motors" not in told
    assert told["parameters"][0]["after"] == pytest.approx(0.7)
    assert change("gear_coupling", {"K": (0.1, 0.01, None)}, motors=("wrist",)).to_dict()["motors"] == ["wrist"]


def frame_of(residual: np.ndarray) -> SimpleNamespace:
    """What the tests of size look at: whitened residuals (n, M), all rows in use."""
    n, rows = residual.shape
    signals = SimpleNamespace(valid=np.ones((rows, n), bool))
    return SimpleNamespace(
        residual=residual, columns=np.zeros((n, rows, 1)), problem=SimpleNamespace(signals=signals), freedom=lambda joints: rows // 2
    )


def test_a_residual_as_usual_is_not_loud():
    rng = np.random.default_rng(0)
    residual = rng.normal(size=(3, 800))
    residual[1] *= 1.3  # another motion makes that much of an inexact model
    residual[2] *= 3.0
    assert loudness(frame_of(residual)) == pytest.approx([1.0, 1.3, 3.0], rel=0.1)
    assert loud(frame_of(residual)).tolist() == [False, False, True]
    # Few rows: chance alone makes a residual twice as large.
    assert not loud(frame_of(2.0 * np.ones((1, 4)))).any()
    absent = frame_of(np.zeros((1, 4)))
    absent.problem.signals.valid[:] = False
    assert loudness(absent).tolist() == [1.0]


def test_what_leaves_much_is_not_believed():
    rng = np.random.default_rng(0)
    frame = frame_of(np.stack([rng.normal(size=800), 3.0 * rng.normal(size=800)]))
    first, second = np.array([True, False]), np.array([False, True])
    assert trust(frame, first, 50.0) == 1.0
    assert trust(frame, second, 500.0) < 0.05
    assert trust(frame, second, 1e6) > 0.99


def test_too_many_new_effects_on_one_joint_are_none():
    effects = [make_effect(name, joints=("elbow",)) for name in ("offset", "linear_spring")]
    assert crowds(effects) == ()
    (found,) = crowds([*effects, make_effect("asymmetric_viscous", joints=("elbow",)), make_effect("offset", joints=("wrist",))])
    assert found.joint == "elbow"
    assert "3 effects" in found.evidence
    assert found.to_dict()["signature"] == "several effects at once"
