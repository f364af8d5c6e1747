from relight.panoramas.colour import luminance as luminance
from relight.panoramas.panorama import Panorama as Panorama
from relight.panoramas.projection import orient as orient
from relight.panoramas.projection import project as project
from relight.panoramas.read import list_panoramas as list_panoramas
from relight.panoramas.read import read_panorama as read_panorama
from relight.panoramas.rooms import generate_room as generate_room
from relight.panoramas.skies import generate_sky as generate_sky
