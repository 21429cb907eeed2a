"""The pictures are those that the code draws today; pages show them and tell their numbers."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"
PICTURES = DOCS / "pictures"
PHOTOGRAPHS = {"live.png", "report.png"}
"""Of pages in a browser; ``tests/browser`` keeps those."""


@pytest.fixture(scope="module")
def drawing() -> Iterator[SimpleNamespace]:
    """What draws them; how figures look is put back for other tests."""
    import matplotlib as mpl

    sys.path.insert(0, str(DOCS))
    with mpl.rc_context():
        import pictures
        from drawing import air, flights, verdict

        yield SimpleNamespace(drawn=pictures.DRAWN, air=air, flights=flights, verdict=verdict)
    sys.path.remove(str(DOCS))


@pytest.fixture(scope="module")
def drawn(drawing: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for name, draw in drawing.drawn.items():
        draw(folder / name)
    return folder


def told(page: str) -> str:
    """The words of a page in one line."""
    return " ".join((DOCS / page).read_text("utf-8").split())


def test_every_picture_is_drawn_by_code(drawn: Path) -> None:
    kept = {p.name for p in PICTURES.glob("*.png")} - PHOTOGRAPHS
    assert kept == {p.name for p in drawn.iterdir()}


def test_pictures_are_up_to_date(drawn: Path) -> None:
    from matplotlib.image import imread

    for new in drawn.iterdir():
        old = imread(PICTURES / new.name)[..., :3]
        now = imread(new)[..., :3]
        assert old.shape == now.shape, f"run python docs/pictures.py {new.name}"
        differs = np.mean(np.abs(old - now).max(axis=2) > 0.2)
        assert differs < 0.01, f"{differs:.1%} differ: run python docs/pictures.py {new.name}"


def test_pages_show_every_picture_in_words_too() -> None:
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    shown = {
        (page.parent / target).resolve().name: words
        for page in pages
        if "_build" not in page.parts
        for words, target in re.findall(r"!\[([^\]]*)\]\(([^)]+\.png)\)", page.read_text("utf-8"))
    }
    assert {p.name for p in PICTURES.glob("*.png")} <= shown.keys()
    assert all(len(words) > 20 for words in shown.values())


def test_the_story_of_a_verdict_has_the_times_of_its_flight(drawing: SimpleNamespace) -> None:
    it = drawing.flights.judged(drawing.verdict.FLIGHT, weigh=True)
    story = told("verdict.md")
    first, second = it.fault("airspeed0"), it.fault("airspeed1")
    air = drawing.air.load("small-uav").air
    changes = [(float(it.seconds(np.array(v.t_us))), v) for v in it.verdicts("airspeed1")]
    flown_s = next(t for t, v in changes if str(v.reason) == "learning")
    learnt_s = next(t for t, v in changes if str(v.state) == "ok")
    suspected_s = [t for t, v in changes if str(v.state) == "suspect"][-1]
    for words in (
        f"not judged until {learnt_s:.1f} s: on the ground until {flown_s:.1f} s",
        f"At {suspected_s:.1f} s it is clear",
        f"At {second['detected_s'] - air.confirm_s:.1f} s its lead passes",
        f"`air.margin_one`, {air.margin_one:g} nat",
        f"here {second['statistic']:.2f} nat over {second['threshold']:g}",
        f"at {first['cleared_s'] - air.readmit_s:.1f} s it has come near enough",
        f'"magnitude": {second["magnitude"]:.3f}, "unit": "m/s"',
        f"faulty from {first['detected_s']:.0f} to {first['cleared_s']:.0f} s",
    ):
        assert words in story


def test_the_drift_is_named_when_the_page_says(drawing: SimpleNamespace) -> None:
    it = drawing.flights.judged(drawing.air.FLIGHT, "small-uav", drawing.air._icing)
    fault, page = it.fault("airspeed0"), told("estimators/air-pitots.md")
    minutes = (fault["detected_s"] - drawing.air.ICING_S) / 60.0
    lost = int(re.search(r"drifted to (\d+) % below", fault["evidence"])[1])
    assert fault["estimator"] == "air_horizon"
    assert f"names it after {minutes:.1f} minutes, when it has lost {lost} %" in page
    assert f"names it at {fault['detected_s']:.0f} s, {lost} % low" in page


def test_bounds_find_what_the_page_says(drawing: SimpleNamespace) -> None:
    run = drawing.air.runaway.work(drawing.air.Job("wan2018", "runaway/fig4", {"seeds": 10}, 0))
    ours, printed = (np.median(run[method]["delay_s"]) for method in ("ours", "CMHE"))
    at_end = [np.median(run[method]["end_error_kt"]) for method in ("ours", "CMHE")]
    page = told("estimators/air-triplex.md")
    assert f"found after {ours:.1f} s in place of {printed:.1f} s" in page
    assert at_end[0] < 1.0
    assert f"known to 1 kt, in place of {at_end[1]:.0f} kt" in page
    assert np.isnan(run["UMHE"]["delay_s"]).all()


def test_the_lone_vane_is_named_when_the_page_says(drawing: SimpleNamespace) -> None:
    page = told("estimators/air-vane.md")
    small, large = (drawing.air.lone_vane(size_deg) for size_deg in (3.0, 4.5))
    assert not [f for f in small.faults if f["sensor"] == "aoa0"]
    fault = large.fault("aoa0")
    assert f"named after {fault['detected_s'] - 130.0:.0f} s and" in page
    assert f"again {fault['cleared_s'] - 160.0:.0f} s after it is whole" in page
