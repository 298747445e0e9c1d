"""The examples in the docstrings of public names run, and every public name has one."""

import doctest
import inspect

import numpy as np
import pytest

import sucre_bench as sb


@pytest.mark.parametrize("name", sorted(set(sb.__all__) - {"__version__"}))
def test_each_public_name_has_an_example_that_runs(name: str):
    public = getattr(sb, name)
    home = inspect.getmodule(public)
    finder = doctest.DocTestFinder(recurse=False)
    space = {**vars(home), "np": np}
    (test,) = finder.find(public, name, module=home, globs=space)
    assert test.examples, f"sucre_bench.{name} has no example in its docstring"
    assert doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL).run(test).failed == 0


def test_the_public_names_are_what_completion_offers():
    assert set(sb.__all__) == set(dir(sb))
