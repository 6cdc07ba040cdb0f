"""Every public name has an example, and every example runs."""

from __future__ import annotations

import doctest
import inspect
import operator
import warnings

import pytest

import ident

PUBLIC = [name for name in ident.__all__ if name != "__version__"]


#: What authors of laws and methods derive from: docs/extend.md has their examples.
CONTRACTS = (ident.Effect, ident.effects.JointEffect, ident.estimators.Estimator)
#: Packages whose laws, methods and functions are public as well.
PACKAGES = (ident.drives, ident.effects, ident.friction, ident.estimators, ident.regressor)
MORE = [
    f"{package.__name__.removeprefix('ident.')}.{name}"
    for package in PACKAGES
    for name in package.__all__
    for found in [getattr(package, name)]
    if inspect.isfunction(found)
    or found is ident.drives.DriveLaw
    or (inspect.isclass(found) and issubclass(found, ident.Effect | ident.estimators.Estimator) and found not in CONTRACTS)
]


def test_laws_methods_and_functions_of_packages_are_found() -> None:
    assert {"friction.Stribeck", "estimators.WeightedLeastSquares", "regressor.mass_matrix", "effects.Payload"} <= set(MORE)


@pytest.mark.parametrize("name", [*PUBLIC, *MORE])
def test_an_example(name: str) -> None:
    found = operator.attrgetter(name)(ident)
    (test,) = doctest.DocTestFinder(recurse=False).find(found, name, globs={})
    assert test.examples, "no example"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        outcome = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)
    assert outcome.failed == 0


def test_the_contents_name_every_public_name() -> None:
    contents = inspect.getdoc(ident) or ""
    assert not [name for name in PUBLIC if f"`{name}`" not in contents]
