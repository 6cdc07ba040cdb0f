"""The rigid-body kernels on random trees: Pinocchio's numbers to 1e-12, and information equal to the stacked matrix.

The slow run takes 500 trees: `pytest -m slow tests/property/test_rigid_trees.py`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigid_models import difference, kernels, oracle, parameters, random_model, states, tree_of, using


def check_tree(seed: int, name: str, joints: int, floating: bool, samples: int) -> None:
    """Everything one kernel computes of one tree, against Pinocchio."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, joints, floating)
    tree, inertia = tree_of(model), parameters(model)
    q, dq, ddq = states(model, rng, samples)
    wanted = oracle(model, q, dq, ddq)
    with using(name) as kernel:
        found = kernel.dynamics.regressor(tree, q, dq, ddq)
        assert difference(found, wanted["regressor"]) < 1e-12
        assert difference(kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq), wanted["inverse"]) < 1e-12
        assert difference(kernel.dynamics.bias_torque(tree, inertia, q, dq), wanted["bias"]) < 1e-12
        assert difference(kernel.dynamics.mass_matrix(tree, inertia, q), wanted["mass"]) < 1e-12
        added = np.diag(rng.uniform(0, 1, model.nv))
        tau = wanted["inverse"] + ddq @ added
        back = kernel.dynamics.forward_dynamics(tree, inertia, q, dq, tau, added)
        assert difference(back, ddq) < 1e-13 * max(np.linalg.cond(wanted["mass"] + added).max(), 10.0)
        check_information(kernel, tree, rng, q, dq, ddq, wanted["regressor"])


def check_information(kernel, tree, rng, q, dq, ddq, regressor) -> None:
    rows = rng.normal(size=(tree.nv, tree.nv)) * (rng.random((tree.nv, tree.nv)) < 0.4)
    columns = np.sort(rng.permutation(10 * tree.nb)[: rng.integers(1, 10 * tree.nb + 1)])
    tau = rng.normal(size=(len(q), tree.nv))
    none = np.zeros((len(q), 0))
    stacked = np.concatenate([np.einsum("rv,nvc->nrc", rows, regressor)[:, :, columns], tau[:, :, None]], axis=2)
    wanted = np.einsum("nrc,nrd->rcd", stacked, stacked)
    for gram in (False, True):
        found = kernel.rows.information(tree, q, dq, ddq, tau, rows, columns, none, np.zeros((tree.nv, 0)), None, None, gram, 1)
        if not gram:
            found = np.swapaxes(found, 1, 2) @ found
        for row in range(tree.nv):
            assert difference(found[row], wanted[row]) < 1e-12


@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 12), floating=st.booleans(), samples=st.integers(1, 20))
@pytest.mark.parametrize("name", kernels())
def test_random_trees(name, seed, joints, floating, samples):
    check_tree(seed, name, joints, floating, samples)


@pytest.mark.slow
@pytest.mark.parametrize("name", kernels())
def test_five_hundred_trees(name):
    """Up to 36 joints, fixed and floating, 500 trees for each kernel."""
    for seed in range(500):
        joints = 1 + (seed * 7) % 36
        check_tree(seed, name, joints, seed % 3 == 0, 3 + seed % 7)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1.0, 1e-3, 1e3]))
@pytest.mark.parametrize("name", kernels())
def test_torque_is_linear_and_energy_is_conserved(name, seed, size):
    """dq'(M ddq + h - g) is the rate of kinetic energy; torque is linear in any parameters, physical or not."""
    rng = np.random.default_rng(seed)
    model = random_model(rng, 5, False)
    tree = tree_of(model)
    q, dq, ddq = states(model, rng, 4)
    first, second = rng.normal(size=(2, 50)) * size
    with using(name) as kernel:

        def torque(inertia):
            return kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq)

        assert difference(torque(first + second), torque(first) + torque(second)) < 1e-12
        h = 1e-6
        energy = [np.einsum("ni,nij,nj->n", dq, kernel.dynamics.mass_matrix(tree, first, q + s * h * dq), dq) / 2 for s in (-1, 1)]
        still = kernel.dynamics.bias_torque(tree, first, q, 0 * dq)
        coriolis = kernel.dynamics.bias_torque(tree, first, q, dq) - still
        scale = np.abs(dq * coriolis).sum(axis=1).max() + np.abs(energy).max()
        assert np.abs((energy[1] - energy[0]) / (2 * h) - (dq * coriolis).sum(axis=1)).max() < 1e-7 * scale
