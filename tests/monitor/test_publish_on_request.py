"""What others may ask of the publisher: other intervals, and a message now."""

from collections import Counter

from links.vocabulary import State
from monitor.publish import Publisher
from monitor.settings.publish import PublishSettings
from monitor.verdict import StepResult
from tests.monitor.test_publish import S, air_row, verdict


def full_row(t_s: float):
    return air_row(
        t_s, cas_m_s=20.0, tas_m_s=21.0, aoa_rad=0.05, ssa_rad=0.0, wind_ned_m_s=(3.0, 1.0, 0.0)
    )


def test_a_message_can_have_an_interval_of_its_own_and_give_it_back():
    publisher = Publisher(PublishSettings(mask_rate_hz=2, value_rate_hz=5))
    publisher.note(StepResult([verdict("airspeed0", State.OK)]))

    def rates(start_s: float) -> Counter[str]:
        names = Counter()
        for k in range(500):  # ten seconds, an estimate every 0.1 s as the watches make them
            t_us = round((start_s + k * 0.02) * S)
            if k % 5 == 0:
                publisher.note(StepResult([], {"air": full_row(t_us / S)}))
            for m in publisher.due(t_us, t_us, silent=False):
                names[m.fields.get("name", m.name)] += 1
        return names

    assert publisher.interval_us("WIND_COV") == 200_000
    usual = rates(0)
    assert (usual["WIND_COV"], usual["R_CAS"], usual["MON_AIR"]) == (50, 50, 20)
    assert publisher.set_interval("WIND_COV", 1_000_000)
    assert publisher.set_interval("AOA_SSA", -1)
    assert publisher.interval_us("WIND_COV") == 1_000_000
    assert publisher.interval_us("AOA_SSA") == -1
    changed = rates(10)
    assert (changed["WIND_COV"], changed["AOA_SSA"], changed["R_CAS"]) == (10, 0, 50)
    assert publisher.set_interval("NAMED_VALUE_FLOAT", 500_000)
    assert publisher.set_interval("WIND_COV", 0)
    changed = rates(20)
    assert (changed["WIND_COV"], changed["R_CAS"], changed["MON_AIR"]) == (50, 20, 20)
    assert changed["HEARTBEAT"] == 10


def test_a_stopped_message_still_tells_a_fault_at_once():
    publisher = Publisher(PublishSettings())
    publisher.set_interval("NAMED_VALUE_FLOAT", -1)
    publisher.note(StepResult([verdict("airspeed0", State.OK)]))
    publisher.due(0, 0, silent=False)
    publisher.note(StepResult([verdict("airspeed0", State.FAULTY)]))
    names = {m.fields.get("name") for m in publisher.due(S, S, silent=False)}
    assert "FLT_AIR" in names


def test_what_may_not_be_changed_is_refused():
    publisher = Publisher(PublishSettings(values_standard=False))
    for name, interval_us in (
        ("HEARTBEAT", 100_000),
        ("HEARTBEAT", -1),
        ("STATUSTEXT", 100_000),
        ("WIND_COV", 100_000),  # switched off by the configuration
        ("ATTITUDE", 100_000),
        ("NAMED_VALUE_FLOAT", 19_999),
    ):
        assert not publisher.set_interval(name, interval_us), name
    assert publisher.interval_us("ATTITUDE") == publisher.interval_us("STATUSTEXT") == 0
    assert publisher.interval_us("HEARTBEAT") == 1_000_000


def test_the_newest_of_each_message_on_request():
    publisher = Publisher(PublishSettings())
    assert [m.fields["system_status"] for m in publisher.newest("HEARTBEAT")] == [6]
    assert publisher.newest("NAMED_VALUE_FLOAT") == publisher.newest("STATUSTEXT") == []
    publisher.note(StepResult([verdict("airspeed0", State.OK)], {"air": full_row(1.0)}))
    sent = publisher.due(S, S, silent=False)
    for name in ("NAMED_VALUE_FLOAT", "WIND_COV", "STATUSTEXT", "AIRSPEED", "HEARTBEAT"):
        told = publisher.newest(name)
        assert told
        assert {str(m.fields) for m in sent if m.name == name} <= {str(m.fields) for m in told}
    assert publisher.newest("ATTITUDE") == []
    publisher.due(9 * S, 9 * S, silent=False)
    assert publisher.newest("WIND_COV") == []  # too old to be told
