"""Commands on whole files, run as a user runs them."""

import json

UNUSABLE = 2


def test_of_several_logs_all_are_processed_and_a_bad_one_shows_in_the_status(
    command, tmp_path, flight_log
):
    bad = tmp_path / "bad.tlog"
    bad.write_bytes(b"")
    out = tmp_path / "out"
    done = command("analyze", bad, flight_log, "--out", out)
    assert done.returncode == UNUSABLE
    assert (out / flight_log.stem / "summary.json").is_file()
    sentences = [line for line in done.stderr.splitlines() if str(bad) in line]
    assert len(sentences) == 1
    assert "Traceback" not in done.stderr


def test_the_summary_names_what_was_broken_and_the_status_says_so_if_asked(
    command, tmp_path, flight_log
):
    done = command("analyze", flight_log, "--out", tmp_path, "--exit-code")
    assert done.returncode == 1, done.stderr
    summary = json.loads((tmp_path / flight_log.stem / "summary.json").read_text())
    assert summary["schema"] == "mavsentry/summary/1"
    assert {f["sensor"] for f in summary["faults"]} == {"imu0.acc_x", "airspeed0"}
    assert "imu0.acc_x" in done.stdout
    assert str(tmp_path / flight_log.stem / "summary.json") in done.stdout
    assert command("analyze", flight_log, "--out", tmp_path).returncode == 0


def test_no_bar_and_no_colour_in_a_pipe(command, tmp_path, flight_log):
    done = command("analyze", flight_log, "--out", tmp_path)
    assert "\x1b" not in done.stdout + done.stderr
    assert "\r" not in done.stdout + done.stderr


def test_the_same_seed_feeds_the_same_bytes(command, tmp_path):
    files = [tmp_path / name for name in ("a.tlog", "b.tlog", "c.tlog")]
    for file, seed in zip(files, (3, 3, 4), strict=True):
        done = command("feed", "parked", "--to", file, "--seed", seed, "--truth", tmp_path)
        assert done.returncode == 0, done.stderr
    first, second, other = (file.read_bytes() for file in files)
    assert first == second
    assert first != other
    assert json.loads((tmp_path / "truth.json").read_text())["seed"] == 4


def test_a_log_can_be_the_input_of_run(command, flight_log):
    done = command("run", "--in", flight_log, "--json")
    assert done.returncode == 0, done.stderr
    changes = [json.loads(line) for line in done.stdout.splitlines()]
    faulty = {c["sensor"] for c in changes if c.get("state") == "faulty"}
    assert faulty == {"imu0.acc_x", "airspeed0"}
    assert changes[-1]["status"]["sent"] > 0


def test_bench_writes_what_it_measured(command, tmp_path):
    file = tmp_path / "bench.json"
    done = command("bench", "--only", "udp_roundtrip", "--seconds", 0.2, "--json", file)
    assert done.returncode == 0, done.stderr
    document = json.loads(file.read_text())
    assert set(document) == {"machine", "results", "missing"}
    (result,) = document["results"]
    assert result["name"] == "udp_roundtrip"
    assert 0 < result["median_us"] <= result["p99_us"]
    assert result["value"] is None
    assert result["peers"]["pymavlink"] > 0


def test_bench_refuses_a_name_it_does_not_know(command):
    done = command("bench", "--only", "speed_of_light")
    assert done.returncode == UNUSABLE
    assert "start_to_verdict_s" in done.stderr
