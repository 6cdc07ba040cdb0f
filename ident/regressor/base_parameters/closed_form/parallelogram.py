"""Theorem 2.5.1: an arm with one planar parallelogram, through the tree cut open at one joint (Yoshida 1995, corrected).

Links xi and zeta turn about the same axis on the link before; xi + 1 hangs on xi and stays parallel to zeta, zeta + 1 hangs on
zeta and stays parallel to xi: theta_{xi+1} = theta_zeta - theta_xi - rho - pi, theta_{zeta+1} = theta_xi - theta_zeta. The loop
closure (`[loop]`) must say just that; which of the joints are independent in it does not matter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...._utils.singular_values import matrix_rank
from ..base_form import BaseForm, make_form
from .frames import ANGLE, AxisFrames, Chain, axis_frames, link_change, read_tree, refuse_nearly_parallel, unsupported
from .linear_forms import LinkForms, point_inertia, point_moment
from .oblique import chain_rows, distal_moments, next_twist, sine, tilted_inertia
from .rotational import hidden_moments

if TYPE_CHECKING:
    from ....robots.robot import Robot

Array = np.ndarray
_THEOREM = "theorem 2.5.1 (planar parallelogram)"


@dataclass(frozen=True, eq=False)
class Parallelogram:
    """Where the parallelogram is: `main` bodies of the chain 1..N, `xi` its 1-based number, `zeta`, `zeta_next` the other bodies."""

    main: tuple[int, ...]
    xi: int
    zeta: int
    zeta_next: int


def parallelogram(robot: Robot) -> BaseForm:
    """Base parameters of a chain of revolute joints, axes at any angles, with one planar parallelogram.

    Raises UnsupportedError, with the reason, for any other structure."""
    chain = read_tree(robot, _THEOREM)
    where = find_parallelogram(chain)
    main, xi = list(where.main), where.xi
    frames = axis_frames(chain.points[main], chain.axes[main], chain.zero_length, level=xi)
    refuse_nearly_parallel(robot, _THEOREM, frames, [robot.tree_joints[b].name for b in main])
    z, origin = frames.rotation[xi - 1, :, 2], frames.origin[xi - 1]
    reach = chain.points[where.zeta_next] - origin
    reach = reach - (reach @ z) * z
    L_zeta, L_xi = float(np.linalg.norm(reach)), float(frames.length[xi - 1, 0])
    if min(L_zeta, L_xi) <= chain.zero_length:
        raise unsupported(robot, _THEOREM, "a side of the parallelogram has no length")
    x_zeta = reach / L_zeta
    turn_zeta = np.stack([x_zeta, np.cross(z, x_zeta), z], axis=-1)
    A_rho = frames.rotation[xi].T @ turn_zeta  # turns frame zeta into frame xi + 1: Rz(rho + pi)
    cos_rho, sin_rho = -float(A_rho[0, 0]), -float(A_rho[1, 0])

    changes = {body: link_change(chain.poses[body], frames.rotation[i], frames.origin[i]) for i, body in enumerate(main)}
    changes[where.zeta] = link_change(chain.poses[where.zeta], turn_zeta, origin)
    changes[where.zeta_next] = link_change(chain.poses[where.zeta_next], frames.rotation[xi - 1], origin + reach)
    forms = LinkForms(changes, robot.tree.nb)
    N, K = frames.count, len(frames.clusters()[0])
    crank, coupler = where.zeta, where.zeta_next
    R, J = _main_links(forms, where, frames)
    L_crank = np.array([L_zeta, 0.0, 0.0])
    R_zeta = forms.moment(crank) + point_moment(forms.mass(coupler), L_crank)
    J_zeta = forms.inertia(crank) + point_inertia(forms.mass(coupler), L_crank)
    R_next, J_next = forms.moment(coupler), forms.inertia(coupler)

    Rb = np.array(R)
    Rb[xi - 1] += R_next
    Rb[xi] += np.tensordot(A_rho, R_zeta, axes=1)
    first = Rb[:, 2].copy()
    first[xi] = R[xi][2]  # RZ(xi) begins with the plain R_{xi+1}^z
    RZ = distal_moments(frames, Rb, first)
    inertia = [tilted_inertia(J[n - 1], frames.length[n - 1], next_twist(frames, n), RZ[n - 1]) for n in range(1, N + 1)]
    tilted_zeta = tilted_inertia(J_zeta, L_crank, 0.0, R_next[2])
    inertia[xi] = inertia[xi] + np.einsum("ij,jkw,lk->ilw", A_rho, tilted_zeta, A_rho)
    inertia[xi - 1] = inertia[xi - 1] + J_next

    Q = hidden_moments(chain, frames, K)
    early = xi + 1 <= K
    rows = chain_rows(frames, Rb, inertia, RZ, Q, K, hidden=xi + 1 if early and xi == Q else 0)
    hat_y = R[xi][1] - sine(next_twist(frames, xi + 1)) * RZ[xi]
    px = L_xi * R[xi][0] - cos_rho * L_zeta * R_next[0]
    py = L_xi * hat_y - sin_rho * L_zeta * R_next[0]
    if early:
        rows += [("Px", px - sin_rho * L_zeta * R_next[1]), ("Py", py + cos_rho * L_zeta * R_next[1])]
    else:
        rows += [("R(zeta+1)y", R_next[1]), ("Px", px), ("Py", py)]
    B1 = (3 if xi == Q else 1) if early else 0
    count = 7 * N - 4 * K - 2 * Q + 3 - B1
    formula = f"7N - 4K - 2Q + 3 - B1 = 7*{N} - 4*{K} - 2*{Q} + 3 - {B1} = {count}"
    return make_form(robot, "parallelogram", tuple(n for n, _ in rows), np.array([r for _, r in rows]), formula)


def _main_links(forms: LinkForms, where: Parallelogram, frames: AxisFrames) -> tuple[list[Array], list[Array]]:
    """First moments R_n and inertias J_n of the chain's links, with the masses beyond each as points at its end."""
    R, J = [], []
    for n, body in enumerate(where.main, start=1):
        beyond = forms.masses(where.main[n:]) + (forms.masses([where.zeta, where.zeta_next]) if n < where.xi else 0.0)
        R.append(forms.moment(body) + point_moment(beyond, frames.length[n - 1]))
        J.append(forms.inertia(body) + point_inertia(beyond, frames.length[n - 1]))
    return R, J


def find_parallelogram(chain: Chain) -> Parallelogram:
    """Find the parallelogram in the tree and check the loop closure against it. Raises UnsupportedError with the reason."""
    robot, tree = chain.robot, chain.robot.tree
    if robot.loop.is_trivial:
        raise unsupported(robot, _THEOREM, "no loop is declared ([loop])", "closed_form.rotational(robot) for an open chain, else ")
    for joint in robot.tree_joints:
        if joint.prismatic:
            raise unsupported(robot, _THEOREM, f"joint {joint.name!r} is prismatic")
    children: dict[int, list[int]] = {}
    for body in range(tree.nb):
        children.setdefault(int(tree.parent[body]), []).append(body)
    forks = [(parent, bodies) for parent, bodies in children.items() if len(bodies) > 1]
    if len(forks) != 1 or len(forks[0][1]) != 2:
        raise unsupported(robot, _THEOREM, "the cut-open tree must fork exactly once, into the two sides of the parallelogram")
    parent, (one, other) = forks[0]

    def line(body: int) -> list[int]:
        bodies = [body]
        while children.get(bodies[-1]):
            bodies.append(children[bodies[-1]][0])
        return bodies

    before: list[int] = []
    body = parent
    while body >= 0:
        before.insert(0, body)
        body = int(tree.parent[body])
    reason = "neither branch after the fork is a crank with one coupler"
    for main, side in ((line(one), line(other)), (line(other), line(one))):
        if len(side) == 2 and len(main) >= 2:
            found = Parallelogram((*before, *main), len(before) + 1, side[0], side[1])
            reason = _mismatch(chain, found)
            if not reason:
                return found
    raise unsupported(robot, _THEOREM, reason)


def _mismatch(chain: Chain, where: Parallelogram) -> str:
    """What keeps this place from being the theorem's parallelogram, "" if nothing does."""
    robot = chain.robot
    names = [j.name for j in robot.tree_joints]
    links = [where.main[where.xi - 1], where.main[where.xi], where.zeta, where.zeta_next]
    z = chain.axes[links[0]]
    sense = []
    for body in links:
        if np.linalg.norm(np.cross(z, chain.axes[body])) > ANGLE:
            return f"the axis of {names[body]!r} is not parallel to that of {names[links[0]]!r}, so the loop is not planar"
        sense.append(float(np.sign(z @ chain.axes[body])))
    apart = np.cross(chain.points[links[2]] - chain.points[links[0]], z)
    if np.linalg.norm(apart) > chain.zero_length:
        return f"the axes of {names[links[0]]!r} and {names[links[2]]!r} do not coincide"
    W = robot.loop.W
    xi, xi_next, zeta, zeta_next = (s * W[body] for s, body in zip(sense, links, strict=True))
    for left, right, text in (
        (xi + xi_next, zeta, f"link {names[links[1]]!r} does not stay parallel to {names[links[2]]!r}"),
        (zeta + zeta_next, xi, f"link {names[links[3]]!r} does not stay parallel to {names[links[0]]!r}"),
    ):
        if np.abs(left - right).max() > 1e-12 * max(1.0, np.abs(W).max()):
            return f"by the declared [loop] {text}"
    if robot.n != len(where.main) or matrix_rank(W) < robot.n:
        return "[loop] makes more joints dependent than the parallelogram does"
    return ""
