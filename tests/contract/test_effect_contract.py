"""The contract of effects, checked on every registered effect and on robots of every kind. A new effect is found by itself."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
import json
import math
import pickle
import pkgutil

import numpy as np
import pytest
from effect_robots import ROBOTS, chain, declared, motion_of

import ident
from ident.effects.base import Effect
from ident.effects.correction import SignalCorrection
from ident.effects.kinds import Axis, Nature, Need
from ident.effects.motion import Coordinates, Motion
from ident.effects.reference import Reference
from ident.effects.registry import effect_types, make_effect
from ident.errors import ConfigurationError
from ident.model import Model
from ident.robots.robot import Robot
from ident.robots.transmission import Side

TYPES = effect_types()
EVERY = pytest.mark.parametrize("name", list(TYPES))
EVERYWHERE = pytest.mark.parametrize("robot_name", list(ROBOTS))


@functools.cache
def case(robot_name: str) -> tuple[Robot, Motion]:
    robot = ROBOTS[robot_name]()
    motion = motion_of(robot, samples=240)
    for array in (motion.t, motion.load, motion.torque, *arrays(motion.joint), *arrays(motion.motor)):
        array.setflags(write=False)  # whoever writes into its input fails
    return robot, motion


def arrays(x: Coordinates) -> tuple[np.ndarray, ...]:
    return x.q, x.dq, x.ddq


def settled(name: str, robot: Robot, motion: Motion, share: float = 0.5, **configuration: object) -> Effect:
    """The effect with its shape parameters well inside the range worth searching on this motion."""
    effect = make_effect(name, **configuration)
    logarithmic = {p.name: p.log for p in effect.shape()}
    chosen = {}
    for key, (low, high) in effect.search_range(motion, robot).items():
        chosen[key] = low * (high / low) ** share if logarithmic[key] else low + share * (high - low)
    return effect.with_shape(**chosen)


def portion(motion: Motion, where: slice) -> Motion:
    """A piece of the run; the start of the run stays what it was."""
    cut = {f: Coordinates(*(x[where] for x in arrays(getattr(motion, f)))) for f in ("joint", "motor")}
    return dataclasses.replace(motion, t=motion.t[where], load=motion.load[where], torque=motion.torque[where], **cut)


def test_no_effect_escapes_the_battery() -> None:
    for module in pkgutil.walk_packages(ident.__path__, "ident."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ImportError as missing:
                if module.name.startswith("ident.regressor.native"):
                    continue  # the compiled kernel was not built
                if not isinstance(missing, ModuleNotFoundError) or str(missing.name).startswith("ident"):
                    raise  # not an optional dependency that is not installed

    def below(kind: type) -> set[type]:
        return {kind} | {x for child in kind.__subclasses__() for x in below(child)}

    concrete = {
        t for t in below(Effect) if t.__module__.startswith("ident.") and not inspect.isabstract(t) and not t.__name__.startswith("_")
    }
    assert concrete == set(effect_types().values())
    assert set(TYPES) == set(effect_types()), "effects were registered after the battery was laid out"


def test_the_catalogue_is_complete() -> None:
    expected = """viscous coulomb asymmetric_coulomb asymmetric_viscous stribeck load_dependent_friction nonlinear_viscous
        position_dependent_friction joint_side_friction presliding temperature_drift_viscous temperature_drift_coulomb rotor_inertia
        offset offset_drift offset_step cogging torque_ripple torque_constant saturation torque_nonlinearity gear_coupling
        joint_elasticity backlash linear_spring nonlinear_spring counterbalance payload payload_step base_tilt gravity_magnitude
        external_force link_length encoder_offset encoder_scale encoder_eccentricity delay filter_lag rigid_body"""
    assert set(expected.split()) <= set(TYPES)


@EVERY
def test_describes_itself(name: str) -> None:
    kind = TYPES[name]
    assert kind.name == name
    assert "_" not in kind.title
    assert kind.title.strip() == kind.title != ""
    assert isinstance(kind.axis, Axis)
    assert isinstance(kind.nature, Nature)
    assert all(isinstance(need, Need) for need in kind.needs)
    assert kind.__doc__ is not None
    assert len(kind.__doc__) > 40
    assert not kind.__doc__.startswith(f"{kind.__name__}(")


def on_side(effect: Effect, side: Side) -> Effect:
    """The effect on a side, its orders counted there, too."""
    counted = {"angle": side} if isinstance(getattr(effect, "angle", None), Side) else {}
    return dataclasses.replace(effect, side=side, **counted)


@EVERY
def test_shape_parameters_have_the_unit_of_the_joints_kind(name: str) -> None:
    """One that is declared for joints that turn and joints that slide is told in the unit of those it sits on."""
    effect = make_effect(name)
    for p in effect.shape():
        turning, both = p.unit.split(" (")[0], " (" in p.unit
        assert effect.shape_unit(p, ROBOTS["pendulum"]()) == turning
        at_the_joint, behind = (on_side(effect, side) for side in (Side.JOINT, Side.MOTOR))
        told = at_the_joint.shape_unit(p, ROBOTS["slide"]())
        assert told == (p.unit[len(turning) + 2 : -1] if both else p.unit)
        assert not both or "rad" not in told
        assert behind.shape_unit(p, ROBOTS["slide"]()) == turning  # a spindle's motor turns
        assert at_the_joint.shape_unit(p, ROBOTS["scara"]()) == p.unit  # on joints of both kinds


@EVERYWHERE
@EVERY
def test_columns_are_real_and_of_the_declared_shape(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    columns = effect.columns(motion, robot)
    assert columns.shape == (len(motion), robot.n, len(effect.parameters(robot)))
    assert columns.dtype == np.float64
    assert np.isfinite(columns).all()
    assert np.array_equal(columns, effect.columns(motion, robot)), "the same input must give the same columns"


@EVERYWHERE
@EVERY
def test_parameters_are_named_and_bounded(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    parameters = effect.parameters(robot)
    assert len({p.name for p in parameters}) == len(parameters)
    for p in parameters:
        assert p.effect == name
        assert p.name.strip()
        assert p.unit.strip()
        assert "{" not in p.unit
        assert p.joint == "" or p.joint in robot.joint_names
        assert p.lower < p.upper
    if effect.per_joint:
        assert all(p.joint for p in parameters)


@EVERYWHERE
@EVERY
def test_torque_is_linear_in_the_parameters(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    columns = effect.columns(motion, robot)
    rng = np.random.default_rng(3)
    values = rng.normal(size=columns.shape[2])
    size = np.abs(columns).max(initial=1e-12) * (1 + len(values))
    np.testing.assert_allclose(effect.torque(motion, robot, values), columns @ values, atol=1e-11 * size, rtol=0)


@EVERYWHERE
@EVERY
def test_power_is_the_same_on_both_sides_of_the_transmission(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    on_side = effect.columns(motion, robot)
    measured = Model(robot, (effect,)).columns(motion)
    power = [
        np.einsum("Nj,Njk->Nk", motion.on(side).dq, c) for side, c in ((effect.side, on_side), (robot.transmission.measured, measured))
    ]
    np.testing.assert_allclose(power[0], power[1], rtol=1e-9, atol=1e-10 * np.abs(power[0]).max(initial=1e-12))


@EVERYWHERE
@EVERY
def test_works_on_either_side(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    if name == "rigid_body":
        pytest.skip("links are on the joint side by definition")
    for side in Side:
        effect = settled(name, robot, motion, side=str(side))
        assert effect.side is side
        assert np.isfinite(effect.columns(motion, robot)).all()


@EVERYWHERE
@EVERY
def test_some_joints_are_some_of_the_columns(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    if not effect.per_joint and not effect.parameters(robot)[0].joint:
        return
    found = dict(zip((p.name for p in effect.parameters(robot)), np.moveaxis(effect.columns(motion, robot), 2, 0), strict=True))
    for joint in sorted({p.joint for p in effect.parameters(robot)}) if name != "rigid_body" else ():
        alone = dataclasses.replace(effect, joints=(joint,))
        parameters = alone.parameters(robot)
        assert {p.joint for p in parameters} == {joint}
        for p, column in zip(parameters, np.moveaxis(alone.columns(motion, robot), 2, 0), strict=True):
            np.testing.assert_allclose(column, found[p.name], rtol=1e-9, atol=1e-12 * np.abs(column).max(initial=1e-12))


@EVERY
def test_units_of_a_slide_are_not_those_of_a_turn(name: str) -> None:
    robot = Robot.from_urdf(chain("slide", [("prismatic", "0 0 1", "0 0.4 0", "0 0 1"), ("prismatic", "0 0 1", "0.5 0 0", "0 0 1")]))
    effect = make_effect(name)
    for p in effect.parameters(robot) if effect.per_joint else ():
        assert "rad" not in p.unit
        assert "N m" not in p.unit


@EVERYWHERE
@EVERY
def test_a_piece_of_the_run_gives_a_piece_of_the_columns(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    if effect.needs & {Need.HISTORY, Need.NEIGHBOURS}:
        pytest.skip("depends on other samples, and says so")
    where = slice(70, 170)
    whole = effect.columns(motion, robot)
    # Corrections of the prediction are difference quotients, whose step depends on the samples.
    tolerance = 1e-7 if Need.REFERENCE in effect.needs else 1e-13
    np.testing.assert_allclose(
        effect.columns(portion(motion, where), robot), whole[where], rtol=0, atol=tolerance * np.abs(whole).max(initial=1e-12)
    )


@EVERY
def test_shape_parameters_are_fields_with_bounds(name: str) -> None:
    effect = make_effect(name)
    fields = {f.name for f in dataclasses.fields(effect)}
    for p in effect.shape():
        assert p.name in fields
        assert p.unit
        assert p.lower < p.upper
        assert p.lower <= p.typical <= p.upper
        assert getattr(effect, p.name) == p.typical, "the default is where a search starts"
        assert not p.log or p.lower > 0.0
        assert math.isfinite(p.lower)
        assert math.isfinite(p.upper)
        assert getattr(effect.with_shape(**{p.name: p.lower}), p.name) == p.lower
        for wrong in (math.nan, p.upper * 2.0 + 1.0, "fast", True):
            with pytest.raises(ConfigurationError, match=p.name):
                dataclasses.replace(effect, **{p.name: wrong})
    with pytest.raises(ConfigurationError, match="shape parameter"):
        effect.with_shape(no_such_shape=1.0)


@EVERY
def test_columns_follow_the_shape(name: str) -> None:
    for p in make_effect(name).shape():
        changed = []
        for robot_name in ("wrist", "scara"):
            robot, motion = case(robot_name)
            effect = settled(name, robot, motion, 0.4)
            low, high = effect.search_range(motion, robot)[p.name]
            other = effect.with_shape(**{p.name: 0.5 * (getattr(effect, p.name) + (high if p.log else low))})
            a, b = effect.columns(motion, robot), other.columns(motion, robot)
            changed.append(a.size and np.abs(a - b).max() > 1e-6 * np.abs(a).max())
        assert any(changed), f"{p.name} changes nothing: it is no shape"


@EVERYWHERE
@EVERY
def test_the_range_worth_searching_is_within_the_bounds(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = make_effect(name)
    still = motion_at_rest(robot)
    for samples in (motion, still):
        ranges = effect.search_range(samples, robot)
        assert set(ranges) == {p.name for p in effect.shape()}
        for p in effect.shape():
            low, high = ranges[p.name]
            assert p.lower <= low < high <= p.upper


@EVERYWHERE
@EVERY
@pytest.mark.parametrize("value", [-1e6, -0.3, 0.0, 1e-12, 0.3, 1e6])
def test_whatever_was_fitted_tells_a_shape_that_the_effect_can_have(name: str, robot_name: str, value: float) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    told = effect.told_by(np.full(len(effect.parameters(robot)), value))
    for p in told.shape():
        assert p.lower <= getattr(told, p.name) <= p.upper
    told.search_range(motion, robot)


def motion_at_rest(robot: Robot) -> Motion:
    still = np.zeros((20, robot.n))
    motion = Motion.of(robot, still + 0.2, still, still, np.arange(20) / 100.0, rate=100.0, torque=still + 1.0)
    return motion.with_reference(case_reference(robot))


def case_reference(robot: Robot) -> Reference:
    return Reference(*declared(robot))


@EVERYWHERE
@pytest.mark.parametrize("name", [n for n, t in TYPES.items() if t.nature == Nature.FRICTION])
def test_friction_is_zero_at_standstill_and_takes_power_out(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    assert not effect.columns(motion_at_rest(robot), robot).any()
    if Need.HISTORY in effect.needs:
        return  # stores energy: see the tests of presliding
    signed = [i for i, p in enumerate(effect.parameters(robot)) if p.lower >= 0.0]
    power = np.einsum("Nj,Njk->Nk", motion.on(effect.side).dq, effect.columns(motion, robot))[:, signed]
    assert power.min(initial=0.0) >= 0.0
    if signed:
        assert power.max() > 0.0


@EVERYWHERE
@EVERY
def test_is_a_value(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion, label="x")
    assert hash(effect) == hash(dataclasses.replace(effect))
    assert effect == pickle.loads(pickle.dumps(effect))
    with pytest.raises(dataclasses.FrozenInstanceError):
        effect.label = "y"  # type: ignore[misc]
    configuration = json.loads(json.dumps(dataclasses.asdict(effect)))
    assert make_effect(name, **configuration) == effect


@EVERY
def test_unknown_joint_and_key_name_the_nearest(name: str) -> None:
    robot, motion = case("wrist")
    if name != "rigid_body":  # always of the whole robot
        effect = make_effect(name, joints=["j22"])
        for ask in (lambda: effect.parameters(robot), lambda: effect.columns(motion, robot)):
            with pytest.raises(ConfigurationError, match=r"j22.*did you mean.*j2"):
                ask()
    with pytest.raises(ConfigurationError, match=r"did you mean.*label"):
        make_effect(name, lable="a")
    with pytest.raises(ConfigurationError, match="side"):
        make_effect(name, side="jiont")


@EVERY
def test_a_label_lets_two_of_a_kind_sit_together(name: str) -> None:
    robot, _ = case("wrist")
    if name == "rigid_body":
        return
    effect = make_effect(name)
    both = Model(robot, (effect, dataclasses.replace(effect, label="b")))
    assert len(both.parameters) == 2 * len(effect.parameters(robot))
    with pytest.raises(ConfigurationError, match="label"):
        Model(robot, (effect, effect))


@EVERY
def test_says_what_is_missing(name: str) -> None:
    robot, motion = case("wrist")
    bare = Motion.of(robot, *arrays(motion.joint))
    effect = make_effect(name)
    if effect.needs & {Need.LOAD, Need.REFERENCE, Need.TORQUE}:
        with pytest.raises(ConfigurationError, match=r"with_reference|torque|uniform"):
            effect.columns(bare, robot)
    else:
        assert np.isfinite(effect.columns(bare, robot)).all()


@EVERYWHERE
@EVERY
def test_a_finding_of_nothing_changes_nothing_when_applied(name: str, robot_name: str) -> None:
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    applied = effect.applied(robot, np.zeros(len(effect.parameters(robot))))
    if isinstance(applied, Robot):
        model, values = declared(robot)
        again = Model(applied, model.effects).torque(Motion.of(applied, *arrays(motion.joint)), values)
        np.testing.assert_allclose(again, model.torque(motion, values), rtol=1e-12, atol=1e-12)
    elif isinstance(applied, SignalCorrection):
        q, tau = motion.joint.q, motion.torque
        np.testing.assert_allclose(applied.true_position(q, robot.transmission), q, atol=1e-12)
        if applied.limit is None:
            np.testing.assert_allclose(applied.true_torque(tau, motion.t, robot.transmission), tau, rtol=1e-9, atol=1e-12)
    else:
        assert applied is None


@EVERYWHERE
@EVERY
def test_placements_together_are_the_effect(name: str, robot_name: str) -> None:
    robot, _ = case(robot_name)
    places = list(TYPES[name].placements(robot, label="z"))
    assert all(place.label == "z" for place in places)
    found = [p.name for place in places for p in place.parameters(robot)]
    assert sorted(found) == sorted(p.name for p in make_effect(name, label="z").parameters(robot))
    if not TYPES[name].per_joint:
        assert len(places) == 1


@EVERY
@EVERYWHERE
def test_what_acceleration_adds_is_what_the_torque_says(name: str, robot_name: str) -> None:
    """Effects may give inertia and bias in a way of their own; the oracle is the torque at accelerations of zero and one."""
    robot, motion = case(robot_name)
    effect = settled(name, robot, motion)
    values = np.random.default_rng(5).uniform(0.5, 1.5, len(effect.parameters(robot)))
    bias, inertia = effect.affine(motion, robot, values)
    expected_bias, expected = Effect.affine(effect, motion, robot, values)
    scale = max(float(np.abs(expected_bias).max()), float(np.abs(expected).max()), 1e-12)
    assert np.abs(bias - expected_bias).max() <= 1e-11 * scale
    assert np.abs((np.zeros_like(expected) if inertia is None else inertia) - expected).max() <= 1e-11 * scale
