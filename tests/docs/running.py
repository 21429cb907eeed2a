"""What becomes of each snippet of a page."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from tests.conftest import ROOT
from tests.docs import kinds
from tests.docs.console import Command, commands
from tests.docs.elsewhere import REASONS, check, exists
from tests.docs.expected import agrees
from tests.docs.pages import Fence, Inline, Page, Setup, Wrong
from tests.docs.session import Session

SHOWN = ("text", "math", "mermaid", "bibtex", "graph")
"""Only shown; ``graph`` is MAVProxy's, and tested beside the page's other names."""

_FILE_NAME = re.compile(r"# (\S*?([\w.\-]+\.\w+))\b(?:[:,;]? .*)?")


class Running:
    """One page, snippet by snippet.

    Parameters
    ----------
    session
        The page's folder and shell.
    flights
        Folder for flights that pages share.
    data
        Recorded flights, if they are there.
    """

    def __init__(self, page: Page, session: Session, flights: Path, data: Path | None) -> None:
        self.page = page
        self.session = session
        self.flights = flights
        self.data = data
        self.namespace = ModuleType("__main__")
        self.printed = ""
        self.by_language: dict[str, Callable[[Fence], None]] = {
            "console": self._console,
            "python": self._python,
            "toml": self._toml,
            "json": self._json,
            "yaml": lambda fence: kinds.yaml_text(fence.text),
            "ini": lambda fence: kinds.ini(fence.text),
            "systemd": lambda fence: kinds.systemd(fence.text, session.folder.parent),
            "sql": self._sql,
            "text": self._text,
        }

    def whole(self) -> list[str]:
        """Everything, in its order; sentences on what is wrong."""
        wrong = []
        for item in self.page.items:
            try:
                self._item(item)
            except Wrong as error:
                wrong.append(f"{self.page.name}:{item.line}: {error}")
        try:
            self.session.close()
        except Wrong as error:
            wrong.append(f"{self.page.name}: {error}")
        return wrong

    def _item(self, item: Fence | Setup | Inline) -> None:
        if isinstance(item, Inline):
            if item.text.startswith("mavsentry "):
                exists(item.text)
        elif isinstance(item, Setup):
            self._setup(item.text)
        elif (copied := item.says.get("copy")) and (ROOT / copied).read_text() != item.text:
            raise Wrong(f"is not what stands in {copied}")
        elif item.language in self.by_language:
            try:
                self.by_language[item.language](item)
            except ValueError as error:
                raise Wrong(str(error)) from error
        elif item.language not in SHOWN and not item.language.startswith("{"):
            known = ", ".join(dict.fromkeys((*self.by_language, *SHOWN)))
            raise Wrong(f"a fence of the language {item.language!r}; known are {known}")

    def _setup(self, text: str) -> None:
        if text.startswith("$ "):
            self.session.type(Command(text[2:], "", False, False))
            return
        name, _, rest = text.partition(" ")
        how, _, what = rest.partition(" ")
        target = self.session.folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if how == "is":
            self._is(target, what)
        elif how == "from" and what.startswith("feed "):
            shutil.copyfile(self._flown(what), target)
        else:
            raise Wrong(f"setup: {text}: neither 'FILE from feed ...', 'FILE is ...' nor '$ ...'")

    def _is(self, target: Path, what: str) -> None:
        for folder in (ROOT, self.data):
            if folder is not None and (folder / what).exists():
                copy = shutil.copytree if (folder / what).is_dir() else shutil.copyfile
                copy(folder / what, target)  # type: ignore[operator]
                return
        if self.data is None:
            pytest.skip(f"no recorded flights: {what}")
        raise Wrong(f"setup: there is no {what}")

    def _flown(self, feed: str) -> Path:
        """The flight, made by the first page that needs it."""
        words = feed.split()
        local = self.session.folder / words[1]
        digest = hashlib.sha256(feed.encode())
        if local.is_file():
            digest.update(local.read_bytes())
        flight = self.flights / f"{digest.hexdigest()[:16]}.tlog"
        with (self.flights / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not flight.exists():
                made = flight.with_suffix(".making.tlog")
                command = Command(f"mavsentry {feed} --to {made} --speed max", "", False, False)
                self.session.type(command)
                made.rename(flight)
        return flight

    def _console(self, fence: Fence) -> None:
        if (reason := fence.says.get("elsewhere")) is not None:
            if reason not in REASONS:
                raise Wrong(f"elsewhere: {reason}: the reasons are {', '.join(REASONS)}")
            check(fence.text)
            return
        typed = list(commands(fence.text))
        for command in typed:
            if command.elsewhere:
                raise Wrong(f"$ {command.text}\n  another computer's prompt: mark it 'elsewhere'")
            status = int(fence.says.get("fails", 0)) if command is typed[-1] else 0
            self.session.type(command, status, fence.says.get("numbers", ""))

    def _python(self, fence: Fence) -> None:
        place = f"{self.page.name} (python, line {fence.line})"
        text = "\n" * fence.line + self.session.ports.here(fence.text)
        code = compile(text, place, "exec", dont_inherit=True)
        if "elsewhere" in fence.says:
            return
        out = io.StringIO()
        before = sys.modules["__main__"]
        sys.modules["__main__"] = self.namespace
        try:
            with self._within(), contextlib.redirect_stdout(out):
                exec(code, self.namespace.__dict__)
        except Exception as error:
            raise Wrong(f"python: {type(error).__name__}: {error}") from error
        finally:
            sys.modules["__main__"] = before
            self.printed = out.getvalue()

    @contextlib.contextmanager
    def _within(self) -> Iterator[None]:
        with contextlib.chdir(self.session.folder), pytest.MonkeyPatch.context() as patch:
            patch.setenv("HOME", str(self.session.folder))
            yield

    def _text(self, fence: Fence) -> None:
        if "output" in fence.says and not agrees(
            fence.text, self.printed, fence.says.get("numbers", "")
        ):
            raise Wrong(f"python printed:\n{self.printed}")

    def _toml(self, fence: Fence) -> None:
        named = _FILE_NAME.match(fence.text)
        file = self.session.write(named[2] if named else "snippet.toml", fence.text)
        with self._within():
            kinds.toml(file)

    def _json(self, fence: Fence) -> None:
        shown = kinds.json_text(fence.text)
        if like := fence.says.get("like"):
            file = self.session.folder / like
            if not file.is_file():
                raise Wrong(f"like: there is no {like}")
            kinds.keys_stand_in(shown, kinds.json_text(file.read_text("utf-8")))

    def _sql(self, fence: Fence) -> None:
        if "elsewhere" in fence.says:
            return
        script = "import duckdb, sys; print(duckdb.sql(sys.stdin.read()))"
        done = subprocess.run(
            [sys.executable, "-c", script],
            input=fence.text,
            cwd=self.session.folder,
            env={**os.environ, "HOME": str(self.session.folder)},
            capture_output=True,
            text=True,
            timeout=60,
        )
        if done.returncode:
            raise Wrong(f"sql: {done.stderr.strip().splitlines()[-1]}")
        self.printed = done.stdout
