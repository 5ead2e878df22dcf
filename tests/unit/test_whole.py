"""Claims about the one writer of files: a reader meets the old file or the new one, whole; a failure leaves the old."""

import threading

import pytest

from pycosim.core import cache
from pycosim.core.whole import write_whole


def test_a_file_that_does_not_pass_its_check_leaves_the_old_one_and_nothing_else(tmp_path):
    path = write_whole(tmp_path / "study.toml", "old")

    def refuse(written):
        assert written.read_text() == "new" and path.read_text() == "old"
        raise ValueError("no")
    with pytest.raises(ValueError, match="no"):
        write_whole(path, "new", refuse)
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["study.toml"]
    with pytest.raises(OSError, match="No such file"):
        write_whole(tmp_path / "no" / "study.toml", "new")


def test_threads_that_write_one_file_leave_one_whole_file(tmp_path):
    path, torn = tmp_path / "entry", []
    texts = [str(k) * 200_000 for k in range(4)]
    write_whole(path, texts[0])

    def work(text):
        for _ in range(20):
            write_whole(path, text)
            torn.extend(t for t in [path.read_text()] if t not in texts)
    threads = [threading.Thread(target=work, args=(t,)) for t in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not torn and path.read_text() in texts and [p.name for p in tmp_path.iterdir()] == ["entry"]


def test_the_cache_gives_again_what_was_made_and_does_without_a_folder(tmp_path, monkeypatch):
    made = []

    def make():
        made.append(1)
        return b"value"
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path / "cache"))
    assert [cache.remember("kind", "key", make, bytes, bytes) for _ in range(2)] == [b"value"] * 2 and len(made) == 1
    assert [p.name for p in (tmp_path / "cache").iterdir()] == ["kind-key"]
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PYCOSIM_CACHE", str(tmp_path / "file"))
    assert cache.remember("kind", "key", make, bytes, bytes) == b"value" and len(made) == 2
