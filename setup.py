"""Build of the compiled kernel. Everything else is in pyproject.toml.

The extension is optional: where it cannot be built (no compiler, or one without vector extensions, such as MSVC) the package
installs without it and uses NumPy. IDENT_SANITIZE=address,undefined builds it with sanitizers (see tests/unit/test_rigid_native.py)."""

import os
import sys

from setuptools import Extension, setup

FOLDER = "ident/_native"
compile_args = ["-std=c++17", "-O3", "-fno-math-errno", "-fvisibility=hidden", "-pthread", "-g0", "-Wall", "-Wextra"]
link_args = ["-pthread"]
sanitizers = os.environ.get("IDENT_SANITIZE", "")
if sanitizers:
    compile_args += [f"-fsanitize={sanitizers}", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g", "-O1"]
    link_args += [f"-fsanitize={sanitizers}"]
written_out = ["-fno-tree-vectorize"]  # the kernel's vectors are in its source; a compiler's own slow its short loops down
if sys.platform == "win32":
    compile_args, link_args, written_out = ["/std:c++17", "/O2"], [], []

setup(
    ext_modules=[
        Extension(
            "ident._native._kernel",
            sources=[f"{FOLDER}/{name}.cpp" for name in ("module", "baseline", "avx2", "avx512")],
            depends=[f"{FOLDER}/{name}.h" for name in ("tree", "lanes", "dynamics", "rows", "information", "integrator", "kernel")],
            language="c++",
            extra_compile_args=[*compile_args, *written_out],
            extra_link_args=link_args,
            py_limited_api=True,
            optional=True,
        ),
        Extension(
            "ident._native._recursions",
            sources=[f"{FOLDER}/recursions.cpp"],
            language="c++",
            extra_compile_args=compile_args,
            extra_link_args=link_args,
            py_limited_api=True,
            optional=True,
        ),
        Extension(
            "ident._native._text",
            sources=[f"{FOLDER}/text.cpp"],
            depends=[f"{FOLDER}/buffer.h"],
            language="c++",
            extra_compile_args=compile_args,
            extra_link_args=link_args,
            py_limited_api=True,
            optional=True,
        ),
        Extension(
            "ident._native._filters",
            sources=[f"{FOLDER}/filters.cpp"],
            depends=[f"{FOLDER}/buffer.h"],
            language="c++",
            extra_compile_args=[*compile_args, *([] if sys.platform == "win32" else ["-ffp-contract=off"])],
            extra_link_args=link_args,
            py_limited_api=True,
            optional=True,
        ),
    ],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},  # one wheel for every Python from 3.11 on
)
