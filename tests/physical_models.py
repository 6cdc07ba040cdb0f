"""Random robots with real links as plain structures, and the PUMA 560 with its published sets, for the tests of `ident.physical`."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ident.friction import Coulomb, RotorInertia, Viscous
from ident.model import Model
from ident.physical import InertiaStructure, Subject, published_subject
from ident.regressor.rigid import regressor
from ident.robots import load_robot, nominal_values, published_tables
from ident.robots.tree import RigidBodyTree

Array = np.ndarray


def rotation(rng: np.random.Generator) -> Array:
    q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def random_tree(rng: np.random.Generator, bodies: int, *, chain: bool, prismatic: float, right: bool, floating: bool) -> RigidBodyTree:
    """A tree with right-angled or oblique axes; with `floating`, body 0 is a free-flyer."""
    parent, R, p, axis, slides = [], [], [], [], []
    for i in range(bodies):
        parent.append(i - 1 if chain or i == 0 else int(rng.integers(0 if floating else -1, i)))
        if right:
            c, s = np.round(np.cos(a := rng.integers(-1, 3) * np.pi / 2)), np.round(np.sin(a))
            R.append(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]))
            p.append(np.array([rng.choice([0, 0.3, 0.4]), 0, rng.choice([0, 0.1, 0.3])]) if i else np.zeros(3))
            axis.append(np.array([0, 0, 1.0]))
        else:
            R.append(rotation(rng))
            p.append(rng.uniform(-0.4, 0.4, 3))
            u = rng.standard_normal(3)
            axis.append(u / np.linalg.norm(u))
        slides.append(bool(rng.random() < prismatic))
    if floating:
        slides[0], axis[0] = False, np.zeros(3)
    return RigidBodyTree(np.array(parent), np.array(R), np.array(p), np.array(axis), np.array(slides), np.array([0, 0, -9.81]), floating)


def random_links(rng: np.random.Generator, bodies: int) -> Array:
    """Inertial parameters (10 nb,) of real bodies of unlike size."""
    out: list[float] = []
    for i in range(bodies):
        m, c = 10 ** rng.uniform(-1, 1.3) * 0.9**i, rng.uniform(-0.2, 0.2, 3)
        turn = rotation(rng)
        second = m * (turn @ np.diag(rng.uniform(0.03, 0.2, 3) ** 2) @ turn.T + np.outer(c, c))
        inertia = np.trace(second) * np.eye(3) - second
        out += [m, *(m * c), *(inertia[x, y] for x, y in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)))]
    return np.array(out)


def base_of(tree: RigidBodyTree, reflected: Array, rng: np.random.Generator) -> Array:
    """Regrouping matrix (b, k) over links and rotors, by Gram-Schmidt on random samples: independent of the toolkit's own."""
    N = 60 + 10 * tree.nb
    q = rng.uniform(-3, 3, (N, tree.nq))
    if tree.floating:
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    ddq = rng.standard_normal((N, tree.nv)) * 3
    Y = np.concatenate([regressor(tree, q, rng.standard_normal((N, tree.nv)), ddq), np.einsum("rij,Nj->Nir", reflected, ddq)], axis=2)
    R = np.linalg.qr(Y.reshape(-1, Y.shape[2]), mode="r")
    size = np.linalg.norm(R, axis=0)
    kept: list[int] = []
    Q = np.zeros((len(R), 0))
    order = [10 * link + s for link in range(tree.nb) for s in (9, 4, 5, 7, 8, 1, 2, 3, 6, 0)] + list(range(10 * tree.nb, R.shape[1]))
    for j in order:
        if size[j] < 1e-9 * size.max():
            continue
        v = R[:, j] / size[j]
        v = v - Q @ (Q.T @ v)
        v -= Q @ (Q.T @ v)
        if np.linalg.norm(v) > 1e-7:
            kept.append(j)
            Q = np.concatenate([Q, v[:, None] / np.linalg.norm(v)], axis=1)
    index = np.array(sorted(kept))
    X = np.linalg.lstsq(R[:, index], R, rcond=None)[0]
    X[np.abs(X) < 1e-9] = 0
    X[:, index] = np.eye(len(index))
    return X


def random_structure(
    rng: np.random.Generator,
    bodies: int,
    *,
    chain: bool = True,
    prismatic: float = 0.2,
    right: bool = True,
    floating: bool = False,
    rotors: bool = True,
    coupled: bool = False,
    limits: bool = False,
) -> tuple[InertiaStructure, Array]:
    """A random robot behind (coupled) gears, and all its parameters: real links, positive rotor inertias."""
    tree = random_tree(rng, bodies, chain=chain, prismatic=prismatic, right=right, floating=floating)
    first, nv = 6 * floating, tree.nv
    n = nv - first
    K_inverse = np.diag(rng.uniform(30, 100, n) * rng.choice([-1, 1], n))
    for i in range(1, n):
        if coupled and rng.random() < 0.5:
            K_inverse[i, i - 1] = rng.uniform(-30, 30)
    reflected = np.zeros((n if rotors else 0, nv, nv))
    for i in range(len(reflected)):
        e = np.zeros(nv)
        e[first:] = K_inverse[i]
        reflected[i] = np.outer(e, e)
    lower = rng.uniform(-2.5, -0.3, n)
    upper = lower + rng.uniform(0.5, 4, n)
    slides = tree.prismatic[int(floating) :]
    lower, upper = np.where(slides, -0.4, lower), np.where(slides, 0.6, upper)
    if not limits:
        lower, upper = np.where(slides, lower, -np.inf), np.where(slides, upper, np.inf)
    structure = InertiaStructure.from_arrays(
        tree,
        base_of(tree, reflected, rng),
        drive=np.arange(10 * tree.nb, 10 * tree.nb + len(reflected)),
        reflected=reflected,
        limits=(lower, upper),
    )
    return structure, np.concatenate([random_links(rng, tree.nb), 10 ** rng.uniform(-5, -4, len(reflected))])


@lru_cache
def puma_table(number: str) -> Subject:
    """A published set of the PUMA 560."""
    return published_subject(load_robot("puma560"), published_tables("puma560")[number].values, f"table {number}")


@lru_cache
def puma_model() -> Model:
    """PUMA 560 with rotor inertia, viscous and Coulomb friction."""
    return load_robot("puma560").rigid_body() + RotorInertia() + Viscous() + Coulomb()


@lru_cache
def puma_truth() -> tuple[InertiaStructure, Array, Array]:
    """The consistent PUMA 560: structure, base values (b,), links (10 nb,)."""
    model = puma_model()
    structure = puma_table("1").structure
    assert model.robot.nominal is not None
    return structure, structure.regroup @ nominal_values(model), model.robot.nominal
