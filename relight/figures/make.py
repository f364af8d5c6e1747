"""Makes a clothed figure from an integer seed: draws it, drapes it, and draws again until it passes the gates."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from relight.core.errors import UserError
from relight.extensions import extension
from relight.figures.assemble import props
from relight.figures.assemble.assembly import Assembly
from relight.figures.assemble.builder import Builder
from relight.figures.body.motion import build_motion
from relight.figures.body.shape import build_body
from relight.figures.cut import footwear
from relight.figures.drape import colliders
from relight.figures.drape.clearance import clear_hands
from relight.figures.drape.dress import Detail, details, drape_outfit
from relight.figures.draw.constraints import Constraints
from relight.figures.draw.garments import room_for_hands
from relight.figures.draw.outfits import Outfit, fitted_to_pose, in_other_fabrics
from relight.figures.draw.person import Expression, Person, sample_expression
from relight.figures.draw.poses import Pose
from relight.figures.gates import checks
from relight.meshes import Mesh
from relight.meshes.left_out import save_mesh
from relight.settings import Figures

GENERATOR = 11  # raised when the same seed gives another figure
ATTEMPTS = 8
SITTING_ATTEMPTS = 4  # attempts in which a figure that sits by chance keeps sitting
UNCONSTRAINED = Constraints()
SITTING_FRAMES = 2  # factor of the frames to sit down: legs that swing so far leave trousers behind


def make_figure(
    seed: int,
    detail: str = "full",
    texture: int = 1024,
    per_subject: int = 1,
    outfits: int = 1,
    constraints: Constraints = UNCONSTRAINED,
) -> Mesh:
    """Makes the figure of an integer seed, the same in every process on machines of one kind.

    Args:
        seed: 0 or more.
        detail: draft (for maps up to 128 px) or full (1024 px).
        texture: side of the largest texture in pixels, 64 or more.
        per_subject: number of consecutive seeds, from a multiple of it on, that are one person in one outfit, in
            other poses and expressions.
        outfits: number of outfits; the materials of those after the first are in the mesh's `outfits`.
        constraints: on what is otherwise drawn at random.

    Returns:
        A mesh in metres, y up, facing +z, standing on y = 0. Its info has name, subject, source, seed, version of the
        generator, traits, pose, garments, hair, shoes, the measures of the gates, and the number of redraws.

    Raises:
        UserError: for a bad argument, and when no attempt passes the gates.
    """
    if detail not in details():
        raise UserError(f"figures.detail is {detail!r}; it must be one of {', '.join(details())}")
    if seed < 0 or texture < 64:
        raise UserError(f"a figure needs a seed >= 0 and a texture >= 64 pixels, not {seed} and {texture}")
    if per_subject < 1 or outfits < 1:
        raise UserError(f"a figure needs per_subject >= 1 and outfits >= 1, not {per_subject} and {outfits}")
    colliders.init_warp()
    reasons: list[str] = []
    fineness = replace(details()[detail], texture=texture)
    sits = constraints.sitting
    for attempt in range(ATTEMPTS):
        draw = sample(seed, attempt, per_subject, sits, constraints)
        made = attempt_figure(draw, seed, fineness, per_subject, outfits)
        if isinstance(made, Mesh):
            made.info |= {"detail": detail, "redrawn": attempt, "redrawn_because": reasons}
            return made
        reasons.append(made)
        if constraints.sitting < 1:  # else sitting figures, which fail more often, would be fewer than asked for
            sits = 1.0 if draw.pose.sitting and attempt + 1 < SITTING_ATTEMPTS else 0.0
    raise UserError(f"no figure of seed {seed} passed the gates in {ATTEMPTS} attempts: {'; '.join(reasons)}")


def subject_of(seed: int, per_subject: int) -> str:
    """Returns the name of a seed's person: the figure's own name if every seed is another person."""
    return f"g{seed:04d}" if per_subject == 1 else f"s{seed // per_subject:04d}"


@dataclass(frozen=True)
class Draw:
    """What is drawn of a figure at random before its cloth is draped; the outfit is already fitted to the pose."""

    person: Person
    outfit: Outfit
    pose: Pose
    expression: Expression


def sample(seed: int, attempt: int, per_subject: int, sits: float, constraints: Constraints = UNCONSTRAINED) -> Draw:
    """Draws a figure.

    Args:
        seed: random seed of the figure.
        attempt: from 0. All attempts have the same person; with more than one figure per subject also the same outfit.
        per_subject: number of consecutive seeds that are one person in one outfit.
        sits: probability of a sitting pose.
        constraints: on what is otherwise drawn at random.
    """
    subject = seed - seed % per_subject  # its first seed, whose person a set without subjects has, too
    # The second number of each seed tells the draws apart: person, outfit, pose, expression.
    person = constraints.sample_person(np.random.default_rng([subject, 0]))
    rng = np.random.default_rng([subject, 1, attempt if per_subject == 1 else 0])
    outfit = constraints.sample_outfit(rng, person)
    moves = rng if per_subject == 1 else np.random.default_rng([seed, 2, attempt])
    pose = constraints.sample_pose(moves, sits, outfit)
    return Draw(person, fitted_to_pose(outfit, pose), pose, sample_expression(np.random.default_rng([seed, 3])))


def attempt_figure(draw: Draw, seed: int, detail: Detail, per_subject: int, outfits: int) -> Mesh | str:
    """Makes the figure of a draw, unless a gate rejects it.

    Args:
        draw: person, outfit, pose and expression.
        seed: random seed of the figure.
        detail: how fine the figure is.
        per_subject: number of consecutive seeds that are one person.
        outfits: number of outfits.

    Returns:
        The mesh, or why it was rejected, in one phrase.
    """
    person, outfit, pose, expression = draw.person, draw.outfit, draw.pose, draw.expression
    if pose.sitting:
        detail = replace(detail, frames=SITTING_FRAMES * detail.frames)
    body = build_body(person, expression)
    pose = replace(pose, heels=footwear.heel_pitch(body, outfit.shoe))
    pose = clear_hands(body, pose, room_for_hands([worn.garment for worn in outfit.garments], pose.sitting))
    motion = build_motion(body, pose, detail.frames)
    worn = drape_outfit(motion, outfit, detail)
    for garment in worn:
        if reason := checks.check_garment(garment.pattern, garment.draped, motion):
            return reason
    reason, measured = checks.check_outfit(worn, motion, pose.sitting)
    if reason:
        return reason
    builder = Builder()
    Assembly(builder, motion, outfit, worn, detail, seed - seed % per_subject).add_all()
    surface = np.concatenate(builder.vertices), np.concatenate(builder.faces)
    figure_props = props.props(motion, pose, surface, seed)
    for (vertices, faces), material in figure_props:
        builder.add(vertices, faces, None, material)
    # 4 keeps these random numbers apart from others of the seed.
    all_outfits = [outfit, *(in_other_fabrics(outfit, np.random.default_rng([seed, 4, k])) for k in range(1, outfits))]
    info = {
        "name": f"g{seed:04d}",
        "subject": subject_of(seed, per_subject),
        "source": "generated",
        "seed": seed,
        "generator": GENERATOR,
        "axes": {"up": "+y", "front": "+z"},
        "pose": pose.name,
        "expression": expression.name,
        "garments": [w.pattern.garment.name for w in worn],
        "fabrics": [w.fabric.kind for w in worn],
        "outfits": [[worn.fabric.kind for worn in look.garments] for look in all_outfits],
        "props": [material.name for _, material in figure_props],
        "shoes": outfit.shoe.name,
        "hair": outfit.hair.name,
        "sex": "female" if person.female > 0.5 else "male",
        "age": round(person.age),
        "height": round(float(np.ptp(body.skin[:, 1])), 3),
        "build": round(person.weight, 3),
        "skin": round(person.skin, 3),
        "strain": round(float(max(np.percentile(w.draped.strain, 95) for w in worn)), 3),
        **measured,
    }
    mesh = builder.mesh(info, all_outfits)
    return checks.check_figure(mesh, np.concatenate(builder.layers)) or mesh


def save_figure(name: str, figures: Figures, out: Path) -> None:
    """Makes the figure of a seed and saves it.

    Args:
        name: g and the seed, such as g0012.
        figures: settings.
        out: the mesh record (.npz).
    """
    seed = int(name[1:])

    def make() -> Mesh:
        if figures.source == "generated":
            constraints = Constraints(
                figures.sitting, tuple(figures.poses), tuple(figures.garments), tuple(figures.hair)
            )
            mesh = make_figure(seed, figures.detail, figures.texture, figures.per_subject, figures.outfits, constraints)
        else:
            mesh = extension(figures.source, "figure")(figures, seed)
        mesh.info.update(name=name, axes={"up": "+y", "front": "+z"})
        mesh.info.setdefault("subject", subject)
        return mesh

    subject = subject_of(seed, figures.per_subject)
    save_mesh(make, {"name": name, "subject": subject, "outfits": [None] * figures.outfits}, out)
