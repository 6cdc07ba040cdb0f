"""Writes docs/gallery.md and its pictures from the classes of the effects: `python docs/make_gallery.py`.

What an effect is confused with is computed: how much of what it adds beyond the usual model (rigid body, rotor inertia, viscous and Coulomb
friction) each other effect would take up, on one and the same motion."""

from __future__ import annotations

import io
import sys
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from ident.commands.simulate import random_motion  # noqa: E402
from ident.diagnosis.advice import motion_for  # noqa: E402
from ident.drawing.document import BlockKind, Figure, Layer, Panel, Role  # noqa: E402
from ident.drawing.figures import draw  # noqa: E402
from ident.effects import Axis, Effect, Motion  # noqa: E402
from ident.effects.kinds import Nature  # noqa: E402
from ident.effects.reference import Reference  # noqa: E402
from ident.effects.registry import effect_types  # noqa: E402
from ident.friction import Coulomb, RotorInertia, Viscous  # noqa: E402
from ident.model import Model  # noqa: E402
from ident.robots import Robot, Side, load_robot, nominal_values  # noqa: E402

Array = np.ndarray
INTRODUCTION = """Made from the classes by `python docs/make_gallery.py`. Each effect with its law, its parameters, and its signature:
torque per unit of a parameter against the quantity that shows it, on joint 3 of a PUMA 560 in random motion where it can sit there.
What it is confused with: the share of it that the usual model (rigid body, rotor inertia, viscous and Coulomb friction) takes up on
that motion, and the share of the rest that other effects take up. Near 100 %, this motion cannot tell them apart; another one may."""
JOINT = "joint3"
USUAL = ("rigid_body", "rotor_inertia", "viscous", "coulomb")
#: Shares below this are left out, and all but so many of those above.
LEAST, MOST = 0.5, 3


def placed(kind: type[Effect], robot: Robot) -> Effect:
    """The effect on joint 3 where it can sit there, else on the first place it can have."""
    places = list(kind.placements(robot))
    return next((e for e in places if e.joints == (JOINT,)), places[0])


def motion_of(model: Model, values: Array, rate: float = 100.0, seconds: float = 20.0) -> Motion:
    """One random motion of the robot, with the torque that it takes and the model's prediction."""
    t = np.arange(0.0, seconds, 1 / rate)
    q = random_motion(model, 1, seconds).sample(t)
    torque = model.inverse_dynamics(q.q, q.dq, q.ddq, values)
    motion = Motion.of(model.robot, q.q, q.dq, q.ddq, t, torque=torque, rate=rate)
    return motion.with_reference(Reference(model, values))


def usual_of(robot: Robot) -> tuple[Model, Array]:
    """What every robot has, and its values."""
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    return model, nominal_values(model)


def axis_of(effect: Effect, robot: Robot, motion: Motion, joint: int) -> tuple[str, Array]:
    """The quantity against which it shows, of its joint."""
    own = motion.on(effect.side)
    side = "motor" if effect.side == Side.MOTOR else "joint"
    match effect.axis:
        case Axis.POSITION:
            return "joint position (rad)", motion.joint.q[:, joint]
        case Axis.MOTOR_ANGLE:
            return "motor angle (rad)", motion.on(Side.MOTOR).q[:, joint]
        case Axis.VELOCITY:
            return f"{side} speed (rad/s)", own.dq[:, joint]
        case Axis.ACCELERATION:
            return f"{side} acceleration (rad/s²)", own.ddq[:, joint]
        case Axis.TIME:
            return "time (s)", motion.t
        case _:
            return "load of the joint (N m)", motion.load.on(Side.JOINT)[:, joint] if hasattr(motion.load, "on") else motion.load[:, joint]


def picture(effect: Effect, robot: Robot, motion: Motion, columns: Array) -> bytes:
    """Torque per unit parameter, on the row where it is largest, against the axis of the effect."""
    joint = effect.at(robot)[0] if effect.joints else int(np.argmax(np.sqrt(np.mean(columns**2, axis=(0, 2)))))
    row = int(np.argmax(np.sqrt(np.mean(columns**2, axis=(0, 2)))))
    label, x = axis_of(effect, robot, motion, joint)
    names = [p.name for p in effect.parameters(robot)]
    panels = []
    sizes = np.sqrt(np.mean(columns[:, row] ** 2, axis=0))
    for k in np.argsort(-sizes)[:2]:
        layer = Layer.of(BlockKind.MARKS if effect.axis == Axis.TIME else BlockKind.POINTS, Role.AFTER, x[::2], columns[::2, row, k])
        panels.append(Panel(names[k], label, "torque per unit" if len(panels) == 0 else "", (layer,)))
    return small(draw(Figure(effect.name, effect.title, "", tuple(panels), columns=2), "png"))


def small(png: bytes) -> bytes:
    """The same picture with few colours, which takes a third of the room."""
    file = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(24).save(file, "PNG", optimize=True)
    return file.getvalue()


def shown(kind: type[Effect], robot: Robot, motion: Motion) -> Effect:
    """The effect where it is shown; laws of friction with shapes in the middle of what is searched on this motion."""
    effect = placed(kind, robot)
    if effect.nature != Nature.FRICTION:
        return effect
    ranges = effect.search_range(motion, robot)
    middle = {s.name: float(np.sqrt(np.prod(ranges[s.name]))) for s in effect.shape() if s.log and min(ranges[s.name]) > 0}
    return effect.with_shape(**middle) if middle else effect


def stacked(columns: Array, scale: Array) -> Array:
    """Rows of all joints (N n, k), each joint over its torque."""
    return np.asarray((columns / scale[:, None]).reshape(-1, columns.shape[2]))


def without(columns: Array, basis: Array) -> Array:
    """What an orthonormal basis leaves of columns."""
    return columns - basis @ (basis.T @ columns)


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis of what columns span."""
    size = np.linalg.norm(columns, axis=0)
    U, S, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return U[:, S > 1e-9 * S.max(initial=0.0)] if S.size else np.zeros((len(columns), 0))


def confusions(columns: dict[str, Array], base: Array) -> dict[str, tuple[float, list[tuple[str, float]]]]:
    """Effect → share of its torque that the usual model takes up, and the other effects with the share of the rest that each takes up."""
    usual = orthonormal(base)
    left = {name: without(own, usual) for name, own in columns.items()}
    spans = {name: orthonormal(own) for name, own in left.items()}
    found = {}
    for name, own in left.items():
        hidden = 1.0 - float(np.sum(own**2) / max(np.sum(columns[name] ** 2), 1e-300))
        shares = []
        if hidden < 1.0 - 1e-9:
            for other, span in spans.items():
                if other != name and np.sum(own**2) > 0:
                    shares.append((other, 1.0 - float(np.sum(without(own, span) ** 2) / np.sum(own**2))))
        found[name] = (hidden, sorted((s for s in shares if s[1] >= LEAST), key=lambda s: -s[1])[:MOST])
    return found


def entry(effect: Effect, robot: Robot, hidden: float, others: list[tuple[str, float]]) -> list[str]:
    """The lines of one effect."""
    doc = " ".join((type(effect).__doc__ or "").split("\n\n    Examples\n")[0].split())
    lines = [f"## `{effect.name}`", f"**{effect.title[0].upper()}{effect.title[1:]}.** {doc}", ""]
    lines += [f"![{effect.title}](gallery/{effect.name}.png)", ""]
    parameters = effect.parameters(robot)
    names = ", ".join(f"`{p.name}` ({p.unit})" for p in parameters[:6]) + (
        f" and {len(parameters) - 6} more" if len(parameters) > 6 else ""
    )
    shapes = ", ".join(f"`{s.name}` ({effect.shape_unit(s, robot)}, {s.lower:g} to {s.upper:g})" for s in effect.shape()) or "none"
    needs = ", ".join(sorted(n.value for n in effect.needs)) or "the motion at the same instant"
    lines += [
        f"- parameters: {names}; shapes: {shapes}",
        f"- acts on the {effect.side.value} side; seen against {effect.axis.value}; needs {needs}",
        f"- to see it: {motion_for(effect, 'the joint')}",
        f"- the usual model takes up {100 * hidden:.0f} % of it on a random motion"
        + ("; of the rest: " + ", ".join(f"`{name}` {100 * share:.0f} %" for name, share in others) if others else ""),
        "",
    ]
    return lines


def gallery(pictures: Path | None = None) -> str:
    """The page; pictures go into a folder, if one is given."""
    robot = load_robot("puma560")
    model, values = usual_of(robot)
    motion = motion_of(model, values)
    scale = np.sqrt(np.mean(model.torque(motion, values) ** 2, axis=0))
    own = {name: kind for name, kind in effect_types().items() if kind.__module__.startswith("ident.") and kind.cause}
    kinds = {name: kind for name, kind in own.items() if name not in USUAL}
    effects = {name: shown(kind, robot, motion) for name, kind in kinds.items()}
    columns = {}
    for name, effect in effects.items():
        own = effect.columns(motion, robot)
        on_measured = robot.transmission.torque_map(effect.side, robot.transmission.measured)
        columns[name] = np.einsum("ij,njk->nik", on_measured, own)
    found = confusions({k: stacked(c, scale) for k, c in columns.items()}, stacked(model.columns(motion), scale))
    out = ["# Gallery of effects", "", INTRODUCTION, ""]
    for name, effect in effects.items():
        if pictures is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                (pictures / f"{name}.png").write_bytes(picture(effect, robot, motion, columns[name]))
        out += entry(effect, robot, *found[name])
    return "\n".join(out).rstrip() + "\n"


if __name__ == "__main__":
    folder = HERE / "gallery"
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    (HERE / "gallery.md").write_text(gallery(folder), encoding="utf-8")
