"""`ident completion`: a script that completes commands, flags and names in a shell, made from the parser."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping

from ..effects.registry import effect_names
from ..estimators import estimator_types
from ..robots.library.folders import built_in_names

_BASH = """# ident: completion for bash and zsh.  eval "$(ident completion {shell})"
{zsh}_ident() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" command="" flags="" i
  for ((i = 1; i < COMP_CWORD; i++)); do
    case "${{COMP_WORDS[i]}}" in -*) ;; *) command="${{COMP_WORDS[i]}}"; break ;; esac
  done
  if [ -z "$command" ]; then
    COMPREPLY=($(compgen -W "{commands}" -- "$word"))
    return
  fi
  case "$command $before" in
{values}
  esac
  case "$word" in
    -*)
      case "$command" in
{flags}
      esac
      COMPREPLY=($(compgen -W "$flags" -- "$word"))
      return ;;
  esac
  COMPREPLY=($(compgen -f -- "$word"))
}}
complete -o filenames -F _ident ident
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help='the shell; for its start-up file: eval "$(ident completion bash)"')


def run(args: argparse.Namespace) -> int:
    commands: Mapping[str, argparse.ArgumentParser] = args.parsers()
    sys.stdout.write(_fish(commands) if args.shell == "fish" else _bash(commands, args.shell))
    return 0


def values_of(action: argparse.Action) -> tuple[str, ...]:
    """The names that an argument takes: its choices, or what is registered; none where it takes files or numbers."""
    if action.choices is not None:
        return tuple(map(str, action.choices))
    known = {"robot": built_in_names, "method": estimator_types, "effects": effect_names}
    return tuple(known[action.dest]()) if action.dest in known and action.option_strings else ()


def _flags(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [a for a in parser._actions if a.option_strings]


def _bash(commands: Mapping[str, argparse.ArgumentParser], shell: str) -> str:
    values, flags = [], []
    for name, parser in commands.items():
        flags.append(f'        {name}) flags="{" ".join(o for a in _flags(parser) for o in a.option_strings)}" ;;')
        for action in _flags(parser):
            if found := values_of(action):
                pattern = "|".join(f'"{name} {o}"' for o in action.option_strings)
                values.append(f'    {pattern}) COMPREPLY=($(compgen -W "{" ".join(found)}" -- "$word")); return ;;')
    zsh = "autoload -U +X bashcompinit && bashcompinit\n" if shell == "zsh" else ""
    return _BASH.format(shell=shell, zsh=zsh, commands=" ".join(commands), values="\n".join(values), flags="\n".join(flags))


def _fish(commands: Mapping[str, argparse.ArgumentParser]) -> str:
    lines = ["# ident: completion for fish.  ident completion fish | source"]
    for name, parser in commands.items():
        lines.append(f"complete -c ident -n __fish_use_subcommand -f -a {name} -d {_quoted(parser.description or '')}")
        for action in _flags(parser):
            words = " ".join(f"-l {o[2:]}" if o.startswith("--") else f"-s {o[1:]}" for o in action.option_strings)
            found = values_of(action)
            takes = f" -x -a '{' '.join(found)}'" if found else "" if action.nargs == 0 else " -r"
            lines.append(f"complete -c ident -n '__fish_seen_subcommand_from {name}' {words}{takes} -d {_quoted(action.help or '')}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return "'" + text.split(";", maxsplit=1)[0].replace("\\", "").replace("'", "’").replace("%%", "%").split("%(")[0].strip() + "'"
