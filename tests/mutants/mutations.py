"""Mutants of a module: small changes to its syntax tree, one at a time.

A mutant is known by where it is and by what it says, not by its line: the expression that it
changes and what is around it, before and after.
"""

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

ORDER: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
"""Each comparison at its boundary, and turned round."""
ARITHMETIC: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
}
CALLS: Final = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum",
                "any": "all", "all": "any"}  # fmt: skip
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
SHORT: Final = 60
"""Length of what a mutant says of its surroundings."""
SIZES: Final = {"empty", "zeros", "ones"}
"""Arrays that are larger than needed are no other behaviour."""
DROPPED = (ast.Raise, ast.AugAssign, ast.Continue, ast.Break)


@dataclass(frozen=True)
class Mutant:
    """One change of a module."""

    scope: str
    """The function, the class or, empty, the module whose code differs."""
    change: str
    """What it changes and a little around it, before and after."""
    line: int
    """Where the changed expression begins, to find the tests that come by."""
    tree: ast.Module
    assigned: tuple[str, ...]
    """Names that the statement assigns, where it is one of a class or the module."""


def mutants_of(source: str) -> list[Mutant]:
    """Return every mutant of a module, in the order of its text, no two alike."""
    found: list[Mutant] = []
    seen: Counter[tuple[str, str]] = Counter()
    trees: set[str] = {ast.dump(ast.parse(source))}
    for path, changed in _changes(ast.parse(source)):
        tree = ast.parse(source)
        before, after = _replaced(tree, path, changed)
        if (dump := ast.dump(tree)) in trees:
            continue
        trees.add(dump)
        mutant = _mutant(ast.parse(source), tree, path, before, after)
        seen[mutant.scope, mutant.change] += 1
        if (again := seen[mutant.scope, mutant.change]) > 1:
            mutant = replace(mutant, change=f"{mutant.change}  #{again}")
        found.append(mutant)
    return found


Path = tuple[tuple[str, int | None], ...]
"""Fields, and places in those that are lists, from the module to a node."""


def _at(tree: ast.AST, path: Path) -> ast.AST:
    for name, place in path:
        value = getattr(tree, name)
        tree = value if place is None else value[place]
    return tree


def _replaced(tree: ast.Module, path: Path, node: ast.AST) -> tuple[ast.AST, ast.AST]:
    """Put a node into a tree; return what stood there, and the node."""
    holder, (name, place) = _at(tree, path[:-1]), path[-1]
    before = _at(tree, path)
    ast.copy_location(node, before)
    if place is None:
        setattr(holder, name, node)
    else:
        getattr(holder, name)[place] = node
    ast.fix_missing_locations(tree)
    return before, node


def _mutant(
    original: ast.Module, tree: ast.Module, path: Path, before: ast.AST, after: ast.AST
) -> Mutant:
    names: list[str] = []
    statement: Path = ()
    function = False
    for depth in range(1, len(path) + 1):
        node = _at(original, path[:depth])
        if isinstance(node, ast.stmt):
            statement = path[:depth]
        if isinstance(node, (*FUNCTIONS, ast.ClassDef)) and not function:
            if depth < len(path):
                names.append(node.name)
            function = isinstance(node, FUNCTIONS)
    old = _at(original, statement)
    said = _said(original, tree, path, len(statement))
    assigned = {n.id for n in ast.walk(old) if isinstance(n, ast.Name) and _stored(n)}
    line = getattr(before, "lineno", None) or getattr(old, "lineno", 0)
    return Mutant(".".join(names), said, line, tree, () if function else tuple(sorted(assigned)))


def _said(original: ast.Module, tree: ast.Module, path: Path, statement: int) -> str:
    """Return the longest part of a statement around a change that is still short."""
    said = ""
    for depth in range(len(path), statement - 1, -1):
        old, new = _at(original, path[:depth]), _at(tree, path[:depth])
        if not isinstance(old, ast.expr | ast.stmt):
            continue
        texts = _header(old), _header(new)
        if said and max(map(len, texts)) > SHORT:
            break
        said = f"{texts[0]} → {texts[1]}"
    return said


def _stored(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Store)


def _header(statement: ast.AST) -> str:
    """Return a statement in one line, and of those with a body what stands before it."""
    if isinstance(getattr(statement, "body", None), list):
        statement = copy.deepcopy(statement)
        statement.body, statement.orelse, statement.handlers = [ast.Pass()], [], []
        statement.finalbody = statement.decorator_list = []
        return " ".join(ast.unparse(statement).removesuffix("pass").split())
    if isinstance(statement, ast.match_case):
        return ast.unparse(statement.pattern)
    return " ".join(ast.unparse(statement).split())


def _changes(tree: ast.Module) -> Iterator[tuple[Path, ast.AST]]:
    """Yield where a node is to be replaced, and by what."""
    for path, node in _walk(tree, ()):
        for changed in _of(node, tree, path):
            yield path, changed


def _walk(node: ast.AST, path: Path) -> Iterator[tuple[Path, ast.AST]]:
    yield path, node
    for name, value in ast.iter_fields(node):
        # Annotations, decorators and text that is written for people are no behaviour.
        if name in ("annotation", "returns", "decorator_list", "bases") or (
            isinstance(node, ast.AnnAssign) and name == "target"
        ):
            continue
        if isinstance(node, ast.Call) and name == "args" and _called(node) in SIZES:
            continue
        if isinstance(value, ast.AST):
            if not isinstance(value, ast.JoinedStr):
                yield from _walk(value, (*path, (name, None)))
        elif isinstance(value, list):
            for i, child in enumerate(value):
                if isinstance(child, ast.AST) and not isinstance(child, ast.JoinedStr):
                    yield from _walk(child, (*path, (name, i)))


def _called(node: ast.Call) -> str:
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def _of(node: ast.AST, tree: ast.Module, path: Path) -> Iterator[ast.AST]:
    match node:
        case ast.Compare():
            for i, op in enumerate(node.ops):
                for other in ORDER[type(op)]:
                    yield ast.Compare(
                        node.left, [*node.ops[:i], other(), *node.ops[i + 1 :]], node.comparators
                    )
        case ast.BinOp() if type(node.op) in ARITHMETIC:
            yield ast.BinOp(node.left, ARITHMETIC[type(node.op)](), node.right)
        case ast.AugAssign() if type(node.op) in ARITHMETIC:
            yield ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)
            yield ast.Pass()
        case ast.BoolOp():
            yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
        case ast.Constant(value=float()):
            yield ast.Constant(2.0 * node.value or 1.0)
        case ast.Call() if (name := _called(node)) in CALLS:
            other = copy.deepcopy(node.func)
            setattr(other, "attr" if isinstance(other, ast.Attribute) else "id", CALLS[name])
            yield ast.Call(other, node.args, node.keywords)
        case ast.Call(func=ast.Name(id="abs")):
            yield node.args[0]
        case ast.Return(value=ast.expr() as value):
            if not (isinstance(value, ast.Constant) and value.value is None):
                yield ast.Return(_wrong(value, tree, path))
        case ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute() | ast.Tuple()]):
            if not any(isinstance(n, ast.Name) and _stored(n) for n in ast.walk(node.targets[0])):
                yield ast.Pass()
    if isinstance(node, DROPPED) and not isinstance(node, ast.AugAssign):
        yield ast.Pass()
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        for value in (True, False):
            if value and isinstance(node, ast.While):
                continue
            other = copy.copy(node)
            other.test = ast.Constant(value)
            yield other


def _wrong(value: ast.expr, tree: ast.Module, path: Path) -> ast.expr:
    """Return what a function is not to return: the contrary where it says yes or no, else None."""
    holders = [_at(tree, path[:depth]) for depth in range(len(path))]
    functions = [node for node in holders if isinstance(node, FUNCTIONS)]
    told = functions[-1].returns if functions else None
    if isinstance(told, ast.Name) and told.id == "bool":
        return ast.UnaryOp(ast.Not(), value)
    return ast.Constant(None)
