"""A page holds nothing that it was not given, and says so in its policy."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path

import jinja2
import pytest

from monitor.pages import html
from monitor.pages.units import on_screen, quantity


def test_a_policy_admits_what_it_was_given_and_nothing_else() -> None:
    policy = html.content_security_policy(["a {}"], ["f()"])
    known = base64.b64encode(hashlib.sha256(b"f()").digest()).decode()
    assert policy.startswith("default-src 'none'; ")
    assert f"script-src 'sha256-{known}';" in policy
    assert "unsafe" not in policy
    assert "connect-src" not in policy


def test_charts_admit_inline_styles_and_data_pictures_but_never_eval_or_blobs() -> None:
    policy = html.content_security_policy(["a {}"], ["f()"], charts=True, connect=True)
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    assert rules["style-src"] == "'unsafe-inline'"
    assert rules["img-src"] == "data:"
    assert rules["connect-src"] == "'self'"
    assert "eval" not in policy
    assert "blob:" not in policy
    assert "unsafe" not in rules["script-src"]


def test_a_page_without_scripts_admits_none() -> None:
    assert "script-src 'none'" in html.content_security_policy(["a {}"], [])


def test_templates_escape_and_miss_nothing(tmp_path: Path) -> None:
    (tmp_path / "page.jinja").write_text("<p>{{ text }}</p>{{ absent }}")
    page = html.environment(tmp_path).get_template("page.jinja")
    with pytest.raises(jinja2.UndefinedError, match="absent"):
        page.render(text="x")
    assert page.render(text="<script>", absent="") == "<p>&lt;script&gt;</p>"


def test_data_cannot_end_its_element() -> None:
    assert "</script" not in html.data_block('{"a": "</script><script>alert(1)</script>"}')


def test_the_theme_knows_every_colour() -> None:
    theme = html.script("theme.js")
    assert "__DARK_BY_LIGHT__" not in theme
    assert '"#0072b2":"#56b4e9"' in theme


def test_only_the_core_of_bokehjs_is_inlined() -> None:
    bokeh = html.bokeh_script()
    assert 1_000_000 < len(bokeh) < 2_000_000
    assert "</script" not in bokeh


def test_the_style_uses_no_colour_that_it_does_not_have() -> None:
    style = html.base_style()
    assert re.search(r"url\(|@import", style) is None
    used = set(re.findall(r"var\(--([a-z-]+)\)", style)) - {"tone", "on"}
    assert used <= set(re.findall(r"--([a-z-]+):", style))


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (0.0, "0:00"),
        (59.4, "0:59"),
        (59.6, "1:00"),
        (83.4, "1:23"),
        (3599.6, "1:00:00"),
        (36_061.0, "10:01:01"),
        (-5.0, "-0:05"),
        (-0.2, "0:00"),
        (None, "–"),
    ],
)
def test_the_clock(seconds: float | None, shown: str) -> None:
    assert html.clock(seconds) == shown


def test_units_as_people_read_them() -> None:
    assert on_screen("rad/s")[1] == "deg/s"
    assert quantity(3.14159265, "rad") == "180 deg"
    assert quantity(-0.0001234, "m/s", sign=True) == "−0.000123 m/s"
    assert quantity(1.5, "m/s^2", sign=True) == "+1.5 m/s²"
    assert quantity(2.0, "1") == "2"
    assert quantity(None, "m/s") == quantity(float("nan"), "m/s") == "–"
