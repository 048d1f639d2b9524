"""Mutants are tried here: in forks of a process that has collected the tests once.

A mutant inside a function replaces that function's code where it is, so nothing is imported
again, and only tests that run the changed statement are run, the quickest first, until one
fails. What changes outside of functions is tried on the module's constants, and, if no test
fails, once more in a fresh process that imports the mutant.
"""

import ast
import gc
import importlib.abc
import importlib.util
import json
import os
import signal
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
_CONSTANTS = (bool, int, float, str, bytes, tuple, frozenset, dict)
_UNSURE = 4
"""Exit code of a mutant that could not be tried in this way."""
_SLOWER, _MORE_S = 5, 3.0
"""A test may take so many times as long as usual, and so much more; then it has failed."""


@dataclass(frozen=True, slots=True)
class Module:
    """A file whose mutants are tried, its full name, and its tests."""

    path: Path
    name: str
    tests: Sequence[str]


@dataclass(frozen=True, slots=True)
class Mutant:
    """Its number, its tree, the lines of its statement, and whether it is in a function."""

    k: int
    tree: ast.Module
    lines: range
    is_in_function: bool


Made = Callable[[int], Mutant]


class _Loader(importlib.abc.Loader, importlib.abc.MetaPathFinder):
    """Give the mutant for the module."""

    def __init__(self, module: Module, tree: ast.Module) -> None:
        self._module, self._tree = module, tree

    def find_spec(self, fullname: str, *_args: object) -> "importlib.machinery.ModuleSpec | None":
        if fullname != self._module.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._module.path, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        code = compile(self._tree, str(self._module.path), "exec")
        exec(code, module.__dict__)  # noqa: S102 - ours


def lines_of(tree: ast.Module, line: int) -> tuple[range, bool]:
    """Return the lines of the innermost statement on a line, and whether it is in a function."""
    found, is_in_function = range(line, line + 1), False
    for node in ast.walk(tree):
        if not isinstance(node, ast.stmt) or not node.lineno <= line <= (node.end_lineno or line):
            continue
        body = getattr(node, "body", None)
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if is_function and body and line >= body[0].lineno:
            is_in_function = True
        end = body[0].lineno - 1 if body else node.end_lineno or line
        if line <= max(end, node.lineno):
            found = range(node.lineno, max(end, node.lineno) + 1)
    return found, is_in_function


def survivors(module: Module, ks: Sequence[int], made: Made) -> tuple[list[int], str]:
    """Return which mutants no test fails on, and what is wrong with the tests as they are."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        _in_child(lambda: _serve(module, ks, made, write))
    os.close(write)
    with os.fdopen(read) as lines:
        rows = [json.loads(line) for line in lines]
    os.waitpid(pid, 0)
    if not rows or "fault" in rows[-1]:
        return [], rows[-1]["fault"] if rows else "its tests cannot be collected"
    alive = [row["alive"] for row in rows if "alive" in row]
    limit_s = _MORE_S + _SLOWER * rows[0]["usual_s"]
    unsure = [row["unsure"] for row in rows if "unsure" in row]
    alive += [k for k in unsure if _passes_imported(module, made(k).tree, limit_s)]
    return sorted(alive), ""


def _in_child(work: Callable[[], int]) -> None:
    os.setpgid(0, 0)
    quiet = os.open(os.devnull, os.O_RDWR)
    for fd in (0, 1, 2):
        os.dup2(quiet, fd)
    code = _UNSURE
    try:
        os.chdir(ROOT)
        code = work()
    finally:
        os._exit(int(code))


def _end_of(pid: int, limit_s: float) -> int:
    """Wait for a process of ours; return its exit code, -9 if it takes too long."""
    end_s, nap_s = time.monotonic() + limit_s, 0.002
    while time.monotonic() < end_s:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(nap_s)
        nap_s = min(2 * nap_s, 0.05)
    os.killpg(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return -9


def _pytest(module: Module, plugins: Sequence[object] = ()) -> int:
    import pytest  # noqa: PLC0415 - loaded already, by the parent

    files = [f"tests/{each}.py" for each in module.tests]
    return int(pytest.main(["-x", "-q", "-n", "0", "-p", "no:cacheprovider", *files], plugins))


def _passes_imported(module: Module, tree: ast.Module, limit_s: float) -> bool:
    pid = os.fork()
    if pid == 0:
        sys.meta_path.insert(0, _Loader(module, tree))
        _in_child(lambda: _pytest(module))
    return _end_of(pid, limit_s) == 0


def _serve(module: Module, ks: Sequence[int], made: Made, write: int) -> int:
    with os.fdopen(write, "w", buffering=1) as out:
        _pytest(module, [_Server(module, ks, made, lambda row: print(json.dumps(row), file=out))])
    return 0


class _Server:
    """A plugin for pytest: instead of running the tests it runs them on every mutant."""

    def __init__(
        self, module: Module, ks: Sequence[int], made: Made, tell: Callable[[Any], None]
    ) -> None:
        self._module, self._ks, self._made, self._tell = module, ks, made, tell
        self._has_failed = False

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note a failure."""
        self._has_failed = self._has_failed or report.failed

    def pytest_runtestloop(self, session: Any) -> bool:
        """Find out which test runs which lines, then try the mutants."""
        items = session.items
        ran = self._traced(items)
        if ran is None:
            self._tell({"fault": "its tests fail as it is"})
            return True
        self._tell({"usual_s": sum(seconds for _, seconds in ran)})
        text = self._module.path.read_text(encoding="utf-8")
        known = dict(_functions(compile(text, str(self._module.path), "exec")))
        objects: dict[object, list[FunctionType]] = defaultdict(list)
        keys = {code: key for key, code in known.items()}
        for each in gc.get_objects():
            if isinstance(each, FunctionType) and each.__code__ in keys:
                objects[keys[each.__code__]].append(each)
        for k in self._ks:
            mutant = self._made(k)
            wanted = [
                n
                for n, (lines, _) in enumerate(ran)
                if not mutant.is_in_function or lines & set(mutant.lines)
            ]
            wanted.sort(key=lambda n: ran[n][1])
            limit_s = _MORE_S + _SLOWER * sum(ran[n][1] for n in wanted)
            pid = os.fork()
            if pid == 0:
                _in_child(
                    lambda mutant=mutant, wanted=wanted: self._changed(  # type: ignore[misc]
                        mutant, [(items[n], ran[n][1]) for n in wanted], known, objects
                    )
                )
            code = _end_of(pid, limit_s)
            # A function that no test enters may have run on import, and made what they use.
            if code == 0 and mutant.is_in_function and wanted:
                self._tell({"alive": k})
            elif code in {0, _UNSURE}:
                self._tell({"unsure": k})
        return True

    def _traced(self, items: Sequence[Any]) -> list[tuple[set[int], float]] | None:
        """Return the module's lines that each test runs, and its seconds; None if one fails."""
        read, write = os.pipe()
        pid = os.fork()
        if pid == 0:
            os.close(read)
            _in_child(lambda: self._trace(items, write))
        os.close(write)
        with os.fdopen(read) as lines:
            ran = [(set(row[0]), row[1]) for row in map(json.loads, lines)]
        _, status = os.waitpid(pid, 0)
        return ran if os.waitstatus_to_exitcode(status) == 0 and len(ran) == len(items) else None

    def _trace(self, items: Sequence[Any], write: int) -> int:
        path, seen = str(self._module.path), set[int]()

        def local(frame: FrameType, event: str, _arg: object) -> Any:
            if event == "line":
                seen.add(frame.f_lineno)
            return local

        def trace(frame: FrameType, _event: str, _arg: object) -> Any:
            if frame.f_code.co_filename != path:
                return None
            seen.add(frame.f_lineno)
            return local

        with os.fdopen(write, "w", buffering=1) as out:
            for each in items:
                seen.clear()
                began_s = time.monotonic()
                threading.settrace(trace)
                sys.settrace(trace)
                # As if it were the last: what a fixture ends runs lines, too.
                each.config.hook.pytest_runtest_protocol(item=each, nextitem=None)
                sys.settrace(None)
                print(json.dumps([sorted(seen), time.monotonic() - began_s]), file=out)
        return int(self._has_failed)

    def _changed(
        self,
        mutant: Mutant,
        tests: Sequence[tuple[Any, float]],
        known: dict[object, CodeType],
        objects: dict[object, list[FunctionType]],
    ) -> int:
        """Become the mutant and run tests; 1 if one of them fails."""
        code = compile(mutant.tree, str(self._module.path), "exec")
        if not mutant.is_in_function:
            space: dict[str, Any] = {"__name__": self._module.name}
            exec(code, space)  # noqa: S102 - ours
            real = sys.modules[self._module.name].__dict__
            names = [n for n, value in space.items() if isinstance(value, _CONSTANTS)]
            real.update({name: space[name] for name in names if not name.startswith("__")})
        for key, new in _functions(code):
            if known.get(key) != new:
                for function in objects.get(key, ()):
                    function.__code__ = new
        afters = [*(each for each, _ in tests[1:]), None][: len(tests)]
        for (each, usual_s), after in zip(tests, afters, strict=True):
            # Nothing heeds its signal: the process ends.
            signal.setitimer(signal.ITIMER_REAL, _MORE_S + _SLOWER * usual_s)
            each.config.hook.pytest_runtest_protocol(item=each, nextitem=after)
            if self._has_failed:
                return 1
        return 0


def _functions(code: CodeType) -> Iterator[tuple[object, CodeType]]:
    """Yield every code in a code, each under a key that a mutant has, too."""
    n_of: dict[object, int] = defaultdict(int)
    waiting = [code]
    while waiting:
        for each in waiting.pop(0).co_consts:
            if isinstance(each, CodeType):
                key = (each.co_qualname, each.co_firstlineno)
                n_of[key] += 1
                yield (*key, n_of[key]), each
                waiting.append(each)
