"""Suggest the command or option that a misspelt one may mean."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import SequenceMatcher

_ALIKE = 0.65  # share of letters that are the same; below it a suggestion confuses more than it helps
_COMMANDS = {  # what other programs call it, or an option that sounds like a command
    "version": "--version",
    "help": "--help",
    "locate": "estimate",
    "plot": "view",
    "show": "view",
    "tare": "estimate --tare SECONDS",
}
_OPTIONS = {  # options that are no options here
    "--log": "a log is named without an option, as in `palpate estimate LOG`.",
    "--ip": "the address of a device is in a rig's [source]: `palpate rig new --source KIND:ADDRESS` writes one.",
}


def unknown_command(words: Sequence[str], known: Sequence[str], groups: Mapping[str, Sequence[str]]) -> str | None:
    """Return a sentence if a call names an unknown command, else None.

    Args:
        words: of the call.
        known: those that name a command or a group.
        groups: first word -> commands below it.
    """
    rest = words[len(known) :]
    if not rest or rest[0].startswith("-") or (known and not groups[known[0]]) or len(known) > 1:
        return None
    called = " ".join([*known, rest[0]])
    if known:
        meant = {name: f"{known[0]} {name}" for name in groups[known[0]]}
    else:  # of a group's commands the last word is enough: `palpate clock`
        leaves = {name: f"{group} {name}" for group, names in groups.items() for name in names}
        meant = leaves | {f"{group}-{name}": f"{group} {name}" for group, names in groups.items() for name in names}
        meant |= {name: name for name in groups}
    near = _nearest(rest[0], meant)
    if not known and rest[0].lower() in _COMMANDS:
        near, meant = rest[0], {rest[0]: _COMMANDS[rest[0].lower()]}
    listed = " ".join(["palpate", *known, "--help"])
    hint = f"`{listed}` lists them." if near is None else f"did you mean `palpate {meant[near]}`?"
    return f"there is no command `{called}`; {hint}"


def unknown_option(words: Sequence[str], command: Sequence[str], options: Iterable[str]) -> str | None:
    """Return a sentence on the first option in `words` that is not among the command's `options`; None without any."""
    known, name = set(options), " ".join(["palpate", *command])
    for word in words:
        option = word.partition("=")[0].replace("_", "-")
        if re.fullmatch(r"--[a-z][\w-]*", option) and option not in known:
            near = _nearest(option, known)
            nearest = f"`{name} --help` lists them." if near is None else f"did you mean {near}?"
            hint = _OPTIONS.get(option, nearest)
            return f"`{name}` has no option {word.partition('=')[0]}; {hint}"
    return None


def _nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the most similar name, or None if nothing is alike."""
    bare = word.lower().lstrip("-")
    ranked = [(SequenceMatcher(None, bare, name.lstrip("-")).ratio(), name) for name in sorted(known)]
    share, name = max(ranked, default=(0.0, ""), key=lambda each: each[0])
    return name if share >= _ALIKE else None
