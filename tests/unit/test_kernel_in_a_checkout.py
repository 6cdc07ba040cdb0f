"""A checkout that was not built takes the kernels of an installed copy of the same sources, and of no other."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ident
from ident._native import __path__ as native

BUILT = next((Path(p) for p in native if list(Path(p).glob("_kernel.*.so"))), None)
SOURCE = Path(ident.__file__).parent
ASK = "from ident.regressor.kernel_choice import kernel; import warnings; warnings.simplefilter('ignore'); print(kernel().compiled)"


@pytest.mark.skipif(BUILT is None, reason="no compiled kernel here")
@pytest.mark.parametrize("same", [True, False])
def test_kernels_of_the_same_sources_are_taken(tmp_path: Path, same: bool) -> None:
    assert BUILT is not None
    checkout, user = tmp_path / "checkout", tmp_path / "user"
    shutil.copytree(SOURCE, checkout / "ident", ignore=shutil.ignore_patterns("*.so", "__pycache__", "demo"))
    environment = {**os.environ, "PYTHONPATH": str(checkout), "PYTHONUSERBASE": str(user), "IDENT_KERNEL": ""}
    where = subprocess.run(
        [sys.executable, "-c", "import site; print(site.getusersitepackages())"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    installed = Path(where.stdout.strip()) / "ident/_native"
    shutil.copytree(SOURCE / "_native", installed, ignore=shutil.ignore_patterns("__pycache__"))
    for file in BUILT.glob("*.so"):
        shutil.copy(file, installed / file.name)
    if not same:
        (installed / "text.cpp").write_text("// another version\n")
    # Other installed copies (of this very environment) would be found, too.
    hide = "import sysconfig, site; site.getsitepackages = lambda: []; sysconfig.get_path = lambda name: '/nowhere'; "
    done = subprocess.run([sys.executable, "-c", hide + ASK], env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(same)
