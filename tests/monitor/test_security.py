"""The signing key's ways in, kept signing times, and the gate that is made of them."""

from __future__ import annotations

import json
import os
import stat
import time
from pathlib import Path

import pytest

from links.mavlink import Encoder
from links.mavlink.signing import Signer, SigningClock, SigningKey, Verifier, ticks_of_unix_us
from links.vocabulary import Rejection
from monitor.cli import invoke
from monitor.commands.replay import _frames as replayed
from monitor.security import VARIABLE, KeyFileError, find_key, new_key_file, open_gate, read_key
from monitor.security.timestamps import AHEAD_S, SigningTimes, TimestampKeeper, TimestampStore
from monitor.settings import Settings, SettingsError, load

PASSPHRASE = "correct horse battery staple"
KEY = SigningKey.of_passphrase(PASSPHRASE)
RAW = bytes(range(200, 232))


def key_file(folder: Path, content: bytes = PASSPHRASE.encode(), mode: int = 0o600) -> Path:
    file = folder / "key"
    file.write_bytes(content)
    file.chmod(mode)
    return file


def settings(**security: object) -> Settings:
    return Settings.model_validate({"security": security})


def host_ticks() -> int:
    return ticks_of_unix_us(time.time_ns() // 1000)


# ------------------------------------------------------------------ the key


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (PASSPHRASE.encode(), KEY),
        (PASSPHRASE.encode() + b"\n", KEY),
        (PASSPHRASE.encode() + b"\r\n", KEY),
        (RAW.hex().encode() + b"\n", SigningKey(RAW)),
        (RAW.hex().upper().encode(), SigningKey(RAW)),
        (RAW, SigningKey(RAW)),
        (b"x" * 32, SigningKey.of_passphrase("x" * 32)),  # text, so a passphrase
        ("pässwörter".encode(), SigningKey.of_passphrase("pässwörter")),
    ],
)
def test_a_key_is_a_passphrase_or_hexadecimal_digits_or_bytes(
    tmp_path: Path, content: bytes, key: SigningKey
) -> None:
    assert read_key(key_file(tmp_path, content)) == key


@pytest.mark.parametrize("content", [b"", b"\n", b"00" * 32, bytes(32), RAW[:31], b"x" * 5000])
def test_what_holds_no_key_is_told_without_showing_it(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(KeyFileError) as error:
        read_key(key_file(tmp_path, content))
    assert str(error.value).count("\n") == 0
    assert content.strip() == b"" or repr(content)[2:-1] not in str(error.value)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o666, 0o700 | 0o010])
def test_a_key_file_that_is_open_to_others_is_refused(tmp_path: Path, mode: int) -> None:
    file = key_file(tmp_path, mode=mode)
    with pytest.raises(KeyFileError, match=f"chmod 600 {file}"):
        read_key(file)


def test_a_key_file_of_another_user_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, us = key_file(tmp_path), os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: us + 1)
    with pytest.raises(KeyFileError, match="belongs to another user"):
        read_key(file)


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path, said in ((tmp_path / "pipe", "not a file"), (tmp_path / "no", "mavsentry key new")):
        with pytest.raises(KeyFileError, match=said):
            read_key(path)
    with pytest.raises(KeyFileError):
        read_key(tmp_path)


def test_the_environment_comes_first_and_is_not_handed_on(tmp_path: Path) -> None:
    environ = {VARIABLE: "from outside", "HOME": "/home/x"}
    file = str(key_file(tmp_path))
    assert find_key(file, environ) == SigningKey.of_passphrase("from outside")
    assert environ == {"HOME": "/home/x"}
    assert find_key(file, environ) == KEY
    assert find_key("", environ) is None


def test_a_credential_of_systemd_is_taken_as_it_gives_it(tmp_path: Path) -> None:
    """They may belong to root and be open to a group that is only the service's access list."""
    (tmp_path / "mavlink-key").write_text(PASSPHRASE)
    (tmp_path / "mavlink-key").chmod(0o440)
    assert find_key("", {"CREDENTIALS_DIRECTORY": str(tmp_path)}) == KEY
    assert find_key("", {"CREDENTIALS_DIRECTORY": str(tmp_path / "other")}) is None


def test_a_new_key_is_ours_alone_random_and_never_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = os.umask(0)
    try:
        assert invoke(["key", "new", str(tmp_path / "one")]) == 0
    finally:
        os.umask(old)
    text = (tmp_path / "one").read_text().strip()
    assert len(text) == 35
    assert text not in capsys.readouterr().out
    assert stat.S_IMODE((tmp_path / "one").stat().st_mode) == 0o600
    assert invoke(["key", "check", str(tmp_path / "one")]) == 0
    assert invoke(["key", "new", str(tmp_path / "one")]) == 2
    assert "is there already" in capsys.readouterr().err
    new_key_file(tmp_path / "two")
    assert (tmp_path / "two").read_text().strip() != text


def test_no_command_shows_a_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = key_file(tmp_path)
    config = tmp_path / "sentry.toml"
    config.write_text(f'[security]\nkey_file = "{file}"\n')
    monkeypatch.setenv(VARIABLE, PASSPHRASE)
    assert invoke(["config", "show", "--config", str(config)]) == 0
    assert invoke(["config", "check", str(config)]) == 0
    shown = capsys.readouterr()
    assert str(file) in shown.out
    assert PASSPHRASE not in shown.out + shown.err
    assert "--key" not in " ".join(_options("run"))  # nor takes one where every user could read it


def _options(command: str) -> list[str]:
    import typer.main

    from monitor.cli import app

    root = typer.main.get_command(app)
    return [name for p in root.commands[command].params for name in p.opts]  # type: ignore[attr-defined]


def test_a_wrong_pattern_is_told_when_the_configuration_is_read(tmp_path: Path) -> None:
    file = tmp_path / "sentry.toml"
    file.write_text('[security]\nallow = ["1:*", "gcs"]\n')
    with pytest.raises(SettingsError, match=r"security: 'gcs' is no SYSTEM:COMPONENT"):
        load(None, file)


# ------------------------------------------------------------------ signing times


def test_times_come_back_as_they_were_kept(tmp_path: Path) -> None:
    store = TimestampStore(tmp_path / "made" / "signing.json")
    assert store.load() == SigningTimes()
    times = SigningTimes(37_000_000_000_000, {(1, 1, 0): 36_999_999_999_999, (255, 190, 7): 5})
    store.save(times)
    assert store.load() == times
    assert stat.S_IMODE(store.path.stat().st_mode) == 0o600
    assert [p.name for p in store.path.parent.iterdir()] == ["signing.json"]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b"\xff\xfe",
        b'{"format": 2, "time": 1, "streams": []}',
        b'{"format": 1, "time": -1, "streams": []}',
        b'{"format": 1, "time": 1e9, "streams": []}',
        b'{"format": 1, "time": 281474976710656, "streams": []}',
        b'{"format": 1, "time": true, "streams": []}',
        b'{"format": 1, "time": 1, "streams": [[1, 1, 256, 5]]}',
        b'{"format": 1, "time": 1, "streams": [[1, 1, 5]]}',
        b'{"format": 1, "time": 1, "streams": 3}',
        b"[" * 100_000,
    ],
)
def test_a_damaged_file_of_times_is_told_and_not_believed(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "signing-191.json").write_bytes(content)
    with pytest.raises(ValueError, match="is damaged"):
        TimestampStore(tmp_path / "signing-191.json").load()
    with open_gate(settings(key_file=str(key_file(tmp_path))), ["a"], {}, tmp_path) as gate:
        assert "is damaged" in gate.notes[0]


def test_a_writing_that_breaks_off_leaves_the_times_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = TimestampStore(tmp_path / "signing.json")
    store.save(SigningTimes(5))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        store.save(SigningTimes(6))
    assert store.load() == SigningTimes(5)


def last_time(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


def test_no_time_is_used_twice_however_often_the_program_dies(tmp_path: Path) -> None:
    """A program that is killed never closes its keeper; a clock that was set back hides nothing."""
    frame, used, host_us = Encoder(1, 191).encode("HEARTBEAT"), [], time.time_ns() // 1000
    began = host_ticks()
    for life in range(20):
        store = TimestampStore(tmp_path / "signing.json")
        clock = SigningClock(store.load().time, lambda life=life: host_us - life * 10_000_000)
        TimestampKeeper(store, clock, Verifier(KEY, clock))
        signer = Signer(KEY, clock, 0)
        used += [last_time(signer.sign(frame)) for _ in range(50)]
    assert used == sorted(set(used))
    # and yet 20 deaths in a row do not run ahead by 20 reserves: others refuse who is a minute off
    assert used[-1] - began < (AHEAD_S + 30) * 100_000


def test_the_keeper_never_waits_for_a_slow_disk(tmp_path: Path) -> None:
    class Slow(TimestampStore):
        slow = False

        def save(self, times: SigningTimes) -> None:
            if self.slow:
                time.sleep(0.3)
            super().save(times)

    store, clock = Slow(tmp_path / "signing.json"), SigningClock()
    keeper = TimestampKeeper(store, clock, Verifier(KEY, clock))
    store.slow = True
    began = time.perf_counter()
    for now_us in range(0, 600_000_000, 1_000_000):
        keeper.tend(now_us)
    assert time.perf_counter() - began < 0.25
    keeper.close(2.0)
    assert store.load().time > host_ticks()


def test_a_disk_that_cannot_be_written_is_told_and_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file where the folder should be")
    with open_gate(
        settings(key_file=str(key_file(tmp_path))), ["a"], {}, tmp_path / "state"
    ) as gate:
        assert "cannot" in gate.notes[-1]
        assert "signing-191.json" in gate.notes[-1]
        assert gate.sign(Encoder(1, 191).encode("HEARTBEAT"), 0)[2] == 1


# ------------------------------------------------------------------ the gate


def test_without_a_key_nothing_is_signed_and_all_let_in(tmp_path: Path) -> None:
    frame = Encoder(1, 1).encode("HEARTBEAT")
    with open_gate(settings(), ["a", "b"], {}, tmp_path) as gate:
        gate.tend(0)
        assert not gate.signs
        assert gate.notes == ()
        assert gate.sign(frame, 1) is frame
        assert gate.reception.take([(0, frame, 0, None)]).data == frame
    assert not list(tmp_path.iterdir())


def test_with_a_key_two_gates_talk_and_a_third_without_it_is_not_heard(tmp_path: Path) -> None:
    here = settings(key_file=str(key_file(tmp_path)))
    with (
        open_gate(here, ["a", "b"], {}, tmp_path / "one") as one,
        open_gate(here, ["a"], {}, tmp_path / "two") as two,
        open_gate(settings(), ["a"], {VARIABLE: "another"}, tmp_path / "three") as third,
    ):
        frame = Encoder(1, 191).encode("HEARTBEAT")
        assert two.reception.take([(0, one.sign(frame, 1), 0, None)]).data
        stranger = two.reception.take([(0, third.sign(frame, 0), 0, None)])
        assert stranger.rejected == {("frame", Rejection.BAD_SIGNATURE): 1}
        assert two.reception.take([(0, frame, 0, None)]).rejected == {
            ("frame", Rejection.UNSIGNED): 1
        }


def test_a_packet_heard_before_a_restart_is_not_believed_after_it(tmp_path: Path) -> None:
    here = settings(key_file=str(key_file(tmp_path)))
    with open_gate(here, ["a"], {}, tmp_path / "one") as sender:
        frame = sender.sign(Encoder(1, 1).encode("HEARTBEAT"), 0)
        for verdict in (False, True):
            with open_gate(here, ["a"], {}, tmp_path / "two") as gate:
                got = gate.reception.take([(0, frame, 0, None)])
                assert (got.rejected == {("frame", Rejection.REPLAYED): 1}) is verdict
    kept = json.loads((tmp_path / "two" / "signing-191.json").read_text())
    assert kept["streams"] == [[1, 1, 0, last_time(frame)]]


def test_signing_can_be_off_while_checking_is_on(tmp_path: Path) -> None:
    here = settings(key_file=str(key_file(tmp_path)), sign=False, unsigned_links=["b"])
    frame = Encoder(1, 1).encode("HEARTBEAT")
    with open_gate(here, ["a", "b"], {}, tmp_path) as gate:
        assert gate.sign(frame, 0) is frame
        assert not gate.reception.take([(0, frame, 0, None)]).data
        assert gate.reception.take([(1, frame, 0, None)]).data
    with pytest.raises(ValueError, match=r"unsigned_links names x, which is none of the links"):
        open_gate(settings(unsigned_links=["x"]), ["a"], {}, tmp_path)


# ------------------------------------------------------------------ keys of others


def test_a_key_in_a_log_is_not_sent_out_again(tmp_path: Path) -> None:
    vehicle, log = Encoder(1, 1), tmp_path / "x.tlog"
    frames = [
        vehicle.encode("HEARTBEAT", autopilot=3),
        vehicle.encode("SETUP_SIGNING", secret_key=RAW),
        vehicle.encode("ATTITUDE", time_boot_ms=5),
    ]
    log.write_bytes(b"".join((k + 1).to_bytes(8, "big") + f for k, f in enumerate(frames)))
    assert [frame for _, frame, _ in replayed(log)] == [frames[0], frames[2]]
