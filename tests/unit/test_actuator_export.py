"""Simulators' actuators: every file says what the fit says in the simulator's fields and units, and what it leaves out."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from physical_models import random_links
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.plant import DrivePlant
from ident.exporting import ExportTarget, Identified, WrittenFile, export, register_target, target
from ident.exporting.target import target_types
from ident.logs.log import LogSet
from ident.regressor.rigid import inverse_dynamics

TRUTH = {
    "Ia": 0.012,
    "Fv": 0.08,
    "Fc": 0.15,
    "kp": 25.0,
    "kd": 0.8,
    "delay": 0.004,
    "Fs": 0.1,
    "Fl": 0.05,
    "offset": 0.0,
    "ks": 0.0,
    "ks0": 0.0,
}
SLIDE = LEG.replace('name="knee" type="revolute"', 'name="knee" type="prismatic"')


def as_fitted(robot: ident.Robot, law: DriveLaw, *more: str, **values: float) -> DriveFit:
    """A fit with these values, as if found."""
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    for name in more:
        model = model + ident.make_effect(name)
    unknowns = DrivePlant(model, law, ()).unknowns
    known = {**TRUTH, **values}
    found = np.array([known[u.name.split("_")[0]] for u in unknowns])
    n = robot.n
    return DriveFit(model, law, unknowns, found, np.diag((0.05 * np.abs(found)) ** 2 + 1e-12), None, np.zeros(n), 0.01, 1, True)


def leg(*more: str, urdf: str = LEG, law: dict[str, object] | None = None, **values: float) -> DriveFit:
    robot = ident.Robot.from_urdf(urdf)
    given = {"kp": [25.0, 30.0], "kd": 0.8, "effort_limit": 5.0, **(law or {})}
    return as_fitted(robot, DriveLaw.of(robot, **given), *more, **values)


def written(fit: object, kind: str, folder: Path, **options: object) -> tuple[str, tuple[str, ...]]:
    file = folder / f"{kind}.out"
    notes = export(fit, file, kind=kind, **options).notes
    return file.read_text(), notes


def namespace(text: str, monkeypatch: pytest.MonkeyPatch, **modules: dict[str, object]) -> dict[str, object]:
    """What a written Python file defines, with stand-ins for the packages it imports."""
    for name, members in modules.items():
        whole = name.replace("__", ".")
        module = ModuleType(whole)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, whole, module)
        if "." in whole:
            monkeypatch.setitem(sys.modules, whole.split(".")[0], ModuleType(whole.split(".")[0]))
    names: dict[str, object] = {}
    exec(compile(text, "written", "exec"), names)
    return names


def test_every_target_is_found_and_says_what_it_is():
    known = target_types()
    assert set(known) >= {"urdf", "mjcf", "json", "mujoco_actuator", "isaaclab", "mjlab", "genesis", "usd", "ranges", "c", "numpy"}
    assert all(kind.title and kind.name == name for name, kind in known.items())


def test_a_new_target_is_one_class(tmp_path, monkeypatch):
    target_types()
    monkeypatch.setattr(target._REGISTRY, "_types", target._REGISTRY.types())

    @register_target
    class Gains(ExportTarget):
        """Gains alone."""

        name = "gains"
        title = "gains"
        suffixes = (".gains",)

        def written(self, found, options):
            return WrittenFile(f"{found.law.kp.tolist()}")

    export(leg(), tmp_path / "leg.gains")
    assert (tmp_path / "leg.gains").read_text() == "[25.0, 30.0]"


def test_what_the_mjcf_says(tmp_path):
    from lxml import etree

    file = tmp_path / "leg.xml"
    export(leg(), file, kind="mujoco_actuator")
    root = etree.parse(str(file)).getroot()
    hip = root.find(".//joint[@name='hip']")
    assert [float(hip.get(key)) for key in ("armature", "damping", "frictionloss")] == [0.012, 0.08, 0.15]
    drives = root.findall("actuator/position")
    assert [(d.get("joint"), float(d.get("kp")), float(d.get("kv"))) for d in drives] == [("hip", 25.0, 0.8), ("knee", 30.0, 0.8)]
    assert drives[0].get("forcerange") == "-5.0 5.0"
    assert (drives[0].get("delay"), drives[0].get("nsample")) == ("0.004", "40")
    with pytest.raises(ident.ConfigurationError, match="exists; nothing was written"):
        export(leg(), file, kind="mujoco_actuator")


def test_back_emf_and_scale_are_in_damping_and_gains(tmp_path):
    fit = leg(law={"back_emf": 0.02, "torque_scale": 2.0})
    found = json.loads(written(fit, "json", tmp_path)[0])
    assert found["drive"]["damping"] == pytest.approx([0.1, 0.1])
    assert found["law"]["kp"] == [50.0, 60.0]
    assert found["law"]["effort_limit"] == [10.0, 10.0]


def test_pwm_is_told_at_a_supply_voltage(tmp_path):
    robot = ident.Robot.from_urdf(PENDULUM)
    law = DriveLaw.of(robot, "pwm", kp=2.0, kd=0.1, delay_s=0.0, torque_scale=0.3, back_emf=0.05)
    fit = as_fitted(robot, law)
    with pytest.raises(ident.ConfigurationError, match="depends on the supply voltage"):
        export(fit, tmp_path / "x.xml", kind="mujoco_actuator")
    export(fit, tmp_path / "x.xml", kind="mujoco_actuator", supply=10.0)
    text = (tmp_path / "x.xml").read_text()
    assert 'kp="6.0"' in text
    assert 'forcerange="-3.0 3.0"' in text
    assert re.search(r'damping="0.13\d*"', text)


def test_isaac_lab(tmp_path, monkeypatch):
    text, notes = written(leg("stribeck"), "isaaclab", tmp_path)
    made = {"DelayedPDActuatorCfg": lambda **given: given}
    (drives,) = namespace(text, monkeypatch, isaaclab__actuators=made)["ACTUATORS"].values()
    assert drives["joint_names_expr"] == ["hip", "knee"]
    assert drives["stiffness"] == {"hip": 25.0, "knee": 30.0}
    assert drives["damping"] == {"hip": 0.8, "knee": 0.8}
    assert drives["viscous_friction"] == {"hip": 0.08, "knee": 0.08}
    assert drives["dynamic_friction"] == {"hip": 0.15, "knee": 0.15}
    assert drives["friction"] == {"hip": 0.25, "knee": 0.25}  # at rest, Stribeck's share with it
    assert drives["effort_limit"] == {"hip": 5.0, "knee": 5.0}
    assert drives["min_delay"] == drives["max_delay"] == 1  # 4 ms in steps of 5 ms
    (stribeck,) = [note for note in notes if "stribeck" in note]
    assert "at standstill the static friction includes it" in stribeck
    still = leg(law={"delay_s": [0.0, 0.01]})
    groups = namespace(
        written(still, "isaaclab", tmp_path / "x")[0] if (tmp_path / "x").mkdir() is None else "",
        monkeypatch,
        isaaclab__actuators={**made, "ImplicitActuatorCfg": lambda **given: given},
    )["ACTUATORS"]
    assert [g["joint_names_expr"] for g in groups.values()] == [["hip"], ["knee"]]
    assert "min_delay" not in groups["drives_1"]
    assert groups["drives_1"]["effort_limit_sim"] == {"hip": 5.0}


def test_mjlab(tmp_path, monkeypatch):
    text, _ = written(leg(), "mjlab", tmp_path)
    entries = namespace(text, monkeypatch, mjlab__actuator={"BuiltinPositionActuatorCfg": lambda **given: given})["ACTUATORS"]
    assert entries[1] == {
        "target_names_expr": ("knee",), "stiffness": 30.0, "damping": 0.8, "effort_limit": 5.0, "armature": 0.012,
        "frictionloss": 0.15, "viscous_damping": 0.08, "delay_min_lag": 1, "delay_max_lag": 1,
    }  # fmt: skip
    fast = leg(law={"velocity_command": "derivative", "delay_s": 0.0})
    text = written(fast, "mjlab", tmp_path / "v")[0] if (tmp_path / "v").mkdir() is None else ""
    assert "BuiltinPdActuatorCfg(" in text
    assert "PHYSICS_DT" not in text


class Entity:
    """What is asked of a Genesis entity, kept."""

    def __init__(self, joints: list[str]) -> None:
        self.joints, self.calls = joints, {}

    def get_joint(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(dofs_idx_local=[6 + self.joints.index(name)])

    def __getattr__(self, name: str):
        return lambda *given: self.calls.update({name: given})


def test_genesis(tmp_path, monkeypatch):
    fit = leg("offset", "linear_spring", offset=0.2, ks=3.0)
    text, notes = written(fit, "genesis", tmp_path)
    entity = Entity(["hip", "knee"])
    namespace(text, monkeypatch)["apply"](entity)
    calls = entity.calls
    assert all(given[-1] == [6, 7] for given in calls.values())
    assert calls["set_dofs_kp"][0].tolist() == [25.0, 30.0]
    assert calls["set_dofs_kv"][0].tolist() == [0.8, 0.8]
    assert calls["set_dofs_armature"][0].tolist() == [0.012, 0.012]
    assert calls["set_dofs_damping"][0].tolist() == [0.08, 0.08]
    assert calls["set_dofs_frictionloss"][0].tolist() == [0.15, 0.15]
    assert [x.tolist() for x in calls["set_dofs_force_range"][:2]] == [[-5.2, -5.2], [4.8, 4.8]]
    # force = gain target + b0 + b1 q + b2 dq: offset and spring are held against.
    assert [x.tolist() for x in calls["set_dofs_act_bias"][:3]] == [[-0.2, -0.2], [-28.0, -33.0], [-0.8, -0.8]]
    order = list(calls)
    assert order.index("set_dofs_act_bias") > order.index("set_dofs_kp")  # which resets the bias
    assert any("the delay from command to torque (4.00 to 4.00 ms)" in note for note in notes)


def test_a_slide_is_in_metres_and_newtons(tmp_path):
    text, _ = written(leg(urdf=SLIDE), "usd", tmp_path)
    slide = text[text.index('PhysicsPrismaticJoint "knee"') :]
    assert "float drive:linear:physics:stiffness = 30.0" in slide
    assert "float physxJointAxis:linear:viscousFrictionCoefficient = 0.08" in slide
    turn = text[text.index('PhysicsRevoluteJoint "hip"') :]
    assert f"float drive:angular:physics:stiffness = {25.0 * np.pi / 180!r}" in turn


def test_usd_is_loaded_by_its_own_library(tmp_path):
    """UsdPhysics parses bodies, joints and drives; gravity's torque of what it parsed is that of the robot."""
    Usd = pytest.importorskip("pxr.Usd", reason="OpenUSD is not installed: pip install usd-core")
    from pxr import Gf, UsdPhysics

    fit = leg("stribeck")
    file = tmp_path / "leg.usda"
    export(fit, file)
    stage = Usd.Stage.Open(str(file))
    assert stage.GetDefaultPrim().HasAPI(UsdPhysics.ArticulationRootAPI)
    load = getattr(UsdPhysics, "UsdPhysicsLoadStageFromPrimRange", None) or UsdPhysics.LoadUsdPhysicsFromRange
    parsed = load(stage, ["/"])
    turning = parsed[UsdPhysics.ObjectType.RevoluteJoint]
    paths, descriptions = turning
    hip = {str(p): d for p, d in zip(paths, descriptions, strict=True)}["/leg/hip"]
    assert all(d.isValid for d in descriptions)
    assert np.deg2rad([hip.limit.lower, hip.limit.upper]) == pytest.approx([-3.0, 3.0], rel=1e-6)
    assert hip.drive.enabled
    assert not hip.drive.acceleration
    assert np.rad2deg(hip.drive.stiffness) == pytest.approx(25.0, rel=1e-6)
    assert np.rad2deg(hip.drive.damping) == pytest.approx(0.8, rel=1e-6)
    assert hip.drive.forceLimit == pytest.approx(5.0)
    prim = stage.GetPrimAtPath("/leg/hip")
    value = {key: prim.GetAttribute(f"physxJointAxis:angular:{key}").Get() for key in ("armature", "staticFrictionEffort",
             "dynamicFrictionEffort", "viscousFrictionCoefficient")}  # fmt: skip
    assert value["armature"] == pytest.approx(0.012)
    assert value["staticFrictionEffort"] == pytest.approx(0.25)
    assert value["dynamicFrictionEffort"] == pytest.approx(0.15)
    assert np.rad2deg(value["viscousFrictionCoefficient"]) == pytest.approx(0.08, rel=1e-6)
    assert len(parsed[UsdPhysics.ObjectType.RigidBody][0]) == 3
    # Gravity about the hip, from masses, places and axes as OpenUSD gives them.
    cache = __import__("pxr.UsdGeom", fromlist=["XformCache"]).XformCache()
    torque = 0.0
    base = cache.GetLocalToWorldTransform(stage.GetPrimAtPath("/leg/base_fixed"))
    frame = (
        Gf.Matrix4d().SetRotate(Gf.Quatd(hip.localPose0Orientation)) * Gf.Matrix4d().SetTranslate(Gf.Vec3d(hip.localPose0Position)) * base
    )
    axis, origin = np.array(frame.TransformDir(Gf.Vec3d(1, 0, 0))), np.array(frame.Transform(Gf.Vec3d(0, 0, 0)))
    scene = UsdPhysics.Scene(stage.GetPrimAtPath("/leg/physicsScene"))
    down = np.array(scene.GetGravityDirectionAttr().Get()) * scene.GetGravityMagnitudeAttr().Get()
    for name in ("thigh", "calf"):
        body = UsdPhysics.MassAPI(stage.GetPrimAtPath(f"/leg/{name}"))
        where = cache.GetLocalToWorldTransform(body.GetPrim()).Transform(Gf.Vec3d(body.GetCenterOfMassAttr().Get()))
        torque -= axis @ np.cross(np.array(where) - origin, body.GetMassAttr().Get() * down)
    robot, still = fit.model.robot, np.zeros((1, 2))
    assert torque == pytest.approx(inverse_dynamics(robot.tree, robot.nominal, still, still, still)[0, 0], abs=1e-6)


def test_usd_places_a_tilted_arm_where_it_is(tmp_path):
    """Six joints with axes and frames of all kinds: each joint's two frames meet, and its axis is the robot's."""
    Usd = pytest.importorskip("pxr.Usd", reason="OpenUSD is not installed: pip install usd-core")
    from pxr import Gf, UsdGeom, UsdPhysics

    robot = ident.load_robot("puma560")
    model = robot.rigid_body()
    export(Identified(model, random_links(np.random.default_rng(0), robot.tree.nb)), tmp_path / "puma.usda")
    stage, cache = Usd.Stage.Open(str(tmp_path / "puma.usda")), UsdGeom.XformCache()
    R, p = np.eye(3), np.zeros(3)
    for i, joint in enumerate(robot.tree_joints):
        R, p = R @ robot.tree.rotation[i], p + R @ robot.tree.translation[i]
        prim = UsdPhysics.RevoluteJoint(stage.GetPrimAtPath(f"/puma560/{joint.name}"))
        ends = []
        for side in "01":
            (body,) = getattr(prim, f"GetBody{side}Rel")().GetTargets()
            at, turn = (getattr(prim, f"GetLocal{what}{side}Attr")().Get() for what in ("Pos", "Rot"))
            frame = cache.GetLocalToWorldTransform(stage.GetPrimAtPath(body))
            ends.append(frame.Transform(Gf.Vec3d(at)))
            ends.append(frame.TransformDir(Gf.Rotation(Gf.Quatd(turn)).TransformDir(Gf.Vec3d(1, 0, 0))))
        assert np.allclose(ends[0], ends[2], atol=1e-6)
        assert np.allclose(ends[0], p, atol=1e-6)
        assert np.allclose(ends[1], ends[3], atol=1e-6)
        assert np.allclose(ends[1], R @ robot.tree.axis[i], atol=1e-6)


def test_a_fit_of_torque_has_no_gains_and_the_limits_of_the_urdf(tmp_path, monkeypatch):
    robot = ident.Robot.from_urdf(LEG, transmission=np.array([-50.0, 100.0]), measured="motor")
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    values = np.concatenate([robot.nominal, [1e-5, 2e-5, 1e-4, 2e-4, 0.01, 0.02]])
    found = Identified(model, values)
    made = {"ImplicitActuatorCfg": lambda **given: given}
    (drives,) = namespace(written(found, "isaaclab", tmp_path)[0], monkeypatch, isaaclab__actuators=made)["ACTUATORS"].values()
    assert drives["stiffness"] is None
    assert drives["armature"] == pytest.approx({"hip": 1e-5 * 2500, "knee": 2e-5 * 1e4})
    assert drives["viscous_friction"] == pytest.approx({"hip": 1e-4 * 2500, "knee": 2e-4 * 1e4})
    assert drives["dynamic_friction"] == pytest.approx({"hip": 0.5, "knee": 2.0})
    assert drives["effort_limit_sim"] == {"hip": 20.0, "knee": 20.0}
    motor = {"BuiltinMotorActuatorCfg": lambda **given: given}
    entries = namespace(written(found, "mjlab", tmp_path)[0], monkeypatch, mjlab__actuator=motor)["ACTUATORS"]
    assert entries[0]["effort_limit"] == 20.0
    assert "<motor" in written(found, "mujoco_actuator", tmp_path)[0]
    assert "drive:" not in written(found, "usd", tmp_path)[0]
    entity = Entity(["hip", "knee"])
    namespace(written(found, "genesis", tmp_path)[0], monkeypatch)["apply"](entity)
    assert "set_dofs_kp" not in entity.calls


def test_what_is_left_out_has_the_torque_it_makes(tmp_path):
    """Against the law of each, evaluated here: the largest over speeds and the rms by joint."""
    fit = leg("stribeck", "load_dependent_friction", law={"delay_s": 0.0})
    notes = written(fit, "mjlab", tmp_path)[1]
    (stribeck,) = [n for n in notes if "stribeck" in n]
    peak = float(re.search(r"up to ([\d.]+) N m", stribeck).group(1))
    assert peak == pytest.approx(0.1, rel=1e-2)
    # Speeds are even within ±30 rad/s: the mean square of Fs exp(-(w/v)²) there.
    v = fit.model.effects[-2].v_s
    rms = 0.1 * np.sqrt(v * np.sqrt(np.pi / 2) / 60.0)
    assert float(re.search(r"hip ([\d.]+)", stribeck).group(1)) == pytest.approx(rms, rel=0.35)
    (load,) = [n for n in notes if "load_dependent_friction" in n]
    robot = fit.model.robot
    rng = np.random.default_rng(1)
    q, dq = rng.uniform(-3, 3, (4000, 2)), rng.uniform(-30, 30, (4000, 2))
    expected = 0.05 * np.sqrt(np.mean(inverse_dynamics(robot.tree, robot.nominal, q, dq, np.zeros_like(q)) ** 2, axis=0))
    assert float(re.search(r"hip ([\d.]+)", load).group(1)) == pytest.approx(expected[0], rel=0.1)


@needs_native
def test_what_is_left_out_is_told_on_logs_as_position(tmp_path):
    """A delay left out: simulated position moves by what our own simulation says, here by a second fit without it."""
    fit = leg(law={"delay_s": 0.01}, urdf=LEG)
    log = commanded_log(fit.model.robot, TRUTH, seconds=2.0, noise=0.0)
    notes = written(fit, "genesis", tmp_path, logs=LogSet((log,)))[1]
    (delay,) = [n for n in notes if "delay" in n]
    other = replace(fit, law=replace(fit.law, constants={**fit.law.constants, "delay_s": np.zeros(2)}))
    shift = other.replay(LogSet((log,)))[log.name] - fit.replay(LogSet((log,)))[log.name]
    told = float(re.search(r"changes by ([\d.e-]+) rad", delay).group(1))
    assert told == pytest.approx(np.sqrt(np.mean(shift**2)), rel=1e-2)
    assert told > 1e-4


def test_a_coupled_wrist_is_approximated_where_it_must_be(tmp_path):
    """MJCF says it exactly by tendons; Isaac Lab has the diagonal, and is told what that costs."""
    K = np.array([[0.02, 0.0], [0.01, 0.01]])
    robot = ident.Robot.from_urdf(LEG).with_transmission(ident.Transmission(K, np.zeros(2), "motor"))
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous()
    found = Identified(model, np.concatenate([robot.nominal, [1e-5, 2e-5, 1e-4, 2e-4]]))
    assert not any("coupling" in note for note in written(found, "mjcf", tmp_path)[1])
    (note,) = [n for n in written(found, "isaaclab", tmp_path)[1] if "coupling" in n]
    back = np.linalg.inv(K)
    drag = back.T @ np.diag([1e-4, 2e-4]) @ back
    assert float(re.search(r"hip ([\d.]+)", note).group(1)) == pytest.approx(abs(drag[0, 1]) * 30 / np.sqrt(3), rel=0.05)


@needs_native
def test_links_identified_under_a_law_become_real_bodies():
    robot = ident.Robot.from_urdf(PENDULUM)
    logs = LogSet((commanded_log(robot, {**TRUTH, "delay": 0.0}, seconds=3.0),))
    model = robot.rigid_body() + ident.friction.Coulomb()
    fit = fit_drives(logs, model, DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.0, links="identify"))
    found = Identified.of(fit)
    assert found.inertial[0] > 0
    assert found.model.base.base_values(found.values) == pytest.approx([fit.value(n) for n in found.model.base.names], rel=1e-6, abs=1e-9)


def test_the_pages_target_of_ones_own_is_found_by_the_command_line(tmp_path, monkeypatch, ident):
    page = (Path(__file__).parents[2] / "docs/simulators.md").read_text()
    ((name, text),) = re.findall(r"```python\n# file: (\S+)\n(.*?)```", page, re.DOTALL)
    (tmp_path / name).write_text(text)
    fit = leg("offset", offset=0.1)
    target_types()
    monkeypatch.setattr(target._REGISTRY, "_types", target._REGISTRY.types())
    monkeypatch.setattr(DriveFit, "load", classmethod(lambda cls, path: fit))
    (tmp_path / "fit.json").write_text('{"drive_state": 0}')
    ran = ident("export", tmp_path / "fit.json", tmp_path / "leg.mysim", "--plugin", tmp_path / name, "--json")
    assert ran.code == 0, ran.err
    assert (tmp_path / "leg.mysim").read_text() == "hip 0.012 0.08\nknee 0.012 0.08\n"
    assert any("not expressible: coulomb" in note for note in ran.json["notes"])
    wrong = ident("export", tmp_path / "fit.json", tmp_path / "leg.x", "--to", "isaaclap")
    assert wrong.code == 2
    assert "isaaclab" in wrong.err
