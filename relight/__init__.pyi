from relight.core.errors import UserError as UserError
from relight.core.version import __version__ as __version__
from relight.lights.load import load_light as load_light
from relight.photos.api import load as load
