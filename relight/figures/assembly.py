"""The mesh record of a dressed figure: skin, eyes, clothes, shoes and hair, each with its picture."""

from collections.abc import Callable

import numpy as np

from relight.figures import (
    aging,
    collars,
    fabrics,
    footwear,
    hair,
    layers,
    makehuman,
    panels,
    patterns,
    seams,
    skin,
    trims,
)
from relight.figures.body import Body, Person
from relight.figures.colliders import Collider
from relight.figures.fabrics import Fabric
from relight.figures.gloss import with_gloss
from relight.figures.outfits import Outfit
from relight.figures.poses import Motion
from relight.figures.surfaces import loop, normals, stacked, thickened
from relight.figures.wear import Detail, Worn
from relight.meshes.mesh import Material, Mesh

Paint = Material | Callable[[Outfit], Material]  # what depends on the outfit's colours is painted for each of them


class Builder:
    """Collects parts into one mesh record; vertices are shared inside a part only, so normals are smooth inside it."""

    def __init__(self) -> None:
        self.vertices: list[np.ndarray] = []
        self.faces: list[np.ndarray] = []
        self.uv: list[np.ndarray] = []
        self.material: list[np.ndarray] = []
        self.layers: list[np.ndarray] = []
        self.materials: list[Paint] = []
        self.offset = 0

    def add(
        self, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None, material: Paint, layer: int = -1
    ) -> None:
        """Adds a part; layer: as for `gates.through`. Parts that are given one object for a material share it."""
        number = next((k for k, known in enumerate(self.materials) if known is material), len(self.materials))
        if number == len(self.materials):
            self.materials.append(material)
        used, inverse = np.unique(faces, return_inverse=True)
        self.vertices.append(vertices[used].astype(np.float32))
        self.faces.append(inverse.reshape(-1, 3).astype(np.int32) + self.offset)
        self.uv.append(np.zeros((len(faces), 3, 2), np.float32) if uv is None else uv.astype(np.float32))
        self.material.append(np.full(len(faces), number, np.int16))
        self.layers.append(np.full(len(faces), layer, np.int16))
        self.offset += len(used)

    def mesh(self, info: dict, outfits: list[Outfit]) -> Mesh:
        """The record, in the first of the outfits; further ones are in its `outfits`."""
        painted = [
            {k: paint if isinstance(paint, Material) else paint(outfit) for k, paint in enumerate(self.materials)}
            if number == 0
            else {k: paint(outfit) for k, paint in enumerate(self.materials) if not isinstance(paint, Material)}
            for number, outfit in enumerate(outfits)
        ]
        painted = [
            {k: with_gloss(material, outfit) for k, material in materials.items()}
            for materials, outfit in zip(painted, outfits)
        ]
        vertices = np.concatenate(self.vertices)
        vertices[:, 1] -= vertices[:, 1].min()
        return Mesh(
            vertices,
            np.concatenate(self.faces),
            np.concatenate(self.uv),
            np.concatenate(self.material),
            list(painted[0].values()),
            None,
            info,
            painted[1:],
        )


def assemble(
    builder: Builder, body: Body, way: Motion, outfit: Outfit, worn: list[Worn], detail: Detail, texture: int, seed: int
) -> None:
    """Adds the posed and dressed figure to `builder`: skin, eyes, clothes, shoes and hair.

    What clothes and shoes cover for good is left out, and what shows through the cloth above it is pushed back.

    Args:
        builder: to add to.
        body: in its rest pose.
        way: the motion into the pose.
        outfit: what is worn, with its colours.
        worn: the draped garments, from the skin outward.
        detail: how fine the figure is.
        texture: side of the largest texture in pixels.
        seed: of what varies on skin and cloth.
    """
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
    hidden, facing = inside_shoes(body, outfit), normals(posed, faces)
    for w, (level, solid) in zip(cut, flat):
        draped = w.draped.positions
        hidden |= layers.covered(body.skin, posed, facing, level.held, draped, level.faces, solid, rings, around)
    bare = ~hidden[faces].all(1) & ~mouth_cavity()
    hands = weights[:, [i for i, b in enumerate(rig.bones) if b.startswith(("finger", "metacarpal", "wrist"))]].sum(1)
    for over in surface:
        posed = layers.tucked_under(posed, faces, over, 0.002, hands < 0.3, facing)
    below = stacked([(posed, faces), *surface, *scarf])
    shown, vertices, corners = faces[bare], posed, uv[bare]
    for _ in range(detail.body):
        up, finer = loop(shown, len(vertices))
        vertices, shown, corners = up @ vertices, finer, split_corners(corners)
    picture = skin_picture(body.person, outfit, texture, seed)
    builder.add(vertices, shown, corners, Material(texture=picture, name="skin"), layer=0)
    eyes(builder, body, way, outfit, texture, seed)
    # clothes
    hung: list[np.ndarray] = []
    for number, w in enumerate(worn):
        level, positions = w.pattern.levels[-1], w.draped.positions
        keep, facing = np.ones(len(level.faces), bool), normals(positions, level.faces)
        for later in range(number + 1, len(cut)):
            outer, solid = flat[later]
            hanging = cut[later].draped.positions
            under = layers.covered(
                level.held, positions, facing, outer.held, hanging, outer.faces, solid, 2 * rings, around
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
            number,
            positions,
            level.faces,
            keep,
            detail,
            texture,
            number + 1 if w.pattern.garment.kind != "scarf" else -1,
        )
        hung.append(positions)
    accessories(builder, body, way, outfit, cut, hung[: len(cut)], texture)
    shoes = footwear.build_shoes(body, way, outfit.shoe)
    paints = {part.name: shoe_paint(part.name) for part in shoes}  # one for both feet
    for part in shoes:
        vertices = part.vertices
        if part.name != "sole":
            for over in surface:
                vertices = layers.tucked_under(vertices, part.faces, over, 0.003, np.ones(len(vertices), bool))
        builder.add(vertices, part.faces, None, paints[part.name], layer=-1 if part.name == "sole" else 0)
    head_of_hair(builder, body, way, outfit, below, detail, texture, seed)


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


def inside_shoes(body: Body, outfit: Outfit) -> np.ndarray:
    """Skin vertices inside closed shoes."""
    if outfit.shoe.straps:
        return np.zeros(len(body.skin), bool)
    top = body.joints["foot.L"][1] + outfit.shoe.top - (0.02 if outfit.shoe.top > 0 else 0.012)
    return body.skin[:, 1] < top


def eyes(builder: Builder, body: Body, way: Motion, outfit: Outfit, texture: int, seed: int) -> None:
    """Adds both eyeballs, with the iris painted on."""
    base, rig = makehuman.base(), makehuman.rig()
    picture = Material(texture=skin.paint_eye(np.array(outfit.iris), max(64, texture // 8), seed), name="eyes")
    for group, part in (("helper-l-eye", makehuman.EYES["L"]), ("helper-r-eye", makehuman.EYES["R"])):
        rest, faces = body.vertices[part], base.faces[group] - part.start
        flat = base.vertices[part, :2] - base.vertices[part, :2].mean(0)  # seen from in front where the gaze is level
        uv = 0.5 + 0.49 * flat / np.abs(flat).max()
        builder.add(way.skin(rig.weights[part], rest), faces, uv[faces], picture)


def skin_picture(person: Person, outfit: Outfit, texture: int, seed: int) -> np.ndarray:
    """The texture (texture,texture,3) of a person's skin."""
    hair_color = np.array(outfit.hair_color)
    return skin.paint_skin(person, hair_color, outfit.hair.scalp, outfit.beard, outfit.makeup, texture, seed)


def head_of_hair(
    builder: Builder,
    body: Body,
    way: Motion,
    outfit: Outfit,
    below: tuple[np.ndarray, np.ndarray],
    detail: Detail,
    texture: int,
    seed: int,
) -> list[hair.HairPart]:
    """Adds hair, beard, brows, lashes and hat, each a material of its own, over the surface `below` (vertices, faces),
    and returns them in that order."""
    parts = hair.build_hair(body, way, outfit.hair, outfit.beard, below, seed, fine=detail.body > 0)
    side = max(64, texture // 4)
    paints = {
        what: hat_paint(side) if what == "hat" else hair_material(outfit, what, side, seed)
        for what in dict.fromkeys(part.what for part in parts)
    }
    for part in parts:
        builder.add(part.vertices, part.faces, part.uv[part.faces], paints[part.what])
    return parts


def clothe(
    builder: Builder,
    body: Body,
    way: Motion,
    w: Worn,
    number: int,
    positions: np.ndarray,
    faces: np.ndarray,
    keep: np.ndarray,
    detail: Detail,
    texture: int,
    layer: int,
) -> None:
    """Adds the garment of that number in the outfit: its panels' texture, its thick edge, its collar."""
    names, panel, cloth = panels.cloth_coordinates(body, w.pattern)
    laid = panels.lay_out(names, panel, cloth, texture)
    top = {name: cloth[panel == k][..., 1].max(initial=0.0) for k, name in enumerate(names)}

    texel = 1 / laid.scale
    marks = aging.images(laid, aging.marks(body, w.pattern))

    def material(outfit: Outfit) -> Material:
        fabric = outfit.garments[number][1]

        def paint(name: str, u: np.ndarray, v: np.ndarray, place: tuple[slice, slice]) -> np.ndarray:
            color = fabrics.weave(fabric, name, u, v, texel)
            color = seams.stitched(w.pattern.garment, fabric.kind, name, u, v, top[name], color)
            at = {mark: picture[place] for mark, picture in marks.items()}
            return aging.aged(w.pattern.garment, fabric, name, u, v, at, texel, color)

        return Material(texture=panels.draw(laid, paint), name=outfit.garments[number][0].name)

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
        fastened = trims.band(w.pattern, positions, by_vertex)
        if fastened is not None:
            builder.add(*fastened, material)
        if w.pattern.garment.collar == "hood":
            paint = cord_paint(number)
            for cord in collars.cords(positions, faces[~w.pattern.sleeve], at, axes[0]):
                builder.add(*cord, None, paint)


def accessories(
    builder: Builder, body: Body, way: Motion, outfit: Outfit, cut: list[Worn], hung: list[np.ndarray], texture: int
) -> None:
    """Adds tie and belt. hung: the vertices (n,3) of the garments `cut`, as they were added."""
    shirt = next((k for k, w in enumerate(cut) if w.pattern.garment.kind == "top"), None)
    if outfit.tie is not None and shirt is not None:
        w = cut[shirt]
        faces = w.pattern.levels[-1].faces[~w.pattern.sleeve]
        at, axes = collars.neck_of(body, way)
        found = trims.tie(hung[shirt], faces, at, axes[0])
        if found is not None:
            vertices, solid = found
            vertices = under_the_next(vertices, solid, cut, hung, shirt)
            uv = (vertices[:, :2] - vertices[:, :2].min(0)) / np.ptp(vertices[:, 1])
            builder.add(vertices, solid, uv[solid], tie_paint(max(64, texture // 4)))
    waist = [k for k, w in enumerate(cut) if w.pattern.garment.kind == "trousers" or w.pattern.garment.belt is not None]
    if outfit.belt is not None and waist:
        w, level = cut[waist[-1]], cut[waist[-1]].pattern.levels[-1]
        height, belt = w.pattern.fields["y"], w.pattern.garment.belt
        if belt is None:
            around = np.abs(height - height.max() + 0.022) < 0.012
        else:
            belted = patterns.landmarks(body)["waist"] + belt
            trunk = np.maximum(w.pattern.fields["onL"], w.pattern.fields["onR"]) < 0.1
            around = trunk & (np.abs(height - belted) < 0.014)
        ahead = way.transforms[-1][way.bones["root"]][:, :3] @ np.array([0.0, 0.0, 1.0])
        metal = Material(np.array([0.42, 0.40, 0.36], np.float32), name="buckle")
        faces = level.faces[~w.pattern.sleeve]
        parts = trims.belt(hung[waist[-1]], faces, hung[waist[-1]][around], ahead, 0.034) if around.sum() > 8 else []
        paints: tuple[Paint, Paint] = (belt_paint(max(64, texture // 8)), metal)
        for (vertices, solid), material in zip(parts, paints):
            vertices = under_the_next(vertices, solid, cut, hung, waist[-1])
            uv = np.stack([vertices[:, 0] - vertices[:, 2], vertices[:, 1]], axis=1) % 1.0
            builder.add(vertices, solid, uv[solid], material)


def under_the_next(
    vertices: np.ndarray, faces: np.ndarray, cut: list[Worn], hung: list[np.ndarray], number: int
) -> np.ndarray:
    """Vertices of what lies on the garment of that number, pushed back under the tops that are worn over it."""
    for w, positions in zip(cut[number + 1 :], hung[number + 1 :]):
        if w.pattern.garment.kind == "top":
            over = (positions, w.pattern.levels[-1].faces)
            vertices = layers.tucked_under(vertices, faces, over, 0.003, np.ones(len(vertices), bool))
    return vertices


def shoe_paint(part: str) -> Paint:
    """Of a part of the shoes, as `footwear.palette` names it."""

    def paint(outfit: Outfit) -> Material:
        return Material(footwear.palette(outfit.shoe, outfit.upper, outfit.sole)[part], name=f"shoes: {part}")

    return paint


def hat_paint(side: int) -> Paint:
    """Of the hat, as a texture of `side` pixels."""
    return lambda outfit: square("hat", outfit.hat, 0.6, side)


def tie_paint(side: int) -> Paint:
    """Of the tie, as a texture of `side` pixels."""

    def paint(outfit: Outfit) -> Material:
        assert outfit.tie is not None  # all outfits of a figure are the same clothes
        return square("tie", outfit.tie, trims.TIE, side)

    return paint


def belt_paint(side: int) -> Paint:
    """Of the belt, as a texture of `side` pixels."""

    def paint(outfit: Outfit) -> Material:
        assert outfit.belt is not None  # all outfits of a figure are the same clothes
        return square("belt", outfit.belt, 0.3, side)

    return paint


def cord_paint(number: int) -> Paint:
    """Of the cords of a hood, paler than the garment of that number."""

    def paint(outfit: Outfit) -> Material:
        return Material(0.5 * (np.array(outfit.garments[number][1].first, np.float32) + 0.7), name="hood cord")

    return paint


def square(name: str, fabric: Fabric, wide: float, side: int) -> Material:
    """A square of a fabric, `wide` metres, as a texture of `side` pixels."""
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    texture = panels.coded(fabrics.weave(fabric, "front", wide * u, -0.5 * wide * v, wide / side))
    return Material(texture=texture, name=name)


def hair_material(outfit: Outfit, what: str, side: int, seed: int) -> Material:
    """Strands along v, each a little lighter or darker than the next, paler and darker ones side by side where hair
    greys."""
    color = np.array(outfit.hair_color)
    if what == "lashes":
        return Material((0.3 * np.minimum(color, 0.12)).astype(np.float32), name=what)
    if what == "brows":
        color = skin.brow_color(color)
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    pale = float(np.clip(color.mean() / 0.3, 0, 1))  # light hair varies less, in shares of its own albedo
    spread = 0.30 - 0.16 * pale
    streaks = fabrics.noise(u * 120, v * 5, seed) + 0.7 * fabrics.noise(u * 31, v * 3, seed + 1) - 0.85
    return Material(texture=panels.coded(color * np.exp(2.4 * spread * streaks)[..., None]), name=what)
