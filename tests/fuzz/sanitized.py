"""`python -m tests.fuzz.sanitized`: compiled modules under address and undefined-behaviour sanitizers."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[2]
_LIBRARIES = ("libasan.so", "libubsan.so", "libstdc++.so.6")
_FLAGS = "-std=c++17 -O1 -g -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all -fPIC -shared -pthread"
#: The compiled modules and their sources.
_MODULES = {"kernel": ("module", "baseline", "avx2", "avx512")} | {name: (name,) for name in ("recursions", "text", "filters")}
#: Tests of the compiled modules, and classes of input that reach them.
TESTS = ("rigid_dynamics", "rigid_information", "rigid_native", "simulate_compiled", "recursions_native", "filters_native", "text_native")
KINDS = ("logs", "compressed", "urdf", "toml")
_FOUND = re.compile(r"runtime error|AddressSanitizer|UndefinedBehaviorSanitizer")


def runtime() -> list[str] | None:
    """Libraries of the sanitizers; None where there is no compiler, or none that has them."""
    compiler = shutil.which("g++")
    if compiler is None:
        return None
    found = [_output(compiler, f"-print-file-name={name}") for name in _LIBRARIES]
    return found if all(Path(path).is_absolute() for path in found) else None


def build(folder: Path) -> None:
    """A copy of the package and its tests, with the compiled modules built anew."""
    shutil.copytree(ROOT / "ident", folder / "ident", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copytree(ROOT / "tests", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    native = folder / "ident/_native"
    for module, names in _MODULES.items():
        sources = [str(native / f"{name}.cpp") for name in names]
        include = f"-I{sysconfig.get_path('include')}"
        _output("g++", *_FLAGS.split(), include, *sources, "-o", str(native / f"_{module}.abi3.so"))


def run(folder: Path, *arguments: str) -> tuple[int, str]:
    """Python with the copy and the sanitizers; its exit code and what it said."""
    environment = {
        **os.environ,
        "LD_PRELOAD": " ".join(runtime() or ()),
        # The interpreter itself leaks by that measure; what libraries that are not built so (pandas) call is not looked at, our code is.
        "ASAN_OPTIONS": "detect_leaks=0:replace_str=0:replace_intrin=0:intercept_strlen=0:intercept_strchr=0:intercept_strndup=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": str(folder),
    }
    done = subprocess.run([sys.executable, *arguments], check=False, cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def run_tests(folder: Path) -> tuple[int, str]:
    """The tests of the compiled modules."""
    tests = [str(folder / "tests/unit" / f"test_{name}.py") for name in TESTS]
    options = ["-q", "-x", "-p", "no:cacheprovider", "--rootdir", str(folder), "-o", "addopts=", "-m", "not slow"]
    return run(folder, "-m", "pytest", *options, *tests)


def run_corpus(folder: Path, count: int, seed: int) -> tuple[int, str]:
    """The fuzzer's inputs, so many of each class."""
    return run(folder, "-m", "tests.fuzz", *KINDS, "--count", str(count), "--seed", str(seed), "--memory", "0")


def is_clean(text: str) -> bool:
    """Whether no sanitizer said anything."""
    return not _FOUND.search(text)


def _output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.sanitized", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="inputs of each class (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if runtime() is None:
        print("no g++ with sanitizers here: nothing was run")
        return 2
    bad = 0
    with TemporaryDirectory() as name:
        build(Path(name))
        for what, (code, text) in (("tests", run_tests(Path(name))), ("corpus", run_corpus(Path(name), given.count, given.seed))):
            clean = is_clean(text)
            bad |= int(code != 0 or not clean)
            print(f"{what}: exit {code}, sanitizers {'silent' if clean else 'not silent'}\n{text[-3000:]}", flush=True)
    return bad


if __name__ == "__main__":
    sys.exit(main())
