"""The command `export`."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def export(
    checkpoint: Annotated[Path, typer.Argument(help="A network that a training wrote (.safetensors).")],
    out: Annotated[Path, typer.Argument(help="The .onnx file to write.")],
) -> None:
    """Write a trained network as one graph (.onnx) for `relight photo -w` and other programs.

    It takes pictures of any size whose sides are multiples of 64.
    """
    from relight.learning.checkpoint import load_network
    from relight.learning.export import export as write

    network, config = load_network(checkpoint)
    typer.echo("torch turns the network into a graph, which takes about a minute", err=True)
    print(f"{out}: differs from torch by {write(network, out, config):.1e} at most")
