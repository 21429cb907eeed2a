"""Vehicle time: wraps, reboots, two time bases, late and absurd stamps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from links.clock import CONFIRM, EPOCH_GAP_US, Stamp, VehicleClock
from links.mavlink import Encoder
from links.vocabulary import Rejection

UNIX = 1_700_000_000_000_000
MS_TURN_US = 2**32 * 1000
US_TURN = 2**32


def advance(clock, *stamps, unix=None):
    """Result of (kind, raw) stamps."""
    kind = np.array([k for k, _ in stamps], np.int64)
    raw = np.array([r for _, r in stamps], np.int64)
    return clock.advance(kind, raw, np.full(len(raw), 24), unix or {})


def boot(*raw_us):
    return [(Stamp.BOOT_MS, r) for r in raw_us]


def test_what_has_no_stamp_takes_the_last_one():
    clock = VehicleClock()
    result = advance(
        clock, (Stamp.NONE, 0), *boot(5_000_000), (Stamp.NONE, 0), *boot(5_100_000), (Stamp.NONE, 0)
    )
    assert result.t_us.tolist()[1:] == [5_000_000, 5_000_000, 5_100_000, 5_100_000]
    assert result.ok.tolist() == [False, True, True, True, True]
    assert result.reason == {0: Rejection.NO_TIME}


def test_a_message_100_ms_older_than_another_is_kept_as_it_is():
    clock = VehicleClock()
    result = advance(clock, *boot(5_000_000, 4_900_000, 5_020_000))
    assert result.t_us.tolist() == [5_000_000, 4_900_000, 5_020_000]
    assert result.ok.all()


def test_time_boot_ms_starts_again_after_49_days():
    clock = VehicleClock()
    before = MS_TURN_US - 2_000
    result = advance(clock, *boot(before, 1_000, MS_TURN_US - 1_000, 5_000))
    assert result.t_us.tolist() == [
        before,
        MS_TURN_US + 1_000,
        MS_TURN_US - 1_000,
        MS_TURN_US + 5_000,
    ]
    assert clock.reboots == 0
    # 64-bit stamps of the same vehicle do not start again
    assert advance(clock, (Stamp.USEC, MS_TURN_US + 9_000)).t_us.tolist() == [MS_TURN_US + 9_000]


def test_the_32_bit_microseconds_of_servo_outputs_follow_the_clock():
    clock = VehicleClock()
    t = 3 * US_TURN + 50_000  # more than three hours after boot
    result = advance(
        clock,
        *boot(t),
        (Stamp.USEC_32, 40_000),
        (Stamp.USEC_32, 70_000),
        (Stamp.USEC_32, US_TURN - 9),
    )
    assert result.t_us.tolist() == [t, t - 10_000, t + 20_000, 3 * US_TURN - 9]
    assert clock.newest_us == t


def test_servo_outputs_alone_give_no_time():
    result = advance(VehicleClock(), (Stamp.USEC_32, 40_000))
    assert result.reason == {0: Rejection.NO_TIME}


def test_after_a_reboot_time_goes_on_in_a_new_epoch():
    clock = VehicleClock()
    advance(clock, *boot(600_000_000))
    after = boot(*range(2_000_000, 2_000_000 + 100_000 * 30, 100_000))
    result = advance(clock, *after)
    lost = CONFIRM - 1
    assert set(result.reason.values()) == {Rejection.TIME_REVERSED}
    assert sorted(result.reason) == list(range(lost))
    t = result.t_us[lost:]
    assert t[0] == 600_000_000 + EPOCH_GAP_US
    assert (np.diff(t) == 100_000).all()
    assert clock.reboots == 1
    (began,) = clock.boots_since(0)
    assert 600_000_000 < began < t[0]
    assert clock.boots_since(1) == ()


def test_single_absurd_stamps_are_rejected_and_move_nothing():
    clock = VehicleClock()
    result = advance(clock, *boot(60_000_000, 1_000, 900_000_000, 60_020_000, 5_000, 60_040_000))
    assert result.reason == {
        1: Rejection.TIME_REVERSED,
        2: Rejection.OUT_OF_RANGE,
        4: Rejection.TIME_REVERSED,
    }
    assert result.t_us[[0, 3, 5]].tolist() == [60_000_000, 60_020_000, 60_040_000]
    assert (clock.reboots, clock.jumps) == (0, 0)


def test_an_absurd_first_stamp_is_left_behind():
    clock = VehicleClock()
    good = [1_000_000 + 20_000 * i for i in range(20)]
    result = advance(clock, *boot(4_000_000_000, *good))
    t = result.t_us[result.ok]
    assert (np.diff(t) > 0).all()
    assert np.diff(t)[-1] == 20_000


def test_a_short_gap_is_believed_at_once_and_a_long_one_when_confirmed():
    clock = VehicleClock()
    assert advance(clock, *boot(1_000_000, 50_000_000)).ok.all()
    later = [9_000_000_000 + 10_000 * i for i in range(CONFIRM + 2)]
    result = advance(clock, *boot(*later))
    assert result.t_us[result.ok].tolist() == later[CONFIRM - 1 :]
    assert clock.jumps == 1


def test_unix_stamps_are_translated_by_system_time():
    clock = VehicleClock()
    result = advance(
        clock,
        *boot(10_000_000),
        (Stamp.USEC, UNIX + 10_020_000),
        *boot(10_040_000),
        unix={0: UNIX + 10_000_000},
    )
    assert result.t_us.tolist() == [10_000_000, 10_020_000, 10_040_000]


def test_unix_stamps_without_system_time_are_paired_with_the_clock():
    clock = VehicleClock()
    result = advance(
        clock,
        (Stamp.USEC, UNIX),
        *boot(10_000_000),
        (Stamp.USEC, UNIX + 7),
        (Stamp.USEC, UNIX + 27),
    )
    assert result.reason == {0: Rejection.NO_TIME}
    assert result.t_us.tolist()[1:] == [10_000_000, 10_000_000, 10_000_020]


def test_a_unix_clock_that_is_set_does_not_move_vehicle_time():
    clock = VehicleClock()
    advance(clock, *boot(10_000_000), (Stamp.USEC, UNIX))
    result = advance(clock, *boot(10_100_000), (Stamp.USEC, UNIX + 10**12))
    assert result.t_us.tolist() == [10_100_000, 10_100_000]


def test_a_fix_has_its_own_time_until_it_freezes():
    clock = VehicleClock()
    fix = Stamp.FIX
    result = advance(
        clock, *boot(20_000_000), (fix, 19_800_000), *boot(20_100_000), (fix, 19_800_000), (fix, 0)
    )
    assert result.t_us.tolist() == [20_000_000, 19_800_000, 20_100_000, 20_100_000, 20_100_000]
    assert result.stamp_us.tolist() == [0, 19_800_000, 0, 19_800_000, 0]


def test_a_late_message_sets_the_time_of_nothing_but_itself():
    clock = VehicleClock()
    late = boot(20_000_000, 19_700_000)
    again = (Stamp.FIX, 19_800_000)
    result = advance(clock, again, *late, again, *late[1:], again, (Stamp.NONE, 0))
    # Were the fix sent again dated before the fix, it would pass for it, and the fix for the copy.
    assert result.t_us.tolist()[3:] == [19_800_000, 19_700_000, 20_000_000, 20_000_000]


def test_a_fix_in_unix_time_comes_onto_the_vehicle_clock():
    clock = VehicleClock()
    result = advance(
        clock,
        *boot(20_000_000),
        (Stamp.FIX, UNIX + 19_850_000),
        *boot(40_000_000),
        (Stamp.FIX, UNIX + 19_850_000),
        unix={0: UNIX + 20_000_000},
    )
    assert result.t_us.tolist() == [20_000_000, 19_850_000, 40_000_000, 40_000_000]
    assert result.stamp_us.tolist() == [0, 19_850_000, 0, 19_850_000]


def test_a_fix_keeps_its_epoch_after_a_reboot():
    clock = VehicleClock()
    advance(clock, *boot(600_000_000), *boot(*range(1_000_000, 3_000_000, 100_000)))
    newest = clock.newest_us
    result = advance(clock, (Stamp.FIX, 2_850_000))
    assert result.t_us.tolist() == [newest - 50_000]


KINDS = st.sampled_from([Stamp.NONE, Stamp.BOOT_MS, Stamp.USEC, Stamp.USEC_32, Stamp.FIX])
RAW = st.one_of(
    st.integers(0, 2**62),
    st.integers(0, 200_000_000),
    st.integers(UNIX, UNIX + 10_000_000),
    st.integers(MS_TURN_US - 10_000_000, MS_TURN_US),
)


@given(st.lists(st.tuples(KINDS, RAW), max_size=60), st.integers(0, 60))
def test_any_stamps_in_any_blocks_give_the_same_times(stamps, cut):
    whole, parts = VehicleClock(), VehicleClock()
    a = advance(whole, *stamps)
    b1, b2 = advance(parts, *stamps[:cut]), advance(parts, *stamps[cut:])
    assert a.t_us.tolist() == b1.t_us.tolist() + b2.t_us.tolist()
    assert a.stamp_us.tolist() == b1.stamp_us.tolist() + b2.stamp_us.tolist()
    assert a.ok.tolist() == b1.ok.tolist() + b2.ok.tolist()
    assert (whole.newest_us, whole.reboots) == (parts.newest_us, parts.reboots)


@given(st.lists(st.tuples(st.sampled_from([Stamp.BOOT_MS, Stamp.USEC]), RAW), max_size=80))
def test_the_newest_time_never_goes_back(stamps):
    clock = VehicleClock()
    newest = -1
    for stamp in stamps:
        advance(clock, stamp)
        if clock.newest_us is not None:
            assert clock.newest_us >= newest
            newest = clock.newest_us


def test_a_reboot_in_a_stream_is_counted_and_rows_go_on(decode, start, vehicle):
    def imu(t_ms):
        return vehicle.encode("SCALED_IMU", time_boot_ms=t_ms)

    data = start + b"".join(imu(10_000 + 20 * i) for i in range(50))
    data += b"".join(imu(300 + 20 * i) for i in range(50))
    batch, decoder = decode(data)
    t = batch.rows["imu0"]["t_us"]
    assert (np.diff(t) > 0).all()
    assert len(t) == 100 - (CONFIRM - 1)
    assert decoder.counters.reboots == 1
    assert batch.rejected["imu0", Rejection.TIME_REVERSED] == CONFIRM - 1


def test_stamps_of_other_components_are_not_the_clock(decode, start):
    companion = Encoder(1, 158)
    batch, decoder = decode(
        start + companion.encode("NAMED_VALUE_FLOAT", time_boot_ms=12_345, name="X", value=1.0)
    )
    assert decoder.clock.newest_us == 10_000_000
    assert batch.rows["named"]["t_us"].tolist() == [10_000_000]
