"""Files are whole or as they were; lines that were acknowledged stay."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from gcs_plugin.durable import LineFile, clean_drafts, make_folder, write_whole
from mission.errors import AnswerError

LIMITED = """
import json, resource, sys
from pathlib import Path
from gcs_plugin.durable import LineFile, write_whole
from mission.errors import AnswerError
folder = Path(sys.argv[1])
write_whole(folder / "answer", b"first")
lines, said, cause = LineFile(folder / "lines"), [], ""
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    while True:
        lines.add(f"line {len(said)} " + 40 * "x")
        said.append(f"line {len(said)} " + 40 * "x")
except AnswerError as error:
    cause = error.cause
try:
    write_whole(folder / "answer", bytes(5000))
except AnswerError as error:
    print(json.dumps([said, cause, error.cause]))
"""

TALKER = """
import sys
from pathlib import Path
from gcs_plugin.durable import LineFile
lines = LineFile(Path(sys.argv[1]))
for i in range(10**6):
    lines.add(f"line {i}")
    print(f"line {i}", flush=True)
"""


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "answer.json"
    write_whole(path, b"one")
    write_whole(path, b"two")
    assert path.read_bytes() == b"two"
    assert [entry.name for entry in tmp_path.iterdir()] == ["answer.json"]


def test_a_full_disk_leaves_whole_lines_and_the_earlier_file(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path)], check=True, capture_output=True, text=True)
    said, cause, second = json.loads(done.stdout)
    assert len(said) > 10
    assert (tmp_path / "lines").read_text().splitlines() == said
    assert "lines cannot be written" in cause
    assert "answer cannot be written" in second
    assert (tmp_path / "answer").read_bytes() == b"first"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["answer", "lines"]


def test_lines_survive_kill_9(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    talker = subprocess.Popen([sys.executable, "-c", TALKER, str(path)], stdout=subprocess.PIPE, text=True)
    assert talker.stdout is not None
    said = [talker.stdout.readline().strip() for _ in range(5)]
    talker.send_signal(signal.SIGKILL)
    said += talker.stdout.read().splitlines()
    talker.wait()
    talker.stdout.close()
    assert path.read_text().splitlines()[: len(said)] == said


def test_a_torn_last_line_is_ended_before_the_next(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    path.write_text("whole\nto")
    with LineFile(path) as lines:
        lines.add("next")
    assert path.read_text() == "whole\nto\nnext\n"


def test_threads_do_not_mix_their_lines(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    with LineFile(path) as lines:

        def talk(letter: str) -> None:
            for _ in range(20):
                lines.add(letter * 50)

        threads = [threading.Thread(target=talk, args=(letter,)) for letter in "abcd"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert sorted(path.read_text().splitlines()) == [k * 50 for k in "abcd" for _ in range(20)]


def test_a_line_has_no_line_end_within(tmp_path: Path) -> None:
    with LineFile(tmp_path / "lines") as lines, pytest.raises(ValueError, match="no line end"):
        lines.add("two\nlines")


def test_where_nothing_can_be_written_the_error_says_so(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(AnswerError, match="cannot be written"):
        write_whole(blocked / "answer", b"")
    with pytest.raises(AnswerError, match="cannot be written"):
        LineFile(blocked / "lines")
    with pytest.raises(NotADirectoryError):
        make_folder(blocked / "folder")


def test_folders_are_made_with_those_above(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b" / "c")
    make_folder(tmp_path / "a" / "b" / "c")
    assert (tmp_path / "a" / "b" / "c").is_dir()


def test_drafts_of_programs_that_are_gone_are_removed_and_no_others(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = [f".answer.json.{gone.pid}-123.new", f".signatures.json.{gone.pid}.new"]
    kept = [f".answer.json.{os.getpid()}-123.new", "notes.new", ".mine.new", f".a.{10**30}.old"]
    for name in (*left, *kept):
        (tmp_path / name).write_bytes(b"x")
    clean_drafts(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(kept)
