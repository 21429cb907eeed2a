"""The compiled decoder against numpy, field by field, and the memory that it works in."""

import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from links import catalog
from links.catalog import MAX_INSTANCES
from links.jit import borrowed, kernel
from links.mavlink import Decoder, DecoderOptions, Encoder
from links.mavlink.dialect import load_dialect
from links.mavlink.plan import build_plan
from links.mavlink.rows import build_rows, instances
from links.mavlink.sourcing import Entry, source_table
from links.samples import Batch
from links.vocabulary import Rejection

ALL = load_dialect("all")
MESSAGES = sorted({source.message for source in catalog.SOURCES})
PAYLOADS = 300
RATIO = 1.7


def payloads_of(message, rng):
    """Random payloads: bits, small numbers and sensible ones; all at one time since boot."""
    payload = np.zeros(PAYLOADS, ALL.by_name[message].dtype)
    noise = np.frombuffer(rng.bytes(payload.nbytes), payload.dtype)
    for name in payload.dtype.names:
        field = payload[name]
        if field.dtype.kind == "S":
            field[:] = rng.choice(
                [b"AOA1", b"AOA10", b"ARSPD_RATIO", b"0123456789", b"x"], len(field)
            )
            continue
        low = -3 if field.dtype.kind == "f" or field.dtype.kind == "i" else 0
        field[:] = rng.integers(low, 16, field.shape)
        if field.dtype.kind == "f":
            field[:] *= rng.choice([0.0, 0.3, 60.0], field.shape)
        wild = rng.random(len(field)) < 0.2
        field[wild] = noise[name][wild]
    if message in catalog.STAMPS:
        name, _, unit = catalog.STAMPS[message]
        payload[name] = 7_000_000 // unit
    return payload


def by_numpy(message, payload, options):
    """Sensor -> rows, and what is rejected, without time and number."""
    rows, rejected = {}, Counter()
    for entry in source_table(ALL, options, 3)[ALL.by_name[message].id]:
        mask = entry.theirs(payload, None)
        mine = payload if mask is None else payload[mask]
        for sensor, mask in instances(entry.source, mine):
            part = mine if mask is None else mine[mask]
            if entry.source.instance and sensor == entry.source.quantity:
                rejected[sensor, Rejection.OUT_OF_RANGE] += len(part)
                continue
            ratio = np.full(len(part), RATIO) if entry.source.ratio else None
            with np.errstate(invalid="ignore"):  # signalling NaN among the random bits
                built, good = build_rows(entry.source, sensor, part, rejected, ratio)
            if good.any():
                rows[sensor] = built[good]
    return rows, +rejected


@pytest.mark.parametrize("message", MESSAGES)
def test_rows_are_those_that_numpy_builds(message):
    """Sines and square roots may differ in the last bit, all else not at all."""
    keys = {s.quantity: (s.key,) for s in catalog.SOURCES if s.message == message}
    ranking = {quantity: keys.get(quantity, ()) for quantity in catalog.RANKING}
    options = DecoderOptions(
        dialect="all", ranking=ranking, settle_us=0, airspeed_ratio=RATIO, named_inputs={
            "AOA1": ("aoa0", "aoa_rad", 0.5), "0123456789": ("aoa1", "aoa_rad", 2.0),
            "AOA10LONGER": ("aoa2", "aoa_rad", 1.0)},
    )  # fmt: skip
    payload = payloads_of(message, np.random.default_rng(len(message)))
    sender, decoder = Encoder(1, 1, "all"), Decoder(options)
    head = sender.encode("HEARTBEAT", type=1, autopilot=3)
    begun = decoder.feed(head + sender.encode("SYSTEM_TIME", time_boot_ms=7000))
    pack, layout = sender.packer(message), ALL.by_name[message].packer
    batch = decoder.feed(b"".join(pack(*layout.unpack(p.tobytes())) for p in payload))
    expected, rejected = by_numpy(message, payload, options)
    assert batch.rejected == rejected
    assert set(batch.rows) == set(expected)
    for sensor, rows in expected.items():
        told = batch.rows[sensor]
        for name in rows.dtype.names[2:]:
            if name == "stamp_us":
                assert (told[name] == 7_000_000).all()
            elif rows[name].dtype.kind == "f":
                np.testing.assert_array_max_ulp(told[name], rows[name], 2)
            else:
                np.testing.assert_array_equal(told[name], rows[name])
    seqs = np.concatenate([r["seq"] for r in (*begun.rows.values(), *batch.rows.values())])
    assert sorted(seqs.tolist()) == list(range(len(seqs)))


def test_rows_given_out_are_not_written_to_again(noisy_stream):
    data, decoder = noisy_stream(4, 3000), Decoder()
    batches = [decoder.feed(data[at : at + 64]) for at in range(0, len(data), 64)]
    kept = [{s: r.tobytes() for s, r in batch.rows.items()} for batch in batches]
    assert sum(len(r) for rows in kept for r in rows.values()) > 1 << 16  # the arena was changed
    batches.append(decoder.feed(data))
    for batch, rows in zip(batches, kept, strict=False):
        assert {s: r.tobytes() for s, r in batch.rows.items()} == rows


@pytest.mark.parametrize("size", [700, 5000, 100_000])
def test_a_large_block_is_as_many_small_ones(noisy_stream, decode, same_batch, size):
    data = noisy_stream(8, 4000)
    same_batch(decode(data)[0], decode(data, range(size, len(data), size))[0])


def test_components_are_looked_at_whoever_else_is_in_the_block(decode, start, vehicle):
    companion = Encoder(1, 158)
    imu = [e.encode("SCALED_IMU", time_boot_ms=10_001, xacc=7) for e in (vehicle, companion)]
    for block in (imu[0], imu[0] + imu[1]):
        batch, _ = decode(start + block, components={"SCALED_IMU": frozenset({158})})
        assert len(batch.rows.get("imu0", ())) == block.count(imu[1])


def test_an_instance_beyond_the_last_takes_no_row_of_another(decode, start, vehicle):
    n = MAX_INSTANCES["airspeed"]
    data = b"".join(vehicle.encode("AIRSPEED", id=k, airspeed=10.0 + k) for k in range(n + 2))
    batch, _ = decode(start + data)
    assert [batch.rows[f"airspeed{k}"]["cas_m_s"].tolist() for k in range(n)] == [[10], [11], [12]]
    assert batch.rejected["airspeed", Rejection.OUT_OF_RANGE] == 2


def test_a_source_that_is_not_data_is_refused():
    (rpm,) = [s for s in catalog.SOURCES if s.message == "EFI_STATUS"]
    fill = replace(rpm.fills[0], compute=lambda payload: payload["rpm"])
    for source in (
        replace(rpm, only=lambda payload: payload["rpm"] > 0),
        replace(rpm, fills=(fill,)),
    ):
        entries = {ALL.by_name["EFI_STATUS"].id: [Entry(0, 0, source, None, None)]}
        with pytest.raises(TypeError, match="must be data"):
            build_plan(ALL, DecoderOptions(), entries, 1, 3)


@kernel
def _ends(text, numbers):
    text, numbers = borrowed(text), borrowed(numbers)
    part = numbers[1:]
    return text[0] + part[len(part) - 1]


def test_borrowed_arrays_keep_their_content_and_their_owner():
    numbers = np.arange(10)
    text = b"abc"
    before = sys.getrefcount(numbers)
    assert [_ends(text, numbers) for _ in range(100)] == [ord("a") + 9] * 100
    assert sys.getrefcount(numbers) == before


def test_a_batch_of_nothing_is_like_any_other():
    batch = Decoder().feed(b"")
    assert isinstance(batch, Batch)
    assert (dict(batch.rows), batch.rejected, len(batch.words)) == ({}, Counter(), 0)
