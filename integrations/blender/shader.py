"""Materials whose color is albedo times transport times light. The light is in properties of the object."""

import bpy
import numpy as np

GROUP = "relight"
TRANSPORT = ("Transport 0", "Transport 1", "Transport 2")  # coefficients 0 to 2, 3 to 5 and 6 to 8 of a pixel or vertex
# Properties of an object, four numbers each, since Eevee reads no more than eight: the colors of coefficients 0 to 6,
# and as fourth numbers those of coefficients 7 and 8.
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
        """Adds a node, whose inputs are outputs of others or values; None leaves one as it is. Returns its outputs."""
        new = nodes.new(f"ShaderNode{kind}")
        for name, value in options.items():
            setattr(new, name, value)
        for socket, value in zip(new.inputs, inputs):
            if isinstance(value, bpy.types.NodeSocket):
                group.links.new(value, socket)
            elif value is not None:
                socket.default_value = value
        return new.outputs

    given = nodes.new("NodeGroupInput").outputs
    lights = [node("Attribute", attribute_type="OBJECT", attribute_name=name) for name in LIGHT]
    colors = [light["Color"] for light in lights]
    for three in (lights[:3], lights[3:6]):
        colors.append(node("CombineXYZ", *(light["Alpha"] for light in three))[0])
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


def new_material(name, sources):
    """Returns a material that shines with the group of `node_group`.

    Args:
        name: of the material.
        sources: a function that takes the material's nodes, adds some that feed the group, and yields pairs of an
            output of theirs and the name of the group's input that it feeds.
    """
    material = bpy.data.materials.new(name)
    material.node_tree.nodes.clear()
    shine(material, sources)
    return material


def shine(material, sources):
    """Makes a material shine with the group of `node_group`, fed as `new_material` says, and returns its node."""
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    group = nodes.new("ShaderNodeGroup")
    group.node_tree, group.name = node_group(), GROUP
    for source, target in sources(nodes):
        link(source, group.inputs[target])
    outputs = [node for node in nodes if node.type == "OUTPUT_MATERIAL"] or [nodes.new("ShaderNodeOutputMaterial")]
    for output in outputs:
        link(group.outputs["Shader"], output.inputs["Surface"])
    return group


def lit_copy(material, sources):
    """Copies a material so that it shines, with its base color as albedo.

    Args:
        material: the user's, which stays as it is, or one that this function made: its origin is copied again.
        sources: as of `new_material`.

    Returns:
        The copy, and whether a base color was found; else it is white.
    """
    material = material.get(ORIGIN, material)
    copy = material.copy()
    copy.name, copy[ORIGIN] = f"relight {material.name}", material
    output = copy.node_tree.get_output_node("ALL")
    surface = output and base_color(output.inputs["Surface"])
    group = shine(copy, sources)
    for name, target in (("Color", "Albedo"), ("Base Color", "Albedo"), ("Alpha", "Alpha")):
        if surface and name in surface.inputs:
            socket = surface.inputs[name]
            group.inputs[target].default_value = socket.default_value
            for link in socket.links:
                copy.node_tree.links.new(link.from_socket, group.inputs[target])
    return copy, bool(surface)


def base_color(socket):
    """Returns the first node that feeds a shader's input and has a color, or None."""
    for node in (link.from_node for link in socket.links):
        if {"Base Color", "Color"} & set(node.inputs.keys()):
            return node
        shaders = (base_color(part) for part in node.inputs if part.type == "SHADER")
        return next(filter(None, shaders), None)
    return None
