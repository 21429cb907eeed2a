"""Every link of README, CHANGELOG and docs leads to something."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.links import Link, anchors, broken, links
from tests.docs.pages import paths

PAGES = [*paths(), ROOT / "CHANGELOG.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    wrong = [
        f"{page.relative_to(ROOT)}:{link.line}: {link.target}: {why}"
        for link in links(page)
        if (why := broken(link))
    ]
    assert not wrong, "\n".join(wrong)


def test_links_to_the_outside_are_few_and_listed() -> None:
    """What a reader without a network cannot follow; ``pytest -s -k outside`` shows them."""
    outside = sorted({link.target for page in PAGES for link in links(page) if link.outside})
    print("", *outside, sep="\n")
    assert 0 < len(outside) < 60


def test_every_page_is_in_the_tree_once() -> None:
    tree = (ROOT / "docs" / "index.md").read_text("utf-8")
    listed = [
        line for part in tree.split("```{toctree}")[1:] for line in part.partition("```")[0].split()
    ]
    listed = [name for name in listed if (ROOT / "docs" / f"{name}.md").is_file()]
    pages = [p.relative_to(ROOT / "docs") for p in PAGES if p.is_relative_to(ROOT / "docs")]
    assert sorted(listed) == sorted(
        p.with_suffix("").as_posix() for p in pages if p.name != "index.md" or len(p.parts) > 1
    )


def test_anchors_are_those_of_the_headings(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One: `two_three` (4)\n\n## Again\n\ntext\n\n## Again\n")
    assert anchors(page) == {"one-two_three-4", "again", "again-1"}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[x](gone.md)", "no such file"),
        ("[x](#gone)", "no such heading"),
        ("[x](other.md#gone)", "no such heading"),
        ("[](other.md)", "a link without words"),
        ("![](other.md)", "a picture without a description"),
        ("[x](/other.md)", "leads to the root"),
        ("[x](http://example.org)", "not https"),
        ("[x](https://localhost/)", "not a public host"),
        ("[x](https://example.org:8080/)", "a user or a port"),
        ("[x](other.md#here)", ""),
        ("[`x`](https://example.org/a#b)", ""),
    ],
)
def test_a_broken_link_is_told(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "other.md").write_text("# Here\n")
    page = tmp_path / "page.md"
    page.write_text(f"# Page\n\n{text}\n")
    (link,) = links(page)
    assert isinstance(link, Link)
    said = broken(link)
    assert said is None if not why else said is not None and said.startswith(why)
