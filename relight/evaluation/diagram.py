"""Draws a diagram of a network from the module itself: its convolutions and their connections."""

from dataclasses import dataclass, field
from pathlib import Path

import torch
from matplotlib.patches import FancyArrowPatch, Rectangle
from torch import nn

from relight.evaluation.charts import COLORS, chart
from relight.learning.networks import Network

INPUT = "picture and mask"
LANE = 2.2  # distance between lanes; layers of a lane have distance 1
TEXT_BOX = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}  # behind text that lines cross


@dataclass
class Layer:
    """A convolution of a network.

    Attributes:
        name: in the module.
        kind: class of the layer.
        channels: of the output.
        side: of the output, pixels.
        sources: names of the layers from which its input is computed; INPUT is the picture and the mask.
    """

    name: str
    kind: str
    channels: int
    side: int
    sources: list[str] = field(default_factory=list)

    @property
    def lane(self) -> str:
        """The part of the network: `encoder`, `decoders.albedo`, `light`."""
        parts = self.name.split(".")
        return ".".join(parts[:2]) if parts[0] == "decoders" else parts[0]


def layers_of(network: Network) -> tuple[list[Layer], dict[str, list[str]]]:
    """Runs a network once and follows its autograd graph from each convolution back to those before it.

    Args:
        network: any; its weights and mode do not change.

    Returns:
        The layers in the order in which they run, and for each output the layers from which it is computed.
    """
    device = next(network.parameters()).device
    found: list[Layer] = []
    layer_of_node: dict[object, str] = {}  # node of the graph -> layer

    def enter(module: nn.Module, given: tuple, name: str) -> None:
        found.append(Layer(name, type(module).__name__, 0, 0, sources(given[0], layer_of_node)))

    def leave(module: nn.Module, given: tuple, output: torch.Tensor) -> None:
        found[-1].channels, found[-1].side = output.shape[1], output.shape[-1]
        layer_of_node[output.grad_fn] = found[-1].name

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
            layer_of_node[torch.autograd.graph.get_gradient_edge(picture).node] = INPUT
            outputs = network(picture, torch.ones(1, 1, size, size, device=device))
    finally:
        network.train(training)
        for hook in hooks:
            hook.remove()
    return found, {name: sources(output, layer_of_node) for name, output in outputs.items()}


def sources(tensor: torch.Tensor, layer_of_node: dict[object, str]) -> list[str]:
    """Returns the nearest layers from which a tensor was computed, or INPUT, in the order in which they ran."""
    nearest: set[str] = set()
    seen: set[object] = set()
    stack = [tensor.grad_fn]
    while stack:
        node = stack.pop()
        if node is None or node in seen:
            continue
        seen.add(node)
        if node in layer_of_node:
            nearest.add(layer_of_node[node])
        else:
            stack += [parent for parent, _ in node.next_functions]
    return [name for name in layer_of_node.values() if name in nearest]


def draw_network(network: Network, title: str, out: Path) -> None:
    """Draws a network: a lane for each part, and a box for each convolution, whose height shows the output's side.

    Args:
        network: any.
        title: over the diagram.
        out: the picture (.png or .svg).
    """
    layers, outputs = layers_of(network)
    lanes = list(dict.fromkeys(layer.lane for layer in layers))
    position: dict[str, tuple[float, float]] = {INPUT: (0, 0)}
    for layer in layers:
        x = 1 + max(position[source][0] for source in layer.sources)
        position[layer.name] = x, -LANE * lanes.index(layer.lane)
    ends: dict[tuple[str, ...], str] = {}  # outputs of the same layers have one place
    for name, layer_names in outputs.items():
        key = tuple(layer_names)
        ends[key] = f"{ends[key]},\n{name}" if key in ends else name
    for from_layers, name in ends.items():
        position[name] = 1 + max(position[source][0] for source in from_layers), position[from_layers[-1]][1]
    last = max(x for x, _ in position.values())
    height = {layer.name: 0.25 + 0.115 * max(layer.side - 1, 0).bit_length() for layer in layers}
    arrows = [(source, layer.name) for layer in layers for source in layer.sources]
    arrows += [(source, name) for from_layers, name in ends.items() for source in from_layers]
    with chart(out, 1.6 + 0.78 * last, 0.9 + 1.25 * len(lanes)) as figure:
        axes = figure.subplots()
        axes.set(xlim=(-0.9, last + 1.1), ylim=(-LANE * (len(lanes) - 0.42), LANE * 0.62), title=title)
        axes.axis("off")
        for layer in layers:
            (x, y), box_height = position[layer.name], height[layer.name]
            color = COLORS[lanes.index(layer.lane) % len(COLORS)]
            axes.add_patch(Rectangle((x - 0.3, y - box_height / 2), 0.6, box_height, facecolor=color, edgecolor="none"))
            words = f"{layer.channels}\n@{layer.side}"
            axes.text(x, y - box_height / 2 - 0.06, words, ha="center", va="top", fontsize=7, bbox=TEXT_BOX)
        for lane in lanes:
            members = [layer.name for layer in layers if layer.lane == lane]
            (x, y), top = position[members[0]], max(height[name] for name in members) / 2
            words = lane.replace(".", ": ")
            axes.text(x - 0.3, y + top + 0.1, words, fontsize=9, weight="bold", va="bottom", bbox=TEXT_BOX)
        for name in (INPUT, *ends.values()):
            (x, y), words = position[name], name.replace(" and ", "\nand ")
            x, side = (x + 0.28, "right") if name == INPUT else (x - 0.26, "left")
            axes.text(x, y, words, ha=side, va="center", fontsize=9, style="italic")
        for first, second in arrows:
            (x, y), (end, level) = position[first], position[second]
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
