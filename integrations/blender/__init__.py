"""relight in Blender: bakes light transport of meshes, and relights them and maps of people by the world."""

from contextlib import suppress
from threading import Lock

import bpy
import numpy as np
from bpy.app.handlers import depsgraph_update_post, frame_change_post, load_post, persistent
from bpy_extras.io_utils import ImportHelper

from . import light, shader, transport, world

SIGNATURE = "relight_signature"  # property of an object: of the world and the rotation that its light was made for
BUSY = Lock()
WARNINGS = []  # why the light does not follow the world, for the panel
STALE = set()  # names of the objects whose bake is of another shape, and of what was baked with them


def update(scene, depsgraph=None, force=False):
    """Gives every object of relight in a depsgraph (default: the window's) the light of the world there.

    Objects whose rotation and light did not change are left alone, unless `force` is set: then all is rendered again.
    """
    depsgraph = depsgraph or bpy.context.evaluated_depsgraph_get()
    window, taken = depsgraph.mode == "VIEWPORT", set()  # a render has copies of the objects, and a thread of its own
    if window:
        WARNINGS.clear()
        STALE.clear()
        layers = [each.view_layer for each in bpy.context.window_manager.windows]
        before = layers[: layers.index(depsgraph.view_layer)] if depsgraph.view_layer in layers else layers
        taken = {each.original for layer in before if layer.depsgraph for each in layer.depsgraph.ids}
    items = [item for item in depsgraph.ids if isinstance(item, bpy.types.Object) and transport.AXES in item]
    items = [item for item in items if item.type == "MESH" and item.mode != "EDIT"]
    if not items or not BUSY.acquire(blocking=False):
        return
    try:
        if not hasattr(scene, "cycles"):
            raise light.Problem("enable Cycles (Edit > Preferences > Add-ons): it renders the light of the world")
        if force:
            world.LIGHTS.clear()
        found = [*zip(items, transport.turned(items))]  # before a render may free what is evaluated
        shown = depsgraph.view_layer.world_override or scene.world
        shown = shown and shown.evaluated_get(depsgraph)
        key = world.state(shown, scene.frame_current)
        for item, (turned, same) in found:
            item = item.original if window else item
            if window and not same:
                WARNINGS.append(f"{item.name}: bake it again, for its shape or what is beside it has changed")
                STALE.update([item.name, *item[transport.BESIDE].splitlines()])
            signature = f"{key} {np.round(turned, 6).tolist()}"
            if force or item.get(SIGNATURE) != signature:
                if item in taken:
                    WARNINGS.append(f"{item.name} has the light of another window: give this scene a copy of it")
                    continue
                if key not in world.LIGHTS:
                    world.LIGHTS[key] = world.render(scene, shown)
                shader.set_light(item, light.rotation(turned.T), *world.LIGHTS[key])
                item[SIGNATURE] = signature
                if window:
                    item.update_tag(refresh={"OBJECT"})
        if window and (error := max(item.original[shader.LIGHT[-1]][3] for item in items)) > 0.028:  # as of a sun
            WARNINGS.append(f"the world's light is too sharp for nine numbers (RMS error {error:.1%} of the brightest)")
    except light.Problem as problem:
        WARNINGS.append(str(problem))
        raise
    finally:
        BUSY.release()


@persistent
def follow(scene, depsgraph=None):
    """Updates the light after a change of the scene, a new frame, or the loading of a file, which names no scene."""
    with suppress(light.Problem):  # the panel shows it
        update(scene if isinstance(scene, bpy.types.Scene) else bpy.context.scene, depsgraph)


HANDLERS = (depsgraph_update_post, frame_change_post, load_post)


def attempt(operator, context, task, *given):
    """Runs a task of an operator, and reports the sentences that it returns. Returns the operator's result.

    A task that returns a text, which tells how far it is, has to go on.
    """
    try:
        if isinstance(notes := task(*given), str):
            context.workspace.status_text_set(f"{notes} (Esc ends it)")
            return {"RUNNING_MODAL"}
        for note in notes:
            operator.report({"WARNING"}, note)
        update(context.scene, force=True)
    except light.Problem as problem:
        operator.report({"ERROR"}, str(problem))
        return {"CANCELLED"}
    return {"FINISHED"}


class Preferences(bpy.types.AddonPreferences):
    """Where the program is."""

    bl_idname = __package__
    program: bpy.props.StringProperty(name="Program", subtype="FILE_PATH", default="relight", description="relight")

    def draw(self, context):
        self.layout.prop(self, "program")


class BakeTransport(bpy.types.Operator):
    """Bake how the selected meshes shade themselves and each other, per vertex, and light them by the world"""

    bl_idname, bl_label, bl_options = "relight.bake_transport", "Bake Light Transport", {"REGISTER", "UNDO"}
    rays: bpy.props.IntProperty(name="Rays", default=256, min=16, max=65536, description="Per vertex")
    again: bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"})  # what is stale, with what it was baked with

    @classmethod
    def poll(cls, context):
        chosen = any(item.type == "MESH" for item in context.selected_editable_objects)
        return context.mode == "OBJECT" and (chosen or bool(STALE))

    def start(self, context):
        addon = context.preferences.addons.get(__package__)
        program = addon.preferences.program if addon else "relight"
        items = context.editable_objects if self.again else context.selected_editable_objects
        items = [item for item in items if item.type == "MESH" and (not self.again or item.name in STALE)]
        return transport.bake(items, program, self.rays)

    def execute(self, context):
        return attempt(self, context, lambda: [*self.start(context)][-1])

    def invoke(self, context, event):
        self.work = self.start(context)
        self.timer = context.window_manager.event_timer_add(0.2, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type not in {"ESC", "TIMER"}:
            return {"PASS_THROUGH"}
        result = {"CANCELLED"} if event.type == "ESC" else attempt(self, context, next, self.work)
        if result != {"RUNNING_MODAL"}:
            self.work.close()
            context.window_manager.event_timer_remove(self.timer)
            context.workspace.status_text_set(None)
        return result


class ImportMaps(bpy.types.Operator, ImportHelper):
    """Add maps of a person (maps.exr of relight photo, or what relight bake wrote) as a plane lit by the world"""

    bl_idname, bl_label, bl_options = "relight.import_maps", "Import Maps of relight", {"REGISTER", "UNDO"}
    filter_glob: bpy.props.StringProperty(default="*.exr", options={"HIDDEN"})

    def execute(self, context):
        return attempt(self, context, transport.add_plane, self.filepath, context)


class UpdateLight(bpy.types.Operator):
    """Read the world's light again, for instance after its panorama was painted on"""

    bl_idname, bl_label = "relight.update_light", "Update the Light"

    def execute(self, context):
        return attempt(self, context, list)


class Panel(bpy.types.Panel):
    """The buttons, in the sidebar of the 3D view."""

    bl_idname, bl_label = "VIEW3D_PT_relight", "relight"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "relight"

    def draw(self, context):
        for operator in (BakeTransport, ImportMaps, UpdateLight):
            self.layout.operator(operator.bl_idname)
        if STALE:
            self.layout.operator(BakeTransport.bl_idname, text="Bake Again").again = True
        for warning in WARNINGS:
            self.layout.label(text=warning, icon="ERROR")


CLASSES = (Preferences, BakeTransport, ImportMaps, UpdateLight, Panel)
register_classes, unregister_classes = bpy.utils.register_classes_factory(CLASSES)


def menu(self, context):
    """Adds the maps to File > Import."""
    self.layout.operator(ImportMaps.bl_idname, text="Maps of relight (.exr)")


def register():
    """Called by Blender when the extension is enabled."""
    register_classes()
    for handlers in HANDLERS:
        handlers.append(follow)
    bpy.types.TOPBAR_MT_file_import.append(menu)


def unregister():
    """Called by Blender when the extension is disabled."""
    bpy.types.TOPBAR_MT_file_import.remove(menu)
    for handlers in HANDLERS:
        with suppress(ValueError):  # others clear the list
            handlers.remove(follow)
    unregister_classes()
