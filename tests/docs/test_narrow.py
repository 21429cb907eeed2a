"""Where names in the site's tables may break; pictures that open."""

import importlib.util
from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "docs" / "_site"


@pytest.fixture(scope="module")
def narrow():
    spec = importlib.util.spec_from_file_location("narrow", SITE / "narrow.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("body", "made"),
    [
        ("<td>MAV_CMD_SET_MESSAGE</td>", "<td>MAV_<wbr>CMD_<wbr>SET_<wbr>MESSAGE</td>"),
        ("<th><b>air/of_it.parquet</b></th>", "<th><b>air/<wbr>of_<wbr>it.<wbr>parquet</b></th>"),
        ("<p>MAV_CMD_SET_MESSAGE</p>", "<p>MAV_CMD_SET_MESSAGE</p>"),
        ("<td>0.35 of it_all</td>", "<td>0.35 of it_all</td>"),
        ('<td><a href="a_long/path.html">b</a></td>', '<td><a href="a_long/path.html">b</a></td>'),
        ("<td>__long_beginning__</td>", "<td>__<wbr>long_<wbr>beginning__</td>"),
    ],
)  # fmt: skip
def test_long_names_break_in_cells_alone(narrow, body, made):
    assert narrow.broken(body) == made


def test_a_picture_is_a_link_to_itself(narrow):
    picture = '<img alt="a flight" src="_images/flight.png" />'
    made = narrow.opening(f"<p>{picture}</p>")
    assert made.startswith('<p><a class="picture" href="_images/flight.png"')
    assert picture in made
