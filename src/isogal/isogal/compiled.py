"""The decorator of compiled functions: numba, kept on disk, and compiled anew when anything has
changed that is in the machine code.

numba's own cache asks whether the file of a function has changed. The machine code of a function
also holds the functions of other files that it calls, and their constants, so that after an update
the old numbers would go on. Here the name of a cached file holds a digest of all that: the
function's file, the kernels that it imports (each by its own digest, thus with what these call),
and constants.

Where the files are is left to numba: the folder NUMBA_CACHE_DIR if that is set, else `__pycache__`
beside the source if that can be written, else the user's cache folder. With none of them kernels
are compiled in each process. Processes that start together, as nodes do, compile a kernel once:
the others wait for the one that has begun."""

import contextlib
import fcntl
import hashlib
import inspect
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numba import njit
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target

_digests: dict[Any, str] = {}
"""Digest of each kernel's Python function."""
_modules: set[str] = set()
"""Names of the modules that hold kernels."""
_PATIENCE = 60.0
"""s, the longest wait for another process that compiles the same kernel."""
_CONSTANTS = (bool, int, float, complex, str, np.generic, tuple)


def kernel(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Compile a function: ``@kernel``, or with options of ``numba.njit``,
    ``@kernel(error_model="numpy")``.

    Without the interpreter lock, and never with fastmath or parallel loops: a run's numbers must
    not depend on what is computed beside it. What a kernel uses of other files has to be imported
    by name, or as a module, above it."""
    if function is None:
        return lambda decorated: kernel(decorated, **options)
    compiled: Any = njit(nogil=True, **options)(function)
    if compiled is not function:  # as it is with NUMBA_DISABLE_JIT
        _digests[function] = _digest(function, options)
        _modules.add(function.__module__)
        with contextlib.suppress(RuntimeError):  # numba finds no folder to write to
            compiled._cache = _KernelCache(function)
    return compiled


def load_compiler() -> None:
    """Load what numba otherwise loads when a compiled function is first called: for processes that
    are forked from this one."""
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()


class _Compiling(event.Listener):
    """Calls something once, when a function is compiled that is not on disk."""

    def __init__(self, say: Callable[[], None]) -> None:
        self._say: Callable[[], None] | None = say

    def on_start(self, event: event.Event) -> None:
        say, self._say = self._say, None
        if say is not None:
            say()

    def on_end(self, event: event.Event) -> None:
        """Nothing is to be said."""


def tell_of_compiling(say: Callable[[], None]) -> None:
    """Call `say` once, when the first function is compiled from now on: not where all are on
    disk."""
    event.register("numba:compile", _Compiling(say))


def digest(compiled: Any) -> str:
    """Return the digest of all that a kernel is made of."""
    return _digests[compiled.py_func]


def _digest(function: Callable[..., Any], options: dict[str, Any]) -> str:
    """Return what tells apart two versions of a kernel, hexadecimal."""
    ours = function.__globals__
    parts = [_of_file(inspect.getfile(function)), repr(sorted(options.items()))]
    for name, value in sorted(ours.items()):
        if isinstance(value, ModuleType) and value.__name__ in _modules:
            parts += [
                f"{name}.{below} {_digests[inner]}" for below, inner in _kernels(vars(value))
            ]
        elif isinstance(value, np.ndarray):
            content = hashlib.sha256(value.tobytes()).hexdigest()
            parts.append(f"{name} {value.dtype} {value.shape} {content}")
        elif not name.startswith("__") and _is_constant(value):
            parts.append(f"{name} {value!r}")
    # those of the file itself are in its text
    parts += [
        f"{name} {_digests[inner]}"
        for name, inner in _kernels(ours)
        if inner.__globals__ is not ours
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def _kernels(names: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield name and Python function of the kernels among a module's names."""
    for name, value in sorted(names.items()):
        inner = getattr(value, "py_func", None) if isinstance(value, Dispatcher) else None
        if inner in _digests:
            yield name, inner


def _is_constant(value: Any) -> bool:
    return isinstance(value, _CONSTANTS) and (
        not isinstance(value, tuple) or all(map(_is_constant, value))
    )


@cache
def _of_file(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class _KernelCacheImpl(CompileResultCacheImpl):
    """Names the files of a kernel by its digest, so that what an interrupted start with other
    sources left is never taken for it."""

    def __init__(self, function: Any) -> None:
        self.function = function
        super().__init__(function)

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        version = f"py{sys.version_info[0]}{sys.version_info[1]}{abiflags}"
        return f"{fullname.replace('<', '').replace('>', '')}-{_digests[self.function]}.{version}"


class _KernelCache(FunctionCache):
    """numba's cache of one function under that name, with the files of its earlier versions
    removed."""

    _impl_class = _KernelCacheImpl

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self.turn: int | None = None
        """The lock file, while this process compiles."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None and self.turn is None:
            self._take_turn()
            found = super().load_overload(sig, target_context)  # if another was at it
            if found is not None:
                self._end_turn()
        return found

    def _take_turn(self) -> None:
        """Wait until no other process compiles the kernel; without a lock after `_PATIENCE`, and
        where no file can be locked."""
        with contextlib.suppress(OSError):
            self._impl.locator.ensure_cache_path()
            lock = os.open(self._lock_file, os.O_RDWR | os.O_CREAT, 0o666)
            for _ in range(int(_PATIENCE / 0.05)):
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    self.turn = lock
                    return
                time.sleep(0.05)
            os.close(lock)

    def _end_turn(self) -> None:
        if self.turn is not None:
            Path(self._lock_file).unlink(missing_ok=True)
            fcntl.flock(self.turn, fcntl.LOCK_UN)  # also for processes that were forked meanwhile
            os.close(self.turn)
            self.turn = None

    @property
    def _lock_file(self) -> str:
        return f"{self.cache_path}/{self._impl.filename_base}.lock"

    def save_overload(self, sig: Any, data: Any) -> None:
        # a full disk costs the next start some time, not this run
        with contextlib.suppress(OSError), contextlib.ExitStack() as turn:
            turn.callback(self._end_turn)
            super().save_overload(sig, data)
            name, rest = self._impl.filename_base.split("-")
            this = f"{name}-{rest.partition('.')[0]}."  # of any Python version
            for old in Path(self.cache_path).glob(f"{name}-*.nb[ci]"):
                if not old.name.startswith(this):
                    old.unlink(missing_ok=True)
