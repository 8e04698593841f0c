"""A command's parameters as a client may give them in JSON, and back into the words of a command line.

click's own declarations are the only list: what ``photomap KIND --help`` tells people, this tells programs.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from photomap_gis.core.errors import UsageError
from photomap_gis.engine.documents import CommandDocument, ParameterDocument

_NOT_OFFERED = frozenset({"as_json", "quiet", "help"})
"""What the engine decides itself: jobs always tell a document, and their progress goes to whoever listens."""


def command_document(kind: str, command: click.Command) -> CommandDocument:
    """Return what a dialog or a script needs to know to start this command as a job."""
    text = inspect.cleandoc((command.help or "").replace("\b", ""))
    return CommandDocument(
        kind=kind,
        summary=command.short_help or "",
        help=text,
        parameters=[_parameter_document(p) for p in offered(command).values()],
    )


def offered(command: click.Command) -> dict[str, click.Parameter]:
    """Return a command's parameters by the names that clients use: options' long names with underscores."""
    return {name_of(p): p for p in command.params if p.name not in _NOT_OFFERED}


def name_of(parameter: click.Parameter) -> str:
    """Return ``gcp_crs`` for ``--gcp-crs``; an argument's own name."""
    return _long_names(parameter)[0]


def argv_of(
    kind: str,
    command: click.Command,
    arguments: Mapping[str, Any],
    forced: Sequence[str] = (),
    folder: Path | None = None,
) -> list[str]:
    """Return the command line of a job, without the program.

    ``arguments`` are JSON values by the names of ``offered`` (dashes and other long names of the same option will do);
    ``null`` means not given. ``forced`` are flags by click's names; ``folder`` is where the job's relative paths begin.
    All that click would refuse is refused here, before a process starts: ``UsageError`` with its words.
    """
    known = {name: p for p in offered(command).values() for name in _long_names(p)}
    given: dict[str, Any] = {}
    for name, value in arguments.items():
        parameter = known.get(name.replace("-", "_"))
        if parameter is None:
            raise UsageError(f"{kind} has no argument {name!r}; it has {', '.join(offered(command))}")
        canonical = name_of(parameter)
        if canonical in given:
            raise UsageError(f"{kind}: {name} is given twice")
        if folder is not None and isinstance(value, str) and isinstance(parameter.type, click.Path):
            value = str(folder / value)  # click looks here and now whether it exists
        if value is not None:
            given[canonical] = value
    words: list[str] = []
    places: list[str] = []
    for parameter in command.params:
        name = name_of(parameter)
        if parameter.name in forced:
            words.append(_longest(parameter.opts))
        elif name in given and parameter.name not in _NOT_OFFERED:
            if isinstance(parameter, click.Option):
                words += _option_words(name, parameter, given[name])
            else:
                places += _argument_words(name, parameter, given[name])
    argv = [*words, "--", *places] if places else words
    try:
        # click itself has the last word: it parses what the process will be given, and calls nothing.
        command.make_context(kind, list(argv), resilient_parsing=False).close()
    except click.UsageError as error:
        raise UsageError(f"{kind}: {error.format_message()}") from error
    except click.exceptions.Exit as error:
        raise UsageError(f"{kind}: these arguments start nothing") from error
    return [kind, *argv]


def _option_words(name: str, option: click.Option, value: Any) -> list[str]:
    flag = _longest(option.opts)
    if option.is_flag:
        if not isinstance(value, bool):
            raise UsageError(f"{name} is a switch: true or false, got {_shown(value)}")
        if value:
            return [flag]
        return [_longest(option.secondary_opts)] if option.secondary_opts else []
    values = value if option.multiple and isinstance(value, list) else [value]
    words = []
    for one in values:
        if option.nargs == 1:
            words.append(f"{flag}={_word(name, option.type, one)}")
            continue
        if not isinstance(one, list) or len(one) != option.nargs:
            raise UsageError(f"{name} takes {option.nargs} values in a list, got {_shown(one)}")
        words += [flag, *(_word(name, option.type, v) for v in one)]
    return words


def _argument_words(name: str, argument: click.Parameter, value: Any) -> list[str]:
    values = value if isinstance(value, list) and argument.nargs != 1 else [value]
    return [_word(name, argument.type, v) for v in values]


def _word(name: str, kind: click.ParamType[Any], value: Any) -> str:
    """A JSON value as a word of the command line; numbers where numbers are wanted, else text."""
    wanted = _type_name(kind)
    if isinstance(value, bool) or value is None or isinstance(value, (list, dict)):
        raise UsageError(f"{name} takes {_ARTICLES[wanted]}, got {_shown(value)}")
    if wanted == "integer" and isinstance(value, float):
        raise UsageError(f"{name} takes a whole number, got {_shown(value)}")
    if wanted in ("integer", "number") and not isinstance(value, (int, float)):
        raise UsageError(f"{name} takes {_ARTICLES[wanted]}, got {_shown(value)}")
    if wanted in ("path", "choice") and not isinstance(value, str):
        raise UsageError(f"{name} takes {_ARTICLES[wanted]}, got {_shown(value)}")
    text = value if isinstance(value, str) else repr(value)
    if "\0" in text:
        raise UsageError(f"{name} must not hold NUL characters")
    return text


def _parameter_document(parameter: click.Parameter) -> ParameterDocument:
    kind = parameter.type
    option = parameter if isinstance(parameter, click.Option) else None
    is_flag = option is not None and option.is_flag
    repeats = parameter.nargs == -1 or bool(option is not None and option.multiple)
    low, high = (getattr(kind, end, None) for end in ("min", "max"))
    return ParameterDocument(
        name=name_of(parameter),
        type="boolean" if is_flag else _type_name(kind),
        role="option" if option is not None else "argument",
        required=parameter.required,
        repeats=repeats,
        count=max(1, parameter.nargs),
        choices=list(kind.choices) if isinstance(kind, click.Choice) else None,
        minimum=low,
        maximum=high,
        default=None if repeats and not parameter.default else _plain(parameter.default),
        metavar=parameter.metavar or "",
        help=(option.help or "") if option is not None else "",
    )


_ARTICLES = {
    "path": "the name of a file or folder",
    "choice": "one of its choices",
    "integer": "a whole number",
    "number": "a number",
    "string": "text or a number",
}


def _type_name(kind: click.ParamType[Any]) -> Any:
    if isinstance(kind, click.Choice):
        return "choice"
    if isinstance(kind, (click.Path, click.File)):
        return "path"
    if isinstance(kind, click.types.IntParamType):
        return "integer"
    if isinstance(kind, click.types.FloatParamType):
        return "number"
    return "string"


def _plain(value: Any) -> Any:
    """A default as JSON can say it; click's mark for "none was declared" becomes ``None``."""
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    return None


def _long_names(parameter: click.Parameter) -> list[str]:
    if isinstance(parameter, click.Option):
        long = [o for o in parameter.opts if o.startswith("--")]
        return [o.removeprefix("--").replace("-", "_") for o in long]
    return [parameter.name or ""]


def _longest(opts: Sequence[str]) -> str:
    return next(o for o in opts if o.startswith("--"))


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
