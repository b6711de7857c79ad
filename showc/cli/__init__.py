"""The command line: one verb a module, each importing what it needs when it runs."""

from __future__ import annotations

from importlib import import_module
from keyword import iskeyword
from typing import ClassVar

import click

from showc._version import __version__


class Verbs(click.Group):
    """Finds a verb's module when the verb is asked for: ``--help`` stays quick."""

    summaries: ClassVar[dict[str, str]] = {
        "init": "Write a first show script to start from.",
        "check": "Find mistakes in show scripts, without solving anything.",
        "fmt": "Format show scripts.",
        "preview": "Show a script in the browser while you write it.",
        "plan": "Show the timeline before anything is solved.",
        "compile": "Solve a script; write missions and a trajectory log.",
        "verify": "Prove a compiled show from its files alone.",
        "export": "Write a compiled show for other systems, and prove it.",
        "import": "Turn another tool's show into a script.",
        "view": "Make a page that plays the show in any browser.",
        "safety": "Compute where drones may fall, and which ground must stay clear.",
        "abort": "Plan how to land the fleet from any moment of the show.",
        "simulate": "Simulate many flights of the show in wind and gusts.",
        "report": "Make a report page to sign.",
        "diff": "Compare two compiled shows.",
        "upload": "Load missions onto vehicles, and check them there.",
        "stream": "Fly the trajectories as timed setpoints.",
        "compare": "Compare flights with the plan.",
        "explain": "Explain a finding, such as SHW201.",
        "schema": "Print the JSON Schema of show scripts.",
        "completion": "Print the completion script for a shell.",
    }

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Verbs in the order in which a show is made."""
        del ctx
        return list(self.summaries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the verb's module; its command has the module's name."""
        del ctx
        if cmd_name not in self.summaries:
            return None
        # A verb that Python keeps for itself has a module with a line behind it.
        name = f"{cmd_name}_" if iskeyword(cmd_name) else cmd_name
        module = import_module(f"showc.cli.{name}")
        command = module.command
        assert isinstance(command, click.Command)  # noqa: S101 - ours
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Answer a mistyped verb with the nearest one."""
        name = args[0] if args else ""
        if name and not name.startswith("-") and name not in self.summaries:
            from difflib import get_close_matches

            near = get_close_matches(name, self.summaries, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise click.UsageError(
                f"there is no verb {name!r}{hint} (showc --help lists them)", ctx
            )
        return super().resolve_command(ctx, args)

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """List the verbs from the table, importing none of them."""
        del ctx
        with formatter.section("Verbs"):
            formatter.write_dl(list(self.summaries.items()))


@click.command(
    cls=Verbs,
    subcommand_metavar="VERB [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 96},
)
@click.version_option(__version__, "--version", message="showc %(version)s")
def showc() -> None:
    """Compile drone light shows.

    A show script (YAML) lists formations and transitions. showc finds the fastest
    flight for every transition on the full quadrotor model. It proves that the drones
    keep their separation at every instant, and writes MAVLink missions and a trajectory
    log.

    \b
      showc init my-show.yaml        start a script
      showc check my-show.yaml       find mistakes
      showc compile my-show.yaml     output.mcap, output/missions, output/manifest.json
      showc verify output.mcap       prove the result
      showc view output.mcap         play the show

    Exit codes: 0 success; 1 findings (the script breaks a rule, a transition has no
    solution, or verify failed); 2 wrong usage, or unreadable or damaged input; 70 an
    error of showc itself; 130 interrupted.
    """
