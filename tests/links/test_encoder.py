"""Samples to messages: pymavlink reads what we write, and the other way round."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect_all
from pymavlink.dialects.v20 import ardupilotmega

from links import catalog
from links.mavlink import OUTPUT_MESSAGES, Encoder, encode
from links.mavlink.dialect import load_dialect
from links.mavlink.framing import Framer
from links.mavlink.rows import gather_payloads

ALL = load_dialect("all")
INPUT_MESSAGES = sorted({s.message for s in catalog.SOURCES} | set(catalog.STAMPS))


def parse(data, module=dialect_all):
    """What pymavlink makes of one frame."""
    mav = module.MAVLink(None)
    mav.robust_parsing = False
    (message,) = mav.parse_buffer(data)
    return message


def single(value):
    return float(np.float32(value))


def values_of(message):
    """Strategy of the fields of a message."""
    fields = {}
    for name, count in zip(message.wire_fields, message.wire_counts, strict=True):
        dtype = message.dtype[name].base
        if dtype.kind == "S":
            alphabet = st.characters(min_codepoint=32, max_codepoint=126)
            size = message.dtype[name].itemsize
            fields[name] = st.text(alphabet, max_size=size).map(str.rstrip)
            continue
        if dtype.kind == "f":
            value = st.floats(width=32 if dtype.itemsize == 4 else 64, allow_nan=False)
        else:
            limits = np.iinfo(dtype)
            value = st.integers(int(limits.min), int(limits.max))
        if message.dtype[name].shape:
            value = st.lists(value, min_size=count, max_size=count)
        fields[name] = value
    return st.fixed_dictionaries(fields)


@pytest.mark.parametrize("name", sorted({*OUTPUT_MESSAGES, *INPUT_MESSAGES}))
@settings(max_examples=12, deadline=None)
@given(data=st.data())
def test_every_message_comes_back_as_it_went(name, data):
    layout = ALL.by_name[name]
    fields = data.draw(values_of(layout))
    frame = Encoder(17, 191, "all").encode(name, **fields)

    heard = parse(frame)
    assert heard.get_type() == name
    assert (heard.get_srcSystem(), heard.get_srcComponent()) == (17, 191)
    frames = Framer(ALL).feed(frame)
    assert len(frames) == 1
    row = gather_payloads(frames, np.arange(1), layout)[0]
    for field, value in fields.items():
        told = getattr(heard, field)
        if isinstance(value, str):
            assert told == value
            assert row[field].decode() == value
        else:
            np.testing.assert_array_equal(row[field], value)
            assert np.asarray(told).tolist() == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize("name", ["ATTITUDE", "STATUSTEXT", "RAW_IMU", "SERVO_OUTPUT_RAW"])
def test_bytes_are_those_of_pymavlink(name):
    """An independent encoder, first of a stream.

    MAVLink 1 has no extension fields, but pymavlink sends them: compared where there are none.
    """
    rng = np.random.default_rng(5)
    cls = getattr(ardupilotmega, f"MAVLink_{name.lower()}_message")
    fields = {
        f: "some text" if t == "char" else int(rng.integers(1, 100))
        for f, t in zip(cls.fieldnames, cls.fieldtypes, strict=True)
    }
    theirs = {f: v.encode() if isinstance(v, str) else v for f, v in fields.items()}
    layout = load_dialect().by_name[name]
    extended = layout.base_size < layout.dtype.itemsize
    for version in (2,) if extended else (1, 2):
        mav = ardupilotmega.MAVLink(None, srcSystem=3, srcComponent=4)
        expected = cls(**theirs).pack(mav, force_mavlink1=version == 1)
        assert Encoder(3, 4, version=version).encode(name, **fields) == expected


def test_trailing_zeros_are_not_sent():
    assert len(encode("ATTITUDE", time_boot_ms=1)) == 12 + 1
    assert len(encode("ATTITUDE")) == 12 + 1
    assert len(Encoder(1, 1, version=1).encode("ATTITUDE")) == 8 + 28


def test_frames_are_numbered_and_counted():
    sender = Encoder(1, 191)
    frames = [sender.encode("HEARTBEAT") for _ in range(300)]
    assert [f[4] for f in frames] == [i % 256 for i in range(300)]
    assert sender.messages == 300
    assert sender.bytes == sum(map(len, frames))
    assert sender.by_name == {"HEARTBEAT": 300}


def test_packer_is_encode_in_wire_order():
    layout = load_dialect().by_name["SCALED_IMU2"]
    values = dict(zip(layout.wire_fields, range(1, 12), strict=True))
    fast, plain = Encoder(1, 1), Encoder(1, 1)
    assert fast.packer("SCALED_IMU2")(*values.values()) == plain.encode("SCALED_IMU2", **values)


def test_text_is_cut_to_its_field_and_other_characters_are_replaced():
    heard = parse(encode("STATUSTEXT", text="é" + "x" * 80))
    assert heard.text == "?" + "x" * 49
    name = parse(encode("NAMED_VALUE_FLOAT", name="FLT_IMU0_TOO_LONG", value=1.0)).name
    assert name == "FLT_IMU0_T"


def test_masks_below_2_to_24_are_exact_in_a_float():
    for mask in (0, 1, 0x700, (1 << 24) - 1):
        heard = parse(encode("NAMED_VALUE_FLOAT", name="FLT_ENG", value=float(mask)))
        assert int(heard.value) == mask


def test_short_arrays_are_filled_with_zero_and_nan_is_sent():
    heard = parse(encode("DEBUG_FLOAT_ARRAY", name="IMU_FLT", array_id=2, data=[math.nan, 2.5]))
    assert math.isnan(heard.data[0])
    assert heard.data[1:3] == [2.5, 0.0]


@pytest.mark.parametrize(
    ("message", "fields", "sentence"),
    [
        ("NOT_A_MESSAGE", {}, "no message 'NOT_A_MESSAGE'"),
        ("ATTITUDE", {"rol": 1.0}, "ATTITUDE has no field 'rol'"),
        ("RAW_IMU", {"xacc": 40_000}, "RAW_IMU cannot hold these values"),
        ("ATTITUDE", {"roll": 1e300}, "ATTITUDE cannot hold these values"),
        ("DEBUG_FLOAT_ARRAY", {"data": [0.0] * 59}, "holds 58 values"),
    ],
)
def test_what_cannot_be_encoded_is_said(message, fields, sentence):
    with pytest.raises(ValueError, match=sentence):
        encode(message, **fields)


def test_mavlink_1_cannot_carry_large_numbers():
    with pytest.raises(ValueError, match="MAVLink 1 cannot carry AOA_SSA"):
        Encoder(1, 1, version=1).encode("AOA_SSA")


@pytest.mark.parametrize("ids", [(0, 1), (1, 256)])
def test_ids_are_checked(ids):
    with pytest.raises(ValueError, match="1 to 255"):
        Encoder(*ids)


def test_the_default_dialect_has_every_output():
    sender = Encoder(1, 191)
    assert all(sender.has(name) for name in OUTPUT_MESSAGES)
    assert not sender.has("SENSOR_AIRFLOW_ANGLES")


def test_float_fields_keep_single_precision():
    heard = parse(encode("NAMED_VALUE_FLOAT", name="R_CAS", value=0.1))
    assert heard.value == single(0.1)
