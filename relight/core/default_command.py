"""Groups of commands of which one needs no name."""

from typing import Any

from typer.core import TyperGroup


def default_command(name: str) -> type[TyperGroup]:
    """Returns the class (Typer's `cls`) of a group that runs the command `name` where none of its commands is named."""

    class Group(TyperGroup):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # ctx is click's, which Typer bundles privately
            if args and args[0] not in {*self.commands, "--help", "-h"}:
                args = [name, *args]
            return super().parse_args(ctx, args)

    return Group
