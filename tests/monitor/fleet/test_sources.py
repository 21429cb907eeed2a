"""Which logs a pattern names, on this computer and behind URLs."""

from __future__ import annotations

import hashlib
import os
import zipfile
from pathlib import Path

import fsspec
import pytest

from monitor.fleet.sources import Source, SourceError, expand, opened


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    for name in ("2026/03/a.tlog", "2026/04/b.BIN", "2026/c.ulg", "2026/notes.txt", "d.tlog"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(name)
    return tmp_path


def names(*patterns: object) -> list[str]:
    return [source.name for source in expand(map(str, patterns))]


def test_a_folder_is_all_logs_below_it_whatever_their_case(archive) -> None:
    assert names(archive) == ["a.tlog", "b.BIN", "c.ulg", "d.tlog"]


def test_patterns_reach_as_deep_as_they_say(archive) -> None:
    assert names(f"{archive}/*.tlog") == ["d.tlog"]
    assert names(f"{archive}/**/*.tlog") == ["a.tlog", "d.tlog"]
    assert names(f"{archive}/2026/0?/*") == ["a.tlog", "b.BIN"]


def test_a_file_that_is_named_is_taken_whatever_its_name_and_each_once(archive) -> None:
    notes = archive / "2026" / "notes.txt"
    assert names(notes, archive / "d.tlog", f"{archive}/d.*", archive / "d.tlog") == [
        "notes.txt",
        "d.tlog",
    ]


def test_a_path_is_absolute_and_its_folder_named(archive, monkeypatch) -> None:
    monkeypatch.chdir(archive)
    (source,) = expand(["2026/03/a.tlog"])
    assert source.log == str(archive / "2026/03/a.tlog")
    assert (source.folder, source.bytes) == ("03", len("2026/03/a.tlog"))


def test_the_stamp_changes_with_the_file(archive) -> None:
    (before,) = expand([str(archive / "d.tlog")])
    os.utime(archive / "d.tlog", ns=(1, 1))
    (after,) = expand([str(archive / "d.tlog")])
    assert before.stamp != after.stamp


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("nothing/*.tlog", "there is no log at nothing/*.tlog"),
        ("memory://nothing-here/*.tlog", "there is no log at memory://nothing-here/*.tlog"),
        (
            "nosuch://bucket/a.tlog",
            "cannot list nosuch://bucket/a.tlog: Protocol not known: nosuch",
        ),
    ],
)
def test_a_pattern_that_names_nothing_is_said(pattern, said) -> None:
    with pytest.raises(SourceError) as error:
        expand([pattern])
    assert str(error.value) == said


def test_a_folder_that_may_not_be_listed_is_said(archive, monkeypatch) -> None:
    def forbidden(self: Path, *_: object) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_file", forbidden)
    with pytest.raises(SourceError, match="cannot list secret: Permission denied"):
        expand(["secret"])


def test_a_missing_file_system_says_what_to_install(monkeypatch) -> None:
    def missing(url: str) -> None:
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr(fsspec, "url_to_fs", missing)
    with pytest.raises(SourceError) as error:
        expand(["s3://bucket/*.tlog"])
    assert str(error.value) == "s3:// needs one more package: Install s3fs to access S3"


def test_urls_are_listed_and_fetched(archive) -> None:
    memory = fsspec.filesystem("memory")
    for name in ("x/a.tlog", "x/y/b.tlog", "x/y/c.txt"):
        memory.pipe_file(f"/sources-test/{name}", name.encode())
    assert names("memory://sources-test/x") == ["a.tlog", "b.tlog"]
    assert names("memory://sources-test/x/**/*.txt") == ["c.txt"]
    (source,) = expand(["memory://sources-test/x/y/b.tlog"])
    assert (source.bytes, source.folder) == (10, "y")
    assert source.stamp
    with opened(source) as (path, sha256):
        assert path.read_text() == "x/y/b.tlog"
        assert sha256 == hashlib.sha256(b"x/y/b.tlog").hexdigest()
        kept = path
    assert not kept.exists()


def test_logs_in_an_archive_file_are_listed_and_fetched(archive) -> None:
    with zipfile.ZipFile(archive / "may.zip", "w") as packed:
        packed.writestr("x/a.tlog", "packed")
        packed.writestr("notes.txt", "no log")
    (source,) = expand([f"zip://**/*.tlog::file://{archive}/may.zip"])
    assert (source.name, source.bytes) == ("a.tlog", 6)
    with opened(source) as (path, _):
        assert path.read_text() == "packed"


def test_a_local_log_is_read_where_it_lies(archive) -> None:
    source = Source(str(archive / "d.tlog"), 6, "s")
    with opened(source) as (path, sha256):
        assert path == archive / "d.tlog"
    assert sha256 == hashlib.sha256(b"d.tlog").hexdigest()
    assert path.exists()
