"""Materials whose color is albedo times transport times light. The light is in properties of the object."""

import bpy
import numpy as np

GROUP = "relight"
TRANSPORT = ("Transport 0", "Transport 1", "Transport 2")  # coefficients 0 to 2, 3 to 5 and 6 to 8 of a pixel or vertex
# Properties of an object: colors of coefficients 0 to 6, with those of 7 and 8 as fourths, for Eevee reads only eight.
LIGHT = [f"relight_light_{i}" for i in range(7)]
ORIGIN = "relight_origin"  # property of a material: the user's own, of which it is a copy


def set_light(item, coefficients):
    """Sets the light of an object: radiance coefficients (9,3) in the frame of its transport."""
    colors, rest = np.split(np.asarray(coefficients, float), [7])
    for name, color, last in zip(LIGHT, colors, [*rest.ravel(), 0]):
        item[name] = [*color, last]


def node_group():
    """Returns the group of nodes that emits albedo / pi * max(transport . light, 0); makes it at the first call."""
    if group := bpy.data.node_groups.get(GROUP):
        return group
    group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    sockets = [("Albedo", "NodeSocketColor"), ("Strength", "NodeSocketFloat"), ("Alpha", "NodeSocketFloat")]
    for name, kind in [*sockets, *((name, "NodeSocketVector") for name in TRANSPORT)]:
        socket = group.interface.new_socket(name, in_out="INPUT", socket_type=kind)
        socket.default_value = {"NodeSocketColor": (1, 1, 1, 1), "NodeSocketFloat": 1}.get(kind, (0, 0, 0))
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    nodes = group.nodes

    def node(kind, *inputs, **options):
        """Adds a node, whose inputs are outputs of others or values. Returns its outputs."""
        new = nodes.new(f"ShaderNode{kind}")
        for name, value in options.items():
            setattr(new, name, value)
        for socket, value in zip(new.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                group.links.new(value, socket)
            else:
                socket.default_value = value
        return new.outputs

    given = nodes.new("NodeGroupInput").outputs
    lights = [node("Attribute", attribute_type="OBJECT", attribute_name=name) for name in LIGHT]
    rest = [node("CombineXYZ", *(light["Alpha"] for light in three))[0] for three in (lights[:3], lights[3:6])]
    colors = [*(light["Color"] for light in lights), *rest]
    thirds = [node("SeparateXYZ", given[name]) for name in TRANSPORT]
    total = (0, 0, 0)
    for color, coefficient in zip(colors, [number for third in thirds for number in third]):
        total = node("VectorMath", color, coefficient, total, operation="MULTIPLY_ADD")[0]
    total = node("VectorMath", total, (0, 0, 0), operation="MAXIMUM")[0]
    total = node("VectorMath", total, given["Albedo"], operation="MULTIPLY")[0]
    strength = node("Math", given["Strength"], 1 / np.pi, operation="MULTIPLY")[0]
    mixed = node("MixShader", given["Alpha"], node("BsdfTransparent")[0], node("Emission", total, strength)[0])
    group.links.new(mixed[0], nodes.new("NodeGroupOutput").inputs["Shader"])
    return group


def lit_copy(material, name, sources):
    """Copies a user's material so that it shines with `node_group`, its base color as albedo; without one, it is white.

    A copy that this function made is copied from its origin again. `sources` adds nodes and yields pairs of an output
    and the input of the group for it. Returns the copy, and what the user should know.
    """
    origin = material and material.get(ORIGIN, material)
    copy = origin.copy() if origin else bpy.data.materials.new(name)
    nodes, link = copy.node_tree.nodes, copy.node_tree.links.new
    copy.name = f"relight {origin.name if origin else name}"
    if origin:
        copy[ORIGIN] = origin
    else:
        nodes.clear()
    output = copy.node_tree.get_output_node("ALL") or nodes.new("ShaderNodeOutputMaterial")
    surface, group = base_color(output.inputs["Surface"]), nodes.new("ShaderNodeGroup")
    group.node_tree, group.name = node_group(), GROUP
    for source, target in sources(nodes):
        link(source, group.inputs[target])
    for given, target in (("Color", "Albedo"), ("Base Color", "Albedo"), ("Alpha", "Alpha")):
        if surface and given in surface.inputs:
            socket = surface.inputs[given]
            group.inputs[target].default_value = socket.default_value
            for source in [each.from_socket for each in socket.links]:
                link(source, group.inputs[target])
    for node in nodes:
        if node.type == "OUTPUT_MATERIAL":
            link(group.outputs["Shader"], node.inputs["Surface"])
    return copy, [f"{origin.name} has no base color: it is white here"] if origin and not surface else []


def base_color(socket):
    """Returns the first node that feeds a shader's input and has a color, or None."""
    for node in (link.from_node for link in socket.links):
        if {"Base Color", "Color"} & set(node.inputs.keys()):
            return node
        shaders = (base_color(part) for part in node.inputs if part.type == "SHADER")
        return next(filter(None, shaders), None)
