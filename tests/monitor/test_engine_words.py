"""What leaves the monitor about engines: masks, events, reconstructed speeds, texts, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from links.vocabulary import Kind, State
from monitor import summary
from monitor.announce import wording
from monitor.columns import flat
from monitor.publish import Publisher
from monitor.settings import SettingsError, load
from monitor.settings.publish import PublishSettings
from monitor.verdict import ENGINE_ESTIMATE, StepResult, Verdict

S = 1_000_000
STOPPED = Verdict(12 * S, "engine0", State.STOPPED, onset_t_us=8 * S, evidence="it glides")
DEAD = Verdict(5 * S, "spool1", State.FAULTY, kind=Kind.DROPOUT, onset_t_us=4 * S)


def sent(*verdicts: Verdict, speeds: tuple[float, ...] = ()) -> dict[str, float]:
    """NAMED_VALUE_FLOAT name -> value of one round, and the heartbeat's status."""
    publisher = Publisher(PublishSettings())
    result = StepResult(list(verdicts))
    if speeds:
        rows = np.zeros(1, ENGINE_ESTIMATE)
        rows["t_us"], rows["speed_rpm"] = 12 * S, (*speeds, *(np.nan,) * (4 - len(speeds)))
        result.estimates["engine"] = rows
    publisher.note(result)
    out = {}
    for m in publisher.due(0, 12 * S, silent=False):
        if m.name == "NAMED_VALUE_FLOAT":
            out[m.fields["name"]] = m.fields["value"]
        elif m.name == "HEARTBEAT":
            out["status"] = m.fields["system_status"]
    return out


def test_a_dead_channel_is_a_bit_of_flt_eng() -> None:
    ok = Verdict(1 * S, "spool0", State.OK)
    values = sent(ok, DEAD, Verdict(1 * S, "engine0", State.OK))
    assert (values["FLT_ENG"], values["MON_ENG"], values["EVT_ENG"]) == (2.0, 3.0, 0.0)


def test_a_stopped_engine_is_an_event_and_no_fault_and_critical() -> None:
    values = sent(Verdict(1 * S, "spool0", State.OK), STOPPED)
    assert (values["FLT_ENG"], values["EVT_ENG"], values["status"]) == (0.0, 1.0, 5)


def test_no_engine_no_event_mask() -> None:
    assert "EVT_ENG" not in sent(DEAD)


def test_reconstructed_speeds_go_out_by_shaft() -> None:
    values = sent(speeds=(5000.0, 5300.5))
    assert {k: v for k, v in values.items() if k.startswith("R_")} == {
        "R_N1": 5000.0,
        "R_N2": 5300.5,
    }


def test_the_text_of_a_stopped_engine() -> None:
    assert wording(STOPPED, 20 * S) == "engine0 STOPPED: no power since 12 s"


def test_summary_keeps_events_and_faults_apart() -> None:
    again = Verdict(30 * S, "engine0", State.OK)
    verdicts = [DEAD, STOPPED, again]
    assert [f["sensor"] for f in summary.faults(verdicts, 0)] == ["spool1"]
    (event,) = summary.events(verdicts, 0)
    assert (event["what"], event["state"]) == ("engine0", "stopped")
    assert (event["onset_s"], event["detected_s"], event["ended_s"]) == (8.0, 12.0, 30.0)
    assert event["evidence"] == "it glides"


def test_the_estimate_becomes_a_column_per_shaft() -> None:
    rows = np.zeros(3, ENGINE_ESTIMATE)
    rows["speed_rpm"][:, 1] = 5300.0
    columns = flat(rows)
    assert columns["speed_2_rpm"].tolist() == [5300.0] * 3
    assert {"speed_1_rpm", "speed_4_std_rpm", "throttle", "climb_power_m_s"} <= set(columns)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[engine.channels.n1]\nrange_rpm = 9.0\nnoise_rpm = 1.0", "n1 is no engine-speed channel"),
        ("[engine.channels.spool0]\nnoise_rpm = 1.0", "range_rpm"),
        ('[engine]\nmodel = "single-shaft"', "run mavsentry learn engine"),
        ('[engine]\nmodel = "two-spool"\ntick_s = 0.055', "not a multiple"),
        ("[engine]\nthrottle_channels = [17]", "servo outputs 1 to 16"),
        ('[links.spools.spool0]\nsource = "RPM.rpm9"', "no engine speed is called 'RPM.rpm9'"),
        ('[links.spools.n1]\nsource = "RPM.rpm1"', "n1 is no engine-speed channel"),
    ],
)
def test_a_configuration_that_cannot_work_is_refused(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "sentry.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError, match=said):
        load(file=file)
