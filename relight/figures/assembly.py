"""Assembles the mesh of a dressed figure: skin, eyes, clothes, accessories, shoes and hair, with their textures."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.figures.body import makehuman, skin
from relight.figures.body.person import Body, Person
from relight.figures.cloth import layers
from relight.figures.cloth.colliders import Collider
from relight.figures.gloss import with_gloss
from relight.figures.hair.styles import HairPart, build_hair
from relight.figures.outfits import Outfit
from relight.figures.pose.poses import Motion
from relight.figures.surfaces import loop, normals, stacked, thickened
from relight.figures.tailor import aging, collars, footwear, panels, patterns, seams, trims
from relight.figures.tailor.fabrics import Fabric
from relight.figures.tailor.weaves import woven
from relight.figures.texture import coded, noise
from relight.figures.wear import Detail, DrapedGarment
from relight.meshes.mesh import Material, Mesh

Paint = Material | Callable[[Outfit], Material]  # a function if the material depends on the outfit's colours


GAP = 0.003  # metres between clothes or shoes and the garment over them
SKIN_GAP = 0.002  # metres between skin and the garment over it


class Builder:
    """Collects the parts of a mesh. Parts share no vertices, so normals are smooth within a part only."""

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
        """Adds a part.

        Args:
            vertices: (V,3) metres; those without faces are dropped.
            faces: (F,3).
            uv: (F,3,2) per corner, or None.
            material: parts that are given the same object share it.
            layer: as for `gates.poke_through`.
        """
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
        """Returns the mesh in the first outfit; its `outfits` are the materials that the others change."""
        painted = []
        for number, outfit in enumerate(outfits):
            materials = {}
            for k, paint in enumerate(self.materials):
                if not isinstance(paint, Material):
                    materials[k] = with_gloss(paint(outfit), outfit)
                elif number == 0:
                    materials[k] = with_gloss(paint, outfit)
            painted.append(materials)
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


@dataclass(frozen=True)
class Layer:
    """A draped garment, without scarves, as it covers the layers below.

    Attributes:
        fitted: (n,3) close around the body on the rest pose, metres.
        draped: (n,3) as it hangs.
        faces: (F,3).
        close: (n,) whether a vertex is above the drop, which hangs free and covers nothing for good.
    """

    fitted: np.ndarray
    draped: np.ndarray
    faces: np.ndarray
    close: np.ndarray

    def covers(
        self, rest: np.ndarray, posed: np.ndarray, normal: np.ndarray, rings: int, figure: Collider
    ) -> np.ndarray:
        """Returns which points (n,) it always hides; see `layers.covered`."""
        return layers.covered(rest, posed, normal, self.fitted, self.draped, self.faces, self.close, rings, figure)

    def push_under(
        self,
        points: np.ndarray,
        faces: np.ndarray,
        gap: float,
        movable: np.ndarray | None = None,
        facing: np.ndarray | None = None,
    ) -> np.ndarray:
        """Returns points (n,3) moved back under it; see `layers.push_under`."""
        return layers.push_under(points, faces, (self.draped, self.faces), gap, movable, facing)


def assemble(
    builder: Builder,
    body: Body,
    motion: Motion,
    outfit: Outfit,
    worn: list[DrapedGarment],
    detail: Detail,
    texture: int,
    seed: int,
) -> None:
    """Adds the posed and dressed figure to `builder`: skin, eyes, clothes, accessories, shoes and hair.

    Faces that clothes and shoes always hide are removed. Vertices that come through the cloth above are pushed back.

    Args:
        builder: to add to.
        body: in its rest pose.
        motion: into the pose.
        outfit: garments and colours.
        worn: the draped garments, from the skin outward.
        detail: how fine the figure is.
        texture: side of the largest texture in pixels.
        seed: of the random details of skin and hair.
    """
    skin_faces = makehuman.base().faces["body"]
    posed = motion.skin(makehuman.rig().weights[makehuman.BODY], body.skin)
    scarves = [w for w in worn if w.pattern.garment.kind == "scarf"]
    cut = [w for w in worn if w.pattern.garment.kind != "scarf"]
    cover = [as_layer(w) for w in cut]
    surfaces = [(layer.draped, layer.faces) for layer in cover]
    surfaces += [(w.draped.positions, w.pattern.levels[-1].faces) for w in scarves]
    vertices, faces = stacked([(posed, skin_faces), *surfaces])
    figure = Collider(vertices, vertices, faces)

    posed = add_skin(builder, body, posed, outfit, cover, figure, detail, texture, seed)
    below_hair = stacked([(posed, skin_faces), *surfaces])
    add_eyes(builder, body, motion, outfit, texture, seed)
    shown = []
    for number, w in enumerate(worn):
        positions, keep = under_outer_layers(w, cover[number + 1 :], figure, 4 * detail.refine)
        add_garment(builder, body, motion, w, number, positions, keep, detail, texture)
        shown.append(positions)
    add_accessories(builder, body, motion, outfit, cut, shown[: len(cut)], texture)
    add_shoes(builder, body, motion, outfit, cover)
    add_hair(builder, body, motion, outfit, below_hair, detail, texture, seed)


def as_layer(worn: DrapedGarment) -> Layer:
    """Returns the layer that a draped garment is to those below."""
    level = worn.pattern.levels[-1]
    return Layer(level.fitted, worn.draped.positions, level.faces, worn.pattern.fields["drop"] < 0.02)


def add_skin(
    builder: Builder,
    body: Body,
    posed: np.ndarray,
    outfit: Outfit,
    cover: list[Layer],
    figure: Collider,
    detail: Detail,
    texture: int,
    seed: int,
) -> np.ndarray:
    """Adds the skin without faces that are always hidden, and returns its posed vertices, pushed under the clothes.

    Args:
        builder: to add to.
        body: in its rest pose.
        posed: (n,3) vertices of the skin, metres.
        outfit: shoes, hair and make-up.
        cover: the garments.
        figure: all surfaces of the figure.
        detail: how fine the figure is.
        texture: side of the texture in pixels.
        seed: of the random details.
    """
    base, rig = makehuman.base(), makehuman.rig()
    faces, uv = base.faces["body"], base.uv[base.uv_faces["body"]]
    hidden, facing = inside_shoes(body, outfit), normals(posed, faces)
    for layer in cover:
        hidden |= layer.covers(body.skin, posed, facing, 2 * detail.refine, figure)
    shown = ~hidden[faces].all(1) & ~mouth_cavity()
    hand_bones = [i for i, bone in enumerate(rig.bones) if bone.startswith(("finger", "metacarpal", "wrist"))]
    hands = rig.weights[makehuman.BODY][:, hand_bones].sum(1)
    for layer in cover:
        posed = layer.push_under(posed, faces, SKIN_GAP, hands < 0.3, facing)
    vertices, faces, corners = posed, faces[shown], uv[shown]
    for _ in range(detail.body):
        matrix, finer = loop(faces, len(vertices))
        vertices, faces, corners = matrix @ vertices, finer, split_corners(corners)
    picture = skin_picture(body.person, outfit, texture, seed)
    builder.add(vertices, faces, corners, Material(texture=picture, name="skin"), layer=0)
    return posed


def under_outer_layers(
    worn: DrapedGarment, outer: list[Layer], figure: Collider, rings: int
) -> tuple[np.ndarray, np.ndarray]:
    """Fits a draped garment under those worn over it.

    Args:
        worn: the garment.
        outer: the garments over it.
        figure: all surfaces of the figure.
        rings: edges by which a covering face must be away from the border of its garment.

    Returns:
        The vertices (n,3), pushed under the outer garments, and which faces (F,) are not always hidden.
    """
    level, positions = worn.pattern.levels[-1], worn.draped.positions
    keep, facing = np.ones(len(level.faces), bool), normals(positions, level.faces)
    for layer in outer:
        hidden = layer.covers(level.fitted, positions, facing, rings, figure)
        keep &= ~hidden[level.faces].all(1)
        positions = layer.push_under(positions, level.faces, GAP)
    return positions, keep


def add_shoes(builder: Builder, body: Body, motion: Motion, outfit: Outfit, cover: list[Layer]) -> None:
    """Adds both shoes, their uppers pushed under the garments."""
    shoes = footwear.build_shoes(body, motion, outfit.shoe)
    paints = {part.name: shoe_paint(part.name) for part in shoes}  # one for both feet
    for part in shoes:
        vertices = part.vertices
        if part.name != "sole":
            for layer in cover:
                vertices = layer.push_under(vertices, part.faces, GAP)
        builder.add(vertices, part.faces, None, paints[part.name], layer=-1 if part.name == "sole" else 0)


def split_corners(uv: np.ndarray) -> np.ndarray:
    """Returns the corner coordinates (4F,3,2) of the faces that `loop` makes of faces with corners (F,3,2)."""
    a, b, c = uv[:, 0], uv[:, 1], uv[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def mouth_cavity() -> np.ndarray:
    """Returns which faces (F,) of the skin line the mouth; they are never seen."""
    base = makehuman.base()
    inside = skin.region("inside-mouth", 1024)
    uv = base.uv[base.uv_faces["body"]].mean(1)
    return inside[(1023 * (1 - uv[:, 1])).astype(int) % 1024, (1023 * uv[:, 0]).astype(int) % 1024] > 0.5


def inside_shoes(body: Body, outfit: Outfit) -> np.ndarray:
    """Returns which vertices (n,) of the skin are inside closed shoes."""
    if outfit.shoe.straps:
        return np.zeros(len(body.skin), bool)
    top = body.joints["foot.L"][1] + outfit.shoe.top - (0.02 if outfit.shoe.top > 0 else 0.012)
    return body.skin[:, 1] < top


def add_eyes(builder: Builder, body: Body, motion: Motion, outfit: Outfit, texture: int, seed: int) -> None:
    """Adds both eyeballs, with a painted iris."""
    base, rig = makehuman.base(), makehuman.rig()
    picture = Material(texture=skin.paint_eye(np.array(outfit.iris), max(64, texture // 8), seed), name="eyes")
    for group, part in (("helper-l-eye", makehuman.EYES["L"]), ("helper-r-eye", makehuman.EYES["R"])):
        rest, faces = body.vertices[part], base.faces[group] - part.start
        flat = base.vertices[part, :2] - base.vertices[part, :2].mean(0)  # seen from in front where the gaze is level
        uv = 0.5 + 0.49 * flat / np.abs(flat).max()
        builder.add(motion.skin(rig.weights[part], rest), faces, uv[faces], picture)


def skin_picture(person: Person, outfit: Outfit, texture: int, seed: int) -> np.ndarray:
    """Returns the texture (texture,texture,3) of a person's skin."""
    hair_color = np.array(outfit.hair_color)
    return skin.paint_skin(person, hair_color, outfit.hair.scalp, outfit.beard, outfit.makeup, texture, seed)


def add_hair(
    builder: Builder,
    body: Body,
    motion: Motion,
    outfit: Outfit,
    below: tuple[np.ndarray, np.ndarray],
    detail: Detail,
    texture: int,
    seed: int,
) -> list[HairPart]:
    """Adds hair, beard, brows, lashes and hat over the surface `below` (vertices, faces), and returns them in order."""
    parts = build_hair(body, motion, outfit.hair, outfit.beard, below, seed, fine=detail.body > 0)
    side = max(64, texture // 4)
    paints = {
        kind: hat_paint(side) if kind == "hat" else hair_material(outfit, kind, side, seed)
        for kind in dict.fromkeys(part.kind for part in parts)
    }
    for part in parts:
        builder.add(part.vertices, part.faces, part.uv[part.faces], paints[part.kind])
    return parts


def add_garment(
    builder: Builder,
    body: Body,
    motion: Motion,
    worn: DrapedGarment,
    number: int,
    positions: np.ndarray,
    keep: np.ndarray,
    detail: Detail,
    texture: int,
) -> None:
    """Adds a garment with its texture, thick border, collar, front band and cords.

    Args:
        builder: to add to.
        body: in its rest pose.
        motion: into the pose.
        worn: the garment.
        number: of the garment in the outfit.
        positions: (n,3) its vertices, metres.
        keep: (F,) faces that are not always hidden.
        detail: how fine the figure is.
        texture: side of its texture in pixels.
    """
    garment, faces = worn.pattern.garment, worn.pattern.levels[-1].faces
    names, panel, cloth = panels.cloth_coordinates(body, worn.pattern)
    atlas = panels.lay_out(names, panel, cloth, texture)
    material = garment_paint(body, worn, number, atlas, panel, cloth)
    rings = 3 if detail.refine > 1 else 2
    if garment.kind == "scarf":  # seen from both sides
        rings = 99
    vertices, thick_faces, source = thickened(positions, faces, np.full(len(positions), garment.thickness), rings)
    vertex_uv = np.zeros((len(positions), 2))
    vertex_uv[faces.ravel()] = atlas.uv.reshape(-1, 2)
    uv = np.concatenate([atlas.uv, vertex_uv[source[thick_faces[len(faces) :]]]])
    shown = np.r_[keep, np.ones(len(thick_faces) - len(faces), bool)]
    layer = number + 1 if garment.kind != "scarf" else -1
    builder.add(vertices, thick_faces[shown], uv[shown], material, layer)
    if garment.kind == "top":
        neck, axes = collars.neck_of(body, motion)
        uv_per_metre = atlas.scale / atlas.side
        collar = collars.collar(positions, faces, vertex_uv, garment.collar, neck, axes[1], uv_per_metre)
        if collar is not None:
            builder.add(*collar, material)
        band = trims.band(worn.pattern, positions, vertex_uv)
        if band is not None:
            builder.add(*band, material)
        if garment.collar == "hood":
            paint = cord_paint(number)
            for cord in collars.cords(positions, faces[~worn.pattern.sleeve], neck, axes[0]):
                builder.add(*cord, None, paint)


def garment_paint(
    body: Body, worn: DrapedGarment, number: int, atlas: panels.Panels, panel: np.ndarray, cloth: np.ndarray
) -> Paint:
    """Returns the function that paints a garment's atlas: its fabric, seams and wear.

    Args:
        body: in its rest pose.
        worn: the garment.
        number: of the garment in the outfit.
        atlas: its panels.
        panel: (F,) of each face.
        cloth: (F,3,2) cloth coordinates of the corners, metres.
    """
    garment, texel = worn.pattern.garment, 1 / atlas.scale
    top = {name: cloth[panel == k][..., 1].max(initial=0.0) for k, name in enumerate(atlas.names)}
    marks = aging.images(atlas, aging.marks(body, worn.pattern))

    def material(outfit: Outfit) -> Material:
        name, fabric = outfit.garments[number][0].name, outfit.garments[number][1]

        def paint(panel_name: str, u: np.ndarray, v: np.ndarray, place: tuple[slice, slice]) -> np.ndarray:
            color = woven(fabric, panel_name, u, v, texel)
            color = seams.stitched(garment, fabric.kind, panel_name, u, v, top[panel_name], color)
            marks_here = {mark: picture[place] for mark, picture in marks.items()}
            return aging.aged(garment, fabric, panel_name, u, v, marks_here, texel, color)

        return Material(texture=panels.draw(atlas, paint), name=name)

    return material


def add_accessories(
    builder: Builder,
    body: Body,
    motion: Motion,
    outfit: Outfit,
    cut: list[DrapedGarment],
    shown: list[np.ndarray],
    texture: int,
) -> None:
    """Adds tie and belt.

    Args:
        builder: to add to.
        body: in its rest pose.
        motion: into the pose.
        outfit: has the fabrics of tie and belt.
        cut: the garments without scarves.
        shown: (n,3) their vertices as added, metres.
        texture: side of the largest texture in pixels.
    """
    shirt = next((k for k, w in enumerate(cut) if w.pattern.garment.kind == "top"), None)
    if outfit.tie is not None and shirt is not None:
        pattern = cut[shirt].pattern
        neck, axes = collars.neck_of(body, motion)
        tie = trims.tie(shown[shirt], pattern.levels[-1].faces[~pattern.sleeve], neck, axes[0])
        if tie is not None:
            vertices, faces = tie
            vertices = under_outer_tops(vertices, faces, cut, shown, shirt)
            uv = (vertices[:, :2] - vertices[:, :2].min(0)) / np.ptp(vertices[:, 1])
            builder.add(vertices, faces, uv[faces], tie_paint(max(64, texture // 4)))
    belted = [
        k
        for k, w in enumerate(cut)
        if w.pattern.garment.kind == "trousers" or w.pattern.garment.belt_height is not None
    ]
    if outfit.belt is not None and belted:
        pattern, positions = cut[belted[-1]].pattern, shown[belted[-1]]
        band = positions[at_belt(body, pattern)]
        ahead = motion.transforms[-1][motion.bones["root"]][:, :3] @ np.array([0.0, 0.0, 1.0])
        trunk_faces = pattern.levels[-1].faces[~pattern.sleeve]
        parts = trims.belt(positions, trunk_faces, band, ahead, 0.034) if len(band) > 8 else []
        metal = Material(np.array([0.42, 0.40, 0.36], np.float32), name="buckle")
        paints: tuple[Paint, Paint] = (belt_paint(max(64, texture // 8)), metal)
        for (vertices, faces), material in zip(parts, paints):
            vertices = under_outer_tops(vertices, faces, cut, shown, belted[-1])
            uv = np.stack([vertices[:, 0] - vertices[:, 2], vertices[:, 1]], axis=1) % 1.0
            builder.add(vertices, faces, uv[faces], material)


def at_belt(body: Body, pattern: patterns.Pattern) -> np.ndarray:
    """Returns the vertices (n,) of a garment that lie under its belt."""
    height, belt = pattern.fields["y"], pattern.garment.belt_height
    if belt is None:
        return np.abs(height - height.max() + 0.022) < 0.012
    trunk = np.maximum(pattern.fields["arm_shareL"], pattern.fields["arm_shareR"]) < 0.1
    return trunk & (np.abs(height - (patterns.landmarks(body)["waist"] + belt)) < 0.014)


def under_outer_tops(
    vertices: np.ndarray, faces: np.ndarray, cut: list[DrapedGarment], shown: list[np.ndarray], number: int
) -> np.ndarray:
    """Returns the vertices (n,3) of an accessory on a garment, pushed under the tops that are worn over it."""
    for w, positions in zip(cut[number + 1 :], shown[number + 1 :]):
        if w.pattern.garment.kind == "top":
            vertices = layers.push_under(vertices, faces, (positions, w.pattern.levels[-1].faces), GAP)
    return vertices


def shoe_paint(part: str) -> Paint:
    """Returns the paint of a part of the shoes, named as in `footwear.palette`."""

    def paint(outfit: Outfit) -> Material:
        return Material(footwear.palette(outfit.shoe, outfit.upper, outfit.sole)[part], name=f"shoes: {part}")

    return paint


def hat_paint(side: int) -> Paint:
    """Returns the paint of the hat, a texture of `side` pixels."""
    return lambda outfit: square("hat", outfit.hat, 0.6, side)


def tie_paint(side: int) -> Paint:
    """Returns the paint of the tie, a texture of `side` pixels."""

    def paint(outfit: Outfit) -> Material:
        assert outfit.tie is not None  # all outfits of a figure have the same clothes
        return square("tie", outfit.tie, trims.TIE, side)

    return paint


def belt_paint(side: int) -> Paint:
    """Returns the paint of the belt, a texture of `side` pixels."""

    def paint(outfit: Outfit) -> Material:
        assert outfit.belt is not None  # all outfits of a figure have the same clothes
        return square("belt", outfit.belt, 0.3, side)

    return paint


def cord_paint(number: int) -> Paint:
    """Returns the paint of a hood's cords, paler than garment `number`."""

    def paint(outfit: Outfit) -> Material:
        return Material(0.5 * (np.array(outfit.garments[number][1].first, np.float32) + 0.7), name="hood cord")

    return paint


def square(name: str, fabric: Fabric, width: float, side: int) -> Material:
    """Returns a material with a square of fabric, `width` metres, as a texture of `side` pixels."""
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    texture = coded(woven(fabric, "front", width * u, -0.5 * width * v, width / side))
    return Material(texture=texture, name=name)


def hair_material(outfit: Outfit, kind: str, side: int, seed: int) -> Material:
    """Returns a material with strands along v of varying lightness; `kind` is hair, beard, brows or lashes."""
    color = np.array(outfit.hair_color)
    if kind == "lashes":
        return Material((0.3 * np.minimum(color, 0.12)).astype(np.float32), name=kind)
    if kind == "brows":
        color = skin.brow_color(color)
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    pale = float(np.clip(color.mean() / 0.3, 0, 1))  # light hair varies less, in shares of its own albedo
    spread = 0.30 - 0.16 * pale
    streaks = noise(u * 120, v * 5, seed) + 0.7 * noise(u * 31, v * 3, seed + 1) - 0.85
    return Material(texture=coded(color * np.exp(2.4 * spread * streaks)[..., None]), name=kind)
