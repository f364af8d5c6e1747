"""Materials whose color is albedo times transport times light. The light is in properties of the object."""

import bpy
import numpy as np

GROUP = "relight"
TRANSPORT = ("Transport 0", "Transport 1", "Transport 2")  # coefficients 0 to 2, 3 to 5 and 6 to 8 of a pixel or vertex
# Properties of an object: colors of coefficients 0 to 6; as fourths those of 7 and 8 and the error: Eevee reads eight.
LIGHT = [f"relight_light_{i}" for i in range(7)]
NOT_MATTE = ("Metallic", "Transmission Weight", "Subsurface Weight", "Emission Strength")
ORIGIN = "relight_origin"  # property of a material: the user's own, of which it is a copy


def set_light(item, rotation, coefficients, error):
    """Sets the light of an object: radiance coefficients (9,3), with their rotation (9,9) to its transport's frame."""
    colors, rest = np.split(rotation @ coefficients, [7])
    for name, color, last in zip(LIGHT, colors, [*rest.ravel(), error]):
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
    behind = node("NewGeometry")["Backfacing"]  # of an open mesh, or one that is inside out: there it is matte
    lit = node("MixShader", behind, node("Emission", total, strength)[0], node("BsdfDiffuse", given["Albedo"])[0])[0]
    mixed = node("MixShader", given["Alpha"], node("BsdfTransparent")[0], lit)
    group.links.new(mixed[0], nodes.new("NodeGroupOutput").inputs["Shader"])
    return group


def lit_copy(material, name, sources):
    """Copies a user's material so that its matte shaders shine with `node_group`, their color as albedo; none is white.

    A copy that this function made is copied from its origin again. `sources` adds nodes and yields pairs of an output
    and the input of the group for it. Returns the copy, and what the user should know.
    """
    origin = material and material.get(ORIGIN, material)
    copy = origin.copy() if origin else bpy.data.materials.new(name)
    nodes, link = copy.node_tree.nodes, copy.node_tree.links.new
    copy.name = f"relight {origin.name if origin else name}"
    if origin:
        copy[ORIGIN] = origin
    matte = [node for node in nodes if node.type in {"BSDF_DIFFUSE", "BSDF_PRINCIPLED"}]
    given, notes = list(sources(nodes)) if matte else [], []
    for node in matte:
        group = nodes.new("ShaderNodeGroup")
        group.node_tree, group.name = node_group(), GROUP
        for source, target in given:
            link(source, group.inputs[target])
        for name, target in (("Color", "Albedo"), ("Base Color", "Albedo"), ("Alpha", "Alpha")) if origin else ():
            if socket := node.inputs.get(name):
                group.inputs[target].default_value = socket.default_value
                for source in [each.from_socket for each in socket.links]:
                    link(source, group.inputs[target])
        for target in [each.to_socket for each in node.outputs[0].links]:
            link(group.outputs["Shader"], target)
        others = [node.inputs[name] for name in NOT_MATTE if name in node.inputs]
        if any(other.is_linked or other.default_value for other in others):
            notes.append(f"{origin.name} is more than matte: of its Principled BSDF, base color and alpha are kept")
    return copy, notes if matte else [f"{origin.name} has no Diffuse or Principled BSDF, but in groups: it stays so"]
