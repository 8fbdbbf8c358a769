"""The examples in the docstrings of the public names run and print what is written."""

from __future__ import annotations

import doctest
from inspect import isclass, isroutine

import pytest

import eomcheck
from eomcheck.calls import is_ours


def examples() -> dict[str, doctest.DocTest]:
    """Return the examples of public functions, classes and methods, by name."""
    finder, tests = doctest.DocTestFinder(recurse=False), {}
    for name in eomcheck.__all__:
        public = getattr(eomcheck, name)
        parts = {name: public} if isclass(public) or isroutine(public) else {}
        if isclass(public) and is_ours(public):
            routines = (x for x, value in vars(public).items() if isroutine(value))
            parts |= {f"{name}.{x}": vars(public)[x] for x in routines if x[0] != "_"}
        for path, part in parts.items():
            part = getattr(part, "__func__", part)
            for test in finder.find(part, path, globs={}):
                if test.examples:
                    tests[path] = test
    return tests


EXAMPLES = examples()


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_of_a_docstring_prints_what_is_written(name: str) -> None:
    lines: list[str] = []
    doctest.DocTestRunner().run(EXAMPLES[name], out=lines.append)
    assert "".join(lines) == ""


def test_examples_are_found() -> None:
    assert {"check", "quantity"} <= set(EXAMPLES)
