"""A material whose color is albedo times transport times light, from nodes."""

import bpy
import numpy as np

GROUP = "relight"
TRANSPORT = ("Transport 0", "Transport 1", "Transport 2")  # coefficients 0 to 2, 3 to 5 and 6 to 8 of a pixel or vertex
CHANNELS = "RGB"


def light_inputs(channel):
    """Returns the names of the inputs that hold a channel's nine coefficients of the light, three in each."""
    return [f"Light {channel} {third}" for third in range(3)]


def node_group():
    """Returns the group of nodes that emits albedo / pi * max(transport . light, 0); makes it at the first call."""
    if group := bpy.data.node_groups.get(GROUP):
        return group
    group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    sockets = [("Albedo", "NodeSocketColor"), ("Strength", "NodeSocketFloat"), ("Alpha", "NodeSocketFloat")]
    sockets += [(name, "NodeSocketVector") for name in TRANSPORT]
    sockets += [(name, "NodeSocketVector") for channel in CHANNELS for name in light_inputs(channel)]
    for name, kind in sockets:
        socket = group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        if kind == "NodeSocketFloat":
            socket.default_value = 1.0
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    nodes, link = group.nodes, group.links.new
    given, color = nodes.new("NodeGroupInput"), nodes.new("ShaderNodeCombineColor")
    for channel, socket in zip(CHANNELS, color.inputs):
        total = None
        for transport, light in zip(TRANSPORT, light_inputs(channel)):
            dot = nodes.new("ShaderNodeVectorMath")
            dot.operation = "DOT_PRODUCT"
            link(given.outputs[transport], dot.inputs[0])
            link(given.outputs[light], dot.inputs[1])
            total = dot.outputs["Value"] if total is None else math(nodes, link, "ADD", total, dot.outputs["Value"])
        link(math(nodes, link, "MAXIMUM", total, 0.0), socket)
    lit, shine, clear, mix = (
        nodes.new(f"ShaderNode{kind}") for kind in ("VectorMath", "Emission", "BsdfTransparent", "MixShader")
    )
    lit.operation = "MULTIPLY"
    link(color.outputs[0], lit.inputs[0])
    link(given.outputs["Albedo"], lit.inputs[1])
    link(lit.outputs[0], shine.inputs["Color"])
    link(math(nodes, link, "MULTIPLY", given.outputs["Strength"], 1 / np.pi), shine.inputs["Strength"])
    link(given.outputs["Alpha"], mix.inputs[0])
    link(clear.outputs[0], mix.inputs[1])
    link(shine.outputs[0], mix.inputs[2])
    link(mix.outputs[0], nodes.new("NodeGroupOutput").inputs["Shader"])
    return group


def math(nodes, link, operation, *values):
    """Adds a Math node.

    Args:
        nodes: of the shader's tree.
        link: connects an output of a node to an input.
        operation: of the node, such as "MULTIPLY".
        *values: its inputs, each a number (float) or the output of another node.

    Returns:
        The output of the node.
    """
    node = nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, value in zip(node.inputs, values):
        if isinstance(value, float):
            socket.default_value = value
        else:
            link(value, socket)
    return node.outputs[0]


def new_material(name, sources):
    """Returns a material that shines with the group of `node_group`.

    Args:
        name: of the material.
        sources: a function that takes the material's nodes, adds some that feed the group, and yields pairs of an
            output of theirs and the name of the group's input that it feeds.
    """
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    group, output = nodes.new("ShaderNodeGroup"), nodes.new("ShaderNodeOutputMaterial")
    group.node_tree, group.name = node_group(), GROUP
    group.inputs["Albedo"].default_value = (1, 1, 1, 1)
    for source, target in sources(nodes):
        link(source, group.inputs[target])
    link(group.outputs["Shader"], output.inputs["Surface"])
    return material


def set_light(material, coefficients):
    """Sets the light of a material from `new_material`: radiance coefficients (9,3) in the transport's frame."""
    node = material.node_tree.nodes[GROUP]
    for channel, values in zip(CHANNELS, np.asarray(coefficients).T):
        for name, third in zip(light_inputs(channel), values.reshape(3, 3)):
            node.inputs[name].default_value = third
