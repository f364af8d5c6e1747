"""A diagram of a network, made from the module itself: its convolutions, and which of them feeds which."""

from dataclasses import dataclass, field
from pathlib import Path

import torch
from matplotlib.patches import FancyArrowPatch, Rectangle
from torch import nn

from relight.evaluation.charts import COLORS, chart
from relight.learning.networks import Network

INPUT = "picture and mask"
LANE = 2.2  # between lanes; neighbours in a lane are 1 apart
CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}  # behind words that lines cross


@dataclass
class Layer:
    """A convolution of a network as it is run: its name in the module, kind, channels and side (pixels) of its output,
    and the names of the layers that its input is made from; INPUT stands for the picture and the mask."""

    name: str
    kind: str
    channels: int
    side: int
    sources: list[str] = field(default_factory=list)

    @property
    def lane(self) -> str:
        """The part of the network that it belongs to: `encoder`, `decoders.albedo`, `light`."""
        parts = self.name.split(".")
        return ".".join(parts[:2]) if parts[0] == "decoders" else parts[0]


def layers_of(network: Network) -> tuple[list[Layer], dict[str, list[str]]]:
    """Runs a network once and follows its autograd graph from each convolution back to those before it.

    Args:
        network: any; its weights and mode are left as they are.

    Returns:
        The layers in the order in which they run; and for each output the layers that it is made from.
    """
    device = next(network.parameters()).device
    found: list[Layer] = []
    made: dict[object, str] = {}  # node of the graph -> layer

    def enter(module: nn.Module, given: tuple, name: str) -> None:
        found.append(Layer(name, type(module).__name__, 0, 0, sources(given[0], made)))

    def leave(module: nn.Module, given: tuple, output: torch.Tensor) -> None:
        found[-1].channels, found[-1].side = output.shape[1], output.shape[-1]
        made[output.grad_fn] = found[-1].name

    hooks = []
    for name, module in network.named_modules():
        if isinstance(module, (nn.Conv2d, nn.ConvTranspose2d)):
            hooks.append(module.register_forward_pre_hook(lambda m, given, name=name: enter(m, given, name)))
            hooks.append(module.register_forward_hook(leave))
    training, size = network.training, network.size
    network.eval()
    try:
        with torch.enable_grad():
            picture = torch.full((1, 3, size, size), 0.5, device=device, requires_grad=True)
            made[torch.autograd.graph.get_gradient_edge(picture).node] = INPUT
            outputs = network(picture, torch.ones(1, 1, size, size, device=device))
    finally:
        network.train(training)
        for hook in hooks:
            hook.remove()
    return found, {name: sources(output, made) for name, output in outputs.items()}


def sources(tensor: torch.Tensor, made: dict[object, str]) -> list[str]:
    """The nearest layers that a tensor was made from, INPUT among them, in the order in which they ran."""
    nearest: set[str] = set()
    seen: set[object] = set()
    left = [tensor.grad_fn]
    while left:
        node = left.pop()
        if node is None or node in seen:
            continue
        seen.add(node)
        if node in made:
            nearest.add(made[node])
        else:
            left += [parent for parent, _ in node.next_functions]
    return [name for name in made.values() if name in nearest]


def draw_network(network: Network, title: str, out: Path) -> None:
    """Draws a network: a lane for each of its parts, a box for each convolution, as tall as its output is large.

    Args:
        network: any.
        title: over the diagram.
        out: the picture (.png or .svg).
    """
    layers, outputs = layers_of(network)
    lanes = list(dict.fromkeys(layer.lane for layer in layers))
    place: dict[str, tuple[float, float]] = {INPUT: (0, 0)}
    for layer in layers:
        x = 1 + max(place[source][0] for source in layer.sources)
        place[layer.name] = x, -LANE * lanes.index(layer.lane)
    ends: dict[tuple[str, ...], str] = {}  # outputs of the same layers have one place
    for name, from_layers in outputs.items():
        own = tuple(from_layers)
        ends[own] = f"{ends[own]},\n{name}" if own in ends else name
    for own, name in ends.items():
        place[name] = 1 + max(place[source][0] for source in own), place[own[-1]][1]
    last = max(x for x, _ in place.values())
    height = {layer.name: 0.25 + 0.115 * max(layer.side - 1, 0).bit_length() for layer in layers}
    arrows = [(source, layer.name) for layer in layers for source in layer.sources]
    arrows += [(source, name) for own, name in ends.items() for source in own]
    with chart(out, 1.6 + 0.78 * last, 0.9 + 1.25 * len(lanes)) as figure:
        axes = figure.subplots()
        axes.set(xlim=(-0.9, last + 1.1), ylim=(-LANE * (len(lanes) - 0.42), LANE * 0.62), title=title)
        axes.axis("off")
        for layer in layers:
            (x, y), tall = place[layer.name], height[layer.name]
            color = COLORS[lanes.index(layer.lane) % len(COLORS)]
            axes.add_patch(Rectangle((x - 0.3, y - tall / 2), 0.6, tall, facecolor=color, edgecolor="none"))
            words = f"{layer.channels}\n@{layer.side}"
            axes.text(x, y - tall / 2 - 0.06, words, ha="center", va="top", fontsize=7, bbox=CLEAR)
        for lane in lanes:
            members = [layer.name for layer in layers if layer.lane == lane]
            (x, y), top = place[members[0]], max(height[name] for name in members) / 2
            words = lane.replace(".", ": ")
            axes.text(x - 0.3, y + top + 0.1, words, fontsize=9, weight="bold", va="bottom", bbox=CLEAR)
        for name in (INPUT, *ends.values()):
            (x, y), words = place[name], name.replace(" and ", "\nand ")
            x, side = (x + 0.28, "right") if name == INPUT else (x - 0.26, "left")
            axes.text(x, y, words, ha=side, va="center", fontsize=9, style="italic")
        for first, second in arrows:
            (x, y), (end, level) = place[first], place[second]
            near = y == level and end - x == 1
            bend = 0 if near else -0.18 if y == level else 0.06
            arrow = FancyArrowPatch(
                (x + 0.3, y),
                (end - 0.3, level),
                arrowstyle="-|>",
                mutation_scale=7,
                connectionstyle=f"arc3,rad={bend}",
                color="#3a3a3e" if near else "#b3b3ad",
                linewidth=1.1 if near else 0.8,
                zorder=0,
            )
            axes.add_patch(arrow)
