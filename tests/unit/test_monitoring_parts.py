"""Parts of monitoring by themselves: what a change says, and where it sits."""

from __future__ import annotations

import numpy as np
import pytest

from ident import make_effect
from ident.diagnosis import CompetingModel, Finding
from ident.effects.places import motors_of, on, place_of
from ident.monitoring import Change, ChangedParameter, How


def change(effect: str, values: dict[str, tuple[float, float, float | None]], how: How = How.CHANGED, **more) -> Change:
    parameters = tuple(ChangedParameter(name, value, std, "N m", before) for name, (value, std, before) in values.items())
    made = make_effect(effect, joints=("elbow",), **more)
    return Change(
        effect=made, joints=("elbow",), parameters=parameters, heldout_gain=0.5, evidence=100.0, confidence=0.9,
        competing=(CompetingModel("offset", ("elbow",), 0.05),), how=how,
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
