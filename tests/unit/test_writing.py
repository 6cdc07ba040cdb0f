"""Writing: whole or not at all, one set at a time, nothing of others lost, nothing left lying about."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ident import ConfigurationError, cli
from ident._utils import files
from ident._utils.files import remove_leftovers, staged, write_atomic
from ident.streaming.checkpoint import Checkpoint, key_of


def names(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


def fill(out: Path, content: dict[str, str], *, force: bool = False, fails: type[Exception] | None = None) -> None:
    """Write a set of files; where it `fails`, with that error after the writing."""
    with staged(out, force=force) as scratch:
        for name, text in content.items():
            (scratch / name).write_text(text)
        if fails is not None:
            raise fails


def test_a_set_appears_at_once(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with staged(out) as scratch:
        (scratch / "a.txt").write_text("1")
        (scratch / "deep").mkdir()
        (scratch / "deep/b.txt").write_text("2")
        assert not out.exists()
        assert scratch.parent == tmp_path
    assert names(out) == ["a.txt", "deep", "deep/b.txt"]
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_leaves_everything_as_it_was(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.txt").write_text("old")
    with pytest.raises(ZeroDivisionError):
        fill(out, {"a.txt": "new"}, force=True, fails=ZeroDivisionError)
    assert (out / "a.txt").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("one_step", [True, False], ids=["exchange", "file by file"])
def test_with_force_others_files_stay_and_old_ones_go(tmp_path: Path, one_step: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not one_step:
        monkeypatch.setattr(files, "_exchanged", lambda *_: False)
    out = tmp_path / "out"
    (out / "mine").mkdir(parents=True)
    (out / "a.txt").write_text("old")
    (out / "mine/note.txt").write_text("keep me")
    (out / "link").symlink_to("a.txt")
    with staged(out, force=True) as scratch:
        (scratch / "a.txt").write_text("new")
        (scratch / "b.txt").write_text("b")
    assert names(out) == ["a.txt", "b.txt", "link", "mine", "mine/note.txt"]
    assert (out / "a.txt").read_text() == "new"
    assert (out / "mine/note.txt").read_text() == "keep me"
    assert (out / "link").readlink() == Path("a.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_without_force_nothing_is_written_over(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.txt").write_text("old")
    with pytest.raises(ConfigurationError, match="nothing was written"):
        fill(out, {"a.txt": "new", "b.txt": "b"})
    assert names(out) == ["a.txt"]
    with pytest.raises(ConfigurationError, match="exists"):
        write_atomic(out / "a.txt", "new")
    assert (out / "a.txt").read_text() == "old"


def test_a_folder_in_which_one_stands_is_not_taken_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "note.txt").write_text("mine")
    with staged(Path(), force=True) as scratch:
        (scratch / "a.txt").write_text("1")
    assert sorted(p.name for p in Path().iterdir()) == ["a.txt", "note.txt"]


def test_of_two_that_write_at_once_the_first_wins(tmp_path: Path) -> None:
    out = tmp_path / "out"

    def late() -> None:
        with staged(out) as second:
            (second / "a.txt").write_text("second")
            fill(out, {"a.txt": "first", "b.txt": "first"})

    with pytest.raises(ConfigurationError, match="nothing was written"):
        late()
    assert (out / "a.txt").read_text() == "first"
    assert names(out) == ["a.txt", "b.txt"]


def test_what_a_killed_process_left_is_removed_and_what_a_living_one_writes_is_not(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = (
        "import os, signal, sys; from pathlib import Path; from ident._utils.files import staged\n"
        "with staged(Path(sys.argv[1])) as scratch:\n    (scratch / 'a.txt').write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, str(out)], check=False)
    (left,) = list(tmp_path.iterdir())
    assert left.name.startswith(".out.ident-")
    other = tmp_path / left.name.replace(".out.", ".other.")
    other.mkdir()  # of another target
    with staged(out) as living:
        assert not left.exists()
        remove_leftovers(out)
        assert living.exists()
        (living / "a.txt").write_text("whole")
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([other.name, "out"])


def test_the_umask_decides_who_may_read(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomic(tmp_path / "a.txt", "1")
        with staged(tmp_path / "out") as scratch:
            write_atomic(scratch / "b.txt", "2")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o750


@pytest.mark.parametrize("name", ["x" * 300, "a\x00b", "é" * 120], ids=["long", "nul", "long in bytes, not too long"])
def test_a_name_is_taken_or_refused_in_one_line(tmp_path: Path, name: str) -> None:
    if len(name.encode()) <= 255 and "\x00" not in name:
        assert write_atomic(tmp_path / name, "1").read_text() == "1"
        return
    with pytest.raises(ConfigurationError, match="nothing was written"):
        write_atomic(tmp_path / name, "1")
    with pytest.raises(ConfigurationError, match="nothing was written"):
        fill(tmp_path / name, {"a.txt": "1"})
    assert list(tmp_path.iterdir()) == []


def test_an_argument_with_a_nul_is_refused_by_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("fit", "base", "export"):
        with pytest.raises(SystemExit) as ended:
            cli.main([command, "--out", "a\x00b"])
        assert ended.value.code == 2
    assert capsys.readouterr().err.count("NUL") == 3


def test_a_checkpoint_has_its_key_or_is_not_there(tmp_path: Path) -> None:
    """A process killed between folder and key once left what neither --resume nor --force took."""
    key = key_of([], {"a": 1})
    code = (
        "import os, signal, sys; from pathlib import Path; from ident.streaming import checkpoint\n"
        "def killed(*_, **__):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
        "checkpoint.write_atomic = killed\n"
        "checkpoint.Checkpoint.beside(Path(sys.argv[1]), {}, resume=False)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert not (tmp_path / "checkpoint").exists()
    found = Checkpoint.beside(tmp_path, key, resume=False)
    assert names(tmp_path) == ["checkpoint", "checkpoint/key.json"]
    (found.part("rows") / "a").write_text("1")
    assert Checkpoint.beside(tmp_path, key, resume=True).folder == found.folder
    assert names(tmp_path) == ["checkpoint", "checkpoint/key.json", "checkpoint/rows", "checkpoint/rows/a"]
    Checkpoint.beside(tmp_path, key, resume=False, force=True)
    assert names(tmp_path) == ["checkpoint", "checkpoint/key.json"]
    found.remove()
    assert names(tmp_path) == []
    (tmp_path / "checkpoint").mkdir()  # as an older version left it
    Checkpoint.beside(tmp_path, key, resume=False)
    assert names(tmp_path) == ["checkpoint", "checkpoint/key.json"]


def test_what_a_killed_command_left_in_its_folder_stops_no_other(tmp_path: Path) -> None:
    """A file that was being written stays hidden in a new folder; the same command was then told that the folder is not empty."""
    out = tmp_path / "out"
    out.mkdir()
    code = (
        "import os, signal, sys; from pathlib import Path; from ident._utils import files\n"
        "files.os.fsync = lambda *_: os.kill(os.getpid(), signal.SIGKILL); files.write_atomic(Path(sys.argv[1]), 'half')"
    )
    subprocess.run([sys.executable, "-c", code, str(out / "base.json")], check=False)
    (left,) = list(out.iterdir())
    assert left.name.startswith(".base.json.ident-")
    assert cli.main(["base", "--robot", "z1", "--out", str(out)]) == 0
    assert not left.exists()
    assert cli.main(["base", "--robot", "z1", "--out", str(out)]) == 2
