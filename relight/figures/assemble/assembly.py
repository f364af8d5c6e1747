"""Assembles the mesh of a dressed figure: skin, eyes, clothes, accessories, shoes and hair."""

import numpy as np

from relight.figures.assemble.builder import Builder
from relight.figures.assemble.hair.combing import Head
from relight.figures.assemble.hair.heads import build_hair
from relight.figures.assemble.layers import hidden_under, push_under
from relight.figures.body import makehuman
from relight.figures.body.motion import Motion
from relight.figures.cut import footwear
from relight.figures.cut.patterns import Pattern
from relight.figures.cut.suit import arm_share
from relight.figures.drape import collars, trims
from relight.figures.drape.colliders import Collider
from relight.figures.drape.dress import Detail, DrapedGarment
from relight.figures.draw.outfits import Outfit
from relight.figures.dye import paints, panels, skin
from relight.figures.dye.paints import Paint
from relight.figures.surfaces import Surface, Textured, loop, normals, quarters, stacked, thickened
from relight.meshes import Material

GAP = 0.003  # metres between clothes or shoes and the garment over them
SKIN_GAP = 0.002  # metres between skin and the garment over it
MIN_SIDE = 64  # pixels of the smallest texture
BELT_WIDTH = 0.034  # metres
METAL = (0.42, 0.40, 0.36)  # of buckles
MASK_SIDE = 1024  # pixels of MakeHuman's mask of the mouth
HIGH_SHOE_MARGIN, LOW_SHOE_MARGIN = 0.02, 0.012  # metres below the top of a shoe from which skin is inside it
BELT_BELOW_TOP = 0.022  # metres from the top of trousers to the middle of their belt
BELT_REACH = 0.012  # metres from the middle of a belt on trousers to the cloth that counts as under it
GATHER_REACH = 0.014  # likewise, of a belt on a dress or robe
MIN_UNDER_BELT = 9  # vertices under a belt, fewer of which do not give its place


class Assembly:
    """Adds the posed and dressed figure to a builder.

    Faces that clothes and shoes always hide are left out. Vertices that come through the cloth above are pushed back.

    Args:
        builder: to add to.
        motion: how the body moves from its rest pose into the pose.
        outfit: garments and colors.
        worn: the draped garments, from the skin outward; a scarf is the last.
        detail: how fine the figure is.
        seed: random seed of skin and hair.

    Attributes:
        cut: the draped garments without scarves, from the skin outward.
        clothes: vertices and faces of all garments.
        figure: all surfaces, before anything is pushed back.
    """

    def __init__(
        self, builder: Builder, motion: Motion, outfit: Outfit, worn: list[DrapedGarment], detail: Detail, seed: int
    ):
        self.builder, self.motion, self.outfit, self.worn = builder, motion, outfit, worn
        self.body, self.detail, self.seed = motion.body, detail, seed
        self.cut = [w for w in worn if w.pattern.garment.kind != "scarf"]
        self.clothes = [w.surface for w in worn]
        vertices, faces = stacked([(motion.posed_skin, makehuman.base().faces["body"]), *self.clothes])
        self.figure = Collider.at_rest(vertices, faces)

    def side(self, share: int) -> int:
        """Returns the pixels of a texture's side that is 1/`share` of the largest one's, at least MIN_SIDE."""
        return max(MIN_SIDE, self.detail.texture // share)

    def add_all(self) -> None:
        """Adds all parts of the figure."""
        skin_vertices = self._add_skin()
        self._add_eyes()
        shown = [self._add_garment(number, w) for number, w in enumerate(self.worn)][: len(self.cut)]
        self._add_tie(shown)
        self._add_belt(shown)
        self._add_shoes()
        self.add_hair(stacked([(skin_vertices, makehuman.base().faces["body"]), *self.clothes]))

    def _add_skin(self) -> np.ndarray:
        """Adds the skin, and returns its posed vertices (n,3), pushed under the clothes."""
        base, posed = makehuman.base(), self.motion.posed_skin
        faces, uv = base.faces["body"], base.uv[base.uv_faces["body"]]
        hidden, facing = inside_shoes(self.motion, self.outfit), normals(posed, faces)
        rings = 2 * self.detail.refine  # near the border of a garment one sees under it
        for worn in self.cut:
            hidden |= hidden_under(worn, self.body.skin, posed, facing, rings, self.figure)
        shown = ~hidden[faces].all(1) & ~mouth_cavity()
        no_hands = makehuman.bone_weights("finger", "metacarpal", "wrist") < 0.3
        for worn in self.cut:
            posed = push_under((posed, faces), worn.surface, SKIN_GAP, no_hands, facing)
        material = skin.paint_skin(self.body.person, self.outfit, self.detail.texture, self.seed)
        self.builder.add(*refined(posed, faces[shown], uv[shown], self.detail.body), material, layer=0)
        return posed

    def _add_eyes(self) -> None:
        """Adds both eyeballs, with a painted iris."""
        base, rig = makehuman.base(), makehuman.rig()
        texture = skin.paint_eye(np.array(self.outfit.iris), self.side(share=8), self.seed)
        material = Material(texture=texture, name="eyes")
        for group, part in (("helper-l-eye", makehuman.EYES["L"]), ("helper-r-eye", makehuman.EYES["R"])):
            rest, faces = self.body.vertices[part], base.faces[group] - part.start
            flat = base.vertices[part, :2] - base.vertices[part, :2].mean(0)  # from in front where the gaze is level
            uv = 0.5 + 0.49 * flat / np.abs(flat).max()
            self.builder.add(self.motion.skin(rig.weights[part], rest), faces, uv[faces], material)

    def _add_garment(self, number: int, worn: DrapedGarment) -> np.ndarray:
        """Adds a garment, by its number from the skin outward, with its collar, band and cords.

        Returns its vertices (n,3), metres, pushed under the garments over it.
        """
        pattern, faces = worn.pattern, worn.pattern.levels[-1].faces
        garment, is_scarf = pattern.garment, pattern.garment.kind == "scarf"
        positions, keep = self._under_outer_layers(worn, self.cut[number + 1 :])
        atlas = panels.lay_out(*panels.cloth_coordinates(pattern), self.detail.texture)
        paint = paints.garment_paint(pattern, number, atlas)
        # A scarf is seen from both sides; other garments get an inner layer along their borders, 2 or 3 edges wide.
        rings = None if is_scarf else 3 if self.detail.refine > 1 else 2
        vertices, thick_faces, corner = thickened(positions, faces, garment.thickness, rings)
        uv = atlas.uv.reshape(-1, 2)[corner]
        shown = np.ones(len(thick_faces), bool)
        shown[: len(faces)] = keep  # the given faces come first
        self.builder.add(vertices, thick_faces[shown], uv[shown], paint, layer=-1 if is_scarf else number + 1)
        if garment.kind == "top":
            neck = collars.neck_of(self.motion)
            vertex_uv = np.zeros((len(positions), 2))
            vertex_uv[faces] = atlas.uv
            collar = collars.collar(positions, faces, vertex_uv, garment.collar, neck, atlas.scale / atlas.side)
            for trim in (collar, trims.band(pattern, positions, vertex_uv)):
                if trim is not None:
                    self.builder.add(*trim, paint)
            if garment.collar == "hood":
                cords = paints.cord_paint(number)
                for cord_vertices, cord_faces in collars.cords(positions, faces[~pattern.sleeve], neck):
                    self.builder.add(cord_vertices, cord_faces, uv=None, paint=cords)
        return positions

    def _under_outer_layers(self, worn: DrapedGarment, outer: list[DrapedGarment]) -> tuple[np.ndarray, np.ndarray]:
        """Pushes a garment under those that are worn over it, `outer`, from the inside outward.

        Returns its vertices (n,3), metres, and which of its faces (F,) are not always hidden.
        """
        level, positions = worn.pattern.levels[-1], worn.draped.positions
        keep, facing = np.ones(len(level.faces), bool), normals(positions, level.faces)
        rings = 4 * self.detail.refine  # near the border of a garment one sees under it
        for other in outer:
            keep &= ~hidden_under(other, level.fitted, positions, facing, rings, self.figure)[level.faces].all(1)
            positions = push_under((positions, level.faces), other.surface, GAP)
        return positions, keep

    def _add_tie(self, shown: list[np.ndarray]) -> None:
        """Adds the tie, if the outfit has one; `shown` are the vertices of the garments `cut`, as added."""
        shirt = next((k for k, w in enumerate(self.cut) if w.pattern.garment.kind == "top"), None)
        if self.outfit.tie is None or shirt is None:
            return
        pattern = self.cut[shirt].pattern
        trunk = pattern.levels[-1].faces[~pattern.sleeve]
        neck = collars.neck_of(self.motion)
        if (tie := trims.tie(shown[shirt], trunk, neck)) is not None:
            vertices, faces = self._under_outer_tops(tie, shown, shirt)
            flat = np.stack([vertices @ neck.aside, vertices[:, 1]], axis=1)
            uv = (flat - flat.min(0)) / np.ptp(flat[:, 1])
            self.builder.add(vertices, faces, uv[faces], paints.accessory_paint("tie", self.side(share=4)))

    def _add_belt(self, shown: list[np.ndarray]) -> None:
        """Adds the belt with its buckle, if the outfit has one; `shown` are the vertices of `cut`, as added."""
        garments = [w.pattern.garment for w in self.cut]
        belted = [k for k, g in enumerate(garments) if g.kind == "trousers" or g.belt_height is not None]
        if self.outfit.belt is None or not belted:
            return
        outermost = belted[-1]
        pattern, positions = self.cut[outermost].pattern, shown[outermost]
        under = positions[at_belt(pattern)]
        if len(under) < MIN_UNDER_BELT:
            return
        trunk = pattern.levels[-1].faces[~pattern.sleeve]
        parts = trims.belt(positions, trunk, under, self.motion.bone("root")[:, 2], BELT_WIDTH)
        buckle = Material(np.array(METAL, np.float32), name="buckle")
        for part, paint in zip(parts, (paints.accessory_paint("belt", self.side(share=8)), buckle)):
            vertices, faces = self._under_outer_tops(part, shown, outermost)
            flat = np.stack([vertices[:, 0] - vertices[:, 2], vertices[:, 1]], axis=1)
            self.builder.add(vertices, faces, (flat - flat.min(0))[faces], paint)

    def _under_outer_tops(self, accessory: Surface, shown: list[np.ndarray], number: int) -> Surface:
        """Returns an accessory on the garment with this number in `cut`, pushed under the tops that are worn over it.

        `shown` are the vertices of `cut`, as added.
        """
        vertices, faces = accessory
        for outer, positions in zip(self.cut[number + 1 :], shown[number + 1 :]):
            if outer.pattern.garment.kind == "top":
                vertices = push_under((vertices, faces), (positions, outer.pattern.levels[-1].faces), GAP)
        return vertices, faces

    def _add_shoes(self) -> None:
        """Adds both shoes, their uppers pushed under the garments."""
        parts = footwear.build_shoes(self.motion, self.outfit.shoe)
        by_part = {name: paints.shoe_paint(name) for name in dict(parts)}  # one for both feet
        for name, (vertices, faces) in parts:
            is_sole = name == "sole"
            for worn in () if is_sole else self.cut:
                vertices = push_under((vertices, faces), worn.surface, GAP)
            self.builder.add(vertices, faces, None, by_part[name], layer=-1 if is_sole else 0)

    def add_hair(self, below: Surface) -> None:
        """Adds hair, beard, brows, lashes and hat over the surface `below`: vertices and faces of skin and clothes."""
        outfit, side = self.outfit, self.side(share=4)
        head = Head(self.motion, Collider.at_rest(*below), self.seed, fine=self.detail.body > 0)
        parts = build_hair(head, outfit.hair, outfit.beard)
        by_kind: dict[str, Paint] = {
            kind: paints.hair_material(outfit, kind, side, self.seed) for kind in dict(parts) if kind != "hat"
        }
        by_kind["hat"] = paints.accessory_paint("hat", side)
        for kind, (vertices, faces, uv) in parts:
            self.builder.add(vertices, faces, uv[faces], by_kind[kind])


def refined(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, times: int) -> Textured:
    """Subdivides a surface by Loop's scheme.

    Args:
        vertices: (V,3).
        faces: (F,3).
        uv: (F,3,2) of the faces' corners.
        times: number of subdivisions, each of which gives four times as many faces.

    Returns:
        Vertices (V',3), faces (F',3) and corner uv (F',3,2).
    """
    for _ in range(times):
        matrix, faces = loop(faces, len(vertices))
        vertices, uv = matrix @ vertices, quarters(uv, (uv + np.roll(uv, -1, axis=1)) / 2)
    return vertices, faces, uv


def mouth_cavity() -> np.ndarray:
    """Returns which faces (F,) of the skin line the mouth, by their centres in the UV map; they are never seen."""
    base = makehuman.base()
    centre = base.uv[base.uv_faces["body"]].mean(1)
    row = ((MASK_SIDE - 1) * (1 - centre[:, 1])).astype(int) % MASK_SIDE
    column = ((MASK_SIDE - 1) * centre[:, 0]).astype(int) % MASK_SIDE
    return skin.region("inside-mouth", MASK_SIDE)[row, column] > 0.5


def inside_shoes(motion: Motion, outfit: Outfit) -> np.ndarray:
    """Returns which vertices (n,) of the skin are inside closed shoes; sandals, which have straps, hide nothing."""
    body, shoe = motion.body, outfit.shoe
    if shoe.straps:
        return np.zeros(len(body.skin), bool)
    margin = HIGH_SHOE_MARGIN if shoe.top > 0 else LOW_SHOE_MARGIN
    return body.skin[:, 1] < body.joints["foot.L"][1] + shoe.top - margin


def at_belt(pattern: Pattern) -> np.ndarray:
    """Returns which vertices (n,) of a garment lie under its belt: at the top of trousers, else at its belt height."""
    height, belt_height = pattern.fields["y"], pattern.garment.belt_height
    if belt_height is None:
        return np.abs(height - height.max() + BELT_BELOW_TOP) < BELT_REACH
    is_trunk = arm_share(pattern.fields) < 0.1
    return is_trunk & (np.abs(height - (pattern.body.heights["waist"] + belt_height)) < GATHER_REACH)
