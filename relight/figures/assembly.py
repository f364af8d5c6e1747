"""The mesh record of a dressed figure: skin, eyes, clothes, shoes and hair, each with its picture."""

import numpy as np

from relight.figures import aging, collars, fabrics, footwear, hair, layers, makehuman, panels, seams, skin
from relight.figures.body import Body
from relight.figures.colliders import Collider
from relight.figures.outfits import Outfit
from relight.figures.poses import Motion
from relight.figures.surfaces import loop, normals, stacked, thickened
from relight.figures.wear import Detail, Worn
from relight.meshes import Material, Mesh


class Builder:
    """Collects parts into one mesh record; vertices are shared inside a part only, so normals are smooth inside it."""

    def __init__(self):
        self.vertices, self.faces, self.uv, self.material, self.materials, self.layers = [], [], [], [], [], []
        self.offset = 0

    def add(
        self, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None, material: Material, layer: int = -1
    ) -> None:
        used, inverse = np.unique(faces, return_inverse=True)
        self.vertices.append(vertices[used].astype(np.float32))
        self.faces.append(inverse.reshape(-1, 3).astype(np.int32) + self.offset)
        self.uv.append(np.zeros((len(faces), 3, 2), np.float32) if uv is None else uv.astype(np.float32))
        self.material.append(np.full(len(faces), len(self.materials), np.int16))
        self.materials.append(material)
        self.layers.append(np.full(len(faces), layer, np.int16))
        self.offset += len(used)

    def mesh(self, info: dict) -> Mesh:
        vertices = np.concatenate(self.vertices)
        vertices[:, 1] -= vertices[:, 1].min()
        return Mesh(
            vertices,
            np.concatenate(self.faces),
            np.concatenate(self.uv),
            np.concatenate(self.material),
            self.materials,
            None,
            info,
        )


def assemble(
    builder: Builder, body: Body, way: Motion, outfit: Outfit, worn: list[Worn], detail: Detail, texture: int, seed: int
) -> None:
    base, rig = makehuman.base(), makehuman.rig()
    weights = rig.weights[makehuman.BODY]
    faces, uv = base.faces["body"], base.uv[base.uv_faces["body"]]
    scarf = [(w.draped.positions, w.pattern.levels[-1].faces) for w in worn if w.pattern.garment.kind == "scarf"]
    cut = [w for w in worn if w.pattern.garment.kind != "scarf"]
    flat = [(level := w.pattern.levels[-1], w.pattern.fields["tube"] < 0.02) for w in cut]
    rings = 2 * detail.refine
    posed = way.skin(weights, body.skin)
    surface = [(w.draped.positions, level.faces) for w, (level, _) in zip(cut, flat)]
    everything = stacked([(posed, faces), *surface, *scarf])
    around = Collider(everything[0], *everything)
    # skin: what clothes and shoes cover for good is left out
    hidden, facing = shod(body, outfit), normals(posed, faces)
    for w, (level, solid) in zip(cut, flat):
        draped = w.draped.positions
        hidden |= layers.covered(body.skin, posed, facing, level.held, draped, level.faces, solid, rings, around)
    bare = ~hidden[faces].all(1) & ~mouth_cavity()
    hands = weights[:, [i for i, b in enumerate(rig.bones) if b.startswith(("finger", "metacarpal", "wrist"))]].sum(1)
    for over in surface:
        posed = layers.tucked_under(posed, faces, over, 0.002, hands < 0.3)
    below = stacked([(posed, faces), *surface, *scarf])
    shown, vertices, corners = faces[bare], posed, uv[bare]
    for _ in range(detail.body):
        up, finer = loop(shown, len(vertices))
        vertices, shown, corners = up @ vertices, finer, split_corners(corners)
    hair_color = np.array(outfit.hair_color)
    picture = skin.paint_skin(body.person, hair_color, outfit.hair.scalp, outfit.beard, outfit.makeup, texture, seed)
    builder.add(vertices, shown, corners, Material(texture=picture), layer=0)
    eyes(builder, body, way, outfit, texture, seed)
    # clothes
    for number, w in enumerate(worn):
        level, positions = w.pattern.levels[-1], w.draped.positions
        keep, facing = np.ones(len(level.faces), bool), normals(positions, level.faces)
        for later in range(number + 1, len(cut)):
            outer, solid = flat[later]
            over = cut[later].draped.positions
            under = layers.covered(
                level.held, positions, facing, outer.held, over, outer.faces, solid, 2 * rings, around
            )
            keep &= ~under[level.faces].all(1)
            positions = layers.tucked_under(
                positions, level.faces, surface[later], 0.003, np.ones(len(positions), bool)
            )
        clothe(
            builder,
            body,
            way,
            w,
            positions,
            level.faces,
            keep,
            detail,
            texture,
            number + 1 if w.pattern.garment.kind != "scarf" else -1,
        )
    colours = footwear.palette(outfit.shoe, outfit.upper, outfit.sole)
    for part in footwear.build_shoes(body, way, outfit.shoe):
        vertices = part.vertices
        if part.name != "sole":
            for over in surface:
                vertices = layers.tucked_under(vertices, part.faces, over, 0.003, np.ones(len(vertices), bool))
        builder.add(vertices, part.faces, None, Material(colours[part.name]), layer=-1 if part.name == "sole" else 0)
    parts = hair.build_hair(body, way, outfit.hair, below, seed, fine=detail.body > 0)
    for part in parts:
        strands = hair_material(outfit, hair_color, part.cloth, max(64, texture // 4), seed)
        builder.add(part.vertices, part.faces, part.uv[part.faces], strands)


def split_corners(uv: np.ndarray) -> np.ndarray:
    """Corner coordinates (F,3,2) of the faces that `loop` makes of each face."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def mouth_cavity() -> np.ndarray:
    """Faces of the skin that line the mouth and are never seen (F,)."""
    base = makehuman.base()
    inside = skin.region("inside-mouth", 1024)
    at = base.uv[base.uv_faces["body"]].mean(1)
    return inside[(1023 * (1 - at[:, 1])).astype(int) % 1024, (1023 * at[:, 0]).astype(int) % 1024] > 0.5


def shod(body: Body, outfit: Outfit) -> np.ndarray:
    """Skin vertices inside closed shoes."""
    if outfit.shoe.straps:
        return np.zeros(len(body.skin), bool)
    top = body.joints["foot.L"][1] + outfit.shoe.top - (0.02 if outfit.shoe.top > 0 else 0.012)
    return body.skin[:, 1] < top


def eyes(builder: Builder, body: Body, way: Motion, outfit: Outfit, texture: int, seed: int) -> None:
    base, rig = makehuman.base(), makehuman.rig()
    picture = Material(texture=skin.paint_eye(np.array(outfit.iris), max(64, texture // 8), seed))
    for group, part in (("helper-l-eye", makehuman.EYES["L"]), ("helper-r-eye", makehuman.EYES["R"])):
        rest, faces = body.vertices[part], base.faces[group] - part.start
        flat = base.vertices[part, :2] - base.vertices[part, :2].mean(0)  # seen from in front where the gaze is level
        uv = 0.5 + 0.49 * flat / np.abs(flat).max()
        builder.add(way.skin(rig.weights[part], rest), faces, uv[faces], picture)


def clothe(
    builder: Builder,
    body: Body,
    way: Motion,
    w: Worn,
    positions: np.ndarray,
    faces: np.ndarray,
    keep: np.ndarray,
    detail: Detail,
    texture: int,
    layer: int,
) -> None:
    """Adds a garment: its panels' texture, its thick edge."""
    names, panel, cloth = panels.cloth_coordinates(body, w.pattern)
    laid = panels.lay_out(names, panel, cloth, texture)
    top = {name: cloth[panel == k][..., 1].max(initial=0.0) for k, name in enumerate(names)}

    texel = 1 / laid.scale
    marks = aging.images(laid, aging.marks(body, w.pattern))

    def paint(name: str, u: np.ndarray, v: np.ndarray, place: tuple[slice, slice]) -> np.ndarray:
        color = fabrics.weave(w.fabric, name, u, v, texel)
        color = seams.stitched(w.pattern.garment, w.fabric.kind, name, u, v, top[name], color)
        at = {mark: picture[place] for mark, picture in marks.items()}
        return aging.aged(w.pattern.garment, w.fabric, name, u, v, at, texel, color)

    material = Material(texture=panels.draw(laid, paint))
    count = len(faces)
    rings = 3 if detail.refine > 1 else 2
    if w.pattern.garment.kind == "scarf":  # seen from both sides
        rings = 99
    vertices, thick, source = thickened(positions, faces, np.full(len(positions), w.pattern.garment.thick), rings)
    by_vertex = np.zeros((len(positions), 2))
    by_vertex[faces.ravel()] = laid.uv.reshape(-1, 2)
    extra = by_vertex[source[thick[count:]]]
    uv = np.concatenate([laid.uv, extra])
    kept = np.r_[keep, np.ones(len(thick) - count, bool)]
    builder.add(vertices, thick[kept], uv[kept], material, layer)
    if w.pattern.garment.kind == "top":
        at, axes = collars.neck_of(body, way)
        metre = laid.scale / laid.side
        extra = collars.collar(positions, faces, by_vertex, w.pattern.garment.collar, at, axes[1], metre)
        if extra is not None:
            builder.add(*extra, material)
        if w.pattern.garment.collar == "hood":
            pale = Material(0.5 * (np.array(w.fabric.first, np.float32) + 0.7))
            for cord in collars.cords(positions, faces[~w.pattern.sleeve], at, axes[0]):
                builder.add(*cord, None, pale)


def hair_material(outfit: Outfit, color: np.ndarray, cloth: bool, side: int, seed: int) -> Material:
    """Strands along v, each column of locks a little lighter or darker, or the fabric of a hat."""
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    if cloth:
        return Material(texture=panels.coded(fabrics.weave(outfit.hat, "front", 0.6 * u, -0.3 * v, 0.6 / side)))
    streaks = 0.55 + 0.6 * fabrics.noise(u * 120, v * 5, seed) + 0.45 * fabrics.noise(u * 31, v * 3, seed + 1)
    return Material(texture=panels.coded(np.array(color) * streaks[..., None]))
