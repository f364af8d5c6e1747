"""Measures error against time of the transport baker and of two baselines, and the upper limit set by Open3D.

    python benchmarks/transport.py --out docs/images/transport.png

All methods run in one process, on one thread, in interleaved rounds, on the same points; time is CPU time. The
baselines follow their published descriptions:

- PIFu (Saito et al. 2019, prt_util): n x n independent directions over the whole sphere, shared by all points, n = 40
  by default; trimesh with embreex. The variant `stratified` has a jittered grid, and sums by matrix products.
- cosine: independent cosine-distributed directions per point, T = pi/N sum V Y; Open3D.

RMSE is over points and coefficients, against 65,536 scrambled Sobol rays per point. Rays of all methods start at the
same offset, so only sampling is compared. Errors of shared directions are the same at all points, so they are averaged
over 24 seeds.
"""

import os
import platform

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is imported: idle threads of BLAS take CPU time

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from relight.meshes import Mesh, vertex_normals
from relight.sh import basis, unoccluded
from relight.transport.baker import primary_hits
from relight.transport.camera import Camera
from relight.transport.integrate import BATCH, integrate
from relight.transport.raycaster import RayCaster
from relight.transport.sampling import random_azimuths, tangent_frames, vogel_directions
from relight.transport.surface import shading_normals

FIRST_SEED = 0  # of the rays that are timed


def figure(path: Path | None, seed: int, per_subject: int = 1) -> Mesh:
    """Returns the aligned mesh of a file (any format), or a generated clothed figure.

    Args:
        path: of a mesh; None for a generated figure.
        seed: of the generated figure.
        per_subject: number of consecutive seeds that are one person in one outfit, in different poses.
    """
    from relight.meshes import align, clean, read_mesh
    from relight.settings import composed

    cfg = composed()
    if path is None:
        from relight.figures.make import make_figure

        mesh = make_figure(seed, detail="full", texture=512, per_subject=per_subject)
    else:
        mesh = Mesh.load(path) if path.suffix == ".npz" else read_mesh(path)
    return align(clean(mesh), cfg.align)


def pixels(mesh: Mesh, caster: RayCaster, size: int, every: int) -> tuple[np.ndarray, ...]:
    """Returns what the camera sees of a mesh at the pixels of some rows, in raster order.

    Args:
        mesh: aligned.
        caster: of the mesh.
        size: side of the image, pixels.
        every: distance of the rows.

    Returns:
        Points, shading normals and geometric normals (P,3), which face the camera.
    """
    row, column = np.divmod(np.arange(size * size), size)
    keep = row % every == every // 2
    _, face, weights = primary_hits(caster, Camera(size), column[keep] + 0.5, row[keep] + 0.5)
    geometric = caster.normals[face]
    normals = shading_normals(vertex_normals(mesh), mesh.faces, face, weights, geometric)
    side = np.where(geometric[:, 2:] < 0, -1.0, 1.0)
    return caster.points(face, weights), normals * side, geometric * side


def relight_baker(caster: RayCaster, points, normals, geometric, rays: int, seed: int) -> np.ndarray:
    """Computes the transport (P,9) by relight's own method.

    Args:
        caster: of the mesh.
        points, normals, geometric: (P,3), with shading normals and geometric normals.
        rays: per point.
        seed: of the rays.
    """
    return integrate(caster, points, normals, geometric, rays, seed=seed)[0]


def local_rays(caster: RayCaster, points, normals, geometric, directions: np.ndarray, seed: int) -> np.ndarray:
    """Returns rays with relight's offset and frames.

    Args:
        caster: of the mesh.
        points, normals, geometric: (P,3).
        directions: (N,3) or (P,N,3) about +z, which is turned to the normal of each point.
        seed: of the rotation about each normal.

    Returns:
        (P,N,6) float32, in the frame of the caster.
    """
    world = np.matmul(directions, tangent_frames(normals, random_azimuths(len(normals), seed)))
    start = caster.to_local(points + caster.offset * geometric)
    return np.concatenate([np.broadcast_to(start[:, None], world.shape), world], 2).astype(np.float32)


def cosine_directions(uniform: np.ndarray) -> np.ndarray:
    """Returns cosine-distributed directions (...,3) about +z of numbers (...,2) that are uniform in [0,1]."""
    radius, angle = np.sqrt(uniform[..., 0]), 2 * np.pi * uniform[..., 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - uniform[..., 0])], -1)


def cosine(caster: RayCaster, points, normals, geometric, rays: int, seed: int) -> np.ndarray:
    """Computes the transport (P,9) by independent cosine-distributed directions for each point: pi/N sum V Y.

    Args:
        caster: of the mesh.
        points, normals, geometric: (P,3), with shading normals and geometric normals.
        rays: N, per point.
        seed: of the directions.
    """
    rng = np.random.default_rng(seed)
    result = np.empty((len(points), 9))
    step = max(1, BATCH // rays)
    for begin in range(0, len(points), step):
        part = slice(begin, begin + step)
        directions = cosine_directions(rng.random((len(points[part]), rays, 2)))
        cast = local_rays(caster, points[part], normals[part], geometric[part], directions, seed)
        seen = ~caster.occluded(cast.reshape(-1, 6)).reshape(-1, rays)
        result[part] = np.pi / rays * np.einsum("pn,pnk->pk", seen, basis(cast[..., 3:]))
    return result


def sphere_directions(uniform: np.ndarray) -> np.ndarray:
    """Returns uniform directions (N,3) on the sphere of numbers (N,2) that are uniform in [0,1]."""
    z, angle = 1 - 2 * uniform[:, 0], 2 * np.pi * uniform[:, 1]
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)


def pifu(intersector, caster: RayCaster, points, normals, geometric, n: int, seed: int) -> np.ndarray:
    """Computes the transport (P,9) as published: n slices of n directions, with all pairs of point and direction.

    Args:
        intersector: trimesh's, of the mesh.
        caster: of the mesh, whose offset of rays is used.
        points, normals, geometric: (P,3), with shading normals and geometric normals.
        n: root of the number of directions, which all points share.
        seed: of the directions.
    """
    directions = sphere_directions(np.random.default_rng(seed).random((n * n, 2)))
    values = basis(directions)
    starts = np.repeat(points + caster.offset * geometric, n, 0)
    repeated = np.repeat(normals, n, 0)
    result = np.zeros((len(points), 9))
    for i in range(0, n * n, n):
        vectors = np.tile(directions[i : i + n], (len(points), 1))
        dots = (vectors * repeated).sum(1)
        seen = (dots > 0) & ~intersector.intersects_any(starts, vectors)
        product = (seen * dots)[:, None] * np.tile(values[i : i + n], (len(points), 1))
        result += product.reshape(len(points), n, 9).sum(1)
    return 4 * np.pi / n**2 * result


def stratified(intersector, caster: RayCaster, points, normals, geometric, n: int, seed: int) -> np.ndarray:
    """Computes the transport (P,9) by an improved form of PIFu's method.

    The directions are a jittered grid over the sphere, and sums are matrix products.

    Args:
        intersector: trimesh's, of the mesh.
        caster: of the mesh, whose offset of rays is used.
        points, normals, geometric: (P,3), with shading normals and geometric normals.
        n: root of the number of directions, which all points share.
        seed: of the directions.
    """
    cell = np.indices((n, n)).reshape(2, -1).T
    directions = sphere_directions((cell + np.random.default_rng(seed).random((n * n, 2))) / n)
    values = basis(directions)
    starts = np.repeat(points + caster.offset * geometric, n, 0)
    result = np.zeros((len(points), 9))
    for i in range(0, n * n, n):
        part = directions[i : i + n]
        seen = ~intersector.intersects_any(starts, np.tile(part, (len(points), 1))).reshape(len(points), n)
        result += (seen * np.clip(normals @ part.T, 0, None)) @ values[i : i + n]
    return 4 * np.pi / n**2 * result


def reference(caster: RayCaster, points, normals, geometric, power: int = 15) -> tuple[np.ndarray, float]:
    """Computes accurate transport by two independent sets of 2^power Sobol rays for each point.

    Args:
        caster: of the mesh.
        points, normals, geometric: (P,3), with shading normals and geometric normals.
        power: logarithm to base 2 of the number of rays.

    Returns:
        (P,9), the mean of the two; and half the RMSE between them, an estimate of its error.
    """
    halves = []
    for seed in (1, 2):
        directions = cosine_directions(qmc.Sobol(d=2, seed=seed).random_base2(power))
        values = np.empty((len(points), 9))
        for p in range(len(points)):
            point = slice(p, p + 1)
            cast = local_rays(caster, points[point], normals[point], geometric[point], directions, seed * 1000 + p)
            blocked = caster.occluded(cast.reshape(-1, 6))
            values[p] = unoccluded(normals[p]) - np.pi / len(directions) * basis(cast[0, blocked, 3:]).sum(0)
        halves.append(values)
    return (halves[0] + halves[1]) / 2, float(np.sqrt(((halves[0] - halves[1]) ** 2).mean()) / 2)


def rmse(values: np.ndarray, truth: np.ndarray) -> float:
    """Returns the root of the mean squared difference over all elements."""
    return float(np.sqrt(((values - truth) ** 2).mean()))


def cpu_seconds(function, *arguments) -> float:
    """Returns the CPU time of a call, over all threads of this process."""
    start = time.process_time()
    function(*arguments)
    return time.process_time() - start


def machine() -> str:
    """Returns the processor and its number of cores, in words."""
    return f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, one used"


def main() -> None:
    """Prints a row for each method and number of rays: error and time; and draws them, if `--out` is given."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--mesh", type=Path, help="a mesh instead of a generated figure")
    parser.add_argument("--seed", type=int, default=0, help="of the generated figure")
    parser.add_argument("--points", type=int, default=600, help="number of points for errors")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, help="plot (.png)")
    options = parser.parse_args()

    try:
        import trimesh
        from trimesh.ray.ray_pyembree import RayMeshIntersector
    except ImportError as error:
        parser.exit(1, f"PIFu's baseline needs embreex, which the extra `bench` installs ({error})\n")

    mesh = figure(options.mesh, options.seed)
    caster = RayCaster(mesh.vertices, mesh.faces, threads=1)
    intersector = RayMeshIntersector(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))
    all_points = pixels(mesh, caster, size=1024, every=16)
    sample = np.random.default_rng(0).permutation(len(all_points[0]))[: options.points]
    sampled_points = tuple(array[sample] for array in all_points)
    truth, reference_error = reference(caster, *sampled_points)
    print(
        f"{machine()}; {len(mesh.faces)} triangles, {len(all_points[0])} points timed, {len(truth)} points for errors"
    )
    print(f"reference: half-difference {reference_error:.1e}, rms of the transport {np.sqrt((truth**2).mean()):.3f}\n")

    methods = {}  # (name, rays): function, its parameter for the rays, number of seeds for the error
    for rays in (16, 24, 64, 256, 1024):
        methods["ours", rays] = (lambda *a: relight_baker(caster, *a), rays, 2)
    for rays in (64, 256, 1024):
        methods["cosine", rays] = (lambda *a: cosine(caster, *a), rays, 2)
    for n in (8, 16, 32, 40):
        methods["PIFu", n * n] = (lambda *a: pifu(intersector, caster, *a), n, 24)
        methods["stratified", n * n] = (lambda *a: stratified(intersector, caster, *a), n, 24)
    seconds = {key: [] for key in methods}
    for _ in range(options.rounds):
        for key, (function, parameter, _) in methods.items():
            of_all = cpu_seconds(function, *all_points, parameter, FIRST_SEED)
            seconds[key].append(of_all / len(all_points[0]) * 1e5)
    rows = []
    for key, (function, parameter, seeds) in methods.items():
        errors = [rmse(function(*sampled_points, parameter, seed + 10), truth) for seed in range(seeds)]
        error = np.sqrt(np.mean(np.square(errors)))
        rows.append((*key, error, min(seconds[key])))  # the least time, since other load only adds to it

    print("| baker | rays | RMSE | CPU-s per 100k points | Mray per CPU-s |\n|---|---|---|---|---|")
    for name, rays, error, cost in rows:
        print(f"| {name} | {rays} | {error:.1e} | {cost:.2f} | {rays / cost / 10:.2f} |")
    curve = np.log(sorted((error, cost) for name, _, error, cost in rows if name == "ours"))  # time by error
    for name in ("PIFu", "stratified"):
        error, cost = next(row[2:] for row in rows if row[:2] == (name, 1600))
        ratio = cost / np.exp(np.interp(np.log(error), *curve.T))
        print(f"\nAt the error of {name} with 1600 rays, {error:.1e}: {ratio:.0f} times less CPU time")

    rays = 256
    cast = local_rays(caster, *all_points, vogel_directions(rays), FIRST_SEED).reshape(-1, 6)
    measured = []
    for _ in range(max(options.rounds, 9)):
        raw = cpu_seconds(lambda: [caster.occluded(cast[i : i + BATCH]) for i in range(0, len(cast), BATCH)])
        baker = cpu_seconds(relight_baker, caster, *all_points, rays, FIRST_SEED)
        measured.append((raw / baker, len(cast) / raw * 1e-6))
    share, rate = np.median(measured, axis=0)
    print(
        f"Raw test_occlusions on the same rays: {rate:.1f} Mray per CPU-s; the baker reaches {100 * share:.0f} % of it"
    )
    if options.out:
        plot(rows, options.out)


def plot(rows: list[tuple], path: Path) -> None:
    """Draws error over time, a curve per method; `rows` are (method, rays, RMSE, CPU-seconds per 100,000 points)."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    for name, color in (("PIFu", "#b0413e"), ("stratified", "#c98a3c"), ("cosine", "#7a7a7a"), ("ours", "#1f5fa8")):
        series = [row for row in rows if row[0] == name]
        ax.loglog([row[3] for row in series], [row[2] for row in series], "o-", color=color, label=name)
        for _, rays, error, cost in series:
            ax.annotate(str(rays), (cost, error), (4, 4), textcoords="offset points", fontsize=8, color=color)
    ax.set(xlabel="CPU seconds per 100,000 points", ylabel="RMSE of the nine coefficients")
    ax.grid(visible=True, which="major", alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, title="rays per point at the marks")
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
