"""Mutants: change one thing in a module, and see whether its tests fail.

    .venv/bin/python campaigns/mutants.py                    every mutant of every module
    .venv/bin/python campaigns/mutants.py --share 0.1 ring   a tenth of the ring's, by a seed

Mutants of a module: comparisons, arithmetic, `and` and `or`, `not`, numbers, True and False,
conditions, statements left out, what is returned. Texts, annotations, decorators and logging are
left alone. Every mutant is tried in a process of its own (`mutant_runs`), with the tests of the
table below that run its statement, until the first fails; five times as long as usual counts as
failed, too. The last line is one JSON object; `survivors` names line and change.
"""

import argparse
import ast
import copy
import importlib
import json
import os
import random
import sys
import time
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from campaigns.mutant_runs import Module, Mutant, lines_of, survivors  # noqa: E402 - below the path

MODULES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "framing": (
        "x2radar/wire",
        "framing",
        ("driver/test_framing_limits", "driver/test_framing", "driver/test_framing_faults"),
    ),
    "codec": ("x2radar/wire", "codec", ("driver/test_codec", "driver/test_codec_rows")),
    "protocol": ("x2radar/wire", "protocol", ("driver/test_protocol", "driver/test_device")),
    "ring": ("daemon/radard/stream", "ring", ("test_ring_limits", "test_ring")),
    "gate": ("daemon/radard/detect", "gate", ("test_gate_limits", "test_gate")),
    "evidence": ("daemon/radard/judge", "evidence", ("test_evidence",)),
    "decision": ("daemon/radard/judge", "decision", ("test_decision", "test_evidence")),
    "panel": ("daemon/radard/alarm", "panel", ("test_alarm", "test_alarm_events")),
    "events": ("daemon/radard/alarm", "events", ("test_alarm_events", "test_alarm")),
}
"""Name to folder, module, and tests, the quickest first."""

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_COUNTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Add,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
_TALK = ("log", "_log", "warning", "info", "debug", "exception")


class Mutator(ast.NodeTransformer):
    """Number every possible change, and make one of them."""

    def __init__(self, wanted: int = -1) -> None:
        self.wanted = wanted
        self.found: list[tuple[int, str]] = []

    def _is_it(self, node: ast.AST, text: str) -> bool:
        self.found.append((getattr(node, "lineno", 0), text))
        return len(self.found) - 1 == self.wanted

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Look into a function's body alone; defaults and decorators stay."""
        node.body = [self._in_body(each, k) for k, each in enumerate(node.body)]
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """Look into a class's body alone."""
        node.body = [self._in_body(each, k) for k, each in enumerate(node.body)]
        return node

    def _in_body(self, node: ast.stmt, k: int) -> ast.stmt:
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        changed: ast.stmt = node if k == 0 and is_text else self.visit(node)
        return changed

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Look at the value alone."""
        if node.value is not None:
            node.value = self.visit(node.value)
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """Leave a call out."""
        if isinstance(node.value, ast.Constant) or _is_talk(node.value):
            return node
        if self._is_it(node, f"left out: {ast.unparse(node)}"):
            return ast.copy_location(ast.Pass(), node)
        return self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        """Look at the value alone; a text for people stays."""
        node.value = self.visit(node.value)
        return node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        """Count the other way."""
        if self._is_it(node, f"left out: {ast.unparse(node)}"):
            return ast.copy_location(ast.Pass(), node)
        node.value = self.visit(node.value)
        return node

    def visit_Return(self, node: ast.Return) -> ast.AST:
        """Return nothing."""
        if node.value is None:
            return node
        is_none = isinstance(node.value, ast.Constant) and node.value.value is None
        if not is_none and self._is_it(node, f"None for {ast.unparse(node)}"):
            none = ast.copy_location(ast.Constant(None), node)
            return ast.copy_location(ast.Return(none), node)
        return self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        """Errors and their texts stay."""
        return node

    def visit_Assert(self, node: ast.Assert) -> ast.AST:
        """Leave what cannot be."""
        return node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        """Leave a text."""
        return node

    def visit_If(self, node: ast.If) -> ast.AST:
        """Turn a condition around."""
        if ast.unparse(node.test) == "TYPE_CHECKING":
            return node
        if self._is_it(node.test, f"not ({ast.unparse(node.test)})"):
            node.test = _not(node.test)
            return node
        return self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        """Likewise."""
        if self._is_it(node.test, f"not ({ast.unparse(node.test)})"):
            node.test = _not(node.test)
            return node
        return self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Leave a sign or a `not` out."""
        if isinstance(node.op, ast.Not | ast.USub) and self._is_it(
            node, f"{ast.unparse(node.operand)} for {ast.unparse(node)}"
        ):
            return node.operand
        return self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Compare otherwise."""
        for k, op in enumerate(node.ops):
            other = _COMPARED[type(op)]
            if self._is_it(node, f"{other.__name__} in {ast.unparse(node)}"):
                node.ops[k] = other()
                return node
        return self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Count otherwise."""
        other = _COUNTED.get(type(node.op))
        if other and self._is_it(node, f"{other.__name__} in {ast.unparse(node)}"):
            node.op = other()
            return node
        return self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        """Swap `and` and `or`."""
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        if self._is_it(node, f"{other.__name__} in {ast.unparse(node)}"):
            node.op = other()
            return node
        return self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Change a number or a truth."""
        if isinstance(node.value, bool):
            changed: bool | float = not node.value
        elif isinstance(node.value, int | float):
            changed = node.value + 1
        else:
            return node
        if self._is_it(node, f"{changed} for {node.value}"):
            return ast.copy_location(ast.Constant(changed), node)
        return node


def _not(test: ast.expr) -> ast.expr:
    return ast.copy_location(ast.UnaryOp(ast.Not(), test), test)


def _is_talk(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in _TALK
    )


def candidates(path: Path) -> list[tuple[int, str]]:
    """Return line and change of every mutant of a file."""
    mutator = Mutator()
    mutator.visit(ast.parse(path.read_text(encoding="utf-8")))
    return mutator.found


def mutant(path: Path, k: int) -> Mutant:
    """Return the k-th mutant of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    mutator = Mutator(k)
    changed = ast.fix_missing_locations(mutator.visit(copy.deepcopy(tree)))
    return Mutant(k, changed, *lines_of(tree, mutator.found[k][0]))


def main() -> int:
    """Run; returns 1 if a module as it is fails its tests."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("modules", nargs="*", choices=[*MODULES, []], default=list(MODULES))
    parser.add_argument("--share", type=float, default=1.0, help="of the mutants")
    parser.add_argument("--most", type=int, default=10**6, help="mutants of a module")
    parser.add_argument("--seed", type=int, default=0, help="of the choice")
    parser.add_argument("--line", type=int, help="only mutants of this line")
    args = parser.parse_args()
    # What takes long to load, once; nothing of the project.
    for library in ("numpy", "pytest", "yaml", "pydantic", "serial", "h5py"):
        importlib.import_module(library)
    report: dict[str, object] = {}
    left: list[str] = []
    tried = killed = 0
    for name in args.modules or list(MODULES):
        folder, module, tests = MODULES[name]
        all_of = candidates(ROOT / folder / f"{module}.py")
        ks = [k for k, (line, _) in enumerate(all_of) if args.line in {None, line}]
        n = min(args.most, max(1, round(args.share * len(ks))))
        chosen = sorted(random.Random(args.seed).sample(ks, n))  # noqa: S311 - a choice
        began_s = time.monotonic()
        full = ".".join([*Path(folder).parts, module]).removeprefix("daemon.")
        path = ROOT / folder / f"{module}.py"
        alive, fault = survivors(Module(path, full, tests), chosen, partial(mutant, path))
        if fault:
            print(f"{name}: {fault}", file=sys.stderr)
            return 1
        left += [f"{folder}/{module}.py:{all_of[k][0]}: {all_of[k][1]}" for k in alive]
        for k in alive:
            print(f"  {folder}/{module}.py:{all_of[k][0]}: {all_of[k][1]}", flush=True)
        tried, killed = tried + n, killed + n - len(alive)
        report[name] = {"mutants": len(all_of), "tried": n, "killed": n - len(alive)}
        took_s = time.monotonic() - began_s
        said = f"{name}: {n - len(alive)} of {n} killed, of {len(all_of)}, in {took_s:.0f} s"
        print(said, flush=True)
    score = round(killed / tried, 4) if tried else 1.0
    print(json.dumps({**report, "score": score, "survivors": left}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
