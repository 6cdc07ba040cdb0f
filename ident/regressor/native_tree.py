"""Trees and rows of the regression equation as the compiled kernel has them: records, made once for each tree.

The C++ side (ident/_native) trusts the records made here for their meaning and checks them for range only."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from .._native import _kernel  # type: ignore[attr-defined, unused-ignore]
from ..robots.tree import RigidBodyTree
from . import numpy_dynamics

Array = np.ndarray

#: Records of ident/_native/tree.h.
_BODY = np.dtype(
    [(name, "i8") for name in ("parent", "position", "row", "kind", "sparse", "shifted")]
    + [("axes", "i8", 3), ("sign", "f8", 3), ("lever", "f8", 3), ("turn", "f8"), ("R0", "f8", (3, 3)), ("p", "f8", 3), ("u", "f8", 3)]
    + [(name, "f8", (3, 3)) for name in ("fixed", "cosine", "sine")]
)
_STEP = np.dtype(
    [(name, "i8") for name in ("body", "starts", "own", "joins", "shows", "leads")] + [("column", "i8", 10), ("twist", "f8", 6)]
)
_EXTRA = np.dtype([("index", "i8"), ("column", "i8"), ("factor", "f8")])
_REVOLUTE, _PRISMATIC, _FREE = range(3)

#: Place of I_ab among the ten parameters of a body.
_INERTIA = np.array([[4, 5, 7], [5, 6, 8], [7, 8, 9]])
#: Columns below this share of the largest of their kind are structural zeros (their numbers are rounding of the trigonometry).
_ZERO = 1e-14


@dataclass(eq=False)
class CompiledTree:
    """A tree as the kernel has it. `order` (nb, 10): the kernel's parameter k of a body is Pinocchio's `order[k]`.

    What only regressors need is made when the first one is asked for: inverse dynamics of many a tree for a few rows do without.
    The tree is not kept: that would keep it alive in the table of all."""

    handle: Any
    bodies: Array
    order: Array
    _samples: Array | None = field(default=None, repr=False)
    _whole: Any = None
    plans: dict[tuple[Any, ...], RowPlan] = field(default_factory=dict)

    def samples(self, tree: RigidBodyTree) -> Array:
        """Regressor at a few generic states (16, nv, 10 nb)."""
        if self._samples is None:
            self._samples = _sampled(tree)
        return self._samples

    def whole(self, tree: RigidBodyTree) -> Any:
        """The kernel's plan of all rows and columns."""
        if self._whole is None:
            self._whole = _plan(tree, self, np.eye(tree.nv), np.arange(10 * tree.nb), np.zeros((tree.nv, 0)), False, whole=True).handle
        return self._whole

    def inertia(self, inertia: Array) -> Array:
        """Parameters (10 nb,) in the kernel's frames."""
        return np.ascontiguousarray(np.take_along_axis(inertia.reshape(-1, 10), self.order, axis=1).reshape(-1))

    def plan(self, tree: RigidBodyTree, rows: Array, columns: Array, extra: Array, pattern: Array) -> RowPlan:
        """The plan of these rows and columns, made once."""
        key = (rows.tobytes(), columns.tobytes(), pattern.tobytes(), extra.ndim)
        found = self.plans.get(key)
        if found is None:
            if len(self.plans) >= 16:
                self.plans.clear()
            found = self.plans[key] = _plan(tree, self, rows, columns, pattern, extra.ndim == 3)
        return found


@dataclass(frozen=True, eq=False)
class RowPlan:
    """Rows of the regression equation for the kernel. `live`: per row, the places of its columns among the k chosen, then the torque."""

    handle: Any
    live: tuple[Array, ...]
    padded: tuple[int, ...]

    def instruments(self, split: int) -> bytes:
        """How many columns of each row are among the first `split` of the k chosen: int64 (R,)."""
        return np.array([np.searchsorted(live, split) for live in self.live], np.int64).tobytes()

    @cached_property
    def unpacking(self) -> tuple[int, Array, Array, Array]:
        """Numbers that the kernel gives; places among them of the upper triangles, and where those go in (R, k+1, k+1), and mirrored."""
        start, taken, upper, lower = 0, [], [], []
        width = int(self.live[0][-1]) + 1
        for r, (live, padded) in enumerate(zip(self.live, self.padded, strict=True)):
            i, j = np.triu_indices(len(live))
            taken.append(start + i * padded + j)
            upper.append((r * width + live[i]) * width + live[j])
            lower.append((r * width + live[j]) * width + live[i])
            start += padded * padded
        return start, np.concatenate(taken), np.concatenate(upper), np.concatenate(lower)


_TREES: WeakKeyDictionary[RigidBodyTree, CompiledTree] = WeakKeyDictionary()


def compiled(tree: RigidBodyTree) -> CompiledTree:
    """The kernel's form of a tree, made once."""
    found = _TREES.get(tree)
    if found is None:
        found = _TREES[tree] = _compile(tree)
    return found


def _compile(tree: RigidBodyTree) -> CompiledTree:
    bodies = np.zeros(tree.nb, _BODY)
    order = np.empty((tree.nb, 10), np.int64)
    frames = []
    for i in range(tree.nb):
        body, free = bodies[i], tree.floating and i == 0
        # Rename the axes (a cyclic permutation C) so that a joint about a principal axis turns about z.
        u = tree.axis[i]
        principal = not free and np.count_nonzero(u) == 1
        first = (int(np.argmax(np.abs(u))) + 1) % 3 if principal else 0
        names = (first + np.arange(3)) % 3
        frames.append(np.eye(3)[:, names])
        order[i] = [0, *(1 + names), *(_INERTIA[names[a], names[b]] for a, b in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))]
        up = tree.parent[i]
        before = frames[up] if up >= 0 else np.eye(3)
        R0 = before.T @ tree.rotation[i] @ frames[i]
        R0 = np.where(np.abs(R0) < 1e-15, 0.0, np.where(np.abs(np.abs(R0) - 1.0) < 1e-15, np.sign(R0), R0))
        u = frames[i].T @ u
        skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
        along = R0 @ np.outer(u, u)
        body["parent"], body["position"], body["row"] = up, i + 6 * (tree.floating and i > 0), i + 5 * (tree.floating and i > 0)
        body["kind"] = _FREE if free else _PRISMATIC if tree.prismatic[i] else _REVOLUTE
        body["R0"], body["p"], body["u"] = R0, before.T @ tree.translation[i], u
        body["fixed"], body["cosine"], body["sine"] = along, R0 - along, R0 @ skew
        body["sparse"] = bool(principal and not tree.prismatic[i] and np.count_nonzero(R0) == 3)
        body["shifted"] = bool(not body["sparse"] or np.any(body["p"]))
        axes = np.argmax(np.abs(R0), axis=0) if body["sparse"] else np.arange(3)
        odd = (axes[1] - axes[0]) % 3 != 1
        body["axes"], body["sign"], body["lever"] = axes, R0[axes, range(3)], (-1.0 if odd else 1.0) * body["p"][axes]
        body["turn"] = u[2]
    handle = _kernel.make_tree(bodies.tobytes(), tree.nv, tree.nq, np.ascontiguousarray(tree.gravity))
    return CompiledTree(handle, bodies, order)


def _sampled(tree: RigidBodyTree) -> Array:
    """Regressor at a few generic states (16, nv, 10 nb): what is zero in all of them is zero always."""
    rng = np.random.default_rng(0)
    q = rng.uniform(-np.pi, np.pi, (16, tree.nq))
    if tree.floating:
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    return numpy_dynamics.regressor(tree, q, rng.normal(size=(16, tree.nv)), rng.normal(size=(16, tree.nv)))


def _plan(tree: RigidBodyTree, own: CompiledTree, rows: Array, columns: Array, pattern: Array, dense: bool, whole: bool = False) -> RowPlan:
    """`rows` (R, nv): row map; `columns` (k,): chosen of the 10 nb rigid and the extra ones; `pattern` (R, e): the extra ones' factors."""
    rigid = 10 * tree.nb
    size = np.abs(np.einsum("rv,svc->src", rows, own.samples(tree))).max(axis=0)
    kind = np.tile([0, 1, 1, 1, 2, 2, 2, 2, 2, 2], tree.nb)
    largest = np.array([size[:, kind == k].max(initial=0.0) for k in range(3)])
    alive = size > _ZERO * largest[kind]
    table, steps, extras, live = [], [], [], []
    for r in range(len(rows)):
        shown = [p for p, c in enumerate(columns) if (alive[r, c] if c < rigid else pattern[r, c - rigid] != 0.0)]
        place = {int(columns[p]): t for t, p in enumerate(shown)}
        width = len(shown) + 1
        padded = -(-width // 4) * 4
        if whole:  # all ten parameters of every body, at their own place
            place = dict(zip(range(rigid), range(rigid), strict=True))
        mine = _steps(tree, own, rows[r], place)
        chosen = [(c - rigid, place[c], pattern[r, c - rigid]) for c in place if c >= rigid]
        table.append((len(mine), len(chosen), width, padded if not whole else rigid + 4 - rigid % 4))
        steps.extend(mine)
        extras.extend(chosen)
        live.append(np.array([*shown, len(columns)]))
    handle = _kernel.make_plan(
        own.handle,
        len(rows),
        np.array(table, np.int64).tobytes(),
        np.array(steps, _STEP).tobytes(),
        np.array(extras, _EXTRA).tobytes(),
        pattern.shape[1],
        int(dense),
    )
    return RowPlan(handle, tuple(live), tuple(t[3] for t in table))


def _steps(tree: RigidBodyTree, own: CompiledTree, row: Array, place: dict[int, int]) -> list[tuple[Any, ...]]:
    """The bodies that take part in one row, base first, without those that show no column themselves or further on."""
    joins, active, needed = (np.zeros(tree.nb, bool) for _ in range(3))
    for i, body in enumerate(own.bodies):
        joins[i] = bool(np.any(row[body["row"] : body["row"] + (6 if body["kind"] == _FREE else 1)]))
        active[i] = joins[i] or (body["parent"] >= 0 and active[body["parent"]])
    shows = np.array([any(10 * i + k in place for k in range(10)) for i in range(tree.nb)])
    leads = np.zeros(tree.nb, bool)
    for i in reversed(range(tree.nb)):
        needed[i] = active[i] and (shows[i] or leads[i])
        if tree.parent[i] >= 0:
            leads[tree.parent[i]] |= needed[i]
    steps = []
    for i in range(tree.nb):
        if not needed[i]:
            continue
        body = own.bodies[i]
        twist = np.zeros(6)
        if body["kind"] == _FREE:
            twist[:] = row[:6]
        else:
            twist[3 * (body["kind"] == _REVOLUTE) :][:3] = row[body["row"]] * body["u"]
        starts = body["parent"] < 0 or not active[body["parent"]]
        column = [place.get(10 * i + int(k), -1) for k in own.order[i]]
        steps.append((i, starts, starts and body["sparse"], joins[i], shows[i], leads[i], column, twist))
    return steps
