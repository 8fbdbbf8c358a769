"""Absent terms, resolved before anything is compiled.

A generic function tests `x is None` on its arguments. numba itself settles such a test only where
the argument is absent; where it is present, it still types the branch that will never run, and
fails or returns an optional value. Since the types are known when a function is compiled, the
tests are settled here, in the syntax tree: what an absent term would need is then not there at all.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable


class _Settle(ast.NodeTransformer):
    """Replace `name is None` by its truth and drop the branches that cannot be reached."""

    def __init__(self, absent: dict[str, bool]):
        self.absent = absent
        self.settled = False

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        match node:
            case ast.Compare(
                left=ast.Name(id=name),
                ops=[ast.Is() | ast.IsNot() as operator],
                comparators=[ast.Constant(value=None)],
            ) if name in self.absent:
                self.settled = True
                truth = self.absent[name] == isinstance(operator, ast.Is)
                return ast.copy_location(ast.Constant(truth), node)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        self.generic_visit(node)
        truths = [value.value for value in node.values if isinstance(value, ast.Constant)]
        if len(truths) < len(node.values):
            return node
        truth = all(truths) if isinstance(node.op, ast.And) else any(truths)
        return ast.copy_location(ast.Constant(truth), node)

    def visit_If(self, node: ast.If) -> ast.If | list[ast.stmt]:
        self.generic_visit(node)
        if isinstance(node.test, ast.Constant):
            # The branch may be all that its block held.
            return (node.body if node.test.value else node.orelse) or [ast.Pass()]
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.test, ast.Constant):
            return node.body if node.test.value else node.orelse
        return node


def settle_absent(function: Callable, absent: tuple[bool, ...]) -> Callable:
    """Return `function` as it reads when exactly the arguments marked in `absent` are None.

    Line numbers and file stay, so that an error points at the source. A function without such
    tests is returned as it is.
    """
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    definition = tree.body[0]
    assert isinstance(definition, ast.FunctionDef)
    names = [argument.arg for argument in definition.args.args]
    settle = _Settle(dict(zip(names, absent, strict=True)))
    settle.visit(definition)
    if not settle.settled:
        return function
    definition.decorator_list = []
    ast.increment_lineno(tree, function.__code__.co_firstlineno - 1)
    namespace: dict[str, Callable] = {}
    code = compile(ast.fix_missing_locations(tree), inspect.getfile(function), "exec")
    exec(code, function.__globals__, namespace)
    return namespace[definition.name]
