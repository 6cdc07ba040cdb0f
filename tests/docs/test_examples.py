"""Every public name has an example, and every example runs."""

from __future__ import annotations

import doctest
import inspect
import warnings

import pytest

import ident

PUBLIC = [name for name in ident.__all__ if name != "__version__" and not inspect.ismodule(getattr(ident, name))]


@pytest.mark.parametrize("name", PUBLIC)
def test_an_example(name: str) -> None:
    found = getattr(ident, name)
    (test,) = doctest.DocTestFinder(recurse=False).find(found, name, globs={})
    assert test.examples, "no example"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        outcome = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)
    assert outcome.failed == 0


def test_the_contents_name_every_public_name() -> None:
    contents = inspect.getdoc(ident) or ""
    assert not [name for name in PUBLIC if f"`{name}`" not in contents]
