from monitor.component.texts import FOLD_US, Texts
from monitor.publish import Message

S = 1_000_000


def text(words: str, severity: int = 5, link: int | None = None) -> Message:
    return Message("STATUSTEXT", {"severity": severity, "text": words}, link)


def test_the_same_text_again_is_folded_with_its_count():
    texts, said = Texts(), []
    for k in range(50):
        texts.put(text("reboot refused", link=1))
        said += texts.due(k * S // 10)
    said += texts.due(FOLD_US)
    assert [(m.fields["text"], m.link) for m in said] == [
        ("reboot refused", 1),
        ("reboot refused (x49)", 1),
    ]


def test_different_texts_are_paced_and_bounded():
    texts, said = Texts(), []
    for k in range(100_000):
        texts.put(text(f"text {k}"))
        said += texts.due(k * 1000)  # a thousand a second for 100 s
    assert len(said) <= 3 + 100 * 0.2 + 1
    assert texts.dropped + len(said) + 16 == 100_000


def test_a_count_fits_into_fifty_characters():
    texts = Texts()
    for _ in range(12):
        texts.put(text("x" * 80))
    (said,) = texts.due(0)
    assert said.fields["text"] == "x" * 44 + " (x12)"
