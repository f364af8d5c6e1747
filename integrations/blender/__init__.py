"""relight in Blender: bakes light transport of meshes, and relights them and maps of people by the world."""

import bpy
from bpy.app.handlers import depsgraph_update_post, frame_change_post, load_post, persistent
from bpy_extras.io_utils import ImportHelper

from . import light, shader, transport

KNOWN = {}  # by name of the object, the signature (transport.signature) of the light that it has


def update(scene, force=False):
    """Gives every object that relight made the light of the scene's world.

    Objects whose rotation and light did not change are left alone, unless `force`.
    """
    for item in scene.objects:
        if transport.PROPERTY in item and item.active_material:
            signature = transport.signature(item, scene.world)
            if force or KNOWN.get(item.name) != signature:
                KNOWN[item.name] = signature
                shader.set_light(item.active_material, light.project(scene.world, transport.axes(item)))


@persistent
def follow(scene, *_):
    """Updates the light after a change of the scene, a new frame, or the loading of a file, which names no scene."""
    update(scene if isinstance(scene, bpy.types.Scene) else bpy.context.scene)


HANDLERS = (depsgraph_update_post, frame_change_post, load_post)


class Preferences(bpy.types.AddonPreferences):
    """Where the program is."""

    bl_idname = __package__
    program: bpy.props.StringProperty(
        name="Program", subtype="FILE_PATH", default="relight", description="relight, with its extra `scans`"
    )

    def draw(self, context):
        """Draws the setting in Blender's preferences."""
        self.layout.prop(self, "program")


class BakeTransport(bpy.types.Operator):
    """Bake how the mesh shades itself, per vertex, and light it by the world"""

    bl_idname, bl_label, bl_options = "relight.bake_transport", "Bake Light Transport", {"REGISTER", "UNDO"}
    rays: bpy.props.IntProperty(name="Rays", default=256, min=16, max=65536, description="Per vertex")

    @classmethod
    def poll(cls, context):
        """Returns whether the active object is a mesh, which the operator needs."""
        return context.active_object is not None and context.active_object.type == "MESH"

    def execute(self, context):
        """Bakes the transport of the active object, and lights it by the world; errors go to the status bar."""
        addon = context.preferences.addons.get(__package__)
        try:
            transport.bake(context.active_object, addon.preferences.program if addon else "relight", self.rays)
            update(context.scene, force=True)
        except (transport.Problem, ValueError) as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class ImportMaps(bpy.types.Operator, ImportHelper):
    """Add maps of a person (maps.exr of relight photo, or what relight bake wrote) as a plane lit by the world"""

    bl_idname, bl_label, bl_options = "relight.import_maps", "Import Maps of relight", {"REGISTER", "UNDO"}
    filename_ext = ".exr"
    filter_glob: bpy.props.StringProperty(default="*.exr", options={"HIDDEN"})

    def execute(self, context):
        """Adds a plane with the maps of the chosen file, and lights it by the world; errors go to the status bar."""
        try:
            context.view_layer.objects.active = transport.add_plane(self.filepath, context)
            update(context.scene, force=True)
        except (transport.Problem, ValueError) as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class UpdateLight(bpy.types.Operator):
    """Read the world's light again, for instance after its panorama was painted on"""

    bl_idname, bl_label = "relight.update_light", "Update the Light"

    def execute(self, context):
        """Projects the light of the world again, for all objects with transport."""
        update(context.scene, force=True)
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """The buttons, in the sidebar of the 3D view."""

    bl_idname, bl_label = "VIEW3D_PT_relight", "relight"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "relight"

    def draw(self, context):
        """Draws a button for each operator."""
        for operator in (BakeTransport, ImportMaps, UpdateLight):
            self.layout.operator(operator.bl_idname)


CLASSES = (Preferences, BakeTransport, ImportMaps, UpdateLight, Panel)


def register():
    """Called by Blender when the extension is enabled."""
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    for handlers in HANDLERS:
        handlers.append(follow)


def unregister():
    """Called by Blender when the extension is disabled."""
    for handlers in HANDLERS:
        handlers.remove(follow)
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
    KNOWN.clear()
