"""``mavsentry completion``: the script by which a shell completes what is typed.

The script asks the program itself (:mod:`monitor.commands.completing` answers), so scenarios,
profiles, logs and settings' keys are those of now.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final

import typer

__all__ = ["ASKED", "completion", "prepare"]

PROGRAM: Final = "mavsentry"
ASKED: Final = "_MAVSENTRY_COMPLETE"
"""Variable by which a shell's script asks for words."""

BASH: Final = """\
# bash takes a colon for the end of a word, and we do not: the words are made of the line anew, and
# what stands before the last colon is taken off the answers. A folder gets no space behind it.
_mavsentry() {
    local IFS=$' \\t\\n' line=${COMP_LINE:0:COMP_POINT} word colon
    set -o noglob; local words=($line); set +o noglob
    [[ $line == *[[:space:]] ]] && words+=("")
    word=${words[${#words[@]}-1]}
    [[ $COMP_WORDBREAKS == *:* ]] && colon=${word%"${word##*:}"}
    IFS=$'\\n'
    COMPREPLY=($(COMP_WORDS=$line COMP_CWORD=$((${#words[@]} - 1)) \\
        _MAVSENTRY_COMPLETE=complete_bash "$1" 2>/dev/null))
    COMPREPLY=("${COMPREPLY[@]#"$colon"}")
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == */ ]] && compopt -o nospace
    return 0
}
complete -o bashdefault -o default -F _mavsentry mavsentry
"""


class Shell(StrEnum):
    """Shells that are served."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


def prepare() -> None:
    """Make the shells' questions known to typer; called where one is asked."""
    from typer.completion import completion_init  # type: ignore[attr-defined,unused-ignore]

    completion_init()


def completion(
    shell: Annotated[
        Shell, typer.Argument(metavar="bash|zsh|fish", help="Whose script is printed.")
    ],
) -> None:
    """Print the script that completes commands, options, logs and keys in a shell.

    Save it where the shell looks for such scripts, as below; a new terminal has it.
    """
    if shell is Shell.BASH:
        print(BASH, end="")
        return
    from typer.completion import (  # type: ignore[attr-defined,unused-ignore]
        get_completion_script,
    )

    print(get_completion_script(prog_name=PROGRAM, complete_var=ASKED, shell=shell.value))
