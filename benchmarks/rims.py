"""Measures the rims of relit figures whose true coverage, maps and light are known.

    python benchmarks/rims.py FOLDER

FOLDER contains baked figures (.exr, of `relight bake` or a run's `maps/`). Each is lit by a panorama of `relight light
setup`, where that was run, else by a generated room, and composited over a view of it, with a lens's blur, noise and
JPEG; every second one has nearly black clothes. Prints the error of the relit picture under two lamps within 6 pixels
of the true silhouette, inside and outside, in codes: by masks as they are and as relight uses them, with the true maps
and with those of the network.
"""

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, gaussian_filter

import relight
from relight.maps import read_maps
from relight.maps.square import MASK_THRESHOLD, crop_around, figure_means, fill_outside
from relight.panoramas import luminance, polyhaven
from relight.photos.api import Relighter
from relight.photos.background import read_background
from relight.photos.camera import camera_view
from relight.photos.color import roll_off, to_srgb8
from relight.photos.look import Look
from relight.photos.mask import selfie
from relight.photos.mask.edge import fit_edge
from relight.photos.person import infer_person
from relight.photos.picture import Picture
from relight.photos.render import over, render
from relight.photos.scene import Scene

PLACES = "park", "hall", "esplanade", "lobby", "sunset", "apartment"
LAMPS = "key:#ffb070@80,20,0.08", "key:#b0d0ff@-70,30,0.3"
RIM, NEAR = 6, 5  # pixels: width of a rim; distance from the true silhouette where an automatic mask is right
LENS, GRAIN, QUALITY = 0.7, 1.5, 92  # standard deviations in pixels and codes; of JPEG
LEVEL, HEAD = 0.75, 0.17  # mean shading; share of the height that dark clothes leave free


def inward_distance(solid: np.ndarray) -> np.ndarray:
    """Returns the distance (H,W) of pixels from the edge of a region, negative outside."""
    return distance_transform_edt(solid) - distance_transform_edt(~solid)


class Case:
    """A photo of a figure, and the network that infers its true maps."""

    def __init__(self, path: Path, number: int, relighter: Relighter):
        """Takes the photo.

        Args:
            path: maps of the figure (.exr).
            number: of the photo, which decides on its light, its background and the color of the clothes.
            relighter: reads the light.
        """
        rng, maps, self.config = np.random.default_rng(number), read_maps(path), {}
        self.known, self.shape = maps.mask & (maps.coverage > 0), maps.coverage.astype(np.float32)
        self.albedo, self.transport = (
            fill_outside(np.nan_to_num(values.astype(np.float32)), self.known)
            for values in (maps.albedo, maps.transport)
        )
        if number % 2:  # nearly black below the head
            rows = np.flatnonzero((self.shape > 0.5).any(1))
            below = (np.arange(len(self.shape)) - rows[0] - HEAD * np.ptp(rows)) / 8
            dark = 0.008 + 0.05 * (0.7 * self.albedo.mean(-1, keepdims=True) + 0.3 * self.albedo)
            self.albedo = over(dark, below.clip(0, 1)[:, None], self.albedo)
        are_set_up = polyhaven.panorama_folder().is_dir()
        light = relighter.read_light(PLACES[number % len(PLACES)] if are_set_up else f"room:{number}")
        mean_shading = np.maximum(self.transport[self.known].mean(0) @ light.coefficients, 0)
        scale = LEVEL / float(luminance(mean_shading))
        self.light = np.float32(scale) * light.coefficients
        view = np.pi * scale * camera_view(light.panorama, self.shape.shape, rng.uniform(0, 2 * np.pi), 1.0)
        self.behind = gaussian_filter(roll_off(view * np.float32(rng.uniform(0.7, 1.2))), (LENS, LENS, 0))
        self.coverage = gaussian_filter(self.shape, LENS)
        codes, file = self.picture(self.light) + rng.normal(0, GRAIN, self.behind.shape), io.BytesIO()
        Image.fromarray(codes.round().clip(0, 255).astype(np.uint8)).save(file, "JPEG", quality=QUALITY)
        self.codes, self.inward = np.asarray(Image.open(file)), inward_distance(self.shape >= 0.5)

    def picture(self, light: np.ndarray) -> np.ndarray:
        """Returns what a camera sees of the figure in a light (9,3), (H,W,3) codes from 0 to 255."""
        front = roll_off(self.albedo * np.maximum(self.transport @ light, 0)) * self.shape[..., None]
        linear = gaussian_filter(front, (LENS, LENS, 0)) + (1 - self.coverage[..., None]) * self.behind
        return to_srgb8(linear.clip(0, 1)).astype(np.float64)

    def infer(self, image: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stands for a network (`relight.photos.network.PhotoNetwork.infer`): returns the truth on the square `crop`.

        Args:
            image, mask: (S,S,3) and (S,S), of which only the mask is used.

        Returns:
            Albedo (S,S,3), transport (S,S,9) and light (9,3), float32.
        """
        inside, mean = figure_means(self.shape, self.known, self.crop)
        albedo, transport = (
            fill_outside(mean(values), inside) * mask[..., None] for values in (self.albedo, self.transport)
        )
        return albedo.astype(np.float32), transport.astype(np.float32), self.light

    def masks(self) -> dict[str, np.ndarray]:
        """Returns masks (H,W) uint8; the automatic one where its network is set up."""
        # A ramp of two pixels, half covered 1.5 pixels outside of the silhouette.
        soft = {"true coverage": self.coverage, "soft, 1.5 pixels too large": (self.inward / 2 + 1.25).clip(0, 1)}
        hard = {"two values": self.inward > 0, "two values, 1.5 pixels too large": self.inward > -1.5}
        known = {"automatic": selfie.segment(self.codes)} if selfie.network_file().is_file() else {}
        return {name: np.rint(255.0 * values).astype(np.uint8) for name, values in (soft | hard).items()} | known

    def errors(self, relighter: Relighter, coverage: np.ndarray, true: bool) -> list[np.ndarray]:
        """Relights the photo under each of LAMPS.

        Args:
            relighter: the network.
            coverage: (H,W) uint8, the mask.
            true: whether the maps are true, and not those of the network.

        Returns:
            For each lamp, the errors (H,W,3) of the relit picture, codes.
        """
        self.crop, keep = crop_around(coverage, relighter.network.size), read_background("keep")
        true_people = [infer_person(self, self.codes, coverage, self.crop)]
        people = true_people if true else relighter.scene(Picture(self.codes, coverage=coverage)).people
        errors = []
        for lamp in LAMPS:
            # Exposures are matched to the maps, so those of the relit and of the true picture differ.
            scenes = (Scene(Picture(self.codes), each) for each in (people, true_people))
            matched, true_light = (scene.exposed(Look(lamp))[0] for scene in scenes)
            errors.append(render(self.codes, people, matched, "ratio", keep) - self.picture(true_light))
        return errors


def main(folder: str) -> None:
    """Prints the table for the figures in a folder."""
    relighter, rows = relight.load(threads=1), {}  # row -> for each photo, errors by maps, mask (given, used), and side
    for number, path in enumerate(sorted(Path(folder).glob("*.exr"))):
        case = Case(path, number, relighter)
        for name, mask in case.masks().items():
            deviation = np.abs(inward_distance(mask >= MASK_THRESHOLD) - case.inward)
            sides = [(side * case.inward > 0) & (side * case.inward <= RIM) for side in (1, -1)]
            used_mask = fit_edge(case.codes, mask, automatic=name == "automatic")
            by_maps_and_mask = [case.errors(relighter, m, true) for true in (True, False) for m in (mask, used_mask)]
            for row, near in ((name, True), (f"{name}, less than {NEAR} pixels off", deviation < NEAR)):
                rms = [
                    [np.mean([(error[near & side] ** 2).mean() ** 0.5 for error in errors]) for side in sides]
                    for errors in by_maps_and_mask
                ]
                rows.setdefault(row, []).append(np.reshape(rms, (2, 2, 2)))
    print("| mask | true maps, inside | outside | network, inside | outside |\n|---|---|---|---|---|")
    for name, values in rows.items():
        cells = np.mean(values, axis=0).swapaxes(1, 2).reshape(4, 2)  # by maps and side; given and used mask
        print(f"| {name} | " + " | ".join(f"{given:.1f}, used {used:.1f}" for given, used in cells) + " |")


if __name__ == "__main__":
    main(*sys.argv[1:])
