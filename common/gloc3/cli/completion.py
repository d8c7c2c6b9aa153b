"""`gloc3 completion`: a script that completes commands, options and choices in a shell."""

from typing import Literal

from cyclopts import App

from gloc3.installed import installed_points

app = App(name="gloc3 completion", help_format="markdown", version_flags=[])


@app.default
def completion(shell: Literal["bash", "zsh", "fish"], /) -> int:
    """Print a script that completes `gloc3` in a shell: commands, options, choices and files.

    For example:

    - bash: `gloc3 completion bash > ~/.local/share/bash-completion/completions/gloc3`
    - zsh: `gloc3 completion zsh > ~/.zfunc/_gloc3`, where `~/.zfunc` is in `fpath`
    - fish: `gloc3 completion fish > ~/.config/fish/completions/gloc3.fish`

    Commands whose libraries are not installed are left out; print it again after an installation.

    Args:
        shell: The shell.
    """
    root = App(name="gloc3", help_flags=["--help"], version_flags=["--version"])
    for point in installed_points("gloc3.commands"):
        try:
            root.command(point.load(), name=point.name)
        except ModuleNotFoundError:
            continue
    print(root.generate_completion(prog_name="gloc3", shell=shell))  # noqa: T201
    return 0
