"""What would be wrong in a page is found."""

from __future__ import annotations

import pytest

from tests.docs.console import commands, lasts, words
from tests.docs.elsewhere import check, exists, parses
from tests.docs.expected import agrees
from tests.docs.kinds import ini, keys_stand_in, toml
from tests.docs.pages import Fence, Setup, Wrong, parse


def test_lines_of_any_number_and_any_words_in_a_line():
    assert agrees("first\n...\nlast 3 of ...", "first\n\na\nb\nlast 3 of 4\n")
    assert agrees("┏━━━┓\n│ a │", "┏━━━━━━┓\n│    a │")
    assert not agrees("first\nlast", "first\nmiddle\nlast")
    assert not agrees("first", "first\nlast")
    assert agrees("first", "first\nlast", so_far=True)


@pytest.mark.parametrize(
    ("numbers", "printed", "same"),
    [
        ("", "since 1.6 s", False),
        ("10 %", "since 1.6 s", True),
        ("10 %", "since 1.9 s", False),
        ("10 %", "till 1.5 s", False),
        ("any", "since 99 s", True),
    ],
)
def test_numbers_differ_as_far_as_the_page_allows(numbers, printed, same):
    assert agrees("since 1.5 s", printed, numbers) is same


def test_a_console_is_cut_into_commands_and_what_they_print():
    one, two = commands("$ a \\\n    b\nsaid\n$ mavsentry run\nmore\n^C\n")
    assert (one.text, one.expected, one.interrupted) == ("a \\\n    b", "said", False)
    assert (two.expected, two.interrupted) == ("more", True)
    (other,) = commands("laptop$ ssh pi")
    assert other.elsewhere
    with pytest.raises(ValueError, match="begins with"):
        list(commands("no prompt"))


def test_words_of_loops_pipes_and_redirections():
    typed = "for i in 1 2; do A=1 mavsentry x >o 2>&1; done | sort && make test"
    assert words(typed) == [["mavsentry", "x"], ["sort"], ["make", "test"]]


def test_what_lasts_is_known():
    assert lasts("mavsentry run --in udpin:127.0.0.1:14550")
    assert lasts("mavsentry feed demo")
    assert not lasts("mavsentry feed demo --to flight.tlog")
    assert not lasts("mavsentry run --in flight.tlog")
    assert not lasts("mavsentry run --help")


@pytest.mark.parametrize(
    "typed",
    [
        "mavsentry analyse flight.tlog",
        "mavsentry analyze --speed 3 flight.tlog",
        "mavsentry run --system-id 999",
        "sudo mavsentry runs",
        "pip install 'mavsentry[everything]'",
        "pip install --no-such-option x",
        "make nothing",
        "python -m tests.nothing",
        "frobnicate",
        "systemctl frobnicate mavsentry",
    ],
)
def test_a_command_elsewhere_that_is_not_there_is_found(typed):
    with pytest.raises(Wrong):
        check(f"$ {typed}\n")


def test_a_command_elsewhere_that_is_right_passes():
    check("$ sudo -u pi mavsentry run --in /dev/ttyAMA0:921600 --system-id 1\n")
    parses(["config", "init", "x.toml"])


def test_code_in_a_line_names_what_is_there():
    exists("mavsentry learn thresholds --out FILE")
    with pytest.raises(Wrong, match="no command airframes"):
        exists("mavsentry learn airframes")
    with pytest.raises(Wrong, match="no --output"):
        exists("mavsentry analyze --output DIR")


def test_comments_belong_to_the_fence_below():
    page = parse("p", "<!-- setup: a from b -->\n<!-- fails: 2 -->\n```console\n$ x\n```\n")
    setup, fence = page.items
    assert setup == Setup("a from b", 1)
    assert isinstance(fence, Fence)
    assert fence.says == {"fails": "2"}


@pytest.mark.parametrize(
    "text",
    ["<!-- fails: 2 -->\n\nprose\n", "    indented = code\n", "<!-- elswhere: needs root -->\n"],
)
def test_a_comment_for_nothing_and_code_without_a_language_are_wrong(text):
    with pytest.raises(Wrong):
        parse("p", text)


@pytest.mark.parametrize(
    "text",
    ["[imu]\nno_such_key = 1\n", 'aircraft = "balloon"\n', '[[fault]]\nsensor = "nose"\n', "="],
)
def test_a_file_that_its_reader_refuses_is_wrong(tmp_path, text):
    file = tmp_path / "x.toml"
    file.write_text(text)
    with pytest.raises(Wrong):
        toml(file)


def test_a_key_that_is_not_written_or_not_known_is_wrong():
    keys_stand_in({"a": [{"b": 0}]}, {"a": [{"b": 1, "c": 2}]})
    with pytest.raises(Wrong, match="/a/0/d"):
        keys_stand_in({"a": [{"d": 0}]}, {"a": [{"b": 1}]})
    with pytest.raises(Wrong, match="Bauds"):
        ini("[UartEndpoint x]\nBauds = 57600\n")
