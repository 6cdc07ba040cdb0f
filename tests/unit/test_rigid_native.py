"""Choice of the kernel, the compiled module's own checks, and a clean run under sanitizers.

The sanitizer run (slow) builds the extension apart with -fsanitize=address,undefined and runs the kernel's tests on it:
`pytest -m slow tests/unit/test_rigid_native.py`."""

from __future__ import annotations

import importlib
import sys
import warnings

import numpy as np
import pytest
from rigid_models import native, needs_native

import ident
from ident._native import choice
from ident.errors import ConfigurationError
from ident.regressor import kernel_choice
from tests.fuzz import sanitized


def test_environment_chooses_the_kernel(monkeypatch):
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    assert not kernel_choice.kernel().compiled
    monkeypatch.setenv("IDENT_KERNEL", "fortran")
    with pytest.raises(ConfigurationError, match="IDENT_KERNEL='fortran'"):
        kernel_choice.kernel()


@pytest.mark.parametrize("name", ["_recursions", "_filters", "_text"])
def test_the_environment_switches_every_compiled_module_off(name, monkeypatch):
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    assert choice.compiled(name) is None
    pytest.importorskip(f"ident._native.{name}", reason="the compiled modules were not built")
    for asked in ("", "native"):
        monkeypatch.setenv("IDENT_KERNEL", asked)
        assert choice.compiled(name).__name__ == f"ident._native.{name}"


def test_a_compiled_module_that_was_asked_for_and_is_not_there_is_an_error(monkeypatch):
    monkeypatch.setenv("IDENT_KERNEL", "native")
    with pytest.raises(ConfigurationError, match="compiled kernel is not there"):
        choice.compiled("_nothing")
    monkeypatch.delenv("IDENT_KERNEL")
    assert choice.compiled("_nothing") is None


@needs_native
def test_native_is_the_default(monkeypatch):
    monkeypatch.delenv("IDENT_KERNEL", raising=False)
    assert kernel_choice.kernel().dynamics is native()


def test_says_once_that_it_is_slower(monkeypatch):
    """Without the extension NumPy takes over, and says so once; asked for by name, it is an error."""
    monkeypatch.delenv("IDENT_KERNEL", raising=False)
    monkeypatch.setitem(sys.modules, "ident.regressor.native", None)
    monkeypatch.delattr("ident.regressor.native", raising=False)
    kernel_choice._kernel.cache_clear()
    try:
        with pytest.warns(kernel_choice.SlowPathWarning, match="IDENT_KERNEL=numpy silences"):
            assert not kernel_choice.kernel().compiled
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert not kernel_choice.kernel().compiled
        monkeypatch.setenv("IDENT_KERNEL", "native")
        with pytest.raises(ConfigurationError, match="compiled kernel is not there"):
            kernel_choice.kernel()
    finally:
        kernel_choice._kernel.cache_clear()


@needs_native
def test_threads_from_the_environment(monkeypatch):
    module = native()
    monkeypatch.setenv("IDENT_NUM_THREADS", "3")
    assert module.thread_count() == 3
    assert module.thread_count(2) == 2
    for text in ("0", "two", "-1"):
        monkeypatch.setenv("IDENT_NUM_THREADS", text)
        with pytest.raises(ConfigurationError, match="IDENT_NUM_THREADS"):
            module.thread_count()
    with pytest.raises(ConfigurationError, match="threads=0"):
        module.thread_count(0)


@needs_native
def test_unknown_instruction_set():
    with pytest.raises(ConfigurationError, match="there is baseline"):
        native().use_instruction_set("mmx")


@needs_native
def test_compiled_module_checks_sizes_and_records():
    """What Python should never send is refused, not run."""
    module = native()
    kernel = module._kernel
    robot = ident.load_robot("puma560")
    tree = robot.tree
    own = module.compiled(tree)
    q = np.zeros((3, 6))
    out = np.zeros((3, 6))
    inertia = np.zeros(60)

    def compute(handle, q, dq, ddq, out):
        kernel.compute(1, handle, None, inertia, None, 3, 1, q, dq, ddq, None, out, None)

    with pytest.raises(ValueError, match="q: expected 144 bytes, given 96"):
        compute(own.handle, q[:2], q, q, out)
    with pytest.raises(ValueError, match="not an array of float64"):
        compute(own.handle, q.astype(int), q, q, out)
    with pytest.raises(ValueError, match="not a contiguous array"):
        compute(own.handle, np.zeros((3, 12))[:, ::2], q, q, out)
    with pytest.raises(ValueError, match="array is missing"):
        compute(own.handle, None, q, q, out)
    with pytest.raises(ValueError, match="expected a tree"):
        compute(own.whole(tree), q, q, q, out)
    with pytest.raises(TypeError, match="expected 13 arguments, given 1"):
        kernel.compute(own.handle)
    with pytest.raises(ValueError, match="unknown task"):
        kernel.compute(7, own.handle, None, inertia, None, 3, 1, q, q, q, None, out, None)
    frozen = out.copy()
    frozen.flags.writeable = False
    with pytest.raises(ValueError, match="out: not a contiguous array"):
        compute(own.handle, q, q, q, frozen)
    bodies = own.bodies.copy()
    bodies["parent"][2] = 5
    with pytest.raises(ValueError, match="a body is out of range"):
        kernel.make_tree(bodies.tobytes(), 6, 6, np.zeros(3))


@needs_native
def test_trees_are_freed():
    """A tree that is gone leaves nothing in the cache."""
    import gc

    from ident.robots.tree import RigidBodyTree

    module = native()
    model = ident.load_robot("puma560").model
    trees = importlib.import_module(module.compiled.__module__)._TREES
    before = len(trees)
    for _ in range(5):
        tree = RigidBodyTree.from_pinocchio(model)
        module.regressor(tree, *np.zeros((3, 2, 6)))
    del tree
    gc.collect()
    assert len(trees) <= before


@pytest.mark.slow
@needs_native
def test_sanitizers_are_clean(tmp_path):
    """The tests of all compiled modules, and inputs of the fuzzer, under address and undefined-behaviour sanitizers."""
    if sanitized.runtime() is None:
        pytest.skip("no compiler with sanitizers")
    sanitized.build(tmp_path)
    for code, report in (sanitized.run_tests(tmp_path), sanitized.run_corpus(tmp_path, 100, 0)):
        assert code == 0, report[-3000:]
        assert sanitized.is_clean(report), report[-3000:]
