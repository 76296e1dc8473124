"""Files that are there whole or not at all; and what is no file stays what it is."""

from __future__ import annotations

import os
import stat
import threading
from pathlib import Path

import pytest

from certify.atomic import write_atomically


def test_what_is_no_file_is_written_to_and_stays(tmp_path: Path) -> None:
    """A device would be gone for every program on the machine, if who writes may do that."""
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_atomically(pipe, b"text")
    reader.join(10)
    assert heard == [b"text"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert [entry.name for entry in tmp_path.iterdir()] == ["pipe"]


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(Path("there", "file"))
    write_atomically(tmp_path / "link", b"text")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "file").read_bytes() == b"text"
    (tmp_path / "dangling").symlink_to(Path("nowhere", "file"))
    with pytest.raises(OSError, match="No such file"):
        write_atomically(tmp_path / "dangling", b"text")
    with pytest.raises(IsADirectoryError):
        write_atomically(tmp_path / "there", b"text")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["dangling", "link", "there"]
