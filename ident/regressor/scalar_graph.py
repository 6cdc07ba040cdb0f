"""Arithmetic written down before it is done: a graph of scalar operations that are simplified, shared and counted.

Whoever computes with `Scalar` instead of numbers gets the straight-line program of it: constants are folded, sums with zero and products
with zero and one vanish, equal expressions are computed once, and what no output needs is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

Array = np.ndarray
#: A constant so near to 0, 1 or -1 is that: what is left of a right angle.
_EXACT = 1e-12


class Operation(StrEnum):
    """What a node of the graph does."""

    CONSTANT = "constant"
    INPUT = "input"
    ADD = "add"
    SUBTRACT = "subtract"
    MULTIPLY = "multiply"
    NEGATE = "negate"


@dataclass(frozen=True, eq=False)
class Scalar:
    """A number that is known later: the node `number` of a `graph`; `value` of a constant."""

    graph: ScalarGraph = field(repr=False)
    number: int
    value: float | None = None

    def __add__(self, other: Scalar | float) -> Scalar:
        return self.graph.add(self, self.graph.of(other))

    def __sub__(self, other: Scalar | float) -> Scalar:
        return self.graph.add(self, self.graph.negate(self.graph.of(other)))

    def __mul__(self, other: Scalar | float) -> Scalar:
        return self.graph.multiply(self, self.graph.of(other))

    def __neg__(self) -> Scalar:
        return self.graph.negate(self)

    __radd__ = __add__
    __rmul__ = __mul__


@dataclass(eq=False)
class ScalarGraph:
    """All operations so far, each once: `nodes` of (operation, its operands or its name or value)."""

    nodes: list[tuple[Operation, tuple[object, ...]]] = field(default_factory=list)
    _known: dict[tuple[Operation, tuple[object, ...]], Scalar] = field(default_factory=dict, repr=False)

    def input(self, name: str) -> Scalar:
        """A number that is given when the program runs."""
        return self._node(Operation.INPUT, (name,))

    def of(self, value: Scalar | float) -> Scalar:
        """A constant; a scalar as it is."""
        if isinstance(value, Scalar):
            return value
        number = float(value)
        nearest = float(round(number)) if abs(number) < 1.5 else number
        return self._node(Operation.CONSTANT, (nearest if abs(number - nearest) < _EXACT else number,))

    def add(self, a: Scalar, b: Scalar) -> Scalar:
        """The sum; a difference where one is a negative."""
        if a.value is not None and b.value is not None:
            return self.of(a.value + b.value)
        if a.value == 0.0 or b.value == 0.0:
            return b if a.value == 0.0 else a
        away, taken = self._negated(a), self._negated(b)
        if away is not None and taken is not None:
            return self.negate(self.add(away, taken))
        if taken is not None or away is not None:
            first, second = (a, taken) if taken is not None else (b, away)
            assert second is not None
            return self.of(0.0) if first.number == second.number else self._node(Operation.SUBTRACT, (first.number, second.number))
        return self._node(Operation.ADD, tuple(sorted((a.number, b.number))))

    def multiply(self, a: Scalar, b: Scalar) -> Scalar:
        """The product, constants first."""
        if a.value is not None and b.value is not None:
            return self.of(a.value * b.value)
        if b.value is not None:
            a, b = b, a
        if a.value is not None:
            if a.value in (0.0, 1.0, -1.0):
                return self.of(0.0) if a.value == 0.0 else (b if a.value == 1.0 else self.negate(b))
            operation, operands = self.nodes[b.number]
            if operation == Operation.MULTIPLY and (inner := self._scalar(operands[0])).value is not None:
                return self.multiply(self.of(a.value * inner.value), self._scalar(operands[1]))
            if a.value < 0.0:
                return self.negate(self.multiply(self.of(-a.value), b))
        for one, other in ((a, b), (b, a)):
            if (inside := self._negated(one)) is not None:
                return self.negate(self.multiply(inside, other))
        order = (a.number, b.number) if a.value is not None else tuple(sorted((a.number, b.number)))
        return self._node(Operation.MULTIPLY, order)

    def negate(self, a: Scalar) -> Scalar:
        """The negative: no operation, as it becomes a difference further on."""
        if a.value is not None:
            return self.of(-a.value)
        inside = self._negated(a)
        if inside is not None:
            return inside
        operation, operands = self.nodes[a.number]
        if operation == Operation.SUBTRACT:
            return self._node(Operation.SUBTRACT, operands[::-1])
        return self._node(Operation.NEGATE, (a.number,))

    def _negated(self, a: Scalar) -> Scalar | None:
        operation, operands = self.nodes[a.number]
        return self._scalar(operands[0]) if operation == Operation.NEGATE else None

    def _scalar(self, number: object) -> Scalar:
        assert isinstance(number, int)
        operation, operands = self.nodes[number]
        return Scalar(self, number, float(str(operands[0])) if operation == Operation.CONSTANT else None)

    def _node(self, operation: Operation, operands: tuple[object, ...]) -> Scalar:
        key = (operation, operands)
        if key not in self._known:
            self.nodes.append(key)
            value = operands[0] if operation == Operation.CONSTANT else None
            self._known[key] = Scalar(self, len(self.nodes) - 1, value)  # type: ignore[arg-type]
        return self._known[key]


@dataclass(frozen=True, eq=False)
class Program:
    """What it takes to compute some outputs: the `graph`, the `outputs`, the numbers of the nodes that are `needed`, in order."""

    graph: ScalarGraph
    outputs: tuple[Scalar, ...]
    needed: tuple[int, ...]

    @classmethod
    def of(cls, graph: ScalarGraph, outputs: Sequence[Scalar]) -> Program:
        """Without what no output needs."""
        needed: set[int] = set()
        stack = [out.number for out in outputs]
        while stack:
            number = stack.pop()
            if number in needed:
                continue
            needed.add(number)
            operation, operands = graph.nodes[number]
            if operation not in (Operation.CONSTANT, Operation.INPUT):
                stack += [o for o in operands if isinstance(o, int)]
        return cls(graph, tuple(outputs), tuple(sorted(needed)))

    @property
    def multiplications(self) -> int:
        """Number of products."""
        return sum(self.graph.nodes[i][0] == Operation.MULTIPLY for i in self.needed)

    @property
    def additions(self) -> int:
        """Number of sums and differences."""
        return sum(self.graph.nodes[i][0] in (Operation.ADD, Operation.SUBTRACT) for i in self.needed)

    def run(self, inputs: Mapping[str, Array]) -> list[Array]:
        """The outputs for inputs by name, each an array of one shape."""
        found: dict[int, Array] = {}
        some = next(iter(inputs.values()))
        for i in self.needed:
            operation, operands = self.graph.nodes[i]
            if operation == Operation.CONSTANT:
                found[i] = np.full(np.shape(some), operands[0], float)
            elif operation == Operation.INPUT:
                found[i] = np.asarray(inputs[str(operands[0])], float)
            elif operation == Operation.NEGATE:
                found[i] = -found[operands[0]]  # type: ignore[index]
            else:
                a, b = (found[o] for o in operands)  # type: ignore[index]
                found[i] = a + b if operation == Operation.ADD else a - b if operation == Operation.SUBTRACT else a * b
        return [found[out.number] for out in self.outputs]
