"""Examples of every command: what is typed, and what it does. A test parses each of them."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["EXAMPLES"]

EXAMPLES: Mapping[str, tuple[tuple[str, str], ...]] = {
    "": (
        ("mavsentry analyze flight.tlog", "What was faulty in a recorded flight."),
        ("mavsentry run --in udpin:0.0.0.0:14550", "Watch a vehicle that sends to this port."),
        ("mavsentry COMMAND --help", "Options and examples of one command."),
    ),
    "run": (
        (
            "mavsentry run --in udpin:0.0.0.0:14550 --record recordings",
            "Watch what arrives on UDP port 14550, answer there, keep a recording.",
        ),
        (
            "mavsentry run --in /dev/ttyAMA0:921600 --out udpout:192.168.1.20:14551",
            "Watch an autopilot on a serial port; publish to a ground station as well.",
        ),
        (
            "mavsentry run --config sentry.toml --web 127.0.0.1:8080",
            "Settings from a file; the live page in a browser on this computer.",
        ),
    ),
    "analyze": (
        (
            "mavsentry analyze flight.tlog",
            "Verdicts as a table; mavsentry-out/flight/ gets summary.json and report.html.",
        ),
        (
            "mavsentry analyze *.BIN --profile light-aircraft --out verdicts --exit-code",
            "Several flights of a 50 m/s aircraft; the status is 1 if a fault was found.",
        ),
    ),
    "fleet": (
        (
            "mavsentry fleet 'flights/**/*.tlog' --out fleet",
            "Every log below flights/, on all cores: fleet/index.html and fleet/dataset/.",
        ),
        (
            "mavsentry fleet archive --out fleet --reports found --aircraft 'tail-([0-9]+)'",
            "Reports of flights with findings; the aircraft is told by the file's path.",
        ),
    ),
    "feed": (
        (
            "mavsentry feed small-uav-pitot-blockage",
            "Fly it in real time to udpout:127.0.0.1:14550, where `mavsentry run` listens.",
        ),
        (
            "mavsentry feed small-uav-pitot-blockage --to flight.tlog",
            "The same flight as a log, at once.",
        ),
    ),
    "inject": (
        ("mavsentry inject --example > faults.toml", "A file of faults to start from."),
        (
            "mavsentry inject flight.tlog faults.toml --to broken.tlog",
            "The flight with these faults in it; analyze broken.tlog shows what is found.",
        ),
    ),
    "replay": (
        (
            "mavsentry replay flight.tlog",
            "Send it as it was received to udpout:127.0.0.1:14550, where `run` listens.",
        ),
        (
            "mavsentry replay flight.tlog --to udpout:192.168.1.20:14550 --speed 10",
            "To another computer, ten times as fast.",
        ),
    ),
    "reproduce": (
        ("mavsentry reproduce wang2020 --out papers", "One paper: papers/report.html."),
        ("mavsentry reproduce all --quick --out papers", "Small versions of all studies."),
    ),
    "selftest": (("mavsentry selftest", "Pass or fail, and how fast this machine is."),),
    "warmup": (("mavsentry warmup", "Once after installation: then `run` starts in seconds."),),
    "demo": (
        ("mavsentry demo", "About a minute of flight; demo-out/ gets what it writes."),
        ("mavsentry demo --web 127.0.0.1:8080", "Watch it on the live page meanwhile."),
    ),
    "completion": (
        (
            "mavsentry completion bash > ~/.local/share/bash-completion/completions/mavsentry",
            "For bash, from the next terminal on (make the folder first if it is not there).",
        ),
        ("mavsentry completion zsh > ~/.zfunc/_mavsentry", "For zsh, with ~/.zfunc in fpath."),
        (
            "mavsentry completion fish > ~/.config/fish/completions/mavsentry.fish",
            "For fish.",
        ),
    ),
    "learn": (
        (
            "mavsentry learn thresholds healthy/*.tlog --out ranger.toml",
            "Thresholds of an airframe; then `mavsentry run --config ranger.toml`.",
        ),
    ),
    "learn thresholds": (
        (
            "mavsentry learn thresholds healthy/*.tlog --out ranger.toml --airframe ranger",
            "Fit thresholds to these flights; then `mavsentry run --config ranger.toml`.",
        ),
    ),
    "learn engine": (
        (
            "mavsentry learn engine healthy/*.tlog --out engine.toml",
            "Fit the engine model; then `mavsentry run --config engine.toml`.",
        ),
    ),
    "learn airframe": (
        (
            "mavsentry learn airframe healthy/*.tlog --start aerosonde --out mine.toml",
            'Refine the Aerosonde\'s coefficients; then [wing] airframe = "mine.toml".',
        ),
    ),
    "bench": (
        ("mavsentry bench --only=pipeline --json=speed.json", "One part, and its numbers."),
        ("mavsentry bench", "All of them, several minutes."),
    ),
    "bench detect": (
        (
            "mavsentry bench detect flights/*.tlog --out docs",
            "The table of the smallest faults, with these healthy flights in it.",
        ),
        ("mavsentry bench detect --quick", "A rough table of small-uav."),
    ),
    "bench against": (
        (
            "mavsentry bench against flights/ --truth flights/expected.json --out against",
            "Each log of the folder, scored against what is known of it.",
        ),
    ),
    "config": (
        ("mavsentry config init --profile small-uav", "A commented sentry.toml to start from."),
        ("mavsentry config check sentry.toml", "What is wrong with a file."),
        (
            "mavsentry config show air.confirm_s --config sentry.toml",
            "One key: its meaning, its value, where that comes from.",
        ),
    ),
    "config init": (
        ("mavsentry config init", "Writes sentry.toml with the values of small-uav."),
        (
            "mavsentry config init ranger.toml --profile light-aircraft",
            "Another file, another class of airframe.",
        ),
    ),
    "config check": (
        ("mavsentry config check sentry.toml", "Every problem of the file, a line each."),
    ),
    "config show": (
        ("mavsentry config show --config sentry.toml", "All keys and where each comes from."),
        ("mavsentry config show air --profile transport", "The keys of one section."),
        (
            "mavsentry config show air.confirm_s --config sentry.toml",
            "One key: its meaning, limits, the value of each layer, which one wins.",
        ),
    ),
    "service": (
        ("mavsentry service install --dry-run", "What an installation would write."),
        ("sudo mavsentry service uninstall", "Take the service away; settings and state stay."),
    ),
    "service install": (
        (
            "sudo mavsentry service install --in /dev/ttyAMA0:921600",
            "Unit, settings and udev rules; compiled and started now and at each boot.",
        ),
        ("mavsentry service install --dry-run", "What it would write, without doing it."),
    ),
    "service uninstall": (
        ("sudo mavsentry service uninstall", "Take the service away; settings and state stay."),
    ),
    "key": (("mavsentry key new mavlink.key", "A new key for MAVLink 2 signing."),),
    "key new": (
        (
            "mavsentry key new mavlink.key",
            'A random passphrase; then [security] key_file = "mavlink.key".',
        ),
    ),
    "key check": (("mavsentry key check mavlink.key", "Says whether `run` can use it."),),
}
"""Command without the program's name -> its examples. What stands in quotes is typed so."""
