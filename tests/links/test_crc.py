"""The checksum in machine code against the definition, bit by bit, at every length."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from links.jit import kernel
from links.mavlink.crc import checksum
from links.memory import copy_bytes, load_word, store_word


@kernel
def _checksum(data, at, end, extra):
    return checksum(data, at, end, extra)


@kernel
def _words(data, to_data, at, size):
    copy_bytes(data, at, to_data, at + 1, size)
    store_word(to_data, 0, load_word(data, at))


def by_definition(data):
    """CRC-16/MCRF4XX: polynomial 0x1021 reflected, begun with ones."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return crc


def test_the_check_value_of_the_algorithm():
    data = np.frombuffer(b"123456789", np.uint8)
    assert _checksum(data, 0, 8, ord("9")) == 0x6F91


def test_every_length_of_a_frame_at_every_alignment():
    data = np.random.default_rng(1).integers(0, 256, 300).astype(np.uint8)
    for size in range(283):
        at = size % 17
        expected = by_definition([*data[at : at + size].tolist(), size & 0xFF])
        # Nothing behind the end may be needed: the array ends there.
        assert _checksum(data[: at + size], at, at + size, size & 0xFF) == expected, size


@settings(deadline=None)  # the first one compiles
@given(st.binary(min_size=8, max_size=60), st.data())
def test_words_and_copies_stand_where_they_are_asked_for(content, choice):
    data, to_data = np.frombuffer(content, np.uint8), np.zeros(100, np.uint8)
    at = choice.draw(st.integers(0, len(data) - 8))
    size = choice.draw(st.integers(0, len(data) - at))
    _words(data, to_data, at, size)
    expected = bytearray(100)
    expected[at + 1 : at + 1 + size] = content[at : at + size]
    expected[:8] = content[at : at + 8]
    assert to_data.tobytes() == bytes(expected)
