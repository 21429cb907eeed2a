"""``feed --streams``: what comes back over the link is answered while the flight goes on."""

from collections import Counter

import pytest

from links.mavlink import Encoder
from monitor.commands.common import Refused
from monitor.commands.feed import _converse, feed, fly

RAW_IMU = 27


class Link:
    """Asks for RAW_IMU at 25 Hz once it has heard enough; remembers the rest."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.asked = False

    def send(self, data: bytes) -> None:
        self.frames.append(data)

    def recv(self, timeout_s: float) -> list[tuple[bytes, int]]:
        if self.asked or len(self.frames) < 500:
            return []
        self.asked = True
        command = {"command": 511, "target_system": 1, "target_component": 1}
        ask = Encoder(1, 191).encode("COMMAND_LONG", **command, param1=RAW_IMU, param2=40_000)
        return [(ask, 0)]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    file = tmp_path_factory.mktemp("feed") / "short.toml"
    file.write_text(
        'title = "Half a minute aloft"\naircraft = "small-uav"\n'
        "[start]\nspeed_m_s = 20.0\nagl_m = 150.0\n"
        '[[leg]]\ndo = "level"\nduration_s = 40.0\n'
    )
    return str(file)


def test_more_is_sent_of_what_is_asked_for(scenario):
    link = Link()
    count = _converse(fly(scenario), link, None, 3.0)  # type: ignore[arg-type]
    numbers = [int.from_bytes(frame[7:10], "little") for frame in link.frames]
    assert count == len(numbers)
    at = numbers.index(77)  # COMMAND_ACK
    before, after = Counter(numbers[:at]), Counter(numbers[at:])
    beats = before[0], after[0]
    assert before[RAW_IMU] / beats[0] == pytest.approx(3, rel=0.2)
    assert after[RAW_IMU] / beats[1] == pytest.approx(25, rel=0.2)


def test_a_file_asks_for_nothing(scenario, tmp_path):
    with pytest.raises(Refused, match="--streams"):
        feed(scenario, to=str(tmp_path / "out.tlog"), streams=3.0)
