"""Certificates on the continuum: a lower bound of H(q) over all positions, solved as one semidefinite program and checked afterwards.

The program is that of `chain`; what the solver returns is not believed but rebuilt: the Gram matrices are evaluated again in floating
point, and whatever they lack is taken off the bound. Where one bound is too weak, the range of one joint at a time is cut in two and
the halves are certified on their own (branch and bound)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .chain import Cross, RecursionStage, _independent_rows, build_stages, gram_freedom, gram_multiplier, spatial_units
from .conic import Block, ConicProgram, InfeasibleError, Solution, SolverError, solver_available, symmetric_basis
from .structure import InertiaStructure

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Certificate:
    """`bound`: H(q) >= bound * diag(weight) for all positions in the ranges, checked; it proves something where it is positive.

    `pieces`: boxes it was put together from; `reason` says why there is none (`bound` is then -inf)."""

    bound: float
    weight: Array
    pieces: int
    seconds: float
    reason: str = ""

    @property
    def eigenvalue_bound(self) -> float:
        """Lower bound of the smallest eigenvalue of H, kg m^2."""
        return float(self.bound * (self.weight.min() if self.bound > 0 else self.weight.max()))


class ChainProgram:
    """The chain's inequalities inside a conic program, for fixed base values or with base values as variables."""

    def __init__(self, structure: InertiaStructure, stages: list[RecursionStage], cross: list[Cross], program: ConicProgram) -> None:
        self.structure, self.stages, self.cross, self.program = structure, stages, cross, program
        self.shares = program.variables(2 * len(cross))
        self.units = [np.einsum("da,kde,eb->kab", s.state[:6], spatial_units(), s.state[:6]) for s in stages]
        self.bounds = [program.variables(s.width * (s.width + 1) // 2) for s in stages]
        self.free = [program.variables(len(gram_freedom(s))) for s in stages]
        self.multipliers = [None if (g := gram_multiplier(s)) is None else program.variables(len(g[1])) for s in stages]

    def constrain(self, constant: Array, columns: Array, sensitivity: Array, margin: float, margin_column: Array | None = None) -> None:
        """Add all inequalities for all parameters `constant` (k,) + `sensitivity` (k, c) @ x[columns], lambda = margin (+ a variable)."""
        for place, stage in enumerate(self.stages):
            const, blocks = self._gram(place, stage, constant, columns, sensitivity, margin, margin_column)
            self.program.semidefinite(const, blocks)
            multiplier = gram_multiplier(stage)
            if multiplier is not None and (at := self.multipliers[place]) is not None:
                g = multiplier[0]
                self.program.semidefinite(np.zeros((g, g)), [(at, symmetric_basis(g))])
        for c, pair in enumerate(self.cross):
            self.program.semidefinite(*self._shared(c, pair, constant, columns, sensitivity))

    def _shared(self, c: int, pair: Cross, constant: Array, columns: Array, sensitivity: Array) -> tuple[Array, list[Block]]:
        """[[alpha, c], [c, delta]] >= 0 for a rotor that couples two branches: what it can take is given to either side."""
        rows = _tree_rows(self.structure)
        entries = self.structure.reflected[:, rows[pair.rates[0]], rows[pair.rates[1]]] * pair.scale
        off = np.array([[0.0, 1.0], [1.0, 0.0]])
        blocks: list[Block] = [(self.shares[2 * c : 2 * c + 2], np.array([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]))]
        drive = self.structure.drive
        if len(columns):
            blocks.append((columns, (sensitivity[drive].T @ entries)[:, None, None] * off))
        return float(constant[drive] @ entries) * off, blocks

    def lower_bound(self, x: Array, values: Array, margin: float) -> float:
        """What the variables x prove for the full parameters `values` (k,), whatever the solver says of itself: a bound of lambda."""
        x = x.copy()
        for place, stage in enumerate(self.stages):
            multiplier, at = gram_multiplier(stage), self.multipliers[place]
            if multiplier is not None and at is not None:
                # A multiplier must be semidefinite; the nearest one is, and the Gram matrix below is rebuilt with it.
                basis = symmetric_basis(multiplier[0])
                eigenvalues, vectors = np.linalg.eigh(np.tensordot(x[at], basis, 1))
                matrix = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
                rows, columns = np.nonzero(np.triu(np.ones_like(matrix)))
                order = np.lexsort((rows, columns))
                x[at] = matrix[rows[order], columns[order]]
        lost = 0.0
        none = np.zeros(0, int), np.zeros((len(values), 0))
        for c, pair in enumerate(self.cross):
            base, blocks = self._shared(c, pair, values, *none)
            matrix = base + sum((np.tensordot(x[at], m, 1) for at, m in blocks), np.zeros((2, 2)))
            lost += max(1e-15 * float(np.abs(matrix).max()) - float(np.linalg.eigvalsh(matrix)[0]), 0.0)
        for place, stage in enumerate(self.stages):
            const, blocks = self._gram(place, stage, values, *none, margin, None)
            G = const + sum((np.tensordot(x[c], m, 1) for c, m in blocks), np.zeros_like(const))
            smallest = float(np.linalg.eigvalsh(G)[0]) if len(G) else 0.0
            slack = 1e-15 * len(G) * float(np.abs(G).max(initial=0.0)) - smallest
            # The functions of the joint have squares that sum to at most two.
            lost += 2.0 * max(slack, 0.0) * stage.weakness
        return margin - lost

    def _gram(
        self,
        place: int,
        stage: RecursionStage,
        constant: Array,
        columns: Array,
        sensitivity: Array,
        margin: float,
        margin_column: Array | None,
    ) -> tuple[Array, list[Block]]:
        s, structure = stage, self.structure
        head = s.f + s.r
        d = s.E.shape[0]

        def lifted(forms: Array) -> Array:
            """Forms (a, s, s) of u as Gram matrices."""
            out = np.zeros((len(forms), s.size, s.size))
            out[:, :head, :head] = np.einsum("ia,kij,jb->kab", s.T, forms, s.T)
            return out

        at = structure.inertial[10 * s.body : 10 * s.body + 10]
        units = np.einsum("da,kde,eb->kab", s.E, self.units[place], s.E)
        rotor = self._rotor(stage)
        const = np.tensordot(constant[at], units, 1) + lifted(np.tensordot(constant[structure.drive], rotor, 1)[None])[0]
        own = lifted(s.own[None])
        const = const - margin * own[0]
        blocks: list[Block] = []
        if len(columns):
            coefficients = np.tensordot(sensitivity[at].T, units, 1) + lifted(np.tensordot(sensitivity[structure.drive].T, rotor, 1))
            blocks.append((columns, coefficients))
        if margin_column is not None:
            blocks.append((margin_column, -own))
        for child, other in enumerate(self.stages):
            if other.parent == s.body:
                blocks.append((self.bounds[child], np.einsum("da,kde,eb->kab", s.E, symmetric_basis(d), s.E)))
        if s.width:
            forms = np.zeros((len(self.bounds[place]), len(s.T), len(s.T)))
            forms[:, : s.width, : s.width] = -symmetric_basis(s.width)
            blocks.append((self.bounds[place], lifted(forms)))
        for c, pair in enumerate(self.cross):
            for side, rate in enumerate(pair.rates):
                if rate in stage.rates:
                    form = np.zeros((1, len(stage.T), len(stage.T)))
                    place_in_u = s.width + stage.rates.index(rate)
                    form[0, place_in_u, place_in_u] = -1.0
                    blocks.append((self.shares[2 * c + side : 2 * c + side + 1], lifted(form)))
        if len(self.free[place]):
            blocks.append((self.free[place], gram_freedom(stage)))
        multiplier = gram_multiplier(stage)
        if multiplier is not None and (m := self.multipliers[place]) is not None:
            blocks.append((m, -multiplier[1]))
        return const, blocks

    def _rotor(self, stage: RecursionStage) -> Array:
        """Forms (r, s, s) of u per drive inertia that belong to this joint's rates."""
        structure = self.structure
        size = len(stage.T)
        out = np.zeros((len(structure.drive), size, size))
        rows = _tree_rows(structure)
        for (a, b), form in zip(stage.pairs, stage.rotor, strict=True):
            out += structure.reflected[:, rows[a], rows[b], None, None] * form
        return out


def _tree_rows(structure: InertiaStructure) -> dict[int, int]:
    """Independent velocity of a tree rate."""
    return {row: j for j, row in enumerate(_independent_rows(structure))}


def certify(
    structure: InertiaStructure,
    values: Array,
    lower: Array,
    upper: Array,
    weight: Array,
    *,
    time_limit: float = 10.0,
    splits: bool = True,
) -> Certificate:
    """Largest certified lambda with H(q) >= lambda diag(weight) for lower <= q <= upper; boxes are cut until it is positive or time is up.

    `values` (b,) base values, `weight` (nv,). Never raises for want of a proof: `reason` says what was missing."""
    start = time.perf_counter()
    if not solver_available():
        return Certificate(-np.inf, weight, 0, 0.0, "the semidefinite solver Clarabel is not installed (pip install 'ident[sdp]')")
    first = _certify_box(structure, values, lower, upper, weight, time_limit)
    if isinstance(first, str):
        return Certificate(-np.inf, weight, 0, time.perf_counter() - start, first)
    pieces = 1
    if first <= 0 and splits:
        first, pieces = _branch(structure, values, lower, upper, weight, first, start + time_limit)
    reason = "" if first > 0 else f"the best bound after {pieces} pieces and {time.perf_counter() - start:.1f} s is not positive"
    return Certificate(first, weight, pieces, time.perf_counter() - start, reason)


def _certify_box(structure: InertiaStructure, values: Array, lower: Array, upper: Array, weight: Array, time_limit: float) -> float | str:
    stages, cross = build_stages(structure, weight, lower, upper)
    program = ConicProgram()
    chain = ChainProgram(structure, stages, cross, program)
    margin = program.variables(1)
    full = structure.lift @ values
    free = structure.null_space if structure.has_loop else np.zeros((structure.k, 0))
    columns = program.variables(free.shape[1])
    chain.constrain(full, columns, free, 0.0, margin)
    program.linear(margin, np.array([-1.0]))
    try:
        found: Solution = program.solve("the certificate", accept=np.inf, time_limit=max(time_limit, 0.1))
    except (InfeasibleError, SolverError) as error:
        return str(error)
    best = float(found.x[margin][0])
    return chain.lower_bound(found.x, full + free @ found.x[columns], best)


def _branch(
    structure: InertiaStructure, values: Array, lower: Array, upper: Array, weight: Array, bound: float, deadline: float
) -> tuple[float, int]:
    """Cut the box with the lowest bound along the joint that helps most, until all bounds are positive or time is up: (bound, pieces)."""
    boxes = [(bound, lower, upper)]
    while boxes[0][0] <= 0 and time.perf_counter() < deadline:
        bound, lower, upper = boxes.pop(0)
        best: list[tuple[float, Array, Array]] | None = None
        for i in np.flatnonzero(structure.relevant & (upper - lower > 1e-3)):
            middle = 0.5 * (lower[i] + upper[i])
            halves: list[tuple[float, Array, Array]] = []
            for a, b in ((lower[i], middle), (middle, upper[i])):
                lo, up = lower.copy(), upper.copy()
                lo[i], up[i] = a, b
                value = _certify_box(structure, values, lo, up, weight, deadline - time.perf_counter())
                if isinstance(value, str):
                    halves = []
                    break
                halves.append((value, lo, up))
            if halves and (best is None or min(h[0] for h in halves) > min(h[0] for h in best)):
                best = halves
            if best is not None and min(h[0] for h in best) > 0:
                break
            if time.perf_counter() > deadline:
                break
        if best is None:
            boxes.insert(0, (bound, lower, upper))
            break
        boxes = sorted([*boxes, *best], key=lambda box: box[0])
    return boxes[0][0], len(boxes)
