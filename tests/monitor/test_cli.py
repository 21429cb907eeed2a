"""What is typed, what is said, and the exit status."""

import subprocess
import sys
import tomllib

import pytest

from monitor.cli import invoke

UNUSABLE = 2


def refused(capsys, *arguments) -> str:
    """The one sentence on standard error with which a command line is refused."""
    assert invoke([str(a) for a in arguments]) == UNUSABLE
    said = capsys.readouterr()
    assert said.out == ""
    (sentence,) = said.err.splitlines()
    assert sentence.startswith("mavsentry: ")
    return sentence.removeprefix("mavsentry: ")


def test_help_names_every_command_and_loads_no_numerics():
    code = "import sys, monitor.cli as c; c.invoke(['--help']); print('LOADED', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    text, _, loaded = done.stdout.partition("LOADED")
    for command in ("run", "analyze", "feed", "replay", "config", "bench", "selftest", "warmup"):
        assert f"\n  {command} " in text
    assert not {"numba", "numpy", "pydantic", "pymavlink"} & set(loaded.split())


def test_without_arguments_the_help_is_shown(capsys):
    assert invoke([]) == 0
    assert "Usage: mavsentry" in capsys.readouterr().out


def test_the_version_is_the_installed_one(capsys):
    assert invoke(["--version"]) == 0
    assert capsys.readouterr().out.startswith("mavsentry 0.")


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["analyse"], "analyse"),
        (["run", "--inn", "udpin:127.0.0.1:1"], "--inn"),
        (["analyze"], "LOG"),
        (["run", "--in", "carrier-pigeon:7"], "carrier-pigeon"),
        (["run", "--in", "udpin:127.0.0.1:notaport"], "notaport"),
        (["analyze", "/nowhere/flight.tlog"], "/nowhere/flight.tlog"),
        (["replay", "/nowhere/flight.tlog"], "/nowhere/flight.tlog"),
        (["replay", "x.tlog", "--speed", "-3"], "-3"),
        (["analyze", "x.tlog", "--profile", "zeppelin"], "zeppelin"),
        (["config", "check", "/nowhere/sentry.toml"], "/nowhere/sentry.toml"),
        (["bench", "--only", "speed_of_light"], "speed_of_light"),
        (["feed", "no-such-scenario"], "no-such-scenario"),
        (["feed", "--aircraft", "zeppelin"], "zeppelin"),
        (["feed", "aerosonde-healthy", "--aircraft", "small-uav"], "circuit"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(capsys, arguments, names):
    assert names in refused(capsys, *arguments)


@pytest.mark.parametrize("what", [["aerosonde-engine-cut"], ["demo", "--aircraft", "c172p"]])
def test_six_degrees_of_freedom_without_jsbsim_are_refused_in_one_sentence(
    capsys, monkeypatch, what
):
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    said = refused(capsys, "feed", *what, "--to", "/nowhere/x.tlog")
    assert "pip install 'mavsentry[sim]'" in said
    assert "kinematic vehicle flies without it" in said


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("[publish]\nmask_rate = 2.0\n", "mask_rate_hz"),
        ("[publsh]\nmask_rate_hz = 2.0\n", "publish"),
        ('[publish]\nmask_rate_hz = "fast"\n', "publish.mask_rate_hz"),
        ("[publish]\nmask_rate_hz = -1\n", "publish.mask_rate_hz"),
        ("[links]\nsystem_id = 300\n", "links.system_id"),
        ('[links.sources]\naoa = ["AOA_SSX"]\n', "AOA_SSA"),
        ('profile = "zeppelin"\n', "zeppelin"),
        ("profile = \n", "TOML"),
    ],
)
def test_a_wrong_key_or_value_is_named_with_what_was_meant(capsys, tmp_path, text, names):
    file = tmp_path / "sentry.toml"
    file.write_text(text)
    assert names in refused(capsys, "config", "check", file)
    assert names in refused(capsys, "run", "--in", "udpin:127.0.0.1:0", "--config", file)


def test_config_init_writes_every_key_and_check_takes_it(capsys, tmp_path):
    file = tmp_path / "sentry.toml"
    assert invoke(["config", "init", str(file), "--profile", "transport"]) == 0
    assert invoke(["config", "check", str(file)]) == 0
    assert "transport" in capsys.readouterr().out
    uncommented = "\n".join(
        line.removeprefix("# ") if " = " in line and line.startswith("# ") else line
        for line in file.read_text().splitlines()
        if not line.startswith("# ") or _is_setting(line)
    )
    values = tomllib.loads(uncommented)
    assert values["publish"]["mask_rate_hz"] == 2.0
    assert values["links"]["sources"]["gps"] == ["GPS_RAW_INT", "GPS2_RAW"]


def _is_setting(line: str) -> bool:
    key, equals, _ = line.removeprefix("# ").partition(" = ")
    return bool(equals) and key.isidentifier() and key == key.lower()


def test_every_commented_key_set_to_its_own_value_is_a_good_file(capsys, tmp_path):
    file = tmp_path / "sentry.toml"
    assert invoke(["config", "init", str(file)]) == 0
    lines = [
        line.removeprefix("# ") if _is_setting(line) else line
        for line in file.read_text().splitlines()
    ]
    file.write_text("\n".join(lines))
    assert invoke(["config", "check", str(file)]) == 0


def test_config_init_does_not_overwrite_unless_told(capsys, tmp_path):
    file = tmp_path / "sentry.toml"
    file.write_text("profile = 'transport'\n")
    assert "--force" in refused(capsys, "config", "init", file)
    assert invoke(["config", "init", str(file), "--force"]) == 0
    assert "small-uav" in file.read_text()


def test_config_show_says_where_each_value_comes_from(capsys, tmp_path):
    file = tmp_path / "sentry.toml"
    file.write_text("[publish]\nmask_rate_hz = 4.0\n")
    assert invoke(["config", "show", "--config", str(file), "--profile", "transport"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (mask,) = [line for line in lines if line.startswith("publish.mask_rate_hz")]
    assert "4.0" in mask
    assert mask.endswith(str(file))
    (burst,) = [line for line in lines if line.startswith("publish.text_burst")]
    assert burst.endswith("default")
    assert any(line.endswith("profile transport") for line in lines)


def test_a_file_that_is_no_log_is_refused(capsys, tmp_path):
    for name, content in (("photo.tlog", b"\x89PNG" * 5000), ("empty.tlog", b"")):
        file = tmp_path / name
        file.write_bytes(content)
        assert name in refused(capsys, "analyze", file, "--out", tmp_path / "out")
        assert name in refused(capsys, "replay", file)
