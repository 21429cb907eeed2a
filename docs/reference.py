"""Writes docs/commands.md and docs/configuration.md from the program's own definitions.

``python docs/reference.py`` writes both; ``--check`` only says which is out of date.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

DOCS: Final = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))

COMMANDS_HEAD: Final = """\
# Commands

Every command with its options and examples, made from the program itself: `mavsentry COMMAND
--help` shows the same. The settings that `--profile` and `--config` choose are in
[configuration](configuration.md); how a link is written, in [links](links.md).

| status | means |
|---|---|
| 0 | done; `run`: told to stop (Ctrl-C, SIGTERM) |
| 1 | with `--exit-code` a fault was found; `demo` or `selftest` failed |
| 2 | input, arguments or configuration cannot be used: standard error says why |
| 130 | ended by Ctrl-C |

Of several logs all are processed; the status is 2 if one of them was unusable.

The shell completes commands, options, profiles, scenarios, logs, links and settings' keys with
the script that [`completion`](#mavsentry-completion) prints.
"""

CONFIGURATION_HEAD: Final = """\
# Configuration

Every key of the configuration, made from the settings' own definitions. A file holds only what
differs; `mavsentry config init` writes one with all keys commented out, and `mavsentry config
check FILE` says all that is wrong with a file.

```toml
# sentry.toml
profile = "small-uav"

[links]
inputs = ["udpin:0.0.0.0:14550"]

[air]
confirm_s = 2.0
```

Where a value comes from, the last one wins: the default, then the profile (`small-uav`,
`light-aircraft`, `transport`), then the file, then what was set [over MAVLink](parameters.md) and
is kept. `mavsentry config show` says for each key which one it was, of a single key what each of
them says:

```console
$ mavsentry config show air.confirm_s --config sentry.toml
air.confirm_s = 2.0
...
  in flight: the MAVLink parameter AIR_CONFIRM
  default      1.0
  sentry.toml  2.0  <- in force
```

`run` reads the file again on SIGHUP; what can be taken in flight and what waits for a restart is
in [parameters](parameters.md#reading-the-configuration-again). Numbers of units stand in the
key's name: `_s` seconds, `_m_s` metres a second, `_rad` radians, `_hz` times a second.

Below, a key is followed by its default, and in brackets by what is taken and by profiles with
another value.
"""


def escaped(text: str) -> str:
    """Words as Markdown, with what is typed as code; angles and stars are themselves."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        part if part.startswith("`") else re.sub(r"([<>*\[\]_|])", r"\\\1", part) for part in parts
    )


def commands() -> str:
    """The page of the commands."""
    import typer

    from monitor.cli import app

    root: Any = typer.main.get_command(app)
    context = root.context_class(root, info_name="mavsentry")
    return COMMANDS_HEAD + "".join(_command(root, context))


def _command(command: Any, context: Any) -> Iterator[str]:
    from monitor.commands.helping import examples_of, grouped

    names = context.command_path.split()
    below = getattr(command, "commands", {})
    if len(names) > 1:
        yield f"\n{'#' * len(names)} {context.command_path}\n\n"
        for paragraph in (command.help or "").split("\n\n"):
            yield f"{escaped(' '.join(paragraph.split()))}\n\n"
        usage = " ".join(command.collect_usage_pieces(context))
        yield f"```text\n{context.command_path} {usage}\n```\n"
        for heading, rows in grouped(command, context).items():
            own = [row for row in rows if not row.typed.endswith("--help")]
            if own:
                yield f"\n*{heading}*\n\n"
            for row in own:
                facts = f" *({row.facts})*" if row.facts else ""
                yield f"- `{row.typed}`: {escaped(row.meaning)}{facts}\n"
        yield "\n*Examples*\n\n"
        for line, does in examples_of(context):
            yield f"- `{line}`<br>{escaped(does)}\n"
    for name, one in below.items():
        yield from _command(one, one.context_class(one, info_name=name, parent=context))


def configuration() -> str:
    """The page of the settings."""
    return CONFIGURATION_HEAD + "".join(_sections())


def _sections() -> Iterator[str]:
    from monitor.component.tunables import TUNABLES
    from monitor.settings.explained import keys_of, profiles_of
    from monitor.toml import toml_value

    parameters = {tunable.key: tunable.name for tunable in TUNABLES}
    section = None
    for key, about in keys_of():
        if key.section != section:
            section = key.section
            yield f"\n## \\[{section}\\]\n\n{escaped(about)}\n\n" if section else "\n## Top\n\n"
        facts = [key.limits] if key.limits else []
        if key.name != "profile":
            facts += [f"{name} `{toml_value(v)}`" for name, v in profiles_of(key).items()]
        if key.name in parameters:
            facts.append(f"in flight `{parameters[key.name]}`")
        shown = f" ({'; '.join(facts)})" if facts else ""
        default = _plain(key.default)
        value = f" = `{toml_value(default)}`" if default is not None else ""
        name = key.name.rpartition(".")[2]
        yield f"- **`{name}`**{value}{shown}: {escaped(key.meaning)}\n"


def _plain(value: Any) -> Any:
    """A default as TOML can write it; None where there is none."""
    return None if type(value).__name__ == "PydanticUndefinedType" else value


PAGES: Final[dict[str, Callable[[], str]]] = {
    "commands.md": commands,
    "configuration.md": configuration,
}


def main(check: bool) -> int:
    """Write both pages, or say which is out of date; the status."""
    stale = []
    for name, make in PAGES.items():
        file, text = DOCS / name, make()
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            stale.append(name)
            if not check:
                file.write_text(text, encoding="utf-8")
    for name in stale:
        print(f"docs/{name} {'is out of date: python docs/reference.py' if check else 'written'}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
