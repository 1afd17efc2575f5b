"""Completion of verbs, options and their values in a shell: a script, made from the parser."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

SHELLS = ("bash", "zsh", "fish")

BASH = """\
_rsicalib() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} verb= words=
    local k
    for ((k = 1; k < COMP_CWORD; k++)); do
        case ${{COMP_WORDS[k]}} in -*) ;; *) verb=${{COMP_WORDS[k]}}; break ;; esac
    done
    case $verb:$before in
{values}
    esac
    if [[ -z $words ]]; then
        case $verb in
        '') words='{verbs}' ;;
{options}
        esac
        [[ -n $verb && $word != -* ]] && words=
    fi
    COMPREPLY=()
    [[ -n $words ]] && COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o bashdefault -o default -F _rsicalib rsicalib
"""

ZSH = """\
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit; }
autoload -U +X bashcompinit && bashcompinit
"""
"""The script for bash works in zsh behind this, also where nothing has set completion up."""


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Write the script that a shell is to read.

    Parameters
    ----------
    parser : ArgumentParser
        With one level of verbs.
    shell : {"bash", "zsh", "fish"}
        For whom.

    Returns
    -------
    str
        Text for `source`; file names are completed where nothing else is known.
    """
    verbs = verbs_of(parser)
    if shell == "fish":
        return "".join(f"{line}\n" for line in _fish(verbs))
    bash = BASH.format(
        verbs=" ".join(verbs),
        values="\n".join(_values(verbs)) or "    *) ;;",
        options="\n".join(
            f"        {name}) words='{' '.join(_options(sub))}' ;;"
            for name, (sub, _) in verbs.items()
        ),
    )
    return f"{ZSH}{bash}" if shell == "zsh" else bash


def verbs_of(
    parser: argparse.ArgumentParser,
) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    """Parser and help of each verb."""
    found: dict[str, tuple[argparse.ArgumentParser, str]] = {}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            words = {a.dest: a.help or "" for a in action._choices_actions}
            found |= {name: (sub, words.get(name, "")) for name, sub in action.choices.items()}
    return found


def _options(parser: argparse.ArgumentParser) -> list[str]:
    return [text for action in parser._actions for text in action.option_strings]


def _values(verbs: dict[str, tuple[argparse.ArgumentParser, str]]) -> Iterator[str]:
    """Cases of options and arguments whose values are known."""
    for name, (sub, _) in verbs.items():
        for action in sub._actions:
            if not action.choices:
                continue
            words = " ".join(map(str, action.choices))
            cases = [f"{name}:{text}" for text in action.option_strings] or [f"{name}:{name}"]
            yield f"    {' | '.join(cases)}) words='{words}' ;;"


def _fish(verbs: dict[str, tuple[argparse.ArgumentParser, str]]) -> Iterator[str]:
    for name, (sub, words) in verbs.items():
        yield f"complete -c rsicalib -n __fish_use_subcommand -f -a {name} -d {_quoted(words)}"
        seen = f"complete -c rsicalib -n '__fish_seen_subcommand_from {name}'"
        for action in sub._actions:
            choices = " ".join(map(str, action.choices or ()))
            values = f" -x -a {_quoted(choices)}" if choices else ""
            longs = [t.removeprefix("--") for t in action.option_strings if t.startswith("--")]
            shorts = [t[1:] for t in action.option_strings if not t.startswith("--")]
            names = "".join([*(f" -l {t}" for t in longs), *(f" -s {t}" for t in shorts)])
            takes = " -r" if names and action.nargs != 0 and not values else ""
            if names:
                yield f"{seen}{names}{values}{takes} -d {_quoted(action.help or '')}"
            elif choices:
                yield f"{seen} -f -a {_quoted(choices)}"


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
