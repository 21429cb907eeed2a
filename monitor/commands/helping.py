"""What ``--help`` of every command looks like: usage, options in groups, examples at the end.

One mechanism for all: a command is registered on an :class:`App`, its options say their group by
typer's ``rich_help_panel``, and its examples stand in :mod:`monitor.commands.examples`. The page
docs/commands.md is made from the same rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from monitor.commands.examples import EXAMPLES

__all__ = ["App", "Command", "Group", "Row", "examples_of", "grouped", "rows_of"]

OPTIONS, ARGUMENTS, COMMANDS = "Options", "Arguments", "Commands"


class Row(NamedTuple):
    """One argument or option, as help shows it.

    Attributes
    ----------
    group
        Heading that it stands under.
    typed
        What is typed: ``--out DIR``, ``LOG...``.
    meaning
        What it does.
    facts
        Default, limits, whether it must be given; empty where there is nothing to say.
    """

    group: str
    typed: str
    meaning: str
    facts: str

    @property
    def text(self) -> str:
        """Meaning and facts in one."""
        return f"{self.meaning}  [{self.facts}]" if self.facts else self.meaning


def rows_of(command: Any, context: Any) -> Iterator[Row]:
    """Each argument and option that is shown, in the order of the command."""
    for param in command.get_params(context):
        if getattr(param, "hidden", False):
            continue
        argument = param.param_type_name == "argument"
        group = getattr(param, "rich_help_panel", None) or (ARGUMENTS if argument else OPTIONS)
        yield Row(group, _typed(param), param.help or "", ", ".join(_facts(param, context)))


def grouped(command: Any, context: Any) -> dict[str, list[Row]]:
    """Heading -> its rows: arguments first, then named groups, what has no group last."""
    groups: dict[str, list[Row]] = {ARGUMENTS: []}
    for row in rows_of(command, context):
        groups.setdefault(row.group, []).append(row)
    if OPTIONS in groups:
        groups[OPTIONS] = groups.pop(OPTIONS)
    return {heading: rows for heading, rows in groups.items() if rows}


def examples_of(context: Any) -> tuple[tuple[str, str], ...]:
    """Command lines and what each does, of the command that this context is of."""
    return EXAMPLES.get(" ".join(context.command_path.split()[1:]), ())


def _typed(param: Any) -> str:
    """What is typed for it: without brackets, but ``...`` where there may be several."""
    metavar = str(param.metavar or param.name.upper())
    if param.param_type_name == "argument":
        return metavar.strip("[]")
    names = ", ".join(sorted(param.opts, key=lambda name: name.startswith("--")))
    if param.is_flag:
        return f"{names} / {', '.join(param.secondary_opts)}" if param.secondary_opts else names
    return f"{names} {metavar}"


def _limit(param: Any, which: str) -> Any:
    """Its least or greatest value; older versions of typer keep it with the type."""
    return getattr(param, which, getattr(getattr(param, "type", None), which, None))


def _facts(param: Any, context: Any) -> Iterator[str]:
    if param.required:
        yield "required"
    default = param.default
    if isinstance(default, Enum):
        default = default.value
    if default not in (None, False, (), []) and not callable(default):
        if getattr(param, "is_flag", False) and param.secondary_opts:
            default = param.opts[0].lstrip("-")
        yield f"default: {default:g}" if isinstance(default, float) else f"default: {default}"
    least, most = _limit(param, "min"), _limit(param, "max")
    if least is not None and most is not None:
        yield f"{least:g} to {most:g}"
    elif least is not None:
        yield f"at least {least:g}"


def _usage(command: Any, context: Any) -> list[str]:
    """``[OPTIONS]``, then each argument, in brackets where it may be left out."""
    pieces = ["[OPTIONS]"]
    for param in command.get_params(context):
        if param.param_type_name == "argument":
            pieces.append(_typed(param) if param.required else f"[{_typed(param)}]")
    return pieces


def _write_options(command: Any, context: Any, formatter: Any) -> None:
    for heading, rows in grouped(command, context).items():
        with formatter.section(heading):
            formatter.write_dl([(row.typed, row.text) for row in rows], col_max=28)


def _write_examples(context: Any, formatter: Any) -> None:
    examples = examples_of(context)
    if not examples:
        return
    with formatter.section("Examples" if len(examples) > 1 else "Example"):
        for line, does in examples:
            # Not wrapped: a line that is copied must be one line.
            formatter.write(f"{'':{formatter.current_indent}}{line}\n")
            with formatter.indentation():
                formatter.write_text(does)


class Command(TyperCommand):
    """A command whose help has groups and examples."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """What stands behind the command's name in the usage."""
        return _usage(self, ctx)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments and options, in groups."""
        _write_options(self, ctx, formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Examples."""
        _write_examples(ctx, formatter)


class Group(TyperGroup):
    """A command with commands below it, under the headings that they name."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """What stands behind the command's name in the usage."""
        return [*_usage(self, ctx), "COMMAND" if not self.invoke_without_command else "[COMMAND]"]

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse what stands before the command; without one the help is what was asked for."""
        if not args and not self.invoke_without_command and not ctx.resilient_parsing:
            print(ctx.get_help())
            raise typer.Exit
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Commands first, then the options of the group itself."""
        self.format_commands(ctx, formatter)
        _write_options(self, ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Every command with its first sentence, under its heading."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.get_command(ctx, name)
            if command is None or command.hidden:
                continue
            heading = getattr(command, "rich_help_panel", None)
            heading = heading if isinstance(heading, str) else COMMANDS
            groups.setdefault(heading, []).append((name, command.get_short_help_str(200)))
        width = max((len(name) for rows in groups.values() for name, _ in rows), default=0)
        for heading, rows in groups.items():
            with formatter.section(heading):
                formatter.write_dl([(f"{name:<{width}}", short) for name, short in rows])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Examples."""
        _write_examples(ctx, formatter)


class App(typer.Typer):
    """Commands that all have this help."""

    def __init__(self, **options: Any) -> None:
        super().__init__(cls=Group, rich_markup_mode=None, add_completion=False, **options)

    def command(self, *args: Any, **options: Any) -> Callable[[Any], Any]:
        """Register a command, as typer does."""
        return super().command(*args, cls=Command, **options)
