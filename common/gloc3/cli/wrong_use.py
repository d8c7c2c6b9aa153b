"""What the command line says of arguments that do not fit: in the words of this project, in one line."""

from typing import TYPE_CHECKING, Final

from gloc3.errors import nearest

if TYPE_CHECKING:
    from cyclopts import CycloptsError

KINDS: Final = {int: "a whole number", float: "a number"}


def explained(error: "CycloptsError") -> str:
    """What is wrong with the arguments, and what would be right."""
    from cyclopts import (
        CoercionError,
        MissingArgumentError,
        RepeatArgumentError,
        UnknownCommandError,
        UnknownOptionError,
        UnusedCliTokensError,
    )

    named = error.argument.name if error.argument is not None else ""
    name = named if named.startswith("--") else named.upper()
    match error:
        case UnknownCommandError(unused_tokens=[word, *_]) if error.app is not None:
            known = [command for command in error.app if not command.startswith("-")]
            return f"no command {word!r}; {nearest(word, known)}"
        case UnknownOptionError(token=token):
            names = [name for argument in error.argument_collection for name in argument.names]
            known = [name.removeprefix("--") for name in names if name.startswith("--")]
            word = token.keyword or token.value
            return f"no option {word}; {nearest(word.lstrip('-'), known)}"
        case MissingArgumentError():
            is_alone = named.startswith("--") and named in (error.root_input_tokens or ())
            return f"{name} needs a value" if is_alone else f"{name} is missing"
        case CoercionError(token=token) if token is not None:
            choices = error.argument.get_choices() if error.argument is not None else None
            kind = KINDS.get(error.target_type) if error.target_type is not None else None
            if choices:
                return f"{name} must be {' or '.join(choices)}, not {token.value!r}"
            if kind is not None:
                return f"{name} must be {kind}, not {token.value!r}"
        case RepeatArgumentError(token=token):
            return f"{token.keyword or name} is given more than once"
        case UnusedCliTokensError(unused_tokens=[*words]):
            return f"nothing was expected after the arguments, but there is {' '.join(words)!r}"
    return str(error).strip()
