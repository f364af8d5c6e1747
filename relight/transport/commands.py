"""`relight bake`: the light transport of any mesh, per pixel or per vertex."""

from pathlib import Path
from typing import Annotated, Literal

import typer

Axis = Literal["auto", "+x", "-x", "+y", "-y", "+z", "-z"]
app = typer.Typer()


@app.command()
def bake(
    ctx: typer.Context,
    mesh: Annotated[Path, typer.Argument(help="A .obj, .ply, .glb, .gltf or .stl file.")],
    out: Annotated[
        list[Path] | None,
        typer.Option(
            "--out",
            "-o",
            help="Maps as .exr or as a .png picture, transport per vertex as .ply, .npz or .glb; may be "
            "repeated. By default the mesh's name with .exr, in the current folder.",
        ),
    ] = None,
    size: Annotated[int, typer.Option(min=1, max=8192, help="Side of the image in pixels.")] = 1024,
    rays: Annotated[
        int, typer.Option(min=1, help="Rays per pixel or vertex: 64 for drafts, 1024 for ground truth.")
    ] = 256,
    order: Annotated[
        int, typer.Option(min=0, max=30, help="Order of the spherical harmonics; 2 gives nine coefficients.")
    ] = 2,
    bounces: Annotated[int, typer.Option(min=0, help="Bounces of light between surfaces, in color.")] = 0,
    supersample: Annotated[
        int, typer.Option(min=1, help="k: maps are means over k x k samples of each pixel, which share its rays.")
    ] = 1,
    yaw: Annotated[
        float,
        typer.Option(help="Rotation of the figure, degrees, -180 to 180; positive turns its front toward image right."),
    ] = 0,
    pitch: Annotated[
        float, typer.Option(help="Degrees by which the camera is raised and looks down; negative: lowered.")
    ] = 0,
    focal: Annotated[
        float | None,
        typer.Option(help="Focal length in mm, for 36 mm of film over the image's height; orthographic if not given."),
    ] = None,
    up: Annotated[Axis, typer.Option(help="The file's axis that points up.")] = "auto",
    front: Annotated[Axis, typer.Option(help="The file's axis toward the camera.")] = "auto",
    padding: Annotated[float, typer.Option(min=0, max=0.49, help="Empty share of the image at top and bottom.")] = 0.05,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Neither repair nor align: the camera sees x and y from -1 to 1.")
    ] = False,
    threads: Annotated[
        int, typer.Option(min=0, help="Threads; 0 uses every core. The result does not depend on it.")
    ] = 0,
) -> None:
    """Bake light transport (spherical harmonics), AO, albedo, normals and depth of a mesh.

    Image = albedo x (transport . light), with any light that `relight light` writes. In other views (--yaw, --pitch,
    --focal) the figure fills the picture, and its maps are in the camera's axes. Transport per vertex keeps the file's
    frame and order of vertices. Formats and conventions: docs/transport.md and docs/conventions.md.
    """
    from relight.core.errors import UserError
    from relight.core.files import writable_folder

    targets = out or [Path(mesh.stem + ".exr")]
    for target in targets:
        if target.suffix.lower() not in (".exr", ".png", ".ply", ".npz", ".glb"):
            raise UserError(f"{target}: maps are written as .exr or .png, transport per vertex as .ply, .npz or .glb")
        if target.resolve() == mesh.resolve():
            raise UserError(f"--out {target} is the mesh itself: choose another file")
        writable_folder(target.parent, "--out")
    of_maps = [target for target in targets if target.suffix.lower() in (".exr", ".png")]
    of_vertices = [target for target in targets if target not in of_maps]
    alignment = ("up", "front", "padding")
    for name in (*alignment, "yaw", "pitch", "focal", "size", "supersample"):
        given_by = ctx.get_parameter_source(name)
        if given_by is None or given_by.name != "COMMANDLINE":
            continue
        if not of_maps:
            raise UserError(f"--{name} is for maps, and transport per vertex is all that --out names: omit it")
        if as_is and name in alignment:
            raise UserError(f"--{name} aligns the mesh, which --as-is leaves as it is: omit one of them")

    import numpy as np

    from relight.meshes import align, clean, read_mesh
    from relight.meshes.cleaning import count_opposed_faces
    from relight.pictures.texture import read_texture
    from relight.settings import Align
    from relight.transport.view import View

    view = View(yaw, pitch, focal)

    source = read_mesh(mesh)
    textures = [material.texture for material in source.materials if material.texture is not None]
    for target in of_maps:
        if textures and target.suffix.lower() == ".png" and target.is_file():
            pictures = [read_texture(target, f"--out {target}", by_profile) for by_profile in (True, False)]
            if any(np.array_equal(picture, texture) for picture in pictures for texture in textures):
                raise UserError(f"--out {target} is a texture of the mesh: choose another file")
    for note in source.info.get("warnings", []):
        typer.echo(f"{mesh.name}: {note}", err=True)
    if (as_is or of_vertices) and (count := count_opposed_faces(source)):
        advice = "remove them: baking per vertex does not repair" if of_vertices else "omit --as-is to repair them"
        note = f"{count} faces coincide with faces of opposite orientation, so vertex normals cancel; {advice}"
        typer.echo(f"{mesh.name}: {note}", err=True)
    if of_maps:
        from relight.maps import write_maps, write_maps_picture
        from relight.transport.baker import bake as bake_maps

        prepared = source
        if not as_is:  # as in the workflow
            cleaned = clean(source)
            if repairs := ", ".join(f"{name} {count}" for name, count in cleaned.info["repairs"].items()):
                typer.echo(f"{mesh.stem}: found or repaired: {repairs}", err=True)
            prepared = align(cleaned, Align(up, front), padding)
            for note in prepared.info["warnings"][len(source.info.get("warnings", [])) :]:  # others are printed already
                typer.echo(f"{mesh.stem}: {note}", err=True)
            record = prepared.info["align"]
            if "auto" in (up, front):
                typer.echo(f"{mesh.stem}: up is {record['up']}, front is {record['front']} (--up, --front)", err=True)
        settings = {"order": order, "supersample": supersample, "bounces": bounces}
        maps = bake_maps(prepared, size, rays, view, threads=threads, **settings)
        for target in of_maps:
            write = write_maps_picture if target.suffix.lower() == ".png" else write_maps
            write(target, maps)
        pixels = int(maps.mask.sum())
        ao = f"mean AO {maps.ao[maps.mask].mean():.3f}"
        typer.echo(f"{mesh.name}: {len(prepared.faces):,} triangles, {pixels:,} pixels, {ao}", err=True)
    if of_vertices:
        from relight.transport.vertices import bake_vertices

        baked = bake_vertices(source, rays, order, bounces=bounces, threads=threads)
        for target in of_vertices:
            baked.save(target)
        typer.echo(f"{mesh.name}: {len(source.vertices):,} vertices", err=True)
        for note in baked.notes:
            typer.echo(f"note: {note}", err=True)
    for target in targets:
        typer.echo(str(target))
