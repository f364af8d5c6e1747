"""The command line."""

import io
import re
import signal
import sys
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup

from relight.benchmark.commands import app as benchmark
from relight.core.errors import UserError, sentence_of
from relight.core.version import __version__
from relight.figures.commands import app as figures
from relight.learning.commands import app as learning
from relight.lights.commands import app as lights
from relight.meshes.commands import app as scans
from relight.photos.commands import app as photos
from relight.photos.commands import mask_app as masks
from relight.transport.commands import app as transport
from relight.viewer.commands import app as viewer
from relight.viewer.commands import web_app as web

# The extra of pyproject.toml that brings a package, by the package's name in imports.
EXTRAS = {
    package: extra
    for extra, packages in {
        "bench": "mitsuba",
        "deep": "OpenImageIO",
        "export": "onnx onnxscript",
        "figures": "anny warp",
        "scans": "open3d pymeshlab trimesh",
        "slurm": "snakemake_executor_plugin_slurm",
        "tracking": "mlflow",
        "train": "safetensors torch",
        "video": "av",
        "workflow": "hydra jinja2 markdown_it matplotlib pandas psutil skimage sklearn snakemake",
    }.items()
    for package in packages.split()
}


class Commands(TyperGroup):
    """The commands, of which one that Ctrl-C ends says so, and one that is given no number says so."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if error.param and re.search("valid (number|integer|float)", error.message):
                option = max(error.param.opts, key=len)
                error.message = f"give a number alone, without a unit, such as {option} {error.param.default or 2}"
            raise
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=Commands,
    help="The open laboratory for occlusion-aware relighting of people.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

for tool in (photos, viewer, learning, transport, figures):
    app.add_typer(tool)
for name, tool in {"light": lights, "scans": scans, "mask": masks, "web": web, "benchmark": benchmark}.items():
    app.add_typer(tool, name=name)


@app.callback(invoke_without_command=True)
def version(show: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    """Prints the version and exits, if `--version` is given."""
    if show:
        print(__version__)
        raise typer.Exit


class RunCommand(TyperCommand):
    """`relight run`, whose help also lists the settings, and which tells options from them."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses the words of the command line. Raises UserError for a setting with dashes."""
        from relight.settings import presets

        for word in args:
            if word.lstrip("-") != word and (key := word.lstrip("-").partition("=")[0]).partition(".")[0] in presets():
                raise UserError(f"{word}: a setting has no dashes and an equals sign, {key}=...")
        return super().parse_args(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:  # click's, which Typer bundles privately
        """Writes the help of `relight run`, followed by all settings with their default values."""
        from relight.settings import composed
        from relight.settings.help import overview

        super().format_help(ctx, formatter)
        print("Settings, as key=value, with their default values (docs/workflow.md):\n" + overview(composed()))


@app.command(cls=RunCommand)
def run(
    overrides: Annotated[
        list[str] | None, typer.Argument(help="Settings: scale=smoke, train.lr=1e-3, figures=scans ...")
    ] = None,
    multirun: Annotated[bool, typer.Option("--multirun", "-m", help="Sweep over comma-separated values.")] = False,
    cores: Annotated[
        int | None, typer.Option("--cores", "-j", help="Number of jobs at the same time; by default one per core.")
    ] = None,
    dry: Annotated[bool, typer.Option("--dry-run", "-n", help="Only print what would run.")] = False,
    cfg: Annotated[Literal["job"] | None, typer.Option(help="Print the composed settings and exit.")] = None,
    target: Annotated[
        list[str], typer.Option(help="Rule (lights, bake, train, tables, viewer ...) or file to make.")
    ] = ["all"],  # noqa: B006
    snakemake: Annotated[str, typer.Option(help="Further arguments for Snakemake, in one string.")] = "",
) -> None:
    """Run the whole workflow, from figures and panoramas to the report. Makes only what is missing."""
    import os
    import shlex

    from relight.settings import ROOT, composed

    need_clone("run")
    os.chdir(ROOT)  # where the jobs read relative paths
    if cfg:
        from omegaconf import OmegaConf

        from relight.lab.run import with_remembered

        print(OmegaConf.to_yaml(composed(with_remembered(overrides or []))), end="")
        return
    from relight.lab.run import run as workflow

    raise typer.Exit(workflow(overrides or [], multirun, cores, dry, target, shlex.split(snakemake)))


@app.command()
def ui(
    overrides: Annotated[
        list[str] | None,
        typer.Argument(help="Settings that select the runs: name=mine, track.uri=sqlite:///other.db ..."),
    ] = None,
    port: Annotated[int, typer.Option(help="Port of the local server.", min=1, max=65535)] = 5000,
) -> None:
    """Browse the runs in MLflow, on this machine only."""
    from relight.lab.tracking.server import serve
    from relight.settings import composed

    need_clone("ui")
    serve(composed(overrides or []).track, port)


def need_clone(command: str) -> None:
    """Raises UserError if relight was installed from a wheel, which does not contain the workflow."""
    from relight.settings import IS_CLONE

    if not IS_CLONE:
        raise UserError(f"relight {command} needs the repository with its Snakefile: clone it and type `make` there")


def main() -> None:
    """Runs the command line; a UserError is printed in one line, with exit code 1. SIGTERM leaves no hidden file."""
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files are bytes; a terminal of ASCII shows ? for a degree
        sys.stdout.reconfigure(errors="surrogateescape" if sys.stdout.encoding.lower() == "utf-8" else "replace")
    try:
        app()
    except Exception as error:
        sentence = sentence_of(error)
        if isinstance(error, ModuleNotFoundError) and (extra := EXTRAS.get((error.name or "").partition(".")[0])):
            sentence = f"this needs {error.name}: run `pip install '.[{extra}]'` in the clone of relight"
        if sentence is None:
            raise
        sys.exit(f"relight: {sentence}")


if __name__ == "__main__":
    main()
