"""``showc completion``: the completion script for a shell."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class


@click.command(name="completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(ctx: click.Context, shell: str) -> int:
    """Print the completion script for a shell.

    \b
      eval "$(showc completion bash)"        in ~/.bashrc
      eval "$(showc completion zsh)"         in ~/.zshrc
      showc completion fish > ~/.config/fish/completions/showc.fish
    """
    completion = get_completion_class(shell)
    if completion is None:
        raise click.UsageError(f"there is no completion for {shell!r}")
    root = ctx.find_root().command
    click.echo(completion(root, {}, "showc", "_SHOWC_COMPLETE").source())
    return 0
