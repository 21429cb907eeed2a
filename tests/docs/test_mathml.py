"""Equations of the site: what is written is what is drawn, and what is not understood is told."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from docutils import nodes

SITE = Path(__file__).parents[2] / "docs" / "_site"


@pytest.fixture(scope="module")
def mathml():
    spec = importlib.util.spec_from_file_location("mathml", SITE / "mathml.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "latex",
    [
        r"\dot{W} = u_W, \quad \hat{x}_{k|k-1}",
        r"\begin{aligned} a &= b \\ c &= \frac{d}{e} \end{aligned}",
        r"P = \begin{bmatrix} P_{11} & P_{12} \\ P_{21} & P_{22} \end{bmatrix}",
        r"\min_x \sum_{k=1}^N \lVert y_k - H x_k \rVert^2_{R^{-1}}",
    ],
)
def test_an_equation_is_well_formed(mathml, latex):
    tree = ET.fromstring(mathml.mathml(latex, "block", nodes.math_block()))
    assert tree.tag.endswith("math")
    assert "\\" not in "".join(tree.itertext())


def test_an_accent_is_one(mathml):
    assert mathml.mathml(r"\dot{W}", "inline", nodes.math()).count('<mover accent="true">') == 1


def test_a_function_has_a_space_and_a_power_keeps_its_two_parts(mathml):
    made = mathml.mathml(r"\sin\phi + \cos^2\theta + \tan\hat{x}", "block", nodes.math_block())
    assert made.count("<mspace") == 2
    power = ET.fromstring(made).find(".//{http://www.w3.org/1998/Math/MathML}msup")
    assert len(power) == 2


def test_a_prime_is_seen(mathml):
    assert mathml.mathml("W_z' = k''", "inline", nodes.math()).count('class="prime"') == 2


@pytest.mark.parametrize("latex", [r"\wrongly{x}", r"\left( x", r"a & b", r"x^"])
def test_what_is_not_understood_is_a_warning(mathml, monkeypatch, latex):
    said = []
    monkeypatch.setattr(mathml.log, "warning", lambda text, *words, location: said.append(words))
    assert mathml.mathml(latex, "inline", nodes.math()).startswith("<code>")
    assert said[0][0] == latex
