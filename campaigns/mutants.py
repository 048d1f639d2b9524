"""Mutants: change one thing in a module, and see whether its tests fail.

    .venv/bin/python campaigns/mutants.py                    every mutant of every module
    .venv/bin/python campaigns/mutants.py --share 0.1 ring   a tenth of the ring's, by a seed

Mutants of a module: comparisons, arithmetic, `and` and `or`, `not`, numbers, True and False,
conditions, calls left out, what is returned. Texts, annotations, decorators, errors and logging
are left alone. Every mutant is tried in a fork of a process that has loaded the libraries, with
those tests of the table below that run its line, until the first fails; one with which they take
five times as long as all tests do has failed, too. The last line is one JSON object; `survivors`
names line and change.
"""

import argparse
import ast
import copy
import importlib
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import SourceFileLoader
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import coverage

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

_LOG = "outputs/test_log outputs/test_log_model"
MODULES = {
    "framing": ("x2radar/wire/framing", "driver/test_framing"),
    "codec": ("x2radar/wire/codec", "driver/test_codec"),
    "link": (
        "x2radar/device/link",
        "driver/test_link driver/test_device driver/test_device_start_up",
    ),
    "ring": ("daemon/radard/stream/ring", "detect/test_ring detect/test_ring_model"),
    "gate": ("daemon/radard/detect/gate", "detect/test_noise_floor detect/test_gate"),
    "evidence": ("daemon/radard/judge/evidence", "training/test_evidence"),
    "decision": ("daemon/radard/judge/decision", "detect/test_decision training/test_evidence"),
    "panel": ("daemon/radard/alarm/panel", "detect/test_alarm detect/test_alarm_events"),
    "health": ("daemon/radard/health/health", "run/test_health"),
    "calibration": (
        "daemon/radard/run/room_calibration",
        "run/test_calibration_limits run/test_room_calibration",
    ),
    "events": ("daemon/radard/alarm/events", "detect/test_alarm_events detect/test_alarm"),
    "log": ("daemon/radard/log", _LOG),
    "log_file": ("daemon/radard/log_file", _LOG),
    "calibration_file": (
        "daemon/radard/detect/calibration",
        "detect/test_gate run/test_calibrate web/test_web_settings",
    ),
}
"""Name to file, and tests, the quickest first."""
_SWAPPED = (
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot)),
    *((ast.In, ast.NotIn), (ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.LShift, ast.RShift)),
    *((ast.BitAnd, ast.BitOr), (ast.And, ast.Or)),
)
"""Operators that stand for each other."""
_OTHER: dict[type[ast.AST], type[ast.AST]] = {
    **dict(_SWAPPED),
    **{other: each for each, other in _SWAPPED},
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Add,
    ast.Pow: ast.Mult,
    ast.BitXor: ast.BitAnd,
}
_TALK = {"log", "_log", "warning", "info", "debug", "exception"}
_SLOWER = 5  # a mutant's tests may take so many times as long as all of them usually do


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:  # noqa: C901, PLR0912 - a table
    """Yield every change of a node itself: what it is called, and the node in its place."""
    match node:
        case ast.Expr(ast.Call(ast.Attribute(attr=name))) if name in _TALK:
            pass
        case ast.Expr(ast.Constant()):
            pass
        case ast.Expr() | ast.AugAssign():
            yield f"left out: {ast.unparse(node)}", ast.Pass()
        case ast.Return(value) if value and ast.unparse(value) != "None":
            yield f"None for {ast.unparse(node)}", ast.Return(ast.Constant(None))
        case ast.If(test) | ast.IfExp(test) if ast.unparse(test) != "TYPE_CHECKING":
            other = copy.copy(node)
            other.test = ast.UnaryOp(ast.Not(), test)  # type: ignore[attr-defined]
            yield f"not ({ast.unparse(test)})", other
        case ast.UnaryOp(ast.Not() | ast.USub(), operand):
            yield f"{ast.unparse(operand)} for {ast.unparse(node)}", operand
        case ast.Compare(left, ops, rest):
            for k, op in enumerate(ops):
                swapped = [_OTHER[type(each)]() if n == k else each for n, each in enumerate(ops)]
                yield _in(op, node), ast.Compare(left, swapped, rest)
        case ast.BinOp(left, op, right) if type(op) in _OTHER:
            yield _in(op, node), ast.BinOp(left, _OTHER[type(op)](), right)
        case ast.BoolOp(op, values):
            yield _in(op, node), ast.BoolOp(_OTHER[type(op)](), values)
        case ast.Constant(bool() as truth):
            yield f"{not truth} for {truth}", ast.Constant(not truth)
        case ast.Constant(int() | float() as number):
            yield f"{number + 1} for {number}", ast.Constant(number + 1)


def _in(op: ast.AST, node: ast.AST) -> str:
    return f"{_OTHER[type(op)].__name__} in {ast.unparse(node)}"


class Mutator(ast.NodeTransformer):
    """Number every possible change of a module, and make one of them."""

    def __init__(self, wanted: int = -1) -> None:
        self.wanted = wanted
        self.found: list[tuple[int, str]] = []  # line and change of each

    def visit(self, node: ast.AST) -> Any:
        """Return the node, or what stands in its place."""
        if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom):
            return node
        for text, other in changes(node):
            self.found.append((node.lineno, text))  # type: ignore[attr-defined]
            if len(self.found) - 1 == self.wanted:
                return ast.copy_location(other, node)
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            node.body = [self.visit(each) for each in node.body]
            return node
        if isinstance(node, ast.AnnAssign | ast.Assign):
            node.value = self.visit(node.value) if node.value else None  # type: ignore[assignment]
            return node
        return self.generic_visit(node)


def mutant(path: Path, k: int = -1) -> tuple[ast.Module, list[tuple[int, str]]]:
    """Return the k-th mutant of a file, and line and change of every one up to it."""
    mutator = Mutator(k)
    tree = mutator.visit(ast.parse(path.read_text(encoding="utf-8")))
    return ast.fix_missing_locations(tree), mutator.found


def in_fork(work: Callable[[], int], limit_s: float) -> int:
    """Run in a fork, in silence; return its exit code, -9 where it takes too long."""

    def run() -> None:
        os.setpgid(0, 0)
        quiet = os.open(os.devnull, os.O_RDWR)
        for fd in (0, 1, 2):
            os.dup2(quiet, fd)
        # Without an end: a mutant may have left threads that do not.
        os._exit(work())

    process = get_context("fork").Process(target=run)
    process.start()
    process.join(limit_s)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    return process.exitcode


def run_tests(names: Sequence[str], *options: str) -> int:
    """Run tests in this process until one fails."""
    import pytest  # noqa: PLC0415 - loaded already, by the parent

    plain = ("-x", "-q", "-n", "0", "-p", "no:cacheprovider")
    return int(pytest.main([*plain, *options, *names]))


def traced(path: Path, tests: Sequence[str]) -> tuple[float, dict[int, set[str]]]:
    """Return the seconds of all tests, and those that run each line; nothing if one fails."""
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines"

        def work() -> int:
            os.environ["COVERAGE_FILE"] = str(lines)
            options = (f"--cov={path.parent}", "--cov-config=/dev/null", "--cov-report=")
            return run_tests(tests, *options, "--cov-context=test")

        if in_fork(work, 1200) != 0:
            return 0.0, {}
        data = coverage.CoverageData(str(lines))
        data.read()
        contexts = data.contexts_by_lineno(str(path))
    # A context is a test and its phase; what runs on import has none.
    by_line = {n: {each.rpartition("|")[0] for each in own} for n, own in contexts.items()}
    return time.monotonic() - begun_s, by_line


def is_killed(path: Path, k: int, tests: Sequence[str], limit_s: float) -> bool:
    """Return whether one of these tests fails on a mutant."""
    tree, plain = mutant(path, k)[0], SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, fullname: str) -> Any:
        is_it = self.path == str(path)
        return compile(tree, self.path, "exec") if is_it else plain(self, fullname)

    def work() -> int:
        SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
        return run_tests(tests)

    return in_fork(work, limit_s) != 0


def main() -> int:
    """Run; returns 1 if a module as it is fails its tests."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("modules", nargs="*", choices=[*MODULES, []], default=[])
    parser.add_argument("--share", type=float, default=1.0, help="of the mutants")
    parser.add_argument("--seed", type=int, default=0, help="of the choice")
    parser.add_argument("--line", type=int, help="only mutants of this line")
    args = parser.parse_args()
    os.chdir(ROOT)
    # What takes long to load, once; nothing of the project.
    for library in ("numpy", "pytest", "yaml", "pydantic", "serial", "h5py"):
        importlib.import_module(library)
    report: dict[str, dict[str, int]] = {}
    left: list[str] = []
    for name in args.modules or MODULES:
        file, tests = MODULES[name]
        path = ROOT / f"{file}.py"
        found = mutant(path)[1]
        ks = [k for k, (line, _) in enumerate(found) if args.line in {None, line}]
        n = max(1, round(args.share * len(ks)))
        drawn = sorted(random.Random(args.seed).sample(ks, n))  # noqa: S311 - a choice
        files = [f"tests/{each}.py" for each in tests.split()]
        seconds, by_line = traced(path, files)
        if not seconds:
            print(f"{name}: its tests fail as it is", file=sys.stderr)
            return 1
        alive = []
        for k in drawn:
            # Of a line that runs on import every test may be the one.
            names = by_line.get(found[k][0], set()) - {""}
            wanted = [name for file in files for name in sorted(names) if name.startswith(file)]
            alive += [] if is_killed(path, k, wanted or files, _SLOWER * seconds) else [k]
        left += [f"{file}.py:{found[k][0]}: {found[k][1]}" for k in alive]
        report[name] = {"mutants": len(found), "tried": n, "killed": n - len(alive)}
        print(f"{name}: {n - len(alive)} of {n} killed, of {len(found)}", flush=True)
    tried, killed = (sum(row[key] for row in report.values()) for key in ("tried", "killed"))
    print(json.dumps({**report, "score": round(killed / tried, 4), "survivors": left}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
