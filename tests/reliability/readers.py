"""Every reader of a file that may come from elsewhere, as a function of the path; and a whole file of each kind."""

import io
import json
import pkgutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image, ImageCms

PLAIN = {  # readers whose result needs no check
    "record": "meshes.mesh:Mesh.load",
    "mesh": "meshes:read_mesh",
    "network": "learning.checkpoint:load_network",
    "photo": "pictures.picture:Picture.of",
    "scores": "evaluation.scoring.scores:read_scores",
    "axes": "meshes.alignment:read_align_table",
}


def __getattr__(name: str) -> Callable[[str], object]:
    if name not in PLAIN:
        raise AttributeError(name)
    return relight(PLAIN[name])


def relight(name: str) -> Callable[..., object]:
    """A function of relight, imported where it is used: each reader is to need no more memory than its own imports."""
    return pkgutil.resolve_name(f"relight.{name}")


def panorama(path: str) -> None:
    light = relight("panoramas:project")(relight("panoramas:read_panorama")(path), 2)
    assert np.isfinite(light).all() and light[0].max() > 0


def light(path: str) -> None:
    assert np.isfinite(relight("lights:load_light")(path).coefficients).all()


def light_set(path: str) -> None:
    lights = relight("lights:read_light_set")(path)
    assert np.isfinite(lights.coefficients).all() and len(lights.of("train")) <= len(lights)


def training_lights(path: str) -> None:
    relight("learning.data:RelitSet")(Path(path).parent / "whole.packed.safetensors", path, 1, "paper")


def split(path: str) -> None:
    parts = relight("learning.data:read_split")(path)
    assert all(isinstance(name, str) for names in parts.values() for name in names)


def maps(path: str) -> None:
    from relight.maps import LeftOut, read_info, read_maps

    read_info(path)
    with suppress(LeftOut):
        read_maps(path)


def packed(path: str) -> None:
    found = relight("maps:PackedMaps")(path)
    for i in range(len(found)):
        found.figure(i)
    found.arrays()


def mask(path: str) -> None:
    assert relight("photos.mask.find:read_mask")(path, (12, 16))[0].shape == (12, 16)


def textured(path: str) -> None:
    """An .obj whose material or texture is damaged: the file itself is only named by it."""
    path = Path(path)
    body = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3\n"
    library = path if path.suffix == ".mtl" else path.with_name("names.mtl")
    if library != path:
        library.write_text(f"newmtl skin\nmap_Kd {path.name}\n")
    mesh = path.with_name("names.obj")
    mesh.write_text(f"mtllib {library.name}\n{body}")
    relight("meshes:read_mesh")(mesh)


def pixels(mode: str = "RGB") -> Image.Image:
    return Image.fromarray(np.random.default_rng(0).integers(0, 256, (12, 16, 3), np.uint8)).convert(mode)


def panoramas(rng: np.random.Generator) -> dict[str, bytes]:
    """Panoramas of every kind and coding, by name."""

    def values(type: np.dtype = np.float32) -> np.ndarray:
        return (rng.random((24, 48, 3)) * 10.0 ** rng.uniform(-2, 2, (24, 48, 1))).astype(type)

    def exr(*parts: dict, **header) -> bytes:
        header, file = {"type": OpenEXR.scanlineimage, **header}, io.BytesIO()
        several = [OpenEXR.Part({"name": str(i), **header}, part) for i, part in enumerate(parts)]
        (OpenEXR.File(several) if len(parts) > 1 else OpenEXR.File(header, parts[0])).write(file)
        return file.getvalue()

    lines = {
        "flat": lambda: rng.integers(2, 255, 4 * 48, np.uint8).tobytes(),
        "old": lambda: bytes(rng.integers(2, 140, 4, np.uint8)) + bytes([1, 1, 1, 47]),
        "new": lambda: bytes([2, 2, 0, 48]) + 4 * (bytes([148, 7, 28]) + rng.integers(90, 140, 28, np.uint8).tobytes()),
    }
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.5\nCOLORCORR=1 1 1\n\n-Y 24 +X 48\n"
    found = {f"{coding}.hdr": header + b"".join(line() for _ in range(24)) for coding, line in lines.items()}
    for name in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA"):
        half = np.float16 if name in ("B44", "PIZ") else np.float32
        found[f"{name}.exr"] = exr({"RGB": values(half)}, compression=getattr(OpenEXR, f"{name}_COMPRESSION"))
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 16
    found["tiled.exr"] = exr({"RGB": values()}, type=OpenEXR.tiledimage, tiles=tiles)
    found["envmap.exr"] = exr({"RGB": values()}, envmap=OpenEXR.ENVMAP_LATLONG)
    found["parts.exr"] = exr({"Z": values()[..., 0]}, {"RGB": values()})
    return found


def write_whole(folder: Path) -> dict[str, list[Path]]:
    """Files of each kind, by the name of the reader."""
    import trimesh
    from samples import encoded, lights_of, mesh_of, random_maps

    from relight.learning.checkpoint import save_network
    from relight.learning.networks import build
    from relight.lights import Light, write_light, write_light_set
    from relight.maps import pack_maps, write_left_out, write_maps
    from relight.meshes import Material
    from relight.photos.write import write_picture
    from relight.settings import Model

    rng = np.random.default_rng(0)
    found: dict[str, list[Path]] = {}

    def add(reader: str, name: str, content: bytes | str | None = None) -> Path:
        path = folder / f"whole.{name}"
        if content is not None:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        found.setdefault(reader, []).append(path)
        return path

    coefficients = rng.uniform(0.1, 1, (9, 3))
    lights = [write_light(Light(coefficients, "test"), folder / f"whole.light.{suffix}") for suffix in ("json", "npy")]
    found["light"] = lights
    add("light", "light.txt", "\n".join(" ".join(map(str, row)) for row in coefficients))
    add("light", "probe.json", json.dumps({"object": {"sh": coefficients.tolist(), "intensity": 1}}))
    write_light_set(lights_of(["train", "test"]), folder)
    for reader in ("light_set", "training_lights"):
        add(reader, f"{reader}.npz", (folder / "lights.npz").read_bytes())
    add("split", "split.json", json.dumps({"train": ["a", "b"], "test": ["c"]}))

    write_maps(add("maps", "maps.exr"), random_maps("a", 12))
    write_left_out(add("maps", "left_out.exr"), {"name": "b"}, "torn")
    pack_maps([folder / "whole.maps.exr"], add("packed", "packed.safetensors"))
    for suffix in ("ply", "glb", "obj", "stl"):
        add("mesh", f"box.{suffix}", trimesh.creation.box().export(file_type=suffix))
    materials = [Material(texture=np.zeros((2, 2, 3), np.uint8))]
    mesh_of(np.eye(3), [0, 1, 2], materials=materials, info={"name": "a"}).save(add("record", "record.npz"))
    model = Model(name="unet", width=0.1, norm="batch", dropout=0.0, order=1, albedo="clip", light_head="pooled",
                  refine=False, sees="image")  # fmt: skip
    save_network(add("network", "network.safetensors"), build(model, 64), model)

    for name, content in panoramas(rng).items():
        add("panorama", name, content)
    for kind in ("PNG", "JPEG", "TIFF", "WEBP", "BMP"):
        add("photo", f"photo.{kind.lower()}", encoded(pixels(), kind))
    add("photo", "cutout.png", encoded(pixels("RGBA"), "PNG"))
    deep = rng.integers(0, 65536, (12, 16, 3)).astype(np.uint16)
    for name in ("deep.png", "deep.tif"):
        write_picture(add("photo", name), deep)
    write_picture(add("photo", "linear.exr"), rng.random((12, 16, 3)).astype(np.float32))
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    add("photo", "profile.png", encoded(pixels(), "PNG", icc_profile=profile))
    add("mask", "labels.png", encoded(pixels("L").point(lambda value: value % 2), "PNG"))
    add("mask", "mask.png", encoded(pixels("L"), "PNG"))
    add("mask", "mask.tiff", encoded(pixels("I"), "TIFF"))
    add("textured", "skin.png", encoded(pixels(), "PNG"))
    add("textured", "skin.jpeg", encoded(pixels(), "JPEG"))
    add("textured", "skin.mtl", "newmtl skin\nKd 0.5 0.25 1\nmap_Kd -s 2 2 -o 0.5 0 whole.skin.png\nnewmtl hair\n")
    rows = "".join(f"ours,{figure},{light},0.5,\n" for figure in "ab" for light in (3, 4))
    add("scores", "scores.csv", "predictor,figure,light,shading_rmse,relit_psnr\n" + rows)
    add("axes", "axes.csv", "name,up,front,turn\na,+y,+z,30\nb,auto,,\n")
    return found
