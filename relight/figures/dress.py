"""From an integer seed to a clothed figure: the whole path, with gates, re-draws, and the mesh record at its end."""

from dataclasses import dataclass

import numpy as np

from relight.figures import (
    collars,
    drape,
    fabrics,
    footwear,
    gates,
    hair,
    layers,
    makehuman,
    panels,
    patterns,
    seams,
    skin,
)
from relight.figures.body import Body, build_body, sample_person
from relight.figures.drape import Effort
from relight.figures.outfits import Outfit, sample_outfit
from relight.figures.poses import Motion, motion, sample_pose
from relight.figures.shading import shaded
from relight.figures.surfaces import loop, thickened
from relight.files import UserError
from relight.meshes.mesh import Material, Mesh

GENERATOR = 1  # raised when the same seed gives another figure
ATTEMPTS = 6
SITTING = 0.08  # share of the figures that sit


@dataclass(frozen=True)
class Detail:
    """refine: subdivisions of a garment; frames of the motion; efforts by level; body: subdivisions of the skin."""

    refine: int
    frames: int
    efforts: list[Effort]
    body: int


DETAILS = {
    "draft": Detail(1, 20, [Effort(12, 2, 8), Effort(10, 3, 8)], 0),
    "full": Detail(2, 28, [Effort(14, 2, 12), Effort(10, 4, 12), Effort(8, 5, 14, gravity=-5.0)], 1),
}


@dataclass(frozen=True)
class Worn:
    """One draped garment: its pattern, its fabric, and how it hangs."""

    pattern: patterns.Pattern
    fabric: fabrics.Fabric
    draped: drape.Draped


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


def make_figure(
    seed: int, detail: str = "full", texture: int = 1024, per_subject: int = 1, shading: float = 0.0
) -> Mesh:
    """The figure of an integer seed, the same in every process on machines of one kind.

    detail: draft (for maps up to 128 px) or full (1024 px); texture: side of the largest baked texture in pixels;
    per_subject: n consecutive seeds, from a multiple of n on, are one person in one outfit, in n poses and
    expressions; shading: strength in [0,1] of the shading that is baked into the albedo, as scans have it. Returns a
    mesh in metres, y up, facing +z, standing on y = 0. Its info holds name, subject, source, seed, generator version,
    traits, pose, garments, hair, shoes, and how often it was re-drawn. Raises UserError for a bad argument, and when
    no attempt passes the gates (none of the seeds tried so far).
    """
    if detail not in DETAILS:
        raise UserError(f"figures.detail is {detail!r}; it must be one of {', '.join(DETAILS)}")
    if seed < 0 or texture < 64:
        raise UserError(f"a figure needs a seed >= 0 and a texture >= 64 pixels, not {seed} and {texture}")
    if per_subject < 1 or not 0 <= shading <= 1:
        raise UserError(f"a figure needs per_subject >= 1 and a shading in [0, 1], not {per_subject} and {shading}")
    drape.prepare()
    reasons: list[str] = []
    for attempt in range(ATTEMPTS):
        mesh, reason = attempt_figure(seed, attempt, DETAILS[detail], texture, per_subject)
        if reason is None:
            mesh = shaded(mesh, shading)
            mesh.info |= {"detail": detail, "redrawn": attempt, "redrawn_because": reasons}
            return mesh
        reasons.append(reason)
    raise UserError(f"no figure of seed {seed} passed the gates in {ATTEMPTS} attempts: {'; '.join(reasons)}")


def subject_of(seed: int, per_subject: int) -> str:
    """The name of the person whom a seed shows: the figure's own where every seed is somebody else."""
    return f"g{seed:04d}" if per_subject == 1 else f"s{seed // per_subject:04d}"


def attempt_figure(
    seed: int, attempt: int, detail: Detail, texture: int, per_subject: int
) -> tuple[Mesh | None, str | None]:
    """One draw: the mesh, or the reason why it is not good enough. The person stays; pose and clothes change, and the
    pose only where others wear the same clothes."""
    subject = seed // per_subject
    person = sample_person(np.random.default_rng([subject, 0]))
    rng = np.random.default_rng([subject, 1, attempt if per_subject == 1 else 0])
    outfit = sample_outfit(rng, person)
    pose = sample_pose(rng if per_subject == 1 else np.random.default_rng([seed, 2, attempt]), SITTING)
    body = build_body(person)
    way = motion(body, pose, detail.frames)
    worn = wear(body, way, outfit, detail)
    reason = next((why for w in worn if (why := gates.cloth(w.pattern, w.draped, way, body))), None)
    if reason:
        return None, reason
    builder = Builder()
    assemble(builder, body, way, outfit, worn, detail, texture, subject)
    info = {
        "name": f"g{seed:04d}",
        "subject": subject_of(seed, per_subject),
        "source": "generated",
        "seed": seed,
        "generator": GENERATOR,
        "pose": pose.name,
        "garments": [w.pattern.garment.name for w in worn],
        "fabrics": [w.fabric.kind for w in worn],
        "shoes": outfit.shoe.name,
        "hair": outfit.hair.name,
        "sex": "female" if person.female > 0.5 else "male",
        "age": round(person.age),
        "height": round(float(np.ptp(body.skin[:, 1])), 3),
        "build": round(person.weight, 3),
        "skin": round(person.skin, 3),
        "strain": round(float(max(np.percentile(w.draped.strain, 95) for w in worn)), 3),
    }
    mesh = builder.mesh(info)
    reason = gates.figure(mesh, np.concatenate(builder.layers))
    return (None, reason) if reason else (mesh, None)


def wear(body: Body, way: Motion, outfit: Outfit, detail: Detail) -> list[Worn]:
    """Drapes the garments one over the other."""
    rig, frames = makehuman.rig(), detail.frames
    weights = rig.weights[makehuman.BODY]
    faces = makehuman.base().faces["body"]

    def share(*names: str) -> np.ndarray:
        return weights[:, [i for i, bone in enumerate(rig.bones) if bone.startswith(names)]].sum(1)

    head = share(
        "head", "jaw", "eye", "levator", "oris", "special", "temporalis", "risorius", "oculi", "tongue", "orbicularis"
    )
    hands = share("finger", "metacarpal") + head
    arms = hands + share("wrist", "lowerarm", "upperarm")
    # hands and, for what hangs from the waist, arms are no obstacles: fingers would catch the cloth
    solid = {"top": faces[(hands[faces] < 0.3).all(1)], "other": faces[(arms[faces] < 0.3).all(1)]}
    posed = [way.skin(weights, body.skin, t) for t in range(frames + 1)]
    worn: list[Worn] = []
    for garment, fabric in outfit.garments:
        pattern = patterns.build_pattern(body, garment, detail.refine)
        under = solid["top" if garment.kind == "top" else "other"]

        def below(frame: int, fine: bool, under: np.ndarray = under, before: tuple[Worn, ...] = tuple(worn)):
            parts = [(posed[frame], under)]
            for w in before:
                level = w.pattern.levels[-1 if fine else 0]
                parts.append((w.draped.positions if fine else w.draped.history[frame], level.faces))
            starts = np.cumsum([0] + [len(p[0]) for p in parts])
            return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] + s for p, s in zip(parts, starts)])

        draped = drape.drape(
            pattern.levels, pattern.refine, garment.cloth, detail.efforts, below, way.skin, frames, ground=0.006
        )
        worn.append(Worn(pattern, fabric, draped))
    return worn


def assemble(
    builder: Builder, body: Body, way: Motion, outfit: Outfit, worn: list[Worn], detail: Detail, texture: int, seed: int
) -> None:
    base, rig = makehuman.base(), makehuman.rig()
    weights = rig.weights[makehuman.BODY]
    faces, uv = base.faces["body"], base.uv[base.uv_faces["body"]]
    flat = [(level := w.pattern.levels[-1], w.pattern.fields["tube"] < 0.02) for w in worn]
    rings = 2 * detail.refine
    # skin: what clothes and shoes cover in the rest pose is left out
    posed = way.skin(weights, body.skin)
    hidden = shod(body, outfit)
    for w, (level, solid) in zip(worn, flat):
        hidden |= layers.covered(body.skin, posed, level.held, w.draped.positions, level.faces, solid, rings)
    bare = ~hidden[faces].all(1) & ~mouth_cavity()
    surface = [(w.draped.positions, level.faces) for w, (level, _) in zip(worn, flat)]
    hands = weights[:, [i for i, b in enumerate(rig.bones) if b.startswith(("finger", "metacarpal", "wrist"))]].sum(1)
    for over in surface:
        posed = layers.tucked_under(posed, faces, over, 0.002, hands < 0.3)
    below = stacked([(posed, faces), *surface])
    shown, vertices, corners = faces[bare], posed, uv[bare]
    for _ in range(detail.body):
        up, finer = loop(shown, len(vertices))
        vertices, shown, corners = up @ vertices, finer, split_corners(corners)
    hair_color = np.array(outfit.hair_color)
    scalp = 0.85 if outfit.hair.thick else outfit.hair.scalp
    picture = skin.paint_skin(body.person, hair_color, scalp, outfit.beard, outfit.makeup, texture, seed)
    builder.add(vertices, shown, corners, Material(texture=picture), layer=0)
    eyes(builder, body, way, outfit, texture, seed)
    # clothes
    for number, (w, (level, _)) in enumerate(zip(worn, flat)):
        positions = w.draped.positions
        keep = np.ones(len(level.faces), bool)
        for later in range(number + 1, len(worn)):
            outer, solid = flat[later]
            over = worn[later].draped.positions
            under = layers.covered(level.held, positions, outer.held, over, outer.faces, solid, 2 * rings)
            keep &= ~under[level.faces].all(1)
            positions = layers.tucked_under(
                positions, level.faces, surface[later], 0.003, np.ones(len(positions), bool)
            )
        clothe(builder, body, way, w, positions, level.faces, keep, detail, texture, number + 1)
    for part in footwear.build_shoes(body, way, outfit.shoe):
        colour = {
            "upper": outfit.upper,
            "sole": outfit.sole,
            "lace": outfit.sole if outfit.sole[0] > 0.3 else (0.05, 0.045, 0.04),
        }
        vertices = part.vertices
        if part.name != "sole":
            for over in surface:
                vertices = layers.tucked_under(vertices, part.faces, over, 0.003, np.ones(len(vertices), bool))
        builder.add(vertices, part.faces, None, Material(np.array(colour[part.name], np.float32)))
    strands = None
    for shell in hair.build_hair(body, way, outfit.hair, below, seed):
        if strands is None:
            strands = hair_material(outfit, hair_color, max(64, texture // 4), seed)
        builder.add(shell.vertices, shell.faces, shell.uv[shell.faces], strands)


def stacked(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    return np.concatenate([v for v, _ in parts]), np.concatenate([f + s for (_, f), s in zip(parts, starts)])


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
        flat = rest[:, :2] - rest[:, :2].mean(0)
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

    def paint(name: str, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        color = fabrics.weave(w.fabric, name, u, v)
        return seams.stitched(w.pattern.garment, w.fabric.kind, name, u, v, top[name], color)

    material = Material(texture=panels.draw(laid, paint))
    count = len(faces)
    rings = 3 if detail.refine > 1 else 2
    vertices, thick, source = thickened(positions, faces, np.full(len(positions), w.pattern.garment.thick), rings)
    by_vertex = np.zeros((len(positions), 2))
    by_vertex[faces.ravel()] = laid.uv.reshape(-1, 2)
    extra = by_vertex[source[thick[count:]]]
    uv = np.concatenate([laid.uv, extra])
    kept = np.r_[keep, np.ones(len(thick) - count, bool)]
    builder.add(vertices, thick[kept], uv[kept], material, layer)
    if w.pattern.garment.kind == "top":
        head = way.transforms[-1]
        neck, up = (head[way.bones[b]] for b in ("neck01", "neck01"))
        at = neck[:, :3] @ body.joints["neck01"] + neck[:, 3]
        axis = up[:, :3] @ np.array([0.0, 0.94, 0.34])
        metre = laid.scale / laid.side
        extra = collars.collar(positions, faces, by_vertex, w.pattern.garment.collar, at, axis, metre)
        if extra is not None:
            builder.add(*extra, material)


def hair_material(outfit: Outfit, color: np.ndarray, side: int, seed: int) -> Material:
    """Strands along v, or the fabric of a hat."""
    u, v = np.meshgrid((np.arange(side) + 0.5) / side, (np.arange(side) + 0.5) / side)
    if outfit.hair.hat != "none":
        return Material(texture=panels.coded(fabrics.weave(outfit.hat, "front", 0.6 * u, -0.3 * v)))
    streaks = 0.55 + 0.6 * fabrics.noise(u * 120, v * 5, seed) + 0.45 * fabrics.noise(u * 31, v * 3, seed + 1)
    return Material(texture=panels.coded(np.array(color) * streaks[..., None]))
