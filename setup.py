"""Build of the compiled kernel. Everything else is in pyproject.toml.

The extension is optional: where it cannot be built (no compiler, or one without vector extensions, such as MSVC) the package
installs without it and uses NumPy. IDENT_SANITIZE=address,undefined builds it with sanitizers (see tests/unit/test_rigid_native.py)."""

import os
import sys

from setuptools import Extension, setup

FOLDER = "ident/_native"
WINDOWS = sys.platform == "win32"
compile_args = ["-std=c++17", "-O3", "-fno-math-errno", "-fvisibility=hidden", "-pthread", "-g0", "-Wall", "-Wextra"]
link_args = ["-pthread"]
sanitizers = os.environ.get("IDENT_SANITIZE", "")
if sanitizers:
    compile_args += [f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g", "-O1"]
    link_args += [f"-fsanitize={sanitizers}"]
if WINDOWS:
    compile_args, link_args = ["/std:c++17", "/O2"], []


def extension(name: str, sources: tuple[str, ...] = (), headers: tuple[str, ...] = (), flags: tuple[str, ...] = ()) -> Extension:
    """`ident._native._<name>`, of <name>.cpp or of `sources`. `flags`: what this one adds for compilers that take them (not MSVC)."""
    return Extension(
        f"ident._native._{name}",
        sources=[f"{FOLDER}/{source}.cpp" for source in sources or (name,)],
        depends=[f"{FOLDER}/{header}.h" for header in headers],
        language="c++",
        extra_compile_args=[*compile_args, *(() if WINDOWS else flags)],
        extra_link_args=link_args,
        py_limited_api=True,
        optional=True,
    )


setup(
    ext_modules=[
        extension(
            "kernel",
            ("module", "baseline", "avx2", "avx512"),
            ("tree", "lanes", "dynamics", "rows", "information", "integrator", "series", "kernel"),
            ("-fno-tree-vectorize",),  # its vectors are in its source; a compiler's own slow its short loops down
        ),
        extension("recursions"),
        extension("text", headers=("buffer",)),
        extension("filters", headers=("buffer",), flags=("-ffp-contract=off",)),
    ],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},  # one wheel for every Python from 3.11 on
)
